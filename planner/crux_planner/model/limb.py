"""Where the links of a limb are, and what they weigh, for a gripper upright on the wall.

The closed-form inverse kinematics written without angles: the elbow is a corner of a triangle, the wrist's axes are
cross products. Smooth wherever the limb is neither stretched nor folded, and the same for numbers, complex numbers,
arrays and casadi's expressions: a vector here is a tuple of three of them.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from crux_contracts.robot import Limb, Robot
from crux_contracts.robot_bounds import JOINTS

from crux_planner.model.arrays import Array

Vector = tuple[Any, Any, Any]
NUMBERS = 36
_STRETCHED = 0.999  # of a limb's links end to end


@dataclass(frozen=True)
class LimbMasses:
    """A limb, and what `placed` needs of it, (36,) SI units: place of the shoulder; lengths of upper link, lower link
    and wrist to gripper; cosine and sine of the gripper's turn on the last joint; then centre of mass and mass of
    links 1..6, each in its own frame, and of the hand (gripper and fingers) in the gripper frame.
    """

    limb: Limb
    numbers: Array


@dataclass(frozen=True)
class PlacedLimb:
    """Joints' origins and axes, and of every link how many joints are before it, its centre of mass and its mass [kg];
    the hand (gripper and fingers) comes last. In the frame of the gripper that was given.
    """

    origins: list[Vector]
    axes: list[Vector]
    links: list[tuple[int, Vector, Any]]

    def first_moment(self) -> Vector:
        """Sum of mass times place [kg m]."""
        total: Vector = (0.0, 0.0, 0.0)
        for _, place, mass in self.links:
            total = combined((1.0, total), (mass, place))
        return total


def limb_masses(robot: Robot, limb: Limb) -> LimbMasses:
    """The masses of a limb from the robot description."""
    turn = limb.gripper_mount_rad
    numbers = [*limb.shoulder_b_m, limb.upper_link_m, limb.lower_link_m, limb.wrist_to_gripper_m]
    numbers += [np.cos(turn), np.sin(turn)]
    for link in (robot.urdf.links[joint.child] for joint in limb.joints):
        numbers += [*link.com_m, link.mass_kg]
    return LimbMasses(limb, np.array([*numbers, *limb.hand_com_g_m, limb.hand_mass_kg]))


def in_reach(numbers: Any, gripper: Vector, up: Vector) -> Vector:
    """The gripper's centre, no farther than a stretched limb has it, as first guesses may; arguments as of `placed`."""
    away = combined((1.0, gripper), (numbers[5], up), (-1.0, _vector(numbers, 0)))
    beyond = 1.0 - _STRETCHED * (numbers[3] + numbers[4]) / dot(away, away) ** 0.5
    return combined((1.0, gripper), (-(beyond + abs(beyond)) / 2, away))


def placed(numbers: Any, gripper: Vector, up: Vector, along: Vector) -> PlacedLimb:
    """The limb with its gripper's centre at `gripper`, z axis `up` and opening axis `along`, all in the body frame.

    `numbers` are those of LimbMasses along the first axis: of one limb, of several along further axes, or symbols.
    """
    shoulder, upper, lower = _vector(numbers, 0), numbers[3], numbers[4]
    wrist = combined((1.0, gripper), (numbers[5], up))
    elbow, out = _elbow(combined((1.0, wrist), (-1.0, shoulder)), upper, lower)
    side = (-out[1], out[0], 0.0)  # y of the yawed limb
    roll = cross(side, up)
    size = dot(roll, roll) ** 0.5
    roll = (roll[0] / size, roll[1] / size, roll[2] / size)
    across = cross(up, along)
    hand_x = combined((numbers[6], along), (-numbers[7], across))
    joint = combined((1.0, shoulder), (1.0, elbow))
    forearm = combined((1.0 / lower, wrist), (-1.0 / lower, joint))
    frames = [
        (shoulder, out, side),
        (shoulder, combined((1.0 / upper, elbow)), side),
        (joint, forearm, side),
        (wrist, roll, side),
        (wrist, roll, cross(up, roll)),
        (wrist, hand_x, cross(up, hand_x)),
        (gripper, along, across),
    ]
    depths = (*range(1, JOINTS + 1), JOINTS)
    places = [_at(*frame, _vector(numbers, 8 + 4 * i)) for i, frame in enumerate(frames)]
    links = list(zip(depths, places, (numbers[11 + 4 * i] for i in range(len(frames))), strict=True))
    axes = [(0.0, 0.0, 1.0), combined((-1.0, side)), side, side, roll, up]
    return PlacedLimb([shoulder, shoulder, joint, wrist, wrist, wrist], axes, links)


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


def _vector(numbers: Any, first: int) -> Vector:
    return numbers[first], numbers[first + 1], numbers[first + 2]
