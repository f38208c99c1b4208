"""Acceptance boxes of (9a): where, in the body frame, a gripper may be, computed from the limb's real workspace.

A gripper stands upright on the wall (its z along W's z) while the body tilts and the gripper turns about W's z. A grid
of positions is kept where inverse kinematics exists, with a margin to every joint limit, for every corner of the range
of tilt and yaw. The box holds every height a gripper needs to grasp and to lift over the faces it held; in plan view it
is the largest rectangle inside that set, and it then grows upwards as far as it fits.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from crux_contracts.robot import Limb

from crux_planner.model.arrays import Array, Flags
from crux_planner.model.kinematics import inverse, limit_margin, rotation_from_rpy, rotation_z

GRID_M = 0.01
JOINT_MARGIN_RAD = 0.05  # covers the grid between its points, IK of a tracked (not exact) pose, and encoder offsets
_SMALLEST_HALF_M = 0.02  # a box smaller than this is no workspace


class WorkspaceError(ValueError):
    """The limbs leave no acceptance box for the asked range of heights, tilt and yaw."""


@dataclass(frozen=True)
class WorkspaceRange:
    """What the box must hold for: the ranges of body and gripper the planner may use."""

    body_height_m: tuple[float, float]
    pad_height_m: tuple[float, float]  # of a grasp above the wall
    lift_height_m: float  # a gripper must get so high above the wall, however low the body
    max_swing_height_m: float
    max_tilt_rad: float
    gripper_yaw_rad: tuple[float, float]  # relative to the body


@dataclass(frozen=True)
class AcceptanceBoxes:
    """|R(theta)^T (c_l - r) - centre_l| <= half of (9a), limbs LF, RF, LR, RR."""

    centre_b_m: Array  # (4, 3)
    half_m: Array  # (3,)


def acceptance_boxes(limbs: Sequence[Limb], wanted: WorkspaceRange) -> AcceptanceBoxes:
    """The acceptance boxes of all limbs, mirror images of one another."""
    signs = np.array([np.sign(limb.shoulder_b_m[:2]) for limb in limbs])
    low, high = _largest_box(limbs[0], wanted)
    centre, half = (low + high) / 2, (high - low) / 2
    mirror = np.concatenate([signs * signs[0], np.ones((len(limbs), 1))], axis=1)
    boxes = AcceptanceBoxes(centre * mirror, half)
    for limb, middle in zip(limbs[1:], boxes.centre_b_m[1:], strict=True):
        if not reachable(limb, _corners(middle, half), wanted).all():
            raise WorkspaceError(
                "the limbs are not mirror images of the first one, their acceptance boxes would differ"
            )
    return boxes


def reachable(limb: Limb, position_b_m: Array, wanted: WorkspaceRange) -> Flags:
    """Whether the gripper reaches positions (..., 3) for every corner of tilt and yaw, with margin to the limits."""
    ok = np.ones(position_b_m.shape[:-1], dtype=bool)
    low, high = wanted.gripper_yaw_rad
    for roll in (-wanted.max_tilt_rad, wanted.max_tilt_rad):
        for pitch in (-wanted.max_tilt_rad, wanted.max_tilt_rad):
            untilt = rotation_from_rpy(np.array([roll, pitch, 0.0])).T
            for yaw in (low, (low + high) / 2, high):
                rotation = np.broadcast_to(untilt @ rotation_z(yaw), (*ok.shape, 3, 3))
                q, reached = inverse(limb, position_b_m, rotation)
                ok &= reached & (limit_margin(limb, q) >= JOINT_MARGIN_RAD)
    return ok


def _largest_box(limb: Limb, wanted: WorkspaceRange) -> tuple[Array, Array]:
    """Lower and upper corner of the largest box in the limb's own quadrant that holds every grasp height."""
    quadrant = np.sign(limb.shoulder_b_m[:2])
    span = limb.upper_link_m + limb.lower_link_m
    # Kept half a grid step off the body's middle planes, so that boxes of two limbs never overlap.
    x = np.arange(GRID_M / 2, abs(limb.shoulder_b_m[0]) + span, GRID_M)
    y = np.arange(GRID_M / 2, abs(limb.shoulder_b_m[1]) + span, GRID_M)
    bottom = wanted.pad_height_m[0] - wanted.body_height_m[1]
    top = wanted.max_swing_height_m - wanted.body_height_m[0]
    z = np.linspace(bottom, top, int(np.ceil((top - bottom) / GRID_M)) + 1)
    inside_up_to = np.logical_and.accumulate(
        reachable(limb, np.stack(np.meshgrid(x * quadrant[0], y * quadrant[1], z, indexing="ij"), axis=-1), wanted),
        axis=2,
    )
    level = int(np.searchsorted(z, wanted.lift_height_m - wanted.body_height_m[0] - 1e-9))
    area, (i0, i1, j0, j1) = largest_rectangle(inside_up_to[:, :, level])
    if area == 0:
        raise WorkspaceError("no acceptance box: the limb cannot grasp and lift over the whole range of body heights")
    while level + 1 < len(z) and inside_up_to[i0 : i1 + 1, j0 : j1 + 1, level + 1].all():
        level += 1
    inner, outer = np.array([x[i0], y[j0]]) * quadrant, np.array([x[i1], y[j1]]) * quadrant
    low, high = np.append(np.minimum(inner, outer), z[0]), np.append(np.maximum(inner, outer), z[level])
    if ((high - low) / 2 < _SMALLEST_HALF_M).any():
        raise WorkspaceError(f"the limb's acceptance box would be only {high - low} m large")
    return low, high


def largest_rectangle(mask: Flags) -> tuple[float, tuple[int, int, int, int]]:
    """Largest axis-aligned rectangle of true cells, between cell centres: area in cells and (i0, i1, j0, j1)."""
    n, m = mask.shape
    counts = np.vstack([np.zeros((1, m), dtype=int), np.cumsum(mask, axis=0)])
    first, last = np.triu_indices(n, k=1)
    full = counts[last + 1] - counts[first] == (last - first + 1)[:, None]  # column all true between rows first..last
    run = np.zeros(len(first), dtype=int)
    best_run, best_end = np.zeros_like(run), np.zeros_like(run)
    for j in range(m):
        run = np.where(full[:, j], run + 1, 0)
        longer = run > best_run
        best_run, best_end = np.where(longer, run, best_run), np.where(longer, j, best_end)
    area = (last - first) * np.maximum(best_run - 1, 0)
    i = int(np.argmax(area))
    end = int(best_end[i])
    return float(area[i]), (int(first[i]), int(last[i]), end - int(best_run[i]) + 1, end)


def _corners(centre: Array, half: Array) -> Array:
    signs = np.stack(np.meshgrid(*[[-1.0, 0.0, 1.0]] * 3, indexing="ij"), axis=-1)
    return centre + signs * half
