"""The exact P1 with contacts fixed, as one programme for ipopt: used where exact.py does not converge.

Contacts, and with them the gripper poses, come from a schedule; what is left is smooth. Each equation is one small
casadi function in `terms`, mapped over the knots or over all pairs of a knot and a limb in stance.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from crux_planner.arrays import Array
from crux_planner.contacts import Contact
from crux_planner.problem import Problem
from crux_planner.search.body_path import BodyPath
from crux_planner.search.schedule import Schedule
from crux_planner.stage_functions import FORCE_SCALE_N, SPINE_WEIGHT
from crux_planner.terms.bounds import body_bounds, reach_bounds, wrench_bounds
from crux_planner.terms.cost import body_cost, schedule_cost, wrench_cost
from crux_planner.terms.dynamics import BODY_STATES, WRENCH_INPUTS, euler_step, gripper_wrench
from crux_planner.terms.limit_surface import surface_room
from crux_planner.terms.reach import offset_in_body
from crux_planner.terms.torque import interval_torques

IPOPT: dict[str, Any] = {
    "print_time": 0,
    "ipopt.print_level": 0,
    "ipopt.sb": "yes",
    "ipopt.linear_solver": "mumps",
    "ipopt.mu_strategy": "adaptive",
    "ipopt.tol": 1e-4,
    "ipopt.constr_viol_tol": 1e-7,
    "ipopt.compl_inf_tol": 1e-3,
    "ipopt.acceptable_iter": 0,
    "ipopt.max_iter": 300,
}


Place = tuple[int, int]
"""A knot and a limb in stance there."""


@dataclass(frozen=True)
class Solution:
    """Body states (N + 1, 12), wrenches q = (s1, s2, m, n1, n2) per knot and limb in stance, and how it went."""

    body: Array
    wrenches: list[dict[int, Array]]
    cost: float
    iterations: int
    status: str
    solved: bool
    position_residual_m: float
    force_residual_N: float
    torque_shares: dict[
        Place, float
    ]  # largest joint torque in the interval over its limit, per knot and limb in stance


@dataclass(frozen=True)
class Start:
    """Where the solver starts: body states (N + 1, 12) and wrenches as in `Solution`; `near`: of a problem much like
    this one.
    """

    body: Array
    wrenches: list[dict[int, Array]]
    near: bool = False


@dataclass(frozen=True)
class _Stance:
    """All (knot, limb) in stance, in the order of the NLP's columns."""

    knots: list[int]
    limbs: list[int]
    contacts: list[Contact]

    @property
    def places(self) -> list[Place]:
        """(knot, limb) of every column."""
        return list(zip(self.knots, self.limbs, strict=True))

    @property
    def grasps(self) -> Array:
        """(9, P): centre, opening axis, tangent."""
        return np.array([[*c.centre_w_m, *c.axis, *c.tangent] for c in self.contacts]).T

    def sums(self, knots: int) -> Any:
        """(P, knots) matrix that adds up what belongs to each knot."""
        return ca.DM.triplet(range(len(self.knots)), self.knots, ca.DM.ones(len(self.knots)), len(self.knots), knots)


class _Rows:
    """Constraints low <= g <= high, collected."""

    def __init__(self) -> None:
        self.expressions: list[Any] = []
        self.low: list[Array] = []
        self.high: list[Array] = []

    def add(self, expression: Any, low: Array | float, high: Array | float) -> None:
        """`expression` is a matrix; bounds are as many, or a column (rows, 1) of them, or one number for all."""
        self.expressions.append(ca.vec(expression))
        self.low.append(np.broadcast_to(low, expression.shape).ravel(order="F"))
        self.high.append(np.broadcast_to(high, expression.shape).ravel(order="F"))


