"""The paper's benchmark: P1 as one NLP, its binaries continuous, pressed towards 0 and 1 by a shrinking relaxation.

alpha in [0, 1] with alpha (1 - alpha) <= relaxation, and (10a) as products, alpha |pose - grasp|^2 <= relaxation,
which vanish together (solvers/relaxation.py).
(14) needs no binaries: a finger is outside a hold exactly if some convex combination of its distances beyond the faces
is not negative. What it reaches may be no plan, and then that is said.
"""

from __future__ import annotations

from collections.abc import Callable
from itertools import pairwise
from typing import Any

import casadi as ca
import numpy as np
from crux_contracts import LIMB_NAMES

from crux_planner.admm.motion_block import Ends
from crux_planner.admm.windows import Windows
from crux_planner.errors import InfeasibleError
from crux_planner.model.arrays import Array
from crux_planner.model.problem import BODY_STATES, Problem
from crux_planner.model.schedule import Swinging
from crux_planner.physics.bounds import body_bounds
from crux_planner.physics.cost import body_cost, plan_cost, wrench_cost
from crux_planner.physics.dynamics import WRENCH_INPUTS, centre_of_mass, euler_step, gripper_wrench
from crux_planner.physics.limit_surface import cone_demand
from crux_planner.physics.reach import offset_in_body
from crux_planner.solvers.relaxation import Relaxed
from crux_planner.trajectory.knot_qp import KnotSolution

_POSE, _FACES = 5, 5
_FORCE_UNIT_N = 10.0
_LENGTH_UNIT_M = 0.05


