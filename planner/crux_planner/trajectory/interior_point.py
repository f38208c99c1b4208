"""A primal-dual interior-point method for the exact P1 that works stage by stage.

Each column (a limb at a knot) meets the rest of the problem only through the body's state at its knot, and each knot
only its neighbours. So columns are eliminated all at once by small inverses, and what is left, states and multipliers
of the dynamics, by a Riccati recursion: time grows linearly with the knots and by a small factor.
"""

from dataclasses import dataclass

import numpy as np
from scipy.linalg.lapack import dgesv

from crux_planner.model.arrays import Array, Flags
from crux_planner.solvers import clock
from crux_planner.trajectory.stage_problem import PINNED, Derivatives, StageProblem

FIRST_BARRIER, LAST_BARRIER = 1e-2, 1e-7
_TOLERANCE, _DUAL_TOLERANCE = 1e-8, 1e-5  # the latter of the largest multiplier: rounding grows with it
_MOST_ITERATIONS = 80
_STILL, _SAME = 3, 1e-7  # so many whole steps in a row, each of which changes the cost by less than this share of it
_STALLED, _SHORT = 8, 0.1  # so many steps in a row, each of less of a Newton step: the rows contradict each other
_NEAR, _NEAR_GAP = 1e-2, 1e-4  # largest defect, and mean product of slack and dual, of a point near a solution
_TO_BOUNDARY = 0.995
_LEAST_SLACK = 1e-2  # with which an inequality starts


@dataclass
class Point:
    """Primal and dual variables: body (N + 1, 12), columns (N, 4, 8), multipliers (N, 12) of the dynamics,
    slacks and duals (2, R) of the rows' lower and upper bounds."""

    body: Array
    columns: Array
    multipliers: Array
    slacks: Array
    duals: Array


@dataclass(frozen=True)
class Outcome:
    """Where the method ended."""

    point: Point
    iterations: int
    solved: bool
    cost: float


def first_point(stages: StageProblem, body: Array, columns: Array) -> Point:
    """A point to start from: slacks as large as what rows have or lack, duals on the central path."""
    body = body.copy()
    body[0] = stages.first
    columns = np.where(stages.fixed, stages.fixed_value, columns)
    values = stages.rows(body, columns)
    slacks = np.maximum(np.abs(stages.slack(values)), _LEAST_SLACK)
    duals = stages.bounded * FIRST_BARRIER / slacks
    return Point(body, columns, np.zeros((stages.knots, body.shape[1])), slacks, duals)


@np.errstate(over="ignore", invalid="ignore", divide="ignore")  # it ends where numbers are no longer finite
def minimise(stages: StageProblem, point: Point, deadline: float) -> Outcome:
    """Newton steps on the barrier problem, the barrier lowered as they succeed.

    It ends where (1)-(9) hold and the slope is nothing, or no more than rounding: at large multipliers that alone is
    more than the tolerance, and whole steps change the cost no longer.
    """
    bounded = stages.bounded
    count = max(int(bounded.sum()), 1)
    iteration, short, still, near, barrier, cost = 0, 0, 0, False, FIRST_BARRIER, np.inf
    while True:
        at = stages.derivatives(point.body, point.columns, point.multipliers, _net(point.duals), near=near)
        slack = stages.slack(at.rows)
        lacking = np.where(bounded, slack - point.slacks, 0.0)
        defects = at.next_states - point.body[1:]
        gap = float((point.slacks * point.duals)[bounded].sum()) / count
        off_end = float((stages.pinned * np.abs(point.body[-1] - stages.last)).max())
        primal = max(float(np.abs(defects).max()), float(np.abs(lacking).max()), off_end)
        scale = max(1.0, float(np.abs(point.multipliers).max()), float(point.duals.max()))
        dual = stages.dual_residual(at, point.multipliers, _net(point.duals)) / scale
        near = primal < _NEAR and gap < _NEAR_GAP
        still, cost = still + 1 if abs(at.cost - cost) < _SAME * abs(cost) else 0, at.cost
        if primal < _TOLERANCE and gap < 2 * LAST_BARRIER and (dual < _DUAL_TOLERANCE or still >= _STILL):
            return Outcome(point, iteration, True, at.cost)
        spent = iteration >= _MOST_ITERATIONS or short >= _STALLED or clock.now() > deadline
        if spent or not np.isfinite(primal + dual):
            return Outcome(point, iteration, False, at.cost)
        slacks = np.where(bounded, point.slacks, 1.0)
        stiffness = point.duals / slacks
        pull = np.where(bounded, barrier / slacks, 0.0) - stiffness * lacking
        try:
            step = newton_step(stages, at, point, defects, stiffness.sum(axis=0), pull[0] - pull[1])
        except np.linalg.LinAlgError:  # the Hessian of a limb's column is singular: no step leads on
            return Outcome(point, iteration, False, at.cost)
        body, columns, multipliers, change = step
        slack_step = np.where(bounded, np.stack([change, -change]) + lacking, 0.0)
        dual_step = np.where(bounded, pull - point.duals - stiffness * np.stack([change, -change]), 0.0)
        primal_share = _share(point.slacks, slack_step, bounded)
        short = short + 1 if primal_share < _SHORT else 0
        dual_share = _share(point.duals, dual_step, bounded)
        point = Point(
            point.body + primal_share * body,
            point.columns + primal_share * columns,
            point.multipliers + primal_share * (multipliers - point.multipliers),
            point.slacks + primal_share * slack_step,
            point.duals + dual_share * dual_step,
        )
        reached = float((point.slacks * point.duals)[bounded].sum()) / count
        shorter = min(primal_share, dual_share)
        still = still if shorter == 1.0 else 0
        barrier = max(LAST_BARRIER, min(1.0, (1.0 - shorter) ** 2 + 0.1) * reached)
        iteration += 1