def solve(
    problem: Problem, schedule: Schedule, start: Start, limited: frozenset[Place], time_limit_s: float
) -> Solution:
    """Solve P1 for a schedule, with constraints on the joint torques at the places `limited`."""
    n, stance = problem.steps, _stance(problem, schedule)
    scale = np.array([1.0, 1.0, problem.patch.k_m, 1.0, 1.0]) * FORCE_SCALE_N
    x = ca.MX.sym("x", BODY_STATES, n + 1)
    q = ca.MX.sym("q", WRENCH_INPUTS, len(stance.knots))  # scaled
    a = ca.MX.sym("a", 3, len(stance.knots))  # the spines' share (3) of a finger's shear and twist, scaled

    rows = _Rows()
    wrenches = _wrench_function(scale).map(len(stance.knots))(q, stance.grasps)
    totals = wrenches @ stance.sums(n)
    rows.add(_step_function(problem).map(n)(x[:, :-1], totals) - x[:, 1:], 0.0, 0.0)
    rough = [i for i, c in enumerate(stance.contacts) if c.grip_friction > 0.0]
    if rough:
        friction = problem.friction_share * np.array([[stance.contacts[i].grip_friction for i in rough]])
        rows.add(_surface_function(problem, scale).map(len(rough))(q[:, rough], a[:, rough], friction), 0.0, np.inf)
    slippery = [i for i, c in enumerate(stance.contacts) if c.grip_friction == 0.0]
    if slippery:  # the cone has shrunk to a ray: spines carry all
        rows.add(q[0:3, slippery] - a[:, slippery], 0.0, 0.0)
    reach_low, reach_high = reach_bounds(problem, schedule)
    grippers = schedule.poses[1:, :, :3].reshape(n, 12).T
    rows.add(_reach_function().map(n)(x[:, 1:], grippers), reach_low.T, reach_high.T)
    for limb in range(4):
        columns = [i for i, place in enumerate(stance.places) if place in limited and place[1] == limb]
        if columns:
            function = _torque_function(problem, limb, scale).map(len(columns))
            torques = function(x[:, [stance.knots[i] for i in columns]], q[:, columns], stance.grasps[:, columns])
            limit = np.tile(problem.torque_limits_Nm[limb], 2)[:, None]
            rows.add(torques, -limit, limit)

    cost = ca.sum2(_body_cost_function(problem).map(n + 1)(x))
    cost += ca.sum2(_wrench_cost_function(problem, scale).map(len(stance.knots))(q)) + SPINE_WEIGHT * ca.sumsqr(a)
    low_x, high_x = body_bounds(problem, schedule)
    bounds_q = [wrench_bounds(problem, contact) for contact in stance.contacts]
    low_q, high_q = ((np.array([b[i] for b in bounds_q]) / scale).ravel() for i in (0, 1))
    spines = np.array([[c.spine_shear_N, c.spine_shear_N, c.spine_twist_Nm] for c in stance.contacts])
    spines = (problem.friction_share * spines / scale[:3]).ravel()
    variables = ca.veccat(x, q, a)
    nlp: dict[str, Any] = {"x": variables, "f": cost, "g": ca.vertcat(*rows.expressions)}
    solver = ca.nlpsol("p1", "ipopt", nlp, {**IPOPT, "ipopt.max_wall_time": time_limit_s})
    many = len(stance.knots)
    q0 = np.array([start.wrenches[k][limb] for k, limb in zip(stance.knots, stance.limbs, strict=True)]) / scale
    result = solver(
        x0=np.concatenate([start.body.ravel(), q0.ravel(), np.zeros(3 * many)]),
        lbx=np.concatenate([low_x.ravel(), low_q, -spines]),
        ubx=np.concatenate([high_x.ravel(), high_q, spines]),
        lbg=np.concatenate(rows.low),
        ubg=np.concatenate(rows.high),
    )
    return _solution(problem, schedule, stance, solver.stats(), result, scale)


def start_from_path(problem: Problem, path: BodyPath, yaw_rad: Array | None = None) -> Start:
    """The quasi-static path: orientation turned evenly, or the heading as given; velocities from the steps."""
    n = problem.steps
    body = np.zeros((n + 1, BODY_STATES))
    body[:, 0:3] = path.positions
    body[:, 3:6] = np.linspace(problem.start.rpy_rad, problem.goal.body.rpy_rad, n + 1)
    if yaw_rad is not None:
        body[:, 5] = yaw_rad
        body[:-1, 11] = np.diff(yaw_rad) / problem.dt_s
    body[:-1, 6:9] = np.diff(path.positions, axis=0) / problem.dt_s
    wrenches = [
        {limb: np.array([s1, s2, m, n + max(f, 0.0), n + max(-f, 0.0)]) for limb, (s1, s2, m, f, n) in knot.items()}
        for knot in path.wrenches
    ]
    return Start(body, wrenches)


def _stance(problem: Problem, schedule: Schedule) -> _Stance:
    found = [
        (k, limb, problem.contacts[contact])
        for limb in range(4)
        for k in range(problem.steps)
        if (contact := schedule.contacts[k][limb]) is not None
    ]
    return _Stance([k for k, _, _ in found], [limb for _, limb, _ in found], [c for _, _, c in found])


