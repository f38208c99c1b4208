"""The paper's benchmark on a walk: P1 as one NLP, its binaries continuous (solvers/relaxation.py).

alpha in [0, 1] a foot and knot with alpha (1 - alpha) <= relaxation. A foot in contact stays where it is and on the
surface, alpha |p_next - p|^2 <= relaxation and alpha z <= relaxation, and only then it pushes: its normal force is
between alpha times the least load and alpha times the most. What it reaches may be no gait, and then that is said.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from typing import Any

import casadi as ca
import numpy as np
from crux_contracts import LIMB_NAMES

from crux_planner.admm.motion_block import FORCE_UNIT_N, Ends, body_cost_function
from crux_planner.errors import InfeasibleError
from crux_planner.model.arrays import Array, Flags
from crux_planner.model.gait import LEAST_AIR, SPEED_SHARE
from crux_planner.model.problem import BODY_STATES
from crux_planner.model.slots import FIRST_LIFT, LAST_LAND, LEAST_GAP, Slot, Slots
from crux_planner.model.walk_problem import FINAL_FOOT_M, WalkProblem
from crux_planner.physics.bounds import FEET_APART_M, least_load_N, rate_steps, walk_bounds
from crux_planner.physics.cost import FORCE_SHARE, walk_cost
from crux_planner.physics.limit_surface import SMOOTHING_N
from crux_planner.solvers.relaxation import Relaxed
from crux_planner.trajectory.walk_qp import WalkKnots

_FEET = 4
_LENGTH_UNIT_M = 0.02
_ROOM_N = 0.05  # that forces of feet in the air have, so that ipopt has some, too
_FIRST_ALPHA = 0.8  # at 0.5 alpha (1 - alpha) has no gradient
_MEAN_OF_FASTEST = 1 / 1.5  # of the smooth way of a step: its mean speed over its largest
_IPOPT = {  # else it does not come to an end at the first relaxation
    "ipopt.mu_init": 1e-2,
    "ipopt.tol": 1e-2,
    "ipopt.dual_inf_tol": 0.1,
    "ipopt.compl_inf_tol": 1e-2,
}
_SIZES = (BODY_STATES, 3 * _FEET, _FEET, 3 * _FEET)  # x, feet, alpha, forces of a knot


class WalkBenchmark:
    """P1 of one walk as an NLP over all knots."""

    def __init__(self, problem: WalkProblem) -> None:
        self.problem, n = problem, problem.steps
        z, relaxation = ca.MX.sym("z", sum(_SIZES), n + 1), ca.MX.sym("relaxation")
        x, p, alpha, u = _parts(z)
        step = _step_function(problem).map(n)(z[:, :-1], z[:, 1:], ca.repmat(relaxation, 1, n))
        knot = _knot_function(problem).map(n + 1)(z, ca.repmat(relaxation, 1, n + 1))
        reach = Ends.of(problem).reach().map(n)(x[:, 1:], p[:, 1:])
        weights = problem.weights
        cost = ca.sum2(body_cost_function(problem).map(n + 1)(x))
        cost += FORCE_SHARE * weights.wrench * FORCE_UNIT_N**2 * ca.sumsqr(u[:, :-1])  # nothing follows the last ones
        cost += weights.lift * ca.sum2(ca.sum1(p[2::3, :])) + weights.switching * ca.sumsqr(
            alpha[:, 1:] - alpha[:, :-1]
        )
        step_low, step_high = _step_row_bounds(problem)
        middle, half = problem.boxes.centre_b_m.ravel(), np.tile(problem.boxes.half_m, _FEET)
        many = knot.shape[0]
        row_bounds = (
            np.concatenate([np.tile(step_low, n), np.tile(middle - half, n), np.zeros(many * (n + 1))]),
            np.concatenate([np.tile(step_high, n), np.tile(middle + half, n), np.full(many * (n + 1), np.inf)]),
        )
        nlp = {"x": ca.vec(z), "p": relaxation, "f": cost, "g": ca.veccat(step, reach, knot)}
        self._relaxed = Relaxed(nlp, self._bounds(), row_bounds, lambda values: self._rows(values)[2], _IPOPT)

    def solve(self, deadline: float, report: Callable[[str], None] = lambda _line: None) -> tuple[WalkKnots, list[int]]:
        """The walk and ipopt's iterations for each relaxation. Raises InfeasibleError where it reaches no gait."""
        values, iterations = self._relaxed.solve(self._guess(), deadline, report)
        return self._walk(values), iterations

    def _rows(self, values: Array) -> list[Array]:
        """x, feet, alpha, forces, each with a row a knot."""
        return np.split(values.reshape(self.problem.steps + 1, -1), np.cumsum(_SIZES)[:-1], axis=1)

    def _walk(self, values: Array) -> WalkKnots:
        problem, n = self.problem, self.problem.steps
        x, p, alpha, u = self._rows(values)
        slots = slots_of(alpha > 0.5)
        if not slots.possible(problem, _FEET):
            names = ", ".join(
                f"{LIMB_NAMES[i]} {land - lift}" for i, each in enumerate(slots.of_limb) for lift, land in each
            )
            raise InfeasibleError("benchmark", f"the benchmark NLP ends with steps that no foot makes (knots: {names})")
        gait = slots.gait(n + 1)
        feet = p.reshape(n + 1, _FEET, 3)
        footholds = np.vstack([problem.start_feet_h_m, *[feet[step.land, step.limb, :2] for step in gait.steps]])
        forces = FORCE_UNIT_N * u[:n].reshape(n, _FEET, 3) * gait.stance[:n, :, None]
        return WalkKnots(gait, x, forces, footholds, problem, walk_cost(problem, gait, x, forces))

    def _bounds(self) -> tuple[Array, Array]:
        problem, n = self.problem, self.problem.steps
        low_x, high_x = walk_bounds(problem, None)
        low_p = np.tile([-np.inf, -np.inf, 0.0], (n + 1, _FEET))
        high_p = np.tile([np.inf, np.inf, problem.step_height_m], (n + 1, _FEET))
        low_p[0] = high_p[0] = np.column_stack([problem.start_feet_h_m, np.zeros(_FEET)]).ravel()
        there = np.column_stack([problem.goal_feet_h_m, np.zeros(_FEET)])
        slack = np.array([FINAL_FOOT_M, FINAL_FOOT_M, 0.0])
        low_p[-1], high_p[-1] = (there - slack).ravel(), (there + slack).ravel()
        low_alpha, high_alpha = np.zeros((n + 1, _FEET)), np.ones((n + 1, _FEET))
        low_alpha[:FIRST_LIFT] = low_alpha[n - LAST_LAND :] = 1.0
        most = problem.max_normal_N / FORCE_UNIT_N
        low_u = np.tile([-problem.friction * most, -problem.friction * most, 0.0], (n + 1, _FEET))
        high_u = np.tile([problem.friction * most, problem.friction * most, most], (n + 1, _FEET))
        low_u[-1] = high_u[-1] = self._standing()  # nothing follows
        low, high = [low_x, low_p, low_alpha, low_u], [high_x, high_p, high_alpha, high_u]
        return np.hstack(low).ravel(), np.hstack(high).ravel()

    def _guess(self) -> Array:
        """Straight to the goal, feet with the body, all as much in contact, the weight on all four."""
        problem, n = self.problem, self.problem.steps
        way = np.linspace(0.0, 1.0, n + 1)[:, None]
        x = np.zeros((n + 1, BODY_STATES))
        start, goal = problem.start, problem.goal.body
        pose = np.concatenate([start.position_m, start.rpy_rad])
        x[:, :6] = pose + way * (np.concatenate([goal.position_m, goal.rpy_rad]) - pose)
        feet = problem.start_feet_h_m + way[..., None] * (problem.goal_feet_h_m - problem.start_feet_h_m)
        p = np.concatenate([feet, np.zeros((n + 1, _FEET, 1))], axis=2).reshape(n + 1, -1)
        return np.hstack([x, p, np.full((n + 1, _FEET), _FIRST_ALPHA), np.tile(self._standing(), (n + 1, 1))]).ravel()

    def _standing(self) -> Array:
        return np.tile(-self.problem.mass_kg * self.problem.gravity_h / _FEET / FORCE_UNIT_N, _FEET)


