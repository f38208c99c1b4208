"""Grips that a limb cannot hold with the body at the goal, where the boxes of `goal_map` are too coarse to say so.

Branch and bound over boxes of the body's poses within the goal's tolerances and of where on its faces the gripper is. A
box is ruled out where the limb cannot have its gripper there by its outer map; the others are halved.
"""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from crux_planner.certificates.infeasibility.poses import GoalPoses
from crux_planner.model.arrays import Array
from crux_planner.model.contacts import Grip
from crux_planner.model.kinematics import wrap_near
from crux_planner.reach.body_grid import spread
from crux_planner.reach.poses import GripperPoses
from crux_planner.reach.protocol import Reach

BOXES = 50_000  # looked at for one grip
_AT_ONCE = 4096
_SIZES = np.array([1.0, 1.0, 1.0, 0.25, 0.25, 0.25, 1.0, 1.0])  # how far [m] a unit moves the gripper in the body frame


def cannot(poses: GoalPoses, reaches: Sequence[Reach], limb: int, grip: Grip) -> bool:
    """Whether no pose at the goal lets a limb hold a grip, with its fingers either way round: that is certain. False
    once a pose is found, or too many boxes are left. `reaches` have no margins.
    """
    low, high = (np.array([ends]) for ends in _whole(poses, grip))
    looked = 0
    while len(low):
        some, looked = slice(-_AT_ONCE, None), looked + len(low[-_AT_ONCE:])
        left = poses.may_be(low[some, :6], high[some, :6])
        boxes = low[some][left], high[some][left]
        may = np.zeros(len(boxes[0]), dtype=bool)
        for yaw in (grip.contact.yaw_rad, grip.contact.yaw_rad + np.pi):
            middle, lowest, highest = _seen(grip, yaw, *boxes)
            may |= ~reaches[limb].cannot(lowest, highest)
            if looked > BOXES or reaches[limb].reaches(middle).any():
                return False
        low, high = (
            np.concatenate([each[:-_AT_ONCE], half])
            for each, half in zip((low, high), _halved(boxes[0][may], boxes[1][may]), strict=True)
        )
    return True


def _whole(poses: GoalPoses, grip: Grip) -> tuple[list[float], list[float]]:
    """Bounds of the body's x, y, z, yaw, roll and pitch, and of how far aside and how high the gripper is."""
    low, high = poses.box()
    return [*low, -grip.aside_m, grip.height_m[0]], [*high, grip.aside_m, grip.height_m[1]]


def _seen(grip: Grip, yaw_w_rad: float, low: Array, high: Array) -> tuple[GripperPoses, GripperPoses, GripperPoses]:
    """Middle, lowest and highest numbers of grippers as the bodies of boxes (n, 8) have them."""
    contact, middle, half = grip.contact, ((low + high) / 2).T, ((high - low) / 2).T
    x, y, z, yaw, roll, pitch, aside, height = middle
    *wide, turned, rolled, pitched, wide_aside, wide_height = half
    east, north = (contact.centre_h_m[i] + aside * contact.tangent[i] - at for i, at in enumerate((x, y)))
    along, across = (wide[i] + wide_aside * abs(contact.tangent[i]) for i in range(2))
    c, s = np.cos(yaw), np.sin(yaw)
    ahead, to_left = c * east + s * north, c * north - s * east
    across_body = np.abs(c) * along + np.abs(s) * across, np.abs(c) * across + np.abs(s) * along
    off_x, off_y = spread((ahead, to_left), across_body, turned)
    at = ahead, to_left, height - z, wrap_near(yaw_w_rad - yaw, 0.0), roll, pitch
    off = off_x, off_y, wide_height + wide[2], turned, rolled, pitched
    lowest, highest = ([a + sign * b for a, b in zip(at, off, strict=True)] for sign in (-1.0, 1.0))
    return GripperPoses(*at), GripperPoses(*lowest), GripperPoses(*highest)


def _halved(low: Array, high: Array) -> tuple[Array, Array]:
    """Boxes (2 n, 8) cut across where they are largest."""
    widest, every = np.argmax((high - low) * _SIZES, axis=1), np.arange(len(low))
    middle = (low[every, widest] + high[every, widest]) / 2
    upper, lower = low.copy(), high.copy()
    upper[every, widest] = lower[every, widest] = middle
    return np.concatenate([low, upper]), np.concatenate([lower, high])
