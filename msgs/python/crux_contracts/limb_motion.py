"""How a limb's joints move its gripper."""

from __future__ import annotations

import numpy as np

from .robot_types import Array, AtZero


def motion(zero: AtZero, q_rad: Array) -> tuple[Array, Array]:
    """(n, 6, S) motion of the gripper, place [m/rad] over turn, for each joint at angles (n, S), and its rotations
    (n, 3, 3), in the body frame.
    """
    turn, place = np.broadcast_to(np.eye(3), (len(q_rad), 3, 3)), np.zeros((len(q_rad), 3))  # of the body's origin
    axes, points = [], []
    for axis, point, angle in zip(zero.axes, zero.points_m, q_rad.T, strict=True):
        axes.append(turn @ axis)
        points.append(place + turn @ point)
        turn = turn @ _about(axis, angle[:, None, None])
        place = points[-1] - turn @ point
    arms = place + turn @ zero.gripper_m - np.array(points)
    columns = np.concatenate([np.cross(axes, arms), np.array(axes)], axis=2)
    return columns.transpose(1, 2, 0), turn @ zero.gripper_rotation


def _about(axis: Array, angle_rad: Array) -> Array:
    """Rotations (n, 3, 3) about one axis, of angles (n, 1, 1)."""
    skew = np.cross(axis, np.eye(3)).T
    return np.asarray(np.eye(3) + np.sin(angle_rad) * skew + (1.0 - np.cos(angle_rad)) * (skew @ skew))
