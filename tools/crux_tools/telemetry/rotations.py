"""Orientations of a log and of a plan's goal as rotation matrices."""

from __future__ import annotations

from typing import Any

import numpy as np
from crux_contracts.scenario import parse_scenario
from numpy.typing import NDArray

Floats = NDArray[np.float64]


def rotations_from_quaternions(quaternion: Floats) -> Floats:
    """(n, 4) w, x, y, z -> (n, 3, 3)."""
    w, x, y, z = quaternion.T
    return np.stack(
        [
            np.stack([1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)], axis=-1),
            np.stack([2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)], axis=-1),
            np.stack([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)], axis=-1),
        ],
        axis=-2,
    )


def rotation_from_rpy(rpy_rad: Any) -> Floats:
    """Rotation W <- B of intrinsic z-y-x angles (roll, pitch, yaw), (3, 3)."""
    (cr, cp, cy), (sr, sp, sy) = np.cos(rpy_rad), np.sin(rpy_rad)
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def goal_pose(plan: Any) -> tuple[Floats, Floats]:
    """Goal position (3,) and rotation (3, 3) of the body in W, from the scenario the plan carries."""
    body = parse_scenario(plan.scenario_yaml, any_robot=True).goal.body
    return np.array(body.position_m), rotation_from_rpy(body.rpy_rad)


def angle_between(a: Floats, b: Floats) -> float:
    """Angle of the rotation from a to b, (3, 3) each [rad]."""
    turn = a.T @ b
    skew = np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
    return float(np.arctan2(np.linalg.norm(skew), np.trace(turn) - 1))
