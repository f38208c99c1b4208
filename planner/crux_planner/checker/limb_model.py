"""The robot as its URDF gives it: serial chains, masses and link shapes, vectorised over samples.

Frames and signs are the URDF's. Everything is computed in the body frame B with the body fixed; gravity is turned into
B by the caller. Nothing here knows the closed form of the limb: chains are walked joint by joint.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from xml.etree import ElementTree

import numpy as np
from crux_contracts.robot import Robot

from crux_planner.checker.geometry import Array, rotation_about_axis, rotation_from_rpy


class RobotModelError(ValueError):
    """The URDF lacks a link or joint that the robot description names, or holds an unknown shape."""


@dataclass(frozen=True)
class Capsule:
    """A sphere swept along a segment, in the frame of its link."""

    start_m: Array
    end_m: Array
    radius_m: float


@dataclass(frozen=True)
class Box:
    """A cuboid in the frame of its link."""

    centre_m: Array
    rotation: Array
    half_m: Array


@dataclass(frozen=True)
class Link:
    """Mass, centre of mass, inertia about it (in the link's frame) and shapes of one link."""

    name: str
    mass_kg: float = 0.0
    com_m: Array = field(default_factory=lambda: np.zeros(3))
    inertia_kg_m2: Array = field(default_factory=lambda: np.zeros((3, 3)))
    capsules: tuple[Capsule, ...] = ()
    boxes: tuple[Box, ...] = ()


@dataclass(frozen=True)
class Joint:
    """One URDF joint with its limits; fixed joints have kind "fixed"."""

    name: str
    kind: str
    parent: str
    child: str
    origin_m: Array
    rotation: Array
    axis: Array
    lower: float
    upper: float
    effort: float
    velocity: float


@dataclass(frozen=True)
class ChainState:
    """Where one limb is, for n samples: link poses by name, joint origins (n, J, 3) and axes (n, J, 3), in B."""

    link_position_m: dict[str, Array]
    link_rotation: dict[str, Array]
    joint_origin_m: Array
    joint_axis: Array


@dataclass(frozen=True)
class Limb:
    """A chain of J revolute joints from the body to the gripper frame, and the finger slides behind it."""

    name: str
    chain: tuple[Joint, ...]
    fingers: tuple[Joint, ...]
    joints: tuple[Joint, ...]
    gripper: str
    links: tuple[Link, ...]

    @property
    def lower_rad(self) -> Array:
        """Lower joint limits, shape (J,)."""
        return np.array([j.lower for j in self.joints])

    @property
    def upper_rad(self) -> Array:
        """Upper joint limits, shape (J,)."""
        return np.array([j.upper for j in self.joints])

    @property
    def effort_Nm(self) -> Array:
        """Peak torques, shape (J,)."""
        return np.array([j.effort for j in self.joints])

    @property
    def speed_rad_s(self) -> Array:
        """Speed limits, shape (J,)."""
        return np.array([j.velocity for j in self.joints])

    def forward(self, q_rad: Array, opening_m: Array | None = None) -> ChainState:
        """Poses of all links for joint angles (n, J) and finger openings (n,); fingers are left out without these."""
        n = len(q_rad)
        position, rotation = np.zeros((n, 3)), np.broadcast_to(np.eye(3), (n, 3, 3))
        positions, rotations = {self.chain[0].parent: position}, {self.chain[0].parent: rotation}
        origins, axes, i = [], [], 0
        for joint in self.chain:
            position = position + rotation @ joint.origin_m
            rotation = rotation @ joint.rotation
            if joint.kind == "revolute":
                origins.append(position)
                axes.append(rotation @ joint.axis)
                rotation = rotation @ rotation_about_axis(joint.axis, q_rad[:, i])
                i += 1
            positions[joint.child], rotations[joint.child] = position, rotation
        if opening_m is not None:
            for joint in self.fingers:
                slide = joint.rotation @ joint.axis
                offset = joint.origin_m + opening_m[:, None] * slide
                positions[joint.child] = position + (rotation @ offset[..., None])[..., 0]
                rotations[joint.child] = rotation @ joint.rotation
        return ChainState(positions, rotations, np.stack(origins, axis=1), np.stack(axes, axis=1))

    def jacobian(self, state: ChainState) -> Array:
        """Geometric Jacobian of the gripper frame in B, rows (v, omega), shape (n, 6, J)."""
        arm = state.link_position_m[self.gripper][:, None, :] - state.joint_origin_m
        linear = np.cross(state.joint_axis, arm)
        return np.asarray(np.concatenate([linear, state.joint_axis], axis=2).swapaxes(1, 2))

    def gravity_torque(self, state: ChainState, gravity_b_m_s2: Array) -> Array:
        """Joint torques (n, J) that carry the limb's own links under gravity (n, 3) given in B."""
        torque = np.zeros(state.joint_axis.shape[:2])
        order = [j.child for j in self.chain if j.kind == "revolute"]
        depth = self._depth(order)
        for link in self.links:
            if link.mass_kg == 0.0 or link.name not in state.link_position_m:
                continue
            com = state.link_position_m[link.name] + state.link_rotation[link.name] @ link.com_m
            count = depth[link.name]
            arm = com[:, None, :] - state.joint_origin_m[:, :count]
            moment = np.cross(arm, link.mass_kg * gravity_b_m_s2[:, None, :])
            torque[:, :count] -= np.einsum("nji,nji->nj", state.joint_axis[:, :count], moment)
        return torque

    def contact_torque(self, state: ChainState, force_b_N: Array, moment_b_Nm: Array) -> Array:
        """Joint torques (n, J) that hold a wrench (n, 3), (n, 3) acting on the robot at the gripper frame: -J^T w."""
        wrench = np.concatenate([force_b_N, moment_b_Nm], axis=1)
        return np.asarray(-np.einsum("nij,ni->nj", self.jacobian(state), wrench))

    def _depth(self, order: list[str]) -> dict[str, int]:
        """Number of revolute joints before each link."""
        depth, count = {}, 0
        for joint in self.chain:
            count += joint.child in order
            depth[joint.child] = count
        return depth | {joint.child: count for joint in self.fingers}


@dataclass(frozen=True)
class WholeRobot:
    """Body link and limbs; `mass_kg` is the whole robot's."""

    body: Link
    limbs: tuple[Limb, ...]

    @property
    def mass_kg(self) -> float:
        """Mass of all links."""
        return self.body.mass_kg + sum(link.mass_kg for limb in self.limbs for link in limb.links)

    def inertia_about_body_origin(self, q_rad: Array, opening_m: Array) -> Array:
        """Composite inertia (3, 3) about B's origin, axes of B, at joint angles (limbs, J) and openings (limbs,)."""
        total = _about_origin(self.body, np.zeros(3), np.eye(3))
        for i, limb in enumerate(self.limbs):
            state = limb.forward(q_rad[i : i + 1], opening_m[i : i + 1])
            for link in limb.links:
                if link.name in state.link_position_m:
                    total = total + _about_origin(
                        link, state.link_position_m[link.name][0], state.link_rotation[link.name][0]
                    )
        return total


def load_model(robot: Robot) -> WholeRobot:
    """The robot's links, joints and shapes from its URDF. Raises RobotModelError."""
    root = ElementTree.fromstring(robot.urdf_path.read_bytes())
    links = {e.attrib["name"]: _read_link(e) for e in root.iter("link")}
    joints = {e.attrib["name"]: _read_joint(e) for e in root.findall("joint")}
    by_child = {j.child: j for j in joints.values()}
    limbs = []
    for limb in robot.limbs:
        chain: list[Joint] = []
        link = limb.gripper_link
        while link != robot.body_link:
            if link not in by_child:
                raise RobotModelError(f"link {link!r} of limb {limb.name} does not hang on {robot.body_link!r}")
            chain.insert(0, by_child[link])
            link = by_child[link].parent
        moving = tuple(j for j in chain if j.kind != "fixed")
        if tuple(j.name for j in moving) != limb.joint_names or any(j.kind != "revolute" for j in moving):
            found = [j.name for j in moving]
            raise RobotModelError(f"limb {limb.name}: revolute joints {found}, expected {list(limb.joint_names)}")
        fingers = tuple(joints[name] for name in limb.finger_joints)
        names = [j.child for j in chain] + [j.child for j in fingers]
        limbs.append(Limb(limb.name, tuple(chain), fingers, moving, limb.gripper_link, tuple(links[n] for n in names)))
    return WholeRobot(links[robot.body_link], tuple(limbs))


def _about_origin(link: Link, position: Array, rotation: Array) -> Array:
    com = position + rotation @ link.com_m
    steiner = link.mass_kg * (com @ com * np.eye(3) - np.outer(com, com))
    return np.asarray(rotation @ link.inertia_kg_m2 @ rotation.T + steiner)


def _vector(text: str | None, default: str) -> Array:
    return np.array([float(v) for v in (text or default).split()])


def _origin(element: ElementTree.Element | None) -> tuple[Array, Array]:
    if element is None:
        return np.zeros(3), np.eye(3)
    return _vector(element.get("xyz"), "0 0 0"), rotation_from_rpy(_vector(element.get("rpy"), "0 0 0"))


def _read_joint(element: ElementTree.Element) -> Joint:
    parent, child, limit = element.find("parent"), element.find("child"), element.find("limit")
    if parent is None or child is None:
        raise RobotModelError(f"joint {element.get('name')!r} lacks parent or child")
    origin, rotation = _origin(element.find("origin"))
    axis_element = element.find("axis")
    axis = _vector(None if axis_element is None else axis_element.get("xyz"), "1 0 0")
    bounds = {} if limit is None else limit.attrib
    return Joint(
        element.attrib["name"],
        element.attrib["type"],
        parent.attrib["link"],
        child.attrib["link"],
        origin,
        rotation,
        axis / np.linalg.norm(axis),
        float(bounds.get("lower", -np.inf)),
        float(bounds.get("upper", np.inf)),
        float(bounds.get("effort", np.inf)),
        float(bounds.get("velocity", np.inf)),
    )


def _read_link(element: ElementTree.Element) -> Link:
    name, inertial = element.attrib["name"], element.find("inertial")
    mass, com, inertia = 0.0, np.zeros(3), np.zeros((3, 3))
    if inertial is not None:
        com, rotation = _origin(inertial.find("origin"))
        mass_element, tensor = inertial.find("mass"), inertial.find("inertia")
        mass = 0.0 if mass_element is None else float(mass_element.attrib["value"])
        if tensor is not None:
            xx, xy, xz, yy, yz, zz = (float(tensor.attrib[k]) for k in ("ixx", "ixy", "ixz", "iyy", "iyz", "izz"))
            inertia = rotation @ np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]]) @ rotation.T
    capsules: list[Capsule] = []
    boxes: list[Box] = []
    for shape in element.findall("collision") or element.findall("visual"):
        centre, rotation = _origin(shape.find("origin"))
        geometry = shape.find("geometry")
        solid = None if geometry is None or len(geometry) == 0 else geometry[0]
        if solid is None:
            raise RobotModelError(f"link {name!r} has a shape without geometry")
        if solid.tag == "box":
            boxes.append(Box(centre, rotation, 0.5 * _vector(solid.get("size"), "0 0 0")))
        elif solid.tag == "sphere":
            capsules.append(Capsule(centre, centre, float(solid.attrib["radius"])))
        elif solid.tag in ("cylinder", "capsule"):
            # a cylinder becomes the capsule with its end faces' centres on the surface: flat ends lose their rims only
            radius = float(solid.attrib["radius"])
            inset = 0.0 if solid.tag == "capsule" else radius
            reach = max(0.5 * float(solid.attrib["length"]) - inset, 0.0)
            along = rotation @ np.array([0.0, 0.0, reach])
            capsules.append(Capsule(centre - along, centre + along, radius))
        else:
            raise RobotModelError(f"link {name!r} has a shape of unknown kind {solid.tag!r}")
    return Link(name, mass, com, inertia, tuple(capsules), tuple(boxes))
