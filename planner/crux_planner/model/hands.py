"""Grippers as arrays: x, y, z [m] and yaw, and where some grasps of a problem are tilted, the tilt's two numbers.

Poses (..., 5) are x, y, z, yaw and opening, (..., 7) with the tilt after these. R = exp(tilt) Rz(yaw), H <- gripper.
"""

from typing import Any

import numpy as np
from crux_contracts.gripper_frames import gripper_rotation

from crux_planner.model.arrays import Array

UPRIGHT, TILTED = 4, 6  # numbers of a hand
_HAND_OF_POSE = [0, 1, 2, 3, 5, 6]
_SMALL = 1e-30  # under a root, so that it is smooth at an upright gripper


def hands_of(poses: Array) -> Array:
    """(..., 4 or 6) of poses (..., 5 or 7), or of such hands themselves."""
    if poses.shape[-1] < TILTED:
        return poses[..., :UPRIGHT]
    return poses if poses.shape[-1] == TILTED else poses[..., _HAND_OF_POSE]


def rotations(hands: Array) -> Array:
    """(..., 3, 3): columns are the opening axis, the way across it, and up off the hold; of hands (..., 4 or 6)."""
    upright = hands.shape[-1] < TILTED
    return gripper_rotation(hands[..., 3], np.zeros((*hands.shape[:-1], 2)) if upright else hands[..., 4:TILTED])


def axes_of(hand: Any) -> tuple[Any, Any, Any]:
    """The same columns of one hand (casadi)."""
    import casadi as ca  # which walks do without

    along = ca.vertcat(ca.cos(hand[3]), ca.sin(hand[3]), 0)
    across, up = ca.vertcat(-ca.sin(hand[3]), ca.cos(hand[3]), 0), ca.DM([0, 0, 1])
    if hand.shape[0] < TILTED:
        return along, across, up
    angle = ca.sqrt(hand[4] ** 2 + hand[5] ** 2 + _SMALL)
    about = ca.vertcat(hand[4], hand[5], 0) / angle

    def turned(v: Any) -> Any:
        aside, kept = ca.cross(about, v), about * ca.dot(about, v)
        return kept + ca.cos(angle) * (v - kept) + ca.sin(angle) * aside

    return turned(along), turned(across), turned(up)
