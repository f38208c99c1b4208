"""Numeric inverse kinematics of a limb for many gripper poses at once: damped Gauss-Newton on the pose error.

A first pose is reached from the nearest of many postures spread over the joint ranges; from its solution a few others
start, and from between these all others; those that fail, or end outside the joint limits, start again from the
nearest sample in time that did not.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import numpy as np
from numpy.typing import NDArray

from crux_planner.checker.geometry import Array, cross, rotation_vector, solved
from crux_planner.checker.limb_model import ChainState, Limb

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
    postures, positions, columns = _postures(limb)
    wanted = np.broadcast_to(rotation.T[..., None], columns.shape)
    away = _pose_error(positions, columns, position[:, None], wanted)
    seeds = postures[np.argsort(np.sqrt((away * away).sum(axis=0)))[:16]]
    q, error = _descend(limb, seeds, np.tile(position, (16, 1)), np.tile(rotation, (16, 1, 1)))
    outside = np.maximum(np.maximum(limb.lower_rad - q, q - limb.upper_rad), 0.0).sum(axis=1)
    return np.asarray(q[np.argmin(error.sum(axis=1) * 1e3 + outside)])


@lru_cache(maxsize=16)
def _postures(limb: Limb) -> tuple[Array, Array, Array]:
    """Postures (m, J) spread over the joint ranges, and the gripper's positions (3, m) and columns (3, 3, m) there."""
    postures = limb.lower_rad + _evenly_spread(SEED_POSTURES, len(limb.joints)) * (limb.upper_rad - limb.lower_rad)
    return postures, *_gripper(limb, limb.forward(postures))


def _evenly_spread(count: int, dimension: int) -> Array:
    """Low-discrepancy points (count, dimension) of the unit cube: multiples of powers of 1/phi_d, modulo 1, with phi_d
    the positive root of x^(d + 1) = x + 1 (Roberts 2018).
    """
    root = 1.5
    for _ in range(40):
        root = (1.0 + root) ** (1.0 / (dimension + 1))
    return np.asarray(np.outer(np.arange(1, count + 1), root ** -np.arange(1.0, dimension + 1)) % 1.0)


def _gripper(limb: Limb, state: ChainState) -> tuple[Array, Array]:
    """Position (3, n) of the gripper and columns (3, 3, n) of its rotation: components first, as all that follows."""
    return state.link_position_m[limb.gripper].T, state.link_rotation[limb.gripper].T


def _pose_error(p: Array, columns: Array, position: Array, wanted: Array) -> Array:
    """Position and weighted rotation vector (6, n) from poses (3, n), (3, 3, n) to the wanted ones."""
    skew = 0.5 * (cross(columns[0], wanted[0]) + cross(columns[1], wanted[1]) + cross(columns[2], wanted[2]))
    cosine = np.clip(0.5 * ((columns * wanted).sum(axis=(0, 1)) - 1.0), -1.0, 1.0)
    sine = np.sqrt((skew * skew).sum(axis=0))
    turning = sine > 1e-9
    turn = skew * np.where(turning, np.arctan2(sine, cosine) / np.where(turning, sine, 1.0), 1.0)
    half_turn = np.flatnonzero((sine <= 1e-6) & (cosine < 0.0))
    if len(half_turn) > 0:
        difference = np.einsum("icn,ijn->ncj", wanted[..., half_turn], columns[..., half_turn])
        turn[:, half_turn] = rotation_vector(difference).T
    return np.concatenate([position - p, ROTATION_LENGTH_M * turn])


def _descend(limb: Limb, start: Array, position: Array, rotation: Array) -> tuple[Array, Array]:
    """Damped Gauss-Newton from `start`; returns angles and the norms of (position, weighted orientation) errors."""
    q = np.array(start.T, order="C")
    left = np.full((2, q.shape[1]), np.inf)
    active = np.arange(q.shape[1])
    angles, p, wanted = q, np.ascontiguousarray(position.T), np.ascontiguousarray(rotation.T)  # of the active ones
    weight = np.array([1.0, 1.0, 1.0, ROTATION_LENGTH_M, ROTATION_LENGTH_M, ROTATION_LENGTH_M])[:, None, None]
    for iteration in range(ITERATIONS):
        state = limb.forward(angles.T)
        error = _pose_error(*_gripper(limb, state), p, wanted)
        squares = error * error
        left[:, active] = now = np.sqrt([squares[:3].sum(axis=0), squares[3:].sum(axis=0)])
        moving = np.flatnonzero(now.max(axis=0) > CONVERGED_M)
        if iteration == ITERATIONS - 1 or len(moving) == 0:
            break
        jacobian = weight * limb.jacobian(state).transpose(1, 2, 0)
        if len(moving) < len(active):
            active, angles, p, wanted = active[moving], angles[:, moving], p[:, moving], wanted[..., moving]
            error, squares, jacobian = error[:, moving], squares[:, moving], jacobian[..., moving]
        normal = np.empty((6, 6, len(active)))
        for i in range(6):
            normal[i:, i] = normal[i, i:] = (jacobian[i:] * jacobian[i]).sum(axis=1)
            normal[i, i] += 0.01 * squares.sum(axis=0) + 1e-12
        step = (jacobian * solved(normal, error)[:, None]).sum(axis=0)
        size = np.abs(step).max(axis=0)
        angles = angles + step * np.minimum(1.0, MAX_STEP_RAD / np.maximum(size, 1e-12))
        q[:, active] = angles
    middle = 0.5 * (limb.lower_rad + limb.upper_rad)
    return middle + (q.T - middle + np.pi) % (2.0 * np.pi) - np.pi, left.T
