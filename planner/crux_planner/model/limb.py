"""Where the links of a limb are, and what they weigh, for a gripper upright on the wall.

The closed-form inverse kinematics written without angles: the elbow is a corner of a triangle, the wrist's axes are
cross products. Smooth wherever the limb is neither stretched nor folded, and the same for numbers, complex numbers,
arrays and casadi's expressions: a vector here is a tuple of three of them.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from crux_contracts.robot import Limb, Robot
from crux_contracts.urdf import Link

Vector = tuple[Any, Any, Any]
JOINTS = 6


@dataclass(frozen=True)
class LimbMasses:
    """Links 1..6 in their own frames; gripper and fingers together in the gripper frame."""

    limb: Limb
    links: tuple[Link, ...]


@dataclass(frozen=True)
class PlacedLimb:
    """Joints' origins and axes, and of every link how many joints are before it, its centre of mass and its mass [kg];
    the hand (gripper and fingers) comes last. In the frame of the gripper that was given.
    """

    origins: list[Vector]
    axes: list[Vector]
    links: list[tuple[int, Vector, float]]

    def first_moment(self) -> Vector:
        """Sum of mass times place [kg m]."""
        total: Vector = (0.0, 0.0, 0.0)
        for _, place, mass in self.links:
            total = combined((1.0, total), (mass, place))
        return total


def limb_masses(robot: Robot, limb: Limb) -> LimbMasses:
    """The masses of a limb from the robot description."""
    return LimbMasses(limb, tuple(robot.urdf.links[joint.child] for joint in limb.joints))


def placed(masses: LimbMasses, gripper: Vector, up: Vector, along: Vector) -> PlacedLimb:
    """The limb with its gripper's centre at `gripper`, z axis `up` and opening axis `along`, all in the body frame."""
    limb = masses.limb
    shoulder = _numbers(limb.shoulder_b_m)
    wrist = combined((1.0, gripper), (limb.wrist_to_gripper_m, up))
    elbow, out = _elbow(combined((1.0, wrist), (-1.0, shoulder)), limb.upper_link_m, limb.lower_link_m)
    side = (-out[1], out[0], 0.0)  # y of the yawed limb
    roll = cross(side, up)
    size = dot(roll, roll) ** 0.5
    roll = (roll[0] / size, roll[1] / size, roll[2] / size)
    across = cross(up, along)
    turn = limb.gripper_mount_rad
    hand_x = combined((float(np.cos(turn)), along), (-float(np.sin(turn)), across))
    joint = combined((1.0, shoulder), (1.0, elbow))
    forearm = combined((1.0 / limb.lower_link_m, wrist), (-1.0 / limb.lower_link_m, joint))
    frames = [
        (shoulder, out, side),
        (shoulder, combined((1.0 / limb.upper_link_m, elbow)), side),
        (joint, forearm, side),
        (wrist, roll, side),
        (wrist, roll, cross(up, roll)),
        (wrist, hand_x, cross(up, hand_x)),
    ]
    links = [
        (depth, _at(origin, x, y, _numbers(link.com_m)), link.mass_kg)
        for depth, ((origin, x, y), link) in enumerate(zip(frames, masses.links, strict=True), start=1)
    ]
    links.append((JOINTS, _at(gripper, along, across, _numbers(limb.hand_com_g_m)), limb.hand_mass_kg))
    back = combined((-1.0, side))
    return PlacedLimb(
        [shoulder, shoulder, joint, wrist, wrist, wrist], [(0.0, 0.0, 1.0), back, side, side, roll, up], links
    )


def combined(*parts: tuple[Any, Vector]) -> Vector:
    """Sum of numbers times vectors."""
    x, y, z = (sum(number * vector[i] for number, vector in parts) for i in range(3))
    return x, y, z


def cross(a: Vector, b: Vector) -> Vector:
    """a x b."""
    return a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]


def dot(a: Vector, b: Vector) -> Any:
    """a . b."""
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _at(origin: Vector, x: Vector, y: Vector, place: Vector) -> Vector:
    """A place in the frame with these axes."""
    return combined((1.0, origin), (place[0], x), (place[1], y), (place[2], cross(x, y)))


def _elbow(wrist: Vector, upper: float, lower: float) -> tuple[Vector, Vector]:
    """Elbow and the limb's horizontal direction for a wrist position, both positions from the shoulder."""
    radius = (wrist[0] ** 2 + wrist[1] ** 2) ** 0.5
    out = (wrist[0] / radius, wrist[1] / radius, 0.0)
    squared = radius**2 + wrist[2] ** 2
    share = (upper**2 - lower**2 + squared) / (2 * squared)  # foot of the elbow's height on the line to the wrist
    height = (upper**2 / squared - share**2) ** 0.5  # as a share of that line
    along = share * radius - height * wrist[2]
    return (along * out[0], along * out[1], share * wrist[2] + height * radius), out


def _numbers(values: Any) -> Vector:
    return float(values[0]), float(values[1]), float(values[2])