class Benchmark:
    """P1 of one problem as an NLP over all knots."""

    def __init__(self, windows: Windows) -> None:
        self.windows, problem = windows, windows.problem
        self.problem = problem
        self.pairs = [(limb, c) for limb in range(4) for c in windows.contacts[limb]]
        self.sizes = (BODY_STATES, 4 * _POSE, len(self.pairs), WRENCH_INPUTS * len(self.pairs), self._many_faces())
        n = problem.steps
        z = ca.MX.sym("z", sum(self.sizes), n + 1)
        relaxation = ca.MX.sym("relaxation")
        knot, step = self._knot_function(), self._step_function()
        rows = knot.map(n + 1)(z, ca.repmat(relaxation, 1, n + 1))
        both = step.map(n)(z[:, :-1], z[:, 1:], ca.repmat(relaxation, 1, n))
        cost = ca.sum2(self._cost_function().map(n)(z[:, :-1], z[:, 1:]))
        nlp = {"x": ca.vec(z), "p": relaxation, "f": cost, "g": ca.veccat(rows, both)}
        self._nlp = nlp
        low, high = _knot_row_bounds(problem, len(self.pairs), self.sizes[4] // _FACES)
        self._row_bounds = (
            np.concatenate([np.tile(low, n + 1), np.tile(_step_low(problem, len(self.pairs)), n)]),
            np.concatenate([np.tile(high, n + 1), np.tile(_step_high(problem, len(self.pairs)), n)]),
        )

    def solve(self, deadline: float, report: Callable[[str], None]) -> tuple[KnotSolution, list[int]]:
        """The plan and ipopt's iterations for each relaxation. Raises InfeasibleError where it reaches no plan."""
        relaxed = Relaxed(self._nlp, self._bounds(), self._row_bounds, self._alpha)
        values, iterations = relaxed.solve(self._guess(), deadline, report)
        return self._plan(values), iterations

    def _alpha(self, values: Array) -> Array:
        alpha: Array = self._parts(values.reshape(self.problem.steps + 1, -1))[2]
        return alpha

    def _plan(self, values: Array) -> KnotSolution:
        problem, n = self.problem, self.problem.steps
        x, _, alpha, q, _ = self._parts(values.reshape(n + 1, -1))
        swings = []
        for limb in range(4):
            of_limb = [i for i, (other, _) in enumerate(self.pairs) if other == limb]
            held = [self._held(alpha[k], of_limb) for k in range(n + 1)]
            standing = [(k, c) for k, c in enumerate(held) if c is not None]
            for (k, c), (later, d) in pairwise(standing):
                if c != d or later > k + 1:
                    swings.append(self._swing(limb, k, later, c, d))
        schedule = self.windows.schedule(swings)
        index = {pair: i for i, pair in enumerate(self.pairs)}
        wrenches = [
            {
                limb: q[k, WRENCH_INPUTS * index[limb, c] : WRENCH_INPUTS * (index[limb, c] + 1)] * _unit(problem)
                for limb, c in enumerate(schedule.contacts[k])
                if c is not None
            }
            for k in range(n)
        ]
        return KnotSolution(problem, schedule, x, wrenches, plan_cost(problem, schedule, x, wrenches))

    def _held(self, alpha: Array, of_limb: list[int]) -> int | None:
        best = max(of_limb, key=lambda i: alpha[i])
        return self.pairs[best][1] if alpha[best] > 0.5 else None

    def _swing(self, limb: int, k: int, later: int, start: int, goal: int) -> Swinging:
        if self.windows.swings.swing(start, goal) is None or later - k - 1 < self.windows.least_knots(start, goal):
            names = [self.problem.hold_names[self.problem.contacts[c].hold] for c in (start, goal)]
            raise InfeasibleError(
                "benchmark",
                f"the benchmark NLP lets {LIMB_NAMES[limb]} go from {names[0]} to {names[1]} in {later - k - 1} steps "
                "in the air: no swing is that quick",
            )
        return Swinging(limb, k + 1, later, start, goal)

    def _parts(self, z: Any) -> list[Any]:
        """x, gripper poses, alpha, q, face weights of one knot's column (or of rows of knots)."""
        edges = np.cumsum([0, *self.sizes])
        if isinstance(z, np.ndarray):
            return [z[:, a:b] for a, b in pairwise(edges)]
        return [z[int(a) : int(b)] for a, b in pairwise(edges)]

    def _many_faces(self) -> int:
        return 2 * _FACES * sum(len(self._holds(limb)) for limb in range(4))

    def _holds(self, limb: int) -> list[int]:
        return sorted({self.problem.contacts[c].hold for c in self.windows.contacts[limb]})

    def _knot_function(self) -> ca.Function:
        """Rows of one knot: reach, (10c), (2), (10b), (10a), binaries, (14); in the order of `_knot_row_bounds`."""
        problem = self.problem
        z, relaxation = ca.SX.sym("z", sum(self.sizes)), ca.SX.sym("relaxation")
        x, g, alpha, q, faces = self._parts(z)
        rows: list[Any] = []
        for limb in range(4):
            rows.append(offset_in_body(x[0:3], x[3:6], g[_POSE * limb : _POSE * limb + 3]))
        rows += [g[_POSE * limb + 3] - x[5] for limb in range(4)]
        for limb in range(4):
            rows.append(ca.sum1(ca.vertcat(*[alpha[i] for i, (other, _) in enumerate(self.pairs) if other == limb])))
        unit = _unit(problem)
        for i, (limb, c) in enumerate(self.pairs):
            contact, pose = problem.contacts[c], g[_POSE * limb : _POSE * (limb + 1)]
            each = q[WRENCH_INPUTS * i : WRENCH_INPUTS * (i + 1)] * unit
            demand = cone_demand(each[0:3], ca.DM.zeros(3), problem.patch.k_m)
            by_spines = problem.friction_share * (contact.spines / [1.0, 1.0, problem.patch.k_m]).min(axis=1)
            of_finger = zip((3, 4), contact.may_press, contact.grip_friction, by_spines, strict=True)
            for normal, may_press, friction, inner in of_finger:
                slack = problem.friction_share * friction * each[normal] + inner * alpha[i] - demand
                press = problem.friction_share * problem.patch.max_normal_N * may_press * alpha[i] - each[normal]
                rows += [(slack + 0.05) / _FORCE_UNIT_N, press / _FORCE_UNIT_N]
            rows.append(relaxation - alpha[i] * _apart(pose, problem, c))
            rows.append(relaxation - alpha[i] * (1 - alpha[i]))
        at = 0
        fingers = Ends.of(problem).points(g)
        for limb in range(4):
            for hold in self._holds(limb):
                for finger in fingers[2 * limb : 2 * limb + 2]:
                    weights = faces[at : at + _FACES]
                    at += _FACES
                    rows += [ca.dot(weights, _beyond(problem, hold, finger)) / _LENGTH_UNIT_M, ca.sum1(weights)]
        return ca.Function("knot", [z, relaxation], [ca.vertcat(*rows)])

    def _step_function(self) -> ca.Function:
        """Rows between knots: (8), the fingers' speed, (10a) pdot = 0."""
        problem = self.problem
        z, then, relaxation = (
            ca.SX.sym("z", sum(self.sizes)),
            ca.SX.sym("then", sum(self.sizes)),
            ca.SX.sym("relaxation"),
        )
        x, g, alpha, q, _ = self._parts(z)
        x_then, g_then = self._parts(then)[:2]
        force, moment = ca.SX.zeros(3), ca.SX.zeros(3)
        for i, (_, c) in enumerate(self.pairs):
            contact = problem.contacts[c]
            each = gripper_wrench(
                q[WRENCH_INPUTS * i : WRENCH_INPUTS * (i + 1)] * _unit(problem),
                ca.DM(contact.centre_h_m),
                ca.DM(contact.axis),
                ca.DM(contact.tangent),
            )
            force, moment = force + each[0], moment + each[1]
        centre = centre_of_mass(problem, x, [g[_POSE * limb : _POSE * limb + 4] for limb in range(4)])
        dynamics = euler_step(x, force, moment, centre, problem)
        rows = [dynamics - x_then]
        for limb in range(4):
            rows.append(g_then[_POSE * limb : _POSE * limb + 3] - g[_POSE * limb : _POSE * limb + 3])
        for i, (limb, c) in enumerate(self.pairs):
            rows.append(relaxation - alpha[i] * _apart(g_then[_POSE * limb : _POSE * (limb + 1)], problem, c))
        return ca.Function("step", [z, then, relaxation], [ca.vertcat(*rows)])

    def _cost_function(self) -> ca.Function:
        """J (6) of a knot."""
        problem, weights = self.problem, self.problem.weights
        z, then = ca.SX.sym("z", sum(self.sizes)), ca.SX.sym("then", sum(self.sizes))
        x, g, alpha, q, _ = self._parts(z)
        cost = body_cost(x, problem)
        for i, (limb, _) in enumerate(self.pairs):
            cost += wrench_cost(q[WRENCH_INPUTS * i : WRENCH_INPUTS * (i + 1)] * _unit(problem), problem)
            cost -= alpha[i] * (weights.lift * g[_POSE * limb + 2] + 2 * weights.opening * g[_POSE * limb + 4])
        for limb in range(4):
            cost += weights.lift * g[_POSE * limb + 2] + 2 * weights.opening * g[_POSE * limb + 4]
        cost += weights.switching * ca.sumsqr(self._parts(then)[2] - alpha)
        return ca.Function("cost", [z, then], [cost])

    def _bounds(self) -> tuple[Array, Array]:
        problem, n = self.problem, self.problem.steps
        low_x, high_x = body_bounds(problem, None)
        shape, many = problem.shape, len(self.pairs)
        low_g = np.tile([-np.inf, -np.inf, 0.0, -np.inf, shape.smallest_opening], 4)
        high_g = np.tile([np.inf, np.inf, problem.swing.max_height_m, np.inf, shape.largest_opening], 4)
        low_q = np.tile([-np.inf] * 3 + [0.0] * 2, many)
        rest = np.concatenate([low_g, np.zeros(many), low_q, np.zeros(self.sizes[4])])
        top = np.concatenate([high_g, np.ones(many), np.full(5 * many, np.inf), np.ones(self.sizes[4])])
        low = np.hstack([low_x, np.tile(rest, (n + 1, 1))])
        high = np.hstack([high_x, np.tile(top, (n + 1, 1))])
        alpha = slice(BODY_STATES + 4 * _POSE, BODY_STATES + 4 * _POSE + many)
        begin = np.array([float(c == problem.start_contacts[limb]) for limb, c in self.pairs])
        low[0, alpha] = high[0, alpha] = begin
        ends = np.array([float(c in self.windows.goals[limb]) for limb, c in self.pairs])
        high[-1, alpha] = ends
        return low.ravel(), high.ravel()

    def _guess(self) -> Array:
        """Straight from the start to the nearest of the goal's grasps, all contacts equally likely on the way."""
        problem, n = self.problem, self.problem.steps
        z = np.zeros((n + 1, sum(self.sizes)))
        z[:, 0:3] = np.linspace(problem.start.position_m, problem.goal.body.position_m, n + 1)
        for limb in range(4):
            begin = problem.contacts[problem.start_contacts[limb]]
            ends = [problem.contacts[c] for c in self.windows.goals[limb]] or [begin]
            swings = [float(np.linalg.norm(c.centre_h_m - begin.centre_h_m)) for c in ends]
            end = ends[int(np.argmin(swings))]
            at = BODY_STATES + _POSE * limb
            z[:, at : at + _POSE] = np.linspace(begin.pose, end.pose, n + 1)
        alpha = BODY_STATES + 4 * _POSE
        z[:, alpha : alpha + len(self.pairs)] = 0.5
        q = alpha + len(self.pairs)
        z[:, q : q + self.sizes[3]] = np.tile([0.0, 0.0, 0.0, 0.5, 0.5], len(self.pairs))
        z[:, q + self.sizes[3] :] = 1 / _FACES
        return z.ravel()


def _unit(problem: Problem) -> Array:
    return np.array([1.0, 1.0, problem.patch.k_m, 1.0, 1.0]) * _FORCE_UNIT_N


def _apart(pose: Any, problem: Problem, contact: int) -> Any:
    """Squared distance of a gripper's pose from a grasp, of order one for a few centimetres."""
    unit = np.array([_LENGTH_UNIT_M] * 3 + [1.0, _LENGTH_UNIT_M])
    return ca.sumsqr((pose - problem.contacts[contact].pose) / unit)


def _beyond(problem: Problem, hold: int, point: Any) -> Any:
    """n_h . (p - o) - s_h of a hold's four sides and its top."""
    cuboids = problem.cuboids
    c, s = np.cos(cuboids.yaw_rad[hold]), np.sin(cuboids.yaw_rad[hold])
    plan = point[:2] - cuboids.foot_h_m[hold]
    a, b, half = c * plan[0] + s * plan[1], -s * plan[0] + c * plan[1], cuboids.half_m[hold]
    return ca.vertcat(a - half[0], -a - half[0], b - half[1], -b - half[1], point[2] - 2 * half[2])


def _knot_row_bounds(problem: Problem, pairs: int, convex: int) -> tuple[Array, Array]:
    middle, half = problem.boxes.centre_b_m.ravel(), np.tile(problem.boxes.half_m, 4)
    yaw, free = problem.gripper_yaw_rad, np.inf
    low = [*(middle - half), *[yaw[0]] * 4, *[0.0] * 4, *[0.0] * (6 * pairs), *[0.0, 1.0] * convex]
    high = [*(middle + half), *[yaw[1]] * 4, *[1.0] * 4, *[free] * (6 * pairs), *[free, 1.0] * convex]
    return np.array(low), np.array(high)


def _reach(problem: Problem) -> float:
    return problem.swing.speed_m_s * problem.dt_s


def _step_low(problem: Problem, pairs: int) -> Array:
    return np.concatenate([np.zeros(BODY_STATES), np.full(12, -_reach(problem)), np.zeros(pairs)])


def _step_high(problem: Problem, pairs: int) -> Array:
    return np.concatenate([np.zeros(BODY_STATES), np.full(12, _reach(problem)), np.full(pairs, np.inf)])
