"""Equation (9a): every gripper stays in its limb's reach and within its range of yaw relative to the body.

Bounds of body positions are along the directions of that reach, x, y and z first: three numbers for boxes.
"""

from dataclasses import replace
from typing import Any

import numpy as np

from crux_planner.model.arrays import Array
from crux_planner.model.problem import Problem
from crux_planner.model.workspace import Reach
from crux_planner.physics.dynamics import rotation


def offset_in_body(r: Any, theta: Any, gripper: Any) -> Any:
    """R(theta)^T (c - r): where the gripper centre is in the body frame (casadi)."""
    return rotation(theta).T @ (gripper - r)


def body_positions(grippers: Array, reach: Reach) -> tuple[Array, Array]:
    """Bounds (..., 4, m) of the body position for which a level, unturned body has grippers (..., 4, 3) in reach."""
    along = grippers @ reach.directions.T
    return along - reach.middle_m - reach.extent_m, along - reach.middle_m + reach.extent_m


def between(problem: Problem, reserve_m: float) -> Reach:
    """What, used for a level body at heading 0, is inside the true reach for all rolls and pitches between none and the
    start's or the goal's, and yaws up to theirs.

    To first order a tilt moves u = R^T q by its cross product with q, to second by no more than half its square.
    """
    reach, rpy_rad = problem.boxes, np.array([problem.start.rpy_rad, problem.goal.body.rpy_rad])
    shape = turned(reach, float(np.abs(rpy_rad[:, 2]).max()), reserve_m)
    tilts = rpy_rad * [1.0, 1.0, 0.0]
    middle, half = reach.centre_b_m.copy(), np.tile(reach.half_m, (4, 1))
    middle[:, 2], half[:, 2] = np.mean(problem.gripper_height_m), np.ptp(problem.gripper_height_m) / 2
    slopes = np.cross(tilts[:, None], reach.directions)  # (k, m, 3): D (q x tilt) = (tilt x D) q
    moved, within = np.einsum("kmi,li->klm", slopes, middle), np.einsum("kmi,li->klm", np.abs(slopes), half)
    rest = np.square(np.abs(tilts).sum(axis=1).max()) / 2 * np.linalg.norm(np.abs(middle) + half, axis=1)[:, None]
    least, most = (moved - within).min(axis=0, initial=0.0), (moved + within).max(axis=0, initial=0.0)
    shift = (least + most) / 2
    return replace(shape, middle_m=shape.middle_m - shift, extent_m=shape.extent_m - (most - least) / 2 - rest)


def turned(reach: Reach, angle_rad: float, reserve_m: float = 0.0) -> Reach:
    """What, used at a fixed heading, is inside the true reach for every heading within `angle_rad` of it.

    Turning by a moves a point by no more than a times its lever arm: (9a) with R fixed, conservatively.
    """
    arm = np.abs(reach.centre_b_m).max(axis=0) + reach.half_m
    lever = np.abs(reach.directions[:, :2]) @ np.array([arm[1], arm[0]])
    return replace(reach, extent_m=reach.extent_m - np.sin(angle_rad) * lever - reserve_m)
