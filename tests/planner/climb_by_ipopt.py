"""The exact P1 of a climb as a program for ipopt: what the planner's own interior-point method must agree with.

Bounds are those of `stage_problem`, equations those of `stage_functions`; here they become one program of casadi's,
mapped over the knots and over all columns in stance, a knot and a limb each.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import casadi as ca
import numpy as np
from crux_planner.model.arrays import Array
from crux_planner.model.problem import BODY_STATES, Problem
from crux_planner.model.schedule import Schedule
from crux_planner.physics.cost import schedule_cost
from crux_planner.physics.dynamics import WRENCH_INPUTS, centre_of_mass, euler_step
from crux_planner.solvers.ipopt import Nlp
from crux_planner.solvers.mapped import Mapped
from crux_planner.trajectory import stage_functions
from crux_planner.trajectory.exact import columns_of
from crux_planner.trajectory.solution import Place, Start
from crux_planner.trajectory.stage_functions import COLUMN, SPINE_WEIGHT, StageFunctions
from crux_planner.trajectory.stage_problem import StageProblem
from scipy.sparse import bsr_array

ONCE: dict[str, Any] = {
    "ipopt.mu_strategy": "adaptive",
    "ipopt.tol": 1e-4,
    "ipopt.constr_viol_tol": 1e-7,
    "ipopt.compl_inf_tol": 1e-3,
    "ipopt.acceptable_iter": 0,
    "ipopt.max_iter": 300,
}


class Optimum(NamedTuple):
    """Where ipopt ended: J, the largest joint torque of each place over its limit, and whether it is a solution."""

    cost: float
    torque_shares: dict[Place, float]
    solved: bool


class _Equations(NamedTuple):
    """The equations alone, as functions of casadi's columns, for a solver that differentiates by itself."""

    step: ca.Function  # (x, total, hands)
    reach: ca.Function  # (x, grippers)
    surface: ca.Function  # (u, fingers)
    torques: ca.Function  # (x, q, grasp, numbers of the limb)
    body_cost: ca.Function  # (x)
    column_cost: ca.Function  # (u)

    @classmethod
    def of(cls, functions: StageFunctions) -> _Equations:
        x, total, hands = (ca.SX.sym(name, n) for name, n in (("x", BODY_STATES), ("w", 6), ("hands", 16)))
        centre = centre_of_mass(functions.problem, x, ca.vertsplit(hands, 4))
        after = euler_step(x, total[0:3], total[3:6], centre, functions.problem)
        f = functions
        torques = stage_functions._make_torque_values(f._torque_given)  # what is kept on disk has no symbols
        others = (f.reach, f.surface, torques, f.body_cost, f.column_cost)
        return cls(ca.Function("step", [x, total, hands], [after]), *map(_equation, others))


def _equation(mapped: Mapped) -> ca.Function:
    """The first output, of the arguments that it depends on."""
    arguments = mapped.function.sx_in()
    value = mapped.function(*arguments)
    value = value[0] if mapped.function.n_out() > 1 else value
    needed = [argument for argument in arguments if ca.depends_on(value, argument)]
    return ca.Function(mapped.function.name(), needed, [value])


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


def solve(
    problem: Problem,
    schedule: Schedule,
    start: Start,
    limited: frozenset[Place] = frozenset(),
    options: dict[str, Any] = ONCE,
) -> Optimum:
    """P1 of a schedule, with constraints on the joint torques at the places `limited`."""
    stages = StageProblem(StageFunctions(problem), problem, schedule).limiting(limited, problem)
    body, columns = start.body, columns_of(stages, start)
    f, n, stance = _Equations.of(stages.functions), stages.knots, stages.stance
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
        given = (
            x[:, at.tolist()],
            u[:WRENCH_INPUTS, here],
            grasps[:, here],
            np.array([[*problem.limb_masses[limb].numbers, *problem.gravity_h] for limb in limbs[here]]).T,
        )
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
    solver = Nlp(nlp, (bounds[0], bounds[1]), row_bounds, {**options, "ipopt.max_cpu_time": 60.0})
    found = solver.solve(np.concatenate([body.ravel(), columns[stance].ravel()]))
    columns = np.zeros((stages.knots, 4, COLUMN))
    columns[stance] = found.x[body.size :].reshape(-1, COLUMN)
    shares = stages.torque_shares(found.x[: body.size].reshape(body.shape), columns)
    return Optimum(found.cost + schedule_cost(schedule, problem), shares, found.solved)


def _totals(stages: StageProblem, u: Any) -> Any:
    """Force and moment about the origin (6, N) at every knot, of columns u (8, P) in stance."""
    stance = stages.stance
    first = np.concatenate([[0], np.cumsum(stance.sum(axis=1))])
    maps = bsr_array((stages.maps[stance], np.arange(first[-1]), first), shape=(6 * len(stance), 5 * first[-1]))
    return ca.reshape(ca.DM(maps.tocsc()) @ ca.vec(u[:WRENCH_INPUTS, :]), 6, len(stance))
