"""Where the body can be with given grasps, (9a) at any orientation: axis-aligned boxes, one a cell of yaw.

c - r = Rz(yaw) q = Rz(yaw) T u, with u in the reach, T a tilt and c the point that the reach is about. For the yaws of
a cell r is in the box that the cell's middle gives, widened by what the cell's edges and the tilt's second order can do
(`mass.level_spans` has q of u). To first order a tilt shifts the boxes of all limbs alike, by at most `shift_m`, and
costs what (6) asks for it.
"""

from dataclasses import dataclass

import numpy as np
from crux_contracts.robot import Limb

from crux_planner.model.arrays import Array
from crux_planner.model.problem import Problem

_YAW_STEPS_RAD = ((0.1, 0.05), (0.5, 0.1), (np.inf, 0.15))  # up to a yaw, how wide cells are
_TILTS = 3  # cells of the tilt about an axis


@dataclass(frozen=True)
class Orientations:
    """Cells of yaw and of tilt, each with the least that J asks at a knot for being in it."""

    yaw_low: Array  # (Y,)
    yaw_high: Array
    yaw_cost: Array
    shift_m: Array  # (T,) of the boxes along x and y, up to the upper end of the cell
    tilt_cost: Array  # (T, 2) for a shift along x (pitch) and along y (roll)


def orientations(problem: Problem, least: float, most: float) -> Orientations:
    """Yaws from `least` to `most`, tilts within the bounds (7)."""
    weight, goal, tilt = problem.weights.orientation, problem.goal.body.rpy_rad, problem.body.max_tilt_rad
    edges = [0.0]
    for end, step in _YAW_STEPS_RAD:
        while edges[-1] < min(end, max(-least, most)) - 1e-9:
            edges.append(edges[-1] + step)
    both = np.clip(np.unique(np.concatenate([-np.array(edges), edges])), least, most)
    low, high = both[:-1], both[1:]
    low, high = low[high > low], high[high > low]
    away = np.maximum(np.maximum(low - goal[2], goal[2] - high), 0.0)
    ends = tilt * np.arange(1, _TILTS + 1) / _TILTS
    begins = np.concatenate([[0.0], ends[:-1]])
    tilted = np.maximum(begins[:, None] - np.abs(goal[[1, 0]]), 0.0)
    return Orientations(low, high, weight * away**2, np.tan(ends) * _most_m(problem), weight * tilted**2)


def _most_m(problem: Problem) -> float:
    """Most that the contacts' points of (9a) and the body are apart along W's z."""
    heights = np.array([contact.centre_h_m[2] for contact in problem.contacts]) + problem.boxes.above_m
    return float(np.abs(np.subtract.outer(heights, problem.body.height_m)).max())


def body_boxes(problem: Problem, about: Orientations) -> tuple[Array, Array]:
    """Bounds (4, C, Y, 3) of the body's position when a limb holds a contact; shifts by tilts come on top."""
    boxes, tilt = problem.boxes, problem.body.max_tilt_rad
    arm = np.abs(boxes.centre_b_m).max(axis=0) + boxes.half_m  # largest |u|
    bent, lean = 1.0 / np.cos(tilt) - 1.0, float(np.tan(tilt)) * _most_m(problem)
    half = boxes.half_m[:2] + bent * arm[:2]
    half[1] += np.tan(tilt) * np.sin(tilt) * ((1.0 + bent) * arm[0] + lean)
    most = np.abs(boxes.centre_b_m[:, :2]).max(axis=0) + half
    middle, wide = (about.yaw_low + about.yaw_high) / 2, (about.yaw_high - about.yaw_low) / 2
    c, s = np.cos(middle), np.sin(middle)
    tilted = np.abs(s) * lean  # a tilt's shift, turned by the yaw
    sides = np.full((4, len(middle), 2, 3), [[-np.inf], [np.inf]])  # lower and upper end of Rz T u
    for limb, a in enumerate(boxes.centre_b_m):
        for axis, (along, across) in enumerate(((c * a[0] - s * a[1], 1), (s * a[0] + c * a[1], 0))):
            turned = np.abs(c) * half[axis] + np.abs(s) * half[across] + tilted
            turned += wide * (most[across] + (np.abs(s) + wide) * most[axis])
            sides[limb, :, 0, axis], sides[limb, :, 1, axis] = along - turned, along + turned
    centres = np.stack([contact.centre_h_m for contact in problem.contacts])  # boxes are along x and y
    low = centres[None, :, None, :] - sides[:, None, :, 1]
    high = centres[None, :, None, :] - sides[:, None, :, 0]
    low[..., 2], high[..., 2] = problem.body.height_m
    return low, high


def shoulders(problem: Problem, about: Orientations, limb: int) -> tuple[Array, Array]:
    """A limb's shoulder off the body's origin along H's x and y: (Y, 2) in the middle of each cell of yaw, and (Y,) how
    far off that it can be, for any tilt.
    """
    b, tilt = problem.limb_masses[limb].limb.shoulder_b_m, problem.body.max_tilt_rad
    middle, half = (about.yaw_low + about.yaw_high) / 2, (about.yaw_high - about.yaw_low) / 2
    c, s = np.cos(middle), np.sin(middle)
    tilted = (1.0 - np.cos(tilt)) * np.abs(b[:2]).sum() + np.sin(tilt) ** 2 * abs(b[1]) + 2 * np.sin(tilt) * abs(b[2])
    place = np.column_stack([c * b[0] - s * b[1], s * b[0] + c * b[1]])
    return place, half * float(np.linalg.norm(b[:2])) + tilted


def shoulder_to_wrist(limb: Limb) -> tuple[float, float]:
    """Shortest and longest [m] up to the joint limits, and a little."""
    low, high = limb.lower_rad[2], limb.upper_rad[2]
    bends = max(abs(low), abs(high)), 0.0 if low <= 0.0 <= high else min(abs(low), abs(high))
    upper, lower = limb.upper_link_m, limb.lower_link_m
    ends = [float(upper**2 + lower**2 + 2 * upper * lower * np.cos(min(bend, np.pi))) ** 0.5 for bend in bends]
    return 0.999 * ends[0], 1.001 * ends[1]
