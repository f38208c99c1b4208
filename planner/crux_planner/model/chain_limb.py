"""Where the links of a limb of any revolute joints are, as `limb.placed` has those with a closed form.

The numbers of a limb are followed by the angles and the inverse Jacobian of a pose near by, which the numeric inverse
kinematics found. Two steps of Newton's method with this Jacobian are exact at that pose, and so are their first and
second derivatives: the error of each step is that of the one before times the way from the pose. S are a limb's joints
and still turns, see crux_contracts.robot_types.AtZero.
"""

from dataclasses import dataclass
from typing import Any, Self

import numpy as np
from crux_contracts.robot import Limb, Robot

from crux_planner.model.arrays import Array
from crux_planner.model.placed_limb import PlacedLimb, Vector, combined, cross, vector

_STEPS = 2
_POSE = 6

Frame = tuple[Vector, Vector, Vector, Vector]
"""Axes x, y, z of what turned with the links from the zero posture, and where what was at the body's origin is."""


@dataclass(frozen=True)
class Layout:
    """Where the numbers of a limb of S = `slots` joints and still turns are: axes and points, the gripper's place and
    axes, masses with their places; behind them a seed: the angles (S,) at a pose, and an inverse Jacobian (S, 6).
    """

    slots: int

    @classmethod
    def of(cls, size: int) -> Self:
        """Of so many numbers with their seed."""
        return cls((size - 16) // 17)

    @property
    def gripper(self) -> int:
        return 6 * self.slots

    @property
    def masses(self) -> int:
        return self.gripper + 12

    @property
    def chain(self) -> int:
        """Numbers of the limb."""
        return self.masses + 4 * self.slots + 4

    @property
    def seed(self) -> int:
        """Numbers of the pose."""
        return (1 + _POSE) * self.slots


def chain_numbers(robot: Robot, limb: Limb) -> Array:
    """(10 S + 16,) of a limb: all places are those at its zero posture, in the body frame."""
    zero = limb.at_zero
    numbers = [*zero.axes.ravel(), *zero.points_m.ravel(), *zero.gripper_m, *zero.gripper_rotation.T.ravel()]
    for joint, origin, turn in zip(limb.joints, zero.points_m, zero.rotations, strict=False):
        link = robot.urdf.links[joint.child]
        numbers += [*(origin + turn @ np.array(link.com_m)), link.mass_kg]
    numbers += [0.0] * 4 * limb.still
    hand = zero.gripper_m + zero.gripper_rotation @ limb.hand_com_g_m
    return np.array([*numbers, *hand, limb.hand_mass_kg])


def placed_chain(numbers: Any, gripper: Vector, up: Vector, along: Vector) -> PlacedLimb:
    """As `limb.placed`; numbers (17 S + 16, ...)."""
    layout = Layout.of(numbers.shape[0])
    _, origins, axes, frames = followed(numbers, gripper, up, along)
    links = []
    for i, frame in enumerate([*frames, frames[-1]]):
        at = layout.masses + 4 * i
        links.append((min(i + 1, layout.slots), place_in(frame, vector(numbers, at)), numbers[at + 3]))
    return PlacedLimb(origins, axes, links)


def followed(
    numbers: Any, gripper: Vector, up: Vector, along: Vector
) -> tuple[list[Any], list[Vector], list[Vector], list[Frame]]:
    """Angles of the joints with the gripper there, their origins and axes, and the frames of the links behind them."""
    layout = Layout.of(numbers.shape[0])
    angles = [numbers[layout.chain + j] for j in range(layout.slots)]
    target = (along, cross(up, along), up)
    for _ in range(_STEPS):
        _, _, frames = _turned(numbers, angles)
        error = _error(numbers, frames[-1], gripper, target)
        rows = range(layout.chain + layout.slots, layout.chain + layout.seed, _POSE)
        moves = (sum(numbers[row + i] * error[i] for i in range(_POSE)) for row in rows)
        angles = [q + move for q, move in zip(angles, moves, strict=True)]
    return angles, *_turned(numbers, angles)


def _turned(numbers: Any, angles: list[Any]) -> tuple[list[Vector], list[Vector], list[Frame]]:
    """The joints' origins and axes, and the frames of the links behind them."""
    frame: Frame = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (0.0, 0.0, 0.0))
    origins, axes, frames = [], [], []
    points = 3 * len(angles)
    for j, angle in enumerate(angles):
        own, point = vector(numbers, 3 * j), vector(numbers, points + 3 * j)
        origin, axis = place_in(frame, point), way_in(frame, own)
        sine, cosine = _sine_cosine(angle)
        x, y = (
            combined((cosine, side), (sine, cross(axis, side)), ((1.0 - cosine) * own[i], axis))
            for i, side in enumerate(frame[:2])
        )
        z = cross(x, y)
        frame = (x, y, z, combined((1.0, origin), (-1.0, way_in((x, y, z, origin), point))))
        origins.append(origin)
        axes.append(axis)
        frames.append(frame)
    return origins, axes, frames


def _error(numbers: Any, frame: Frame, gripper: Vector, target: tuple[Vector, Vector, Vector]) -> list[Any]:
    """(6,) of place and orientation, to first order."""
    at = Layout.of(numbers.shape[0]).gripper
    off = combined((1.0, gripper), (-1.0, place_in(frame, vector(numbers, at))))
    sides = [way_in(frame, vector(numbers, at + 3 + 3 * i)) for i in range(3)]
    turn = combined(*((0.5, cross(here, there)) for here, there in zip(sides, target, strict=True)))
    return [*off, *turn]


def way_in(frame: Frame, v: Vector) -> Vector:
    """A vector of the zero posture, as it is turned."""
    return combined(*((v[i], frame[i]) for i in range(3)))


def place_in(frame: Frame, place: Vector) -> Vector:
    """Where a place of the zero posture is."""
    return combined((1.0, frame[3]), *((place[i], frame[i]) for i in range(3)))


def _sine_cosine(angle: Any) -> tuple[Any, Any]:
    if hasattr(angle, "is_symbolic"):  # of casadi, whose import takes long
        return angle.sin(), angle.cos()
    return np.sin(angle), np.cos(angle)
