"""How thick the limbs are: radii of the links' cylinders and capsules in the robot's URDF."""

import xml.etree.ElementTree as ET
from dataclasses import dataclass

from crux_contracts.robot import Robot
from crux_contracts.urdf import link_shapes


def limb_radii_m(robot: Robot) -> tuple[float, ...]:
    """Of a limb as a ball, its shoulder, and three capsules: to elbow, to wrist, to palm. Of the thickest limb; a link
    without a cylinder or capsule counts as a line.
    """
    links = {link.get("name"): link for link in ET.parse(robot.urdf_path).getroot().iter("link")}

    def radius(joints: slice) -> float:
        found = [
            float(solid.get("radius", "0"))
            for limb in robot.limbs
            for joint in limb.joints[joints]
            for shape in link_shapes(links[joint.child])
            for kind in ("cylinder", "capsule")
            for solid in shape.iter(kind)
        ]
        return max(found, default=0.0)

    return tuple(radius(slice(*joints)) for joints in ((0, 1), (1, 2), (2, 3), (3, None)))


@dataclass(frozen=True)
class PalmShape:
    """The box between wrist and fingers: half edges along and across the opening axis, and its height [m]."""

    half_length: float
    half_width: float
    height: float


def palm_shape(robot: Robot) -> PalmShape | None:
    """Of the smallest gripper; None where one has no box."""
    links = {link.get("name"): link for link in ET.parse(robot.urdf_path).getroot().iter("link")}
    found = []
    for limb in robot.limbs:
        boxes = [box for shape in link_shapes(links[limb.gripper_link]) for box in shape.iter("box")]
        if not boxes:
            return None
        found.append([float(edge) for edge in boxes[0].get("size", "").split()])
    length, width, height = (min(edges) for edges in zip(*found, strict=True))
    return PalmShape(length / 2, width / 2, height)
