"""Orientations of a log and of a plan's goal as rotation matrices."""

from __future__ import annotations

from typing import Any

import numpy as np
from crux_contracts.scenario import parse_scenario
from numpy.typing import NDArray

Floats = NDArray[np.float64]
_TILT = "gripper_tilt_w_rad"
_RIGHT_ANGLE = 1e-9  # cosine of pitches at which roll and yaw are one turn


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


def rpy_of(rotation: Floats) -> Floats:
    """Roll, pitch and yaw (3,) [rad] of Rz(yaw) Ry(pitch) Rx(roll); yaw is 0 where the pitch is a right angle."""
    flat = float(np.hypot(*rotation[:2, 0]))
    pitch = np.arctan2(-rotation[2, 0], flat)
    if flat < _RIGHT_ANGLE:
        return np.array([np.arctan2(-rotation[1, 2], rotation[1, 1]), pitch, 0.0])
    return np.array([np.arctan2(*rotation[2, [1, 2]]), pitch, np.arctan2(*rotation[[1, 0], 0])])


def hold_rotation(hold: Any) -> Floats:
    """Rotation W <- the hold's (hold_t) own axes, (3, 3)."""
    return rotation_from_rpy([*hold.tilt_rad, hold.yaw_rad])


def hold_quaternion(hold: Any) -> Floats:
    """The same as w, x, y, z."""
    (cr, cp, cy), (sr, sp, sy) = (of(np.array([*hold.tilt_rad, hold.yaw_rad]) / 2) for of in (np.cos, np.sin))
    return np.array(
        [
            cy * cp * cr + sy * sp * sr,
            cy * cp * sr - sy * sp * cr,
            cy * sp * cr + sy * cp * sr,
            sy * cp * cr - cy * sp * sr,
        ]
    )


def hold_middle(hold: Any) -> Floats:
    """Centre (3,) of a hold's box in W."""
    return np.asarray(hold.position_w_m + hold_rotation(hold)[:, 2] * hold.size_m[2] / 2)


def hold_top_m(hold: Any) -> float:
    """Height of its highest point over the wall."""
    return float(hold_middle(hold)[2] + np.abs(hold_rotation(hold)[2]) @ hold.size_m / 2)


def tilts_of(references: NDArray[Any]) -> Floats:
    """(..., 2) by which references (...) of a log tilt the grippers; older logs have none."""
    names = references.dtype.names or ()
    return references[_TILT] if _TILT in names else np.zeros((*references.shape, 2))


def goal_pose(plan: Any) -> tuple[Floats, Floats]:
    """Goal position (3,) and rotation (3, 3) of the body in W, from the scenario the plan carries."""
    body = parse_scenario(plan.scenario_yaml, any_robot=True).goal.body
    return np.array(body.position_m), rotation_from_rpy(body.rpy_rad)


def angle_between(a: Floats, b: Floats) -> float:
    """Angle of the rotation from a to b, (3, 3) each [rad]."""
    turn = a.T @ b
    skew = np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
    return float(np.arctan2(np.linalg.norm(skew), np.trace(turn) - 1))