def newton_step(
    stages: StageProblem, at: Derivatives, point: Point, defects: Array, stiffness: Array, pull: Array
) -> tuple[Array, Array, Array, Array]:
    """Steps of body and columns, the new multipliers, and the rows' change."""
    body_hessian, column_hessian, cross, body_slope, column_slope = stages.condensed(at, stiffness, pull)
    inverse = np.linalg.inv(column_hessian)  # (N, 4, 8, 8)
    into = at.into_state  # (N, 4, 12, 8): of a column on the next state
    cross_inverse, into_inverse = cross @ inverse, into @ inverse
    hessian = body_hessian.copy()
    hessian[:-1] -= (cross_inverse @ cross.swapaxes(-1, -2)).sum(axis=1)
    slope = body_slope.copy()
    slope[:-1] -= (cross_inverse @ column_slope[..., None]).sum(axis=1)[..., 0]
    free = at.state_map - (into_inverse @ cross.swapaxes(-1, -2)).sum(axis=1)
    supply = (into_inverse @ into.swapaxes(-1, -2)).sum(axis=1)
    offset = defects - (into_inverse @ column_slope[..., None]).sum(axis=1)[..., 0]
    pinned = stages.pinned
    hessian[-1] += np.diag(PINNED * pinned)
    slope[-1] -= PINNED * pinned * (stages.last - point.body[-1])
    body, multipliers = _riccati(hessian, slope, free, supply, offset)
    columns = -np.einsum(
        "klij,klj->kli",
        inverse,
        column_slope + np.einsum("klij,ki->klj", cross, body[:-1]) + np.einsum("klij,ki->klj", into, multipliers),
    )
    return body, columns, multipliers, stages.change(at, body, columns)


def _riccati(hessian: Array, slope: Array, free: Array, supply: Array, offset: Array) -> tuple[Array, Array]:
    """x[0] = 0, x[k + 1] = free x[k] - supply m[k] + offset, m[k] the slope of all that comes after; steps and m."""
    n, size = offset.shape
    identity = np.eye(size)
    # LAPACK itself: numpy's solve takes six times as long for one small matrix
    gains = np.empty((n, size, size + 1))
    value, push = hessian[n], slope[n]
    right = np.empty((size, size + 1))
    for k in range(n - 1, -1, -1):
        right[:, :size] = value @ free[k]
        right[:, size] = value @ offset[k] + push
        gains[k] = dgesv(identity + value @ supply[k], right)[2]
        back = free[k].T @ gains[k]
        value = hessian[k] + back[:, :size]
        value = (value + value.T) / 2
        push = slope[k] + back[:, size]
    steps, multipliers = np.zeros((n + 1, size)), np.empty((n, size))
    for k in range(n):
        multipliers[k] = gains[k, :, :size] @ steps[k] + gains[k, :, size]
        steps[k + 1] = free[k] @ steps[k] - supply[k] @ multipliers[k] + offset[k]
    return steps, multipliers


def _net(duals: Array) -> Array:
    """Of the rows: the lower bounds' duals less the upper bounds'."""
    return np.asarray(duals[0] - duals[1])


def _share(values: Array, steps: Array, bounded: Flags) -> float:
    """Of a step that keeps the values positive."""
    falling = bounded & (steps < 0)
    if not falling.any():
        return 1.0
    return min(1.0, _TO_BOUNDARY * float((-values[falling] / steps[falling]).min()))