def slots_of(stance: Flags) -> Slots:
    """When each limb is in the air by (N + 1, 4) of who stands, too short ones as long as the shortest step."""
    knots = len(stance)
    of_limb: list[tuple[Slot, ...]] = []
    for limb in range(_FEET):
        change = np.diff(stance[:, limb].astype(int))
        slots: list[Slot] = []
        for lift, land in zip(np.flatnonzero(change < 0) + 1, np.flatnonzero(change > 0) + 1, strict=True):
            more = max(LEAST_AIR - int(land - lift), 0)
            begin = max(int(lift) - more // 2, FIRST_LIFT)
            end = min(begin + int(land - lift) + more, knots - 1 - LAST_LAND)
            if slots and begin < slots[-1][1] + LEAST_GAP:  # run into one another
                begin = slots.pop()[0]
            slots.append((begin, end))
        of_limb.append(tuple(slots))
    return Slots(tuple(of_limb))


def _parts(z: Any) -> list[Any]:
    return [z[int(a) : int(b), :] for a, b in pairwise(np.cumsum([0, *_SIZES]))]


def _knot_function(problem: WalkProblem) -> ca.Function:
    """Rows of one knot, none below zero: binaries, feet on the surface, forces of feet in contact alone, the cone."""
    z, relaxation = ca.SX.sym("z", sum(_SIZES)), ca.SX.sym("relaxation")
    _, p, alpha, u = _parts(z)
    least, most = least_load_N(problem) / FORCE_UNIT_N, problem.max_normal_N / FORCE_UNIT_N
    rows: list[Any] = []
    for i in range(_FEET):
        force = u[3 * i : 3 * i + 3]
        demand = ca.sqrt(force[0] ** 2 + force[1] ** 2 + (SMOOTHING_N / FORCE_UNIT_N) ** 2) - SMOOTHING_N / FORCE_UNIT_N
        rows += [relaxation - alpha[i] * (1 - alpha[i])]
        rows += [relaxation - alpha[i] * p[3 * i + 2] / _LENGTH_UNIT_M]
        slack = _ROOM_N / FORCE_UNIT_N
        rows += [most * alpha[i] - force[2] + slack, force[2] - least * alpha[i] + slack]
        rows += [problem.friction * force[2] - demand + slack]
    for front, rear in ((0, 2), (1, 3)):
        rows.append((p[3 * front] - p[3 * rear] - FEET_APART_M) / _LENGTH_UNIT_M)
    return ca.Function("knot", [z, relaxation], [ca.vertcat(*rows)])


def _step_function(problem: WalkProblem) -> ca.Function:
    """Rows between knots: (8), the body's accelerations, the feet's speed, feet in contact at rest."""
    z, then, relaxation = ca.SX.sym("z", sum(_SIZES)), ca.SX.sym("then", sum(_SIZES)), ca.SX.sym("relaxation")
    (x, p, alpha, u), (x_then, p_then, _, _) = _parts(z), _parts(then)
    moved = [ca.sumsqr(p_then[3 * i : 3 * i + 3] - p[3 * i : 3 * i + 3]) / _LENGTH_UNIT_M**2 for i in range(_FEET)]
    rows = [Ends.of(problem).step(problem)(x, p, u) - x_then, x_then[6:12] - x[6:12], *moved]
    rows += [relaxation - alpha[i] * moved[i] for i in range(_FEET)]
    return ca.Function("step", [z, then, relaxation], [ca.vertcat(*rows)])


def _step_row_bounds(problem: WalkProblem) -> tuple[Array, Array]:
    rate, still = rate_steps(problem), np.zeros(BODY_STATES)
    far = (_MEAN_OF_FASTEST * SPEED_SHARE * problem.foot_speed_m_s * problem.dt_s / _LENGTH_UNIT_M) ** 2
    low = [still, -rate, np.full(_FEET, -np.inf), np.zeros(_FEET)]
    high = [still, rate, np.full(_FEET, far), np.full(_FEET, np.inf)]
    return np.concatenate(low), np.concatenate(high)
