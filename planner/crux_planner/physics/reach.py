"""Equation (9a): every gripper stays in its limb's reach and within its range of yaw relative to the body.

Bounds of body positions are along the directions of that reach, x, y and z first: three numbers for boxes.
"""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from crux_planner.model.arrays import Array
from crux_planner.physics.dynamics import rotation

if TYPE_CHECKING:
    from crux_planner.model.workspace import Reach


def offset_in_body(r: Any, theta: Any, gripper: Any) -> Any:
    """R(theta)^T (c - r): where the gripper centre is in the body frame (casadi)."""
    return rotation(theta).T @ (gripper - r)


def body_positions(grippers: Array, reach: Reach) -> tuple[Array, Array]:
    """Bounds (..., 4, m) of the body position for which a level, unturned body has grippers (..., 4, 3) in reach."""
    along = grippers @ reach.directions.T
    return along - reach.middle_m - reach.extent_m, along - reach.middle_m + reach.extent_m


def spread(reach: Reach) -> Array:
    """(m,) how far a cube of half edge 1 goes along each direction."""
    far: Array = np.abs(reach.directions).sum(axis=1)
    return far


def turned(reach: Reach, angle_rad: float, reserve_m: float = 0.0) -> Reach:
    """What, used at a fixed heading, is inside the true reach for every heading within `angle_rad` of it.

    Turning by a moves a point by no more than a times its lever arm: (9a) with R fixed, conservatively.
    """
    arm = np.abs(reach.centre_b_m).max(axis=0) + reach.half_m
    lever = np.abs(reach.directions[:, :2]) @ np.array([arm[1], arm[0]])
    return replace(reach, extent_m=reach.extent_m - np.sin(angle_rad) * lever - reserve_m)
