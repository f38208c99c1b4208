"""Where the links of a limb of any six revolute joints are, as `limb.placed` has those with a closed form.

The numbers of a limb are followed by the angles and the inverse Jacobian of a pose near by, which the numeric inverse
kinematics found. Two steps of Newton's method with this Jacobian are exact at that pose, and so are their first and
second derivatives: the error of each step is that of the one before times the way from the pose.
"""

from typing import Any

import numpy as np
from crux_contracts.robot import Limb, Robot
from crux_contracts.robot_bounds import JOINTS

from crux_planner.model.arrays import Array
from crux_planner.model.placed_limb import PlacedLimb, Vector, combined, cross, vector

_AXES, _POINTS, _GRIPPER, _ROTATION, _MASSES = 0, 18, 36, 39, 48
CHAIN = 76  # numbers of a limb: axes and points, the gripper's place and axes, masses with their places
SEED = 42  # of a pose: angles (6,) and inverse Jacobian (6, 6)
_STEPS = 2

Frame = tuple[Vector, Vector, Vector, Vector]
"""Axes x, y, z of what turned with the links from the zero posture, and where what was at the body's origin is."""


def chain_numbers(robot: Robot, limb: Limb) -> Array:
    """(76,) of a limb: all places are those at its zero posture, in the body frame."""
    zero = limb.at_zero
    numbers = [*zero.axes.ravel(), *zero.points_m.ravel(), *zero.gripper_m, *zero.gripper_rotation.T.ravel()]
    for joint, origin, turn in zip(limb.joints, zero.points_m, zero.rotations, strict=True):
        link = robot.urdf.links[joint.child]
        numbers += [*(origin + turn @ np.array(link.com_m)), link.mass_kg]
    hand = zero.gripper_m + zero.gripper_rotation @ limb.hand_com_g_m
    return np.array([*numbers, *hand, limb.hand_mass_kg])


def placed_chain(numbers: Any, gripper: Vector, up: Vector, along: Vector) -> PlacedLimb:
    """As `limb.placed`; numbers (118, ...)."""
    _, origins, axes, frames = followed(numbers, gripper, up, along)
    links = []
    for i, frame in enumerate([*frames, frames[-1]]):
        at = _MASSES + 4 * i
        links.append((min(i + 1, JOINTS), place_in(frame, vector(numbers, at)), numbers[at + 3]))
    return PlacedLimb(origins, axes, links)


def followed(
    numbers: Any, gripper: Vector, up: Vector, along: Vector
) -> tuple[list[Any], list[Vector], list[Vector], list[Frame]]:
    """Angles of the joints with the gripper there, their origins and axes, and the frames of the links behind them."""
    angles = [numbers[CHAIN + j] for j in range(JOINTS)]
    target = (along, cross(up, along), up)
    for _ in range(_STEPS):
        _, _, frames = _turned(numbers, angles)
        error = _error(numbers, frames[-1], gripper, target)
        rows = range(CHAIN + JOINTS, CHAIN + SEED, JOINTS)
        angles = [q + sum(numbers[row + i] * error[i] for i in range(6)) for q, row in zip(angles, rows, strict=True)]
    return angles, *_turned(numbers, angles)


def _turned(numbers: Any, angles: list[Any]) -> tuple[list[Vector], list[Vector], list[Frame]]:
    """The joints' origins and axes, and the frames of the links behind them."""
    frame: Frame = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0), (0.0, 0.0, 0.0))
    origins, axes, frames = [], [], []
    for j, angle in enumerate(angles):
        own, point = vector(numbers, _AXES + 3 * j), vector(numbers, _POINTS + 3 * j)
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
    off = combined((1.0, gripper), (-1.0, place_in(frame, vector(numbers, _GRIPPER))))
    sides = [way_in(frame, vector(numbers, _ROTATION + 3 * i)) for i in range(3)]
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
