"""A primal-dual interior-point method for the exact P1 that works stage by stage.

Each column (a limb at a knot) meets the rest of the problem only through the body's state at its knot, and each knot
only its neighbours. So columns are eliminated one by one, and what is left, states and multipliers of the dynamics, by
a Riccati recursion (libcrux_stages.so): time grows linearly with the knots and by a small factor. Every step is
Mehrotra's: one without a barrier says how low the next may be and where products of slack and dual would leave it, and
a second solve with the same factors corrects that (Nocedal and Wright, Numerical Optimization, 19.3).
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from crux_planner.model.arrays import Array, Flags
from crux_planner.solvers import clock
from crux_planner.trajectory.native import StageSystem
from crux_planner.trajectory.stage_functions import POSE
from crux_planner.trajectory.stage_problem import PINNED, Derivatives, StageProblem

FIRST_BARRIER, LAST_BARRIER = 1e-2, 1e-7
_TOLERANCE, _DUAL_TOLERANCE = 1e-8, 1e-5  # the latter of the largest multiplier: rounding grows with it
_ROUNDING = 1e-6  # what (1)-(9) may lack where whole steps change nothing: a tenth of what the check forgives
_STILL, _SAME = 3, 1e-7  # so many whole steps in a row, each of which changes the cost by less than this share of it
_SHORT = 0.1  # of a Newton step: many shorter steps in a row show that the rows contradict each other
_NEAR, _NEAR_GAP = 1e-2, 1e-4  # largest defect, and mean product of slack and dual, of a point near a solution
_SWINGS, _SETTLES = 0.5, 0.1  # the largest defect, by that of the step before: more, or less than that
_UNDAMPED = 40  # steps: most problems are solved by then, and more exactly
_DAMPING, _MORE_DAMPED, _LESS_DAMPED = 10.0, 4.0, 0.5  # of steps of the body's pose, and its factors
_TO_BOUNDARY = 0.995
_LEAST_SLACK = 1e-2  # with which an inequality starts
_LEAST_CENTRING = 1e-4  # of the mean product of slack and dual, what the next barrier is at least
_MOST_CORRECTED = 10.0  # of the barrier: a product is corrected by no more
_OFF_CENTRE = 100.0  # factor by which a product may differ from the mean: rows far off it make the next steps short


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

    It ends where (1)-(9) hold and the slope is nothing, or both no more than rounding: at large multipliers that alone
    is more than the tolerance, and whole steps change the cost no longer.
    """
    bounded = stages.bounded
    iteration, short, still, near, cost, damping, primal = 0, 0, 0, False, np.inf, 0.0, np.inf
    while True:
        before = primal
        try:
            at = stages.derivatives(point.body, point.columns, point.multipliers, _net(point.duals), near=near)
        except np.linalg.LinAlgError:  # of numbers that are no longer finite
            return Outcome(point, iteration, False, cost)
        lacking = np.where(bounded, stages.slack(at.rows) - point.slacks, 0.0)
        defects = at.next_states - point.body[1:]
        gap = _gap(point.slacks, point.duals, bounded)
        off_end = float((stages.pinned * np.abs(point.body[-1] - stages.last)).max())
        primal = max(float(np.abs(defects).max()), float(np.abs(lacking).max()), off_end)
        scale = max(1.0, float(np.abs(point.multipliers).max()), float(point.duals.max()))
        dual = stages.dual_residual(at, point.multipliers, _net(point.duals)) / scale
        near = primal < _NEAR and gap < _NEAR_GAP
        swings = gap < _NEAR_GAP and iteration >= _UNDAMPED
        damping = _damped(damping, primal, before) if swings else 0.0
        still, cost = still + 1 if abs(at.cost - cost) < _SAME * abs(cost) else 0, at.cost
        exact = primal < _TOLERANCE and dual < _DUAL_TOLERANCE
        if gap < 2 * LAST_BARRIER and (exact or (still >= _STILL and primal < _ROUNDING)):
            return Outcome(point, iteration, True, at.cost)
        patience = stages.functions
        spent = iteration >= patience.most_iterations or short >= patience.short_steps or clock.now() > deadline
        if spent or not np.isfinite(primal + dual):
            return Outcome(point, iteration, False, at.cost)
        try:
            step = _corrected_step(NewtonSystem(stages, at, point, damping), defects, lacking, gap)
        except np.linalg.LinAlgError:  # the Hessian of a limb's column is singular: no step leads on
            return Outcome(point, iteration, False, at.cost)
        shares = _shares(point, step, bounded)
        short = short + 1 if shares[0] < _SHORT else 0
        still = still if min(shares) == 1.0 else 0
        point = _centred(_stepped(point, step, shares), bounded)
        iteration += 1


