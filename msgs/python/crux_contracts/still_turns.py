"""What a limb of fewer than six joints cannot do: turns of its gripper about axes of its own, which stay at zero.

With them the limb has as many turns as a pose has numbers, and kinematics is the same for limbs of any number of
joints. The runtime has the same (runtime/core/robot/still_turns.cpp).
"""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np

from .limb_motion import motion
from .robot_bounds import JOINTS, LEAST_PLACED_M3
from .robot_types import AtZero, Limb

CANNOT_PLACE = "expected joints that move the gripper in all three directions from the middle of their ranges"


def completed(limb: Limb, slots: int) -> Limb | None:
    """The limb with so many axes; None where its joints cannot move the gripper in all directions.

    Of the gripper's own axes those come first that, with the joints in the middle of their ranges, leave the joints and
    them the largest determinant; axes of length zero fill up the rest.
    """
    zero, missing = limb.at_zero, max(JOINTS - len(limb.joints), 0)
    best: tuple[int, ...] = ()
    if missing:
        (columns,), (turn,) = motion(zero, limb.middle_rad[None])
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
