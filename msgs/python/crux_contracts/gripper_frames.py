"""How a gripper is turned: R = exp(tilt) Rz(yaw), W <- gripper. The tilt is a rotation vector about W's x and y, by
which the gripper's z, the way off its hold, is turned out of W's z; none for an upright gripper.
"""

from __future__ import annotations

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


def gripper_rotation(yaw_rad: ArrayLike, tilt_rad: ArrayLike) -> Array:
    """(..., 3, 3) of yaws (...) and tilts (..., 2) [rad]; columns are the opening axis, the way across it, and up."""
    yaw, tilt = np.asarray(yaw_rad, dtype=float), np.asarray(tilt_rad, dtype=float)
    c, s, zero, one = np.cos(yaw), np.sin(yaw), np.zeros_like(yaw), np.ones_like(yaw)
    upright = _matrix((c, -s, zero), (s, c, zero), (zero, zero, one))
    if not tilt.any():
        return upright
    angle = np.hypot(tilt[..., 0], tilt[..., 1])
    kx, ky = (tilt[..., i] / np.where(angle > 0.0, angle, 1.0) for i in (0, 1))
    sine, rest = np.sin(angle), 1.0 - np.cos(angle)
    turned = _matrix(
        (1.0 - rest * ky * ky, rest * kx * ky, sine * ky),
        (rest * kx * ky, 1.0 - rest * kx * kx, -sine * kx),
        (-sine * ky, sine * kx, 1.0 - rest),
    )
    return np.asarray(turned @ upright)


def yaw_and_tilt(rotation: ArrayLike) -> tuple[float, Array]:
    """Yaw and tilt (2,) [rad] of a rotation (3, 3) whose z is not turned all the way round."""
    turn = np.asarray(rotation, dtype=float)
    east, north, up = turn[:, 2]
    sine = float(np.hypot(east, north))
    angle = np.arctan2(sine, up)
    tilt = np.array([-north, east]) * (angle / sine if sine > 1e-12 else 0.0)
    back = gripper_rotation(0.0, -tilt) @ turn
    return float(np.arctan2(back[1, 0], back[0, 0])), tilt


def _matrix(*rows: tuple[Array, Array, Array]) -> Array:
    return np.stack([np.stack(row, axis=-1) for row in rows], axis=-2)
