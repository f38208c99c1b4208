"""What a limb of fewer than six joints cannot do: turns of its gripper about axes of its own, which stay at zero.

With them the limb has as many turns as a pose has numbers, and kinematics is the same for limbs of any number of
joints. The runtime has the same (runtime/core/robot/still_turns.cpp).
"""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np

from .robot_bounds import JOINTS, LEAST_PLACED_M3
from .robot_types import Array, AtZero, Limb
from .urdf import about

CANNOT_PLACE = "expected joints that move the gripper in all three directions from the middle of their ranges"


def completed(limb: Limb, slots: int) -> Limb | None:
    """The limb with so many axes; None where its joints cannot move the gripper in all directions.

    Of the gripper's own axes those come first that, with the joints in the middle of their ranges, leave the joints and
    them the largest determinant; axes of length zero fill up the rest.
    """
    zero, missing = limb.at_zero, max(JOINTS - len(limb.joints), 0)
    best: tuple[int, ...] = ()
    if missing:
        columns, turn = _in_the_middle(limb)
        own = np.vstack([np.zeros((3, 3)), turn])
        sizes = {
            each: abs(float(np.linalg.det(np.hstack([columns, own[:, list(each)]]))))
            for each in itertools.combinations(range(3), missing)
        }
        best = max(sizes, key=lambda each: sizes[each])
        if sizes[best] < LEAST_PLACED_M3:
            return None
    more = slots - len(limb.joints)
    axes = np.zeros((more, 3))
    axes[:missing] = zero.gripper_rotation.T[list(best)]
    whole = AtZero(
        np.vstack([zero.axes, axes]),
        np.vstack([zero.points_m, np.tile(zero.gripper_m, (more, 1))]),
        np.concatenate([zero.rotations, np.tile(zero.gripper_rotation, (more, 1, 1))]),
        zero.gripper_m,
        zero.gripper_rotation,
    )
    return replace(limb, at_zero=whole, senses=np.ones(slots))


def _in_the_middle(limb: Limb) -> tuple[Array, Array]:
    """(6, J) motion of the gripper, place over turn, for each joint, and its rotation (3, 3), in the body frame."""
    zero, turn, place = limb.at_zero, np.eye(3), np.zeros(3)  # of what was at the body's origin
    axes, points = [], []
    for axis, point, angle in zip(zero.axes, zero.points_m, limb.middle_rad, strict=True):
        axes.append(turn @ axis)
        points.append(place + turn @ point)
        turn = turn @ about(axis, angle)
        place = points[-1] - turn @ point
    arms = place + turn @ zero.gripper_m - np.array(points)
    return np.vstack([np.cross(axes, arms).T, np.array(axes).T]), turn @ zero.gripper_rotation
