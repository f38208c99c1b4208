"""ipopt on the stages of an exact P1: used where the own interior-point method does not converge.

Bounds are those of `stage_problem`, equations those of `stage_functions`; here they become one program of casadi's,
mapped over the knots and over all columns in stance, a knot and a limb each.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np
from scipy.sparse import bsr_array

from crux_planner.model.arrays import Array
from crux_planner.model.problem import BODY_STATES
from crux_planner.physics.dynamics import WRENCH_INPUTS
from crux_planner.solvers.ipopt import ONCE, Nlp
from crux_planner.trajectory.stage_functions import COLUMN, SPINE_WEIGHT
from crux_planner.trajectory.stage_problem import StageProblem

ITERATIONS = 80  # after which other sequences of contacts promise more; a count, so that plans depend on no clock


@dataclass(frozen=True)
class Optimum:
    """Body states (N + 1, 12) and columns (N, 4, 8) where ipopt ended, and how."""

    body: Array
    columns: Array
    cost: float
    iterations: int
    status: str
    solved: bool


class _Rows:
    """Constraints low <= g <= high, collected."""

    def __init__(self) -> None:
        self.expressions: list[Any] = []
        self.low: list[Array] = []
        self.high: list[Array] = []

    def add(self, expression: Any, low: Array | float, high: Array | float) -> None:
        """`expression` is a matrix (rows, n); bounds are (n, rows), or one number for all."""
        self.expressions.append(ca.vec(expression))
        self.low.append(np.broadcast_to(low, expression.T.shape).ravel())
        self.high.append(np.broadcast_to(high, expression.T.shape).ravel())


def solve(stages: StageProblem, body: Array, columns: Array, time_limit_s: float, most_iterations: int) -> Optimum:
    """Solve P1 of a schedule from body states (N + 1, 12) and columns (N, 4, 8)."""
    f, n, stance = stages.functions.equations, stages.knots, stages.stance
    knots, limbs = np.nonzero(stance)
    x = ca.MX.sym("x", BODY_STATES, n + 1)
    u = ca.MX.sym("u", COLUMN, len(knots))
    grasps = stages.grasps[stance].T
    low, high = stages.split(stages.low), stages.split(stages.high)

    rows = _Rows()
    rows.add(f.step.map(n)(x[:, :-1], _totals(stages, u), stages.hands.T) - x[:, 1:], 0.0, 0.0)
    rows.add(f.reach.map(n)(x[:, 1:], stages.grippers.T), low[1], high[1])
    rough = stages.rough[stance].any(axis=-1)
    if which := np.flatnonzero(rough).tolist():
        slack = f.surface.map(len(which))(u[:, which], stages.fingers[stance][rough].T)
        rows.add(slack, low[3][stance][rough], high[3][stance][rough])
    if len(at := stages.limited[0]):
        here = [int(np.flatnonzero((knots == k) & (limbs == limb))[0]) for k, limb in zip(*stages.limited, strict=True)]
        given = x[:, at.tolist()], u[:WRENCH_INPUTS, here], grasps[:, here], stages.functions.numbers[limbs[here]].T
        rows.add(f.torques.map(len(at))(*given), low[4], high[4])

    cost = ca.sum2(f.body_cost.map(n + 1)(x)) + ca.sum2(f.column_cost.map(len(knots))(u))
    by_spines = np.flatnonzero(stages.by_spines[stance]).tolist()
    cost += SPINE_WEIGHT * ca.sumsqr(u[:3, by_spines])
    fixed, value = stages.fixed[stance], stages.fixed_value[stance]
    last = [np.where(stages.pinned > 0.0, stages.last, bounds[0][-1]) for bounds in (low, high)]
    bounds = [
        np.concatenate([stages.first, b[0][:-1].ravel(), end, np.where(fixed, value, b[2][stance]).ravel()])
        for b, end in zip((low, high), last, strict=True)
    ]
    nlp = {"x": ca.veccat(x, u), "f": cost, "g": ca.vertcat(*rows.expressions)}
    row_bounds = np.concatenate(rows.low), np.concatenate(rows.high)
    options = {**ONCE, "ipopt.max_iter": most_iterations, "ipopt.max_cpu_time": time_limit_s}
    solver = Nlp(nlp, (bounds[0], bounds[1]), row_bounds, options)
    found = solver.solve(np.concatenate([body.ravel(), columns[stance].ravel()]))
    columns = stages.empty_columns()
    columns[stance] = found.x[body.size :].reshape(-1, COLUMN)
    ended = found.x[: body.size].reshape(body.shape)
    return Optimum(ended, columns, found.cost, found.iterations, found.status, found.solved)


def _totals(stages: StageProblem, u: Any) -> Any:
    """Force and moment about the origin (6, N) at every knot, of columns u (8, P) in stance."""
    stance = stages.stance
    first = np.concatenate([[0], np.cumsum(stance.sum(axis=1))])
    maps = bsr_array((stages.maps[stance], np.arange(first[-1]), first), shape=(6 * len(stance), 5 * first[-1]))
    return ca.reshape(ca.DM(maps.tocsc()) @ ca.vec(u[:WRENCH_INPUTS, :]), 6, len(stance))
