"""Numeric inverse kinematics of a limb for many gripper poses at once: damped Gauss-Newton on the pose error.

A first pose is reached from the nearest of many postures spread over the joint ranges; from its solution a few others
start, and from between these all others; those that fail, or end outside the joint limits, start again from the
nearest sample in time that did not.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from crux_planner.checker.geometry import Array, rotation_vector
from crux_planner.checker.limb_model import Limb

SEED_POSTURES = 1024
STRIDE = 8  # samples of which one is solved from the first pose, the others from what lies between two such
ITERATIONS = 30
MAX_STEP_RAD = 0.4
CONVERGED_M = 1e-7
ROTATION_LENGTH_M = 1.0
"""Weighs an orientation error [rad] against a position error [m]."""


@dataclass(frozen=True)
class Solution:
    """Joint angles (n, J) and what is left of the pose error: position (n,) [m], orientation (n,) [rad]."""

    q_rad: Array
    position_error_m: Array
    rotation_error_rad: Array


def solve(limb: Limb, position_b_m: Array, rotation_b: Array) -> Solution:
    """Joint angles for gripper poses (n, 3), (n, 3, 3) in B that follow each other in time."""
    n = len(position_b_m)
    some = np.unique(np.append(np.arange(0, n, STRIDE), n - 1))
    first = np.tile(_first(limb, position_b_m[0], rotation_b[0]), (len(some), 1))
    found, _ = _descend(limb, first, position_b_m[some], rotation_b[some])
    start = np.stack([np.interp(np.arange(n), some, angles) for angles in found.T], axis=1)
    q, error = _descend(limb, start, position_b_m, rotation_b)
    for _ in range(3):
        good = _good(limb, q, error)
        if good.all() or not good.any():
            break
        bad = np.flatnonzero(~good)
        fine = np.flatnonzero(good)
        nearest = fine[np.abs(fine[None, :] - bad[:, None]).argmin(axis=1)]
        again, left = _descend(limb, q[nearest], position_b_m[bad], rotation_b[bad])
        better = _good(limb, again, left) | (left.sum(axis=1) < 0.5 * error[bad].sum(axis=1))
        q[bad[better]], error[bad[better]] = again[better], left[better]
        if not better.any():
            break
    return Solution(q, error[:, 0], error[:, 1] / ROTATION_LENGTH_M)


def _good(limb: Limb, q: Array, error: Array) -> NDArray[np.bool_]:
    inside = ((q >= limb.lower_rad - 1e-9) & (q <= limb.upper_rad + 1e-9)).all(axis=1)
    return np.asarray(inside & (error.max(axis=1) < 1e-5))


def _first(limb: Limb, position: Array, rotation: Array) -> Array:
    """The best of the descents from the postures nearest to a pose: inside the limits if any is."""
    spread = _evenly_spread(SEED_POSTURES, len(limb.joints))
    postures = limb.lower_rad + spread * (limb.upper_rad - limb.lower_rad)
    state = limb.forward(postures)
    away = _pose_error(state.link_position_m[limb.gripper], state.link_rotation[limb.gripper], position, rotation)
    seeds = postures[np.argsort(np.linalg.norm(away, axis=1))[:16]]
    q, error = _descend(limb, seeds, np.tile(position, (16, 1)), np.tile(rotation, (16, 1, 1)))
    outside = np.maximum(np.maximum(limb.lower_rad - q, q - limb.upper_rad), 0.0).sum(axis=1)
    return np.asarray(q[np.argmin(error.sum(axis=1) * 1e3 + outside)])


def _evenly_spread(count: int, dimension: int) -> Array:
    """Low-discrepancy points (count, dimension) of the unit cube: multiples of powers of 1/phi_d, modulo 1, with phi_d
    the positive root of x^(d + 1) = x + 1 (Roberts 2018).
    """
    root = 1.5
    for _ in range(40):
        root = (1.0 + root) ** (1.0 / (dimension + 1))
    return np.asarray(np.outer(np.arange(1, count + 1), root ** -np.arange(1.0, dimension + 1)) % 1.0)


def _pose_error(p: Array, r: Array, position: Array, rotation: Array) -> Array:
    turn = rotation_vector(rotation @ r.swapaxes(1, 2))
    return np.concatenate([position - p, ROTATION_LENGTH_M * turn], axis=1)


def _descend(limb: Limb, start: Array, position: Array, rotation: Array) -> tuple[Array, Array]:
    """Damped Gauss-Newton from `start`; returns angles and the norms of (position, weighted orientation) errors."""
    q = start.copy()
    left = np.full((len(q), 2), np.inf)
    active = np.arange(len(q))
    weight = np.array([1.0, 1.0, 1.0, ROTATION_LENGTH_M, ROTATION_LENGTH_M, ROTATION_LENGTH_M])
    for iteration in range(ITERATIONS):
        state = limb.forward(q[active])
        error = _pose_error(
            state.link_position_m[limb.gripper],
            state.link_rotation[limb.gripper],
            position[active],
            rotation[active],
        )
        left[active, 0] = np.linalg.norm(error[:, :3], axis=1)
        left[active, 1] = np.linalg.norm(error[:, 3:], axis=1)
        moving = left[active].max(axis=1) > CONVERGED_M
        if iteration == ITERATIONS - 1 or not moving.any():
            break
        jacobian = (limb.jacobian(state) * weight[:, None])[moving]
        error, active = error[moving], active[moving]
        damping = 0.01 * (error * error).sum(axis=1)[:, None, None] + 1e-12
        normal = jacobian @ jacobian.swapaxes(1, 2) + damping * np.eye(6)
        step = (jacobian.swapaxes(1, 2) @ np.linalg.solve(normal, error[..., None]))[..., 0]
        size = np.abs(step).max(axis=1, keepdims=True)
        q[active] += step * np.minimum(1.0, MAX_STEP_RAD / np.maximum(size, 1e-12))
    middle = 0.5 * (limb.lower_rad + limb.upper_rad)
    return middle + (q - middle + np.pi) % (2.0 * np.pi) - np.pi, left