def _damped(damping: float, primal: float, before: float) -> float:
    """More where steps near a solution swing about it, as rows that bend let them; less where they come nearer."""
    if primal > _SWINGS * before:
        return max(_DAMPING, _MORE_DAMPED * damping)
    return _LESS_DAMPED * damping if primal < _SETTLES * before else damping


def _corrected_step(system: NewtonSystem, defects: Array, lacking: Array, gap: float) -> Point:
    """Changes of all variables: to the barrier that a step to none at all promises, what that step does to the products
    of slack and dual by second order taken back."""
    point, bounded = system.point, system.stages.bounded
    plain = system.step(defects, lacking, np.zeros_like(lacking))
    primal_share, dual_share = _shares(point, plain, bounded)
    promised = _gap(point.slacks + primal_share * plain.slacks, point.duals + dual_share * plain.duals, bounded)
    barrier = max(LAST_BARRIER, min(1.0, max((promised / gap) ** 3, _LEAST_CENTRING)) * gap)
    most = _MOST_CORRECTED * barrier
    return system.step(defects, lacking, barrier - np.clip(plain.slacks * plain.duals, -most, most))


class NewtonSystem:
    """The Newton system at a point, factorised: steps for any right side."""

    def __init__(self, stages: StageProblem, at: Derivatives, point: Point, damping: float) -> None:
        self.stages, self.at, self.point = stages, at, point
        self._slacks = np.where(stages.bounded, point.slacks, 1.0)
        self._stiffness = point.duals / self._slacks
        body, columns, cross = stages.condensed(at, self._stiffness.sum(axis=0))
        body[1:, :POSE, :POSE] += damping * np.eye(POSE)
        body[-1] += np.diag(PINNED * stages.pinned)
        self._system = StageSystem(body, columns, cross, at.state_map, at.into_state)

    def step(self, defects: Array, lacking: Array, products: Array) -> Point:
        """Changes of all variables, towards these products of slack and dual (2, R) or one for all; `defects` (N, 12)
        of the dynamics and what slacks lack (2, R)."""
        stages, point, bounded = self.stages, self.point, self.stages.bounded
        pull = np.where(bounded, products / self._slacks, 0.0) - self._stiffness * lacking
        body_slope, column_slope = stages.slopes(self.at, pull[0] - pull[1])
        body_slope[-1] -= PINNED * stages.pinned * (stages.last - point.body[-1])
        body, columns, multipliers = self._system.solve(body_slope, column_slope, defects)
        change = stages.change(self.at, body, columns)
        inwards = np.stack([change, -change])
        return Point(
            body,
            columns,
            multipliers - point.multipliers,
            np.where(bounded, inwards + lacking, 0.0),
            np.where(bounded, pull - point.duals - self._stiffness * inwards, 0.0),
        )


def _gap(slacks: Array, duals: Array, bounded: Flags) -> float:
    """The mean product of slack and dual."""
    return float((slacks * duals)[bounded].sum()) / max(int(bounded.sum()), 1)


def _shares(point: Point, step: Point, bounded: Flags) -> tuple[float, float]:
    """Of a step that keep slacks and duals positive."""
    return _share(point.slacks, step.slacks, bounded), _share(point.duals, step.duals, bounded)


def _stepped(point: Point, step: Point, shares: tuple[float, float]) -> Point:
    primal, dual = shares
    return Point(
        point.body + primal * step.body,
        point.columns + primal * step.columns,
        point.multipliers + primal * step.multipliers,
        point.slacks + primal * step.slacks,
        point.duals + dual * step.duals,
    )


def _centred(point: Point, bounded: Flags) -> Point:
    """The point with duals that leave no product far from the mean."""
    on_path = _gap(point.slacks, point.duals, bounded) / np.where(bounded, point.slacks, 1.0)
    duals = np.clip(point.duals, on_path / _OFF_CENTRE, on_path * _OFF_CENTRE)
    return replace(point, duals=np.where(bounded, duals, 0.0))


def _net(duals: Array) -> Array:
    """Of the rows: the lower bounds' duals less the upper bounds'."""
    return np.asarray(duals[0] - duals[1])


def _share(values: Array, steps: Array, bounded: Flags) -> float:
    """Of a step that keeps the values positive."""
    falling = bounded & (steps < 0)
    if not falling.any():
        return 1.0
    return min(1.0, _TO_BOUNDARY * float((-values[falling] / steps[falling]).min()))
