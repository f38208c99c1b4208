"""Equation (9a): every gripper stays in its limb's acceptance box and within its range of yaw relative to the body."""

from __future__ import annotations

from typing import Any

import numpy as np

from crux_planner.model.arrays import Array
from crux_planner.physics.dynamics import rotation


def offset_in_body(r: Any, theta: Any, gripper: Any) -> Any:
    """R(theta)^T (c - r): where the gripper centre is in the body frame (casadi)."""
    return rotation(theta).T @ (gripper - r)


def body_positions(gripper: Array, centre_b: Array, half: Array) -> tuple[Array, Array]:
    """Bounds of the body position for which a level, unturned body has the gripper in the box; shapes (..., 3)."""
    return gripper - centre_b - half, gripper - centre_b + half


def turned_half(half: Array, centre_b: Array, angle_rad: float) -> Array:
    """Half-box that, used at a fixed heading, is inside the true box for every heading within `angle_rad` of it.

    Turning by a moves a point of the box by no more than a times its lever arm: (9a) with R fixed, conservatively.
    """
    arm = np.abs(centre_b).max(axis=0) + half
    shrunk: Array = half - np.sin(angle_rad) * np.array([arm[1], arm[0], 0.0])
    return shrunk