def _torque_shares(problem: Problem, stance: _Stance, body: Array, scaled: Array, scale: Array) -> dict[Place, float]:
    shares: dict[Place, float] = {}
    for limb in range(4):
        columns = [i for i, other in enumerate(stance.limbs) if other == limb]
        function = _torque_function(problem, limb, scale).map(len(columns))
        knots = [stance.knots[i] for i in columns]
        torques = np.array(function(body[knots].T, scaled[columns].T, stance.grasps[:, columns]))
        used = (np.abs(torques) / np.tile(problem.torque_limits_Nm[limb], 2)[:, None]).max(axis=0)
        shares.update(zip([(k, limb) for k in knots], used.tolist(), strict=True))
    return shares


def _solution(problem: Problem, schedule: Schedule, stance: _Stance, stats: Any, result: Any, scale: Array) -> Solution:
    n, values = problem.steps, np.array(result["x"]).ravel()
    size = BODY_STATES * (n + 1)
    body = values[:size].reshape(n + 1, BODY_STATES)
    scaled = values[size : size + WRENCH_INPUTS * len(stance.knots)].reshape(-1, WRENCH_INPUTS)
    wrenches: list[dict[int, Array]] = [{} for _ in range(n)]
    for k, limb, q in zip(stance.knots, stance.limbs, scaled, strict=True):
        wrenches[k][limb] = q * scale
    defects = np.abs(np.array(result["g"]).ravel()[: BODY_STATES * n].reshape(n, BODY_STATES))
    return Solution(
        body=body,
        wrenches=wrenches,
        cost=float(result["f"]) + schedule_cost(schedule, problem),
        iterations=int(stats["iter_count"]),
        status=str(stats["return_status"]),
        solved=bool(stats["success"]),
        position_residual_m=float(defects[:, :3].max()),
        force_residual_N=float(defects[:, 6:9].max()) * problem.mass_kg / problem.dt_s,
        torque_shares=_torque_shares(problem, stance, body, scaled, scale),
    )


def _wrench_function(scale: Array) -> ca.Function:
    q, grasp = ca.SX.sym("q", WRENCH_INPUTS), ca.SX.sym("grasp", 9)
    force, moment = gripper_wrench(q * scale, grasp[0:3], grasp[3:6], grasp[6:9])
    return ca.Function("gripper_wrench", [q, grasp], [ca.vertcat(force, moment)])


def _step_function(problem: Problem) -> ca.Function:
    x, total = ca.SX.sym("x", BODY_STATES), ca.SX.sym("total", 6)
    step = euler_step(x, total[0:3], total[3:6], problem.mass_kg, problem.inertia_b, problem.gravity_w, problem.dt_s)
    return ca.Function("euler_step", [x, total], [step])


def _surface_function(problem: Problem, scale: Array) -> ca.Function:
    q, a, friction = ca.SX.sym("q", WRENCH_INPUTS), ca.SX.sym("a", 3), ca.SX.sym("friction")
    loads = friction * q[3:5] * scale[3:]
    room = surface_room(problem.limit_surface, q[0:3] * scale[:3], a * scale[:3], loads, problem.patch.k_m)
    return ca.Function("limit_surface", [q, a, friction], [room / FORCE_SCALE_N])


def _reach_function() -> ca.Function:
    x, grippers = ca.SX.sym("x", BODY_STATES), ca.SX.sym("grippers", 12)
    offsets = [offset_in_body(x[0:3], x[3:6], grippers[3 * limb : 3 * limb + 3]) for limb in range(4)]
    return ca.Function("reach", [x, grippers], [ca.vertcat(*offsets)])


def _torque_function(problem: Problem, limb: int, scale: Array) -> ca.Function:
    x, q, grasp = ca.SX.sym("x", BODY_STATES), ca.SX.sym("q", WRENCH_INPUTS), ca.SX.sym("grasp", 9)
    masses = problem.limb_masses[limb]
    torques = interval_torques(masses, x, q * scale, grasp, problem.gravity_w, problem.dt_s)
    return ca.Function(f"torques_{limb}", [x, q, grasp], [torques])


def _body_cost_function(problem: Problem) -> ca.Function:
    x = ca.SX.sym("x", BODY_STATES)
    return ca.Function("body_cost", [x], [body_cost(x, problem)])


def _wrench_cost_function(problem: Problem, scale: Array) -> ca.Function:
    q = ca.SX.sym("q", WRENCH_INPUTS)
    return ca.Function("wrench_cost", [q], [wrench_cost(q * scale, problem)])
