"""The exact P1 with contacts fixed: body motion and finger forces under (2)-(4), (7), (8), (9a), with casadi and ipopt.

Contacts, and with them the gripper poses, come from a schedule; what is left is smooth. Each equation is one small
casadi function in `terms`, mapped over the knots (or over all pairs of knot and limb in stance).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from crux_planner.arrays import Array
from crux_planner.problem import Problem
from crux_planner.search.body_path import BodyPath
from crux_planner.search.schedule import Schedule
from crux_planner.terms.cost import body_cost, schedule_cost, wrench_cost
from crux_planner.terms.dynamics import BODY_STATES, WRENCH_INPUTS, euler_step, gripper_wrench
from crux_planner.terms.limit_surface import cone_demand
from crux_planner.terms.reach import offset_in_body

FORCE_SCALE_N = 10.0  # forces in tens of newtons, so that all variables of the NLP are of order one
LEAST_NORMAL_N = 1.0  # a finger in stance keeps touching
_BOUND_SHARE = 0.999  # of speeds and tilt: room for the solver's tolerance

_IPOPT: dict[str, Any] = {
    "print_time": 0,
    "ipopt.print_level": 0,
    "ipopt.sb": "yes",
    "ipopt.linear_solver": "mumps",
    "ipopt.mu_strategy": "monotone",
    "ipopt.mu_init": 1e-2,
    "ipopt.tol": 1e-4,
    "ipopt.constr_viol_tol": 1e-7,
    "ipopt.compl_inf_tol": 1e-3,
    "ipopt.acceptable_iter": 0,
    "ipopt.max_iter": 300,
    "ipopt.fixed_variable_treatment": "make_parameter",
}


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


def solve(problem: Problem, schedule: Schedule, guess: BodyPath, friction_margin: float) -> Solution:
    """Solve P1 for a schedule from a quasi-static guess. `friction_margin` is the share of (2) the plan may use."""
    n = problem.steps
    pairs = [(k, limb) for k in range(n) for limb in range(4) if schedule.contacts[k][limb] is not None]
    contacts = [problem.contacts[_index(schedule, k, limb)] for k, limb in pairs]

    x = ca.MX.sym("x", BODY_STATES, n + 1)
    q = ca.MX.sym("q", WRENCH_INPUTS, len(pairs))  # scaled
    a = ca.MX.sym("a", 3, len(pairs))  # the spines' share (3) of a finger's shear and twist, scaled
    scale = np.array([FORCE_SCALE_N, FORCE_SCALE_N, FORCE_SCALE_N * problem.patch.k_m, FORCE_SCALE_N, FORCE_SCALE_N])

    grasps = np.array([[*c.centre_w_m, *c.axis, *c.tangent] for c in contacts]).T
    of_knot = np.zeros((len(pairs), n))
    of_knot[np.arange(len(pairs)), [k for k, _ in pairs]] = 1.0
    totals = _wrench_function(scale).map(len(pairs))(q, grasps) @ ca.sparsify(ca.DM(of_knot))
    defects = _step_function(problem).map(n)(x[:, :-1], totals) - x[:, 1:]
    friction = np.array([friction_margin * c.friction for c in contacts])[None, :]
    cones = _cone_function(problem, scale).map(len(pairs))(q, a, friction)
    offsets = _reach_function().map(n)(x[:, 1:], schedule.poses[1:, :, :3].reshape(n, 12).T)

    cost = ca.sum2(_body_cost_function(problem).map(n + 1)(x)) + ca.sum2(
        _wrench_cost_function(problem, scale).map(len(pairs))(q)
    )
    low_x, high_x = _body_bounds(problem, schedule)
    high_q = np.array([ca.inf, ca.inf, ca.inf, problem.patch.max_normal_N, problem.patch.max_normal_N]) / scale
    low_q = np.array([-ca.inf, -ca.inf, -ca.inf, LEAST_NORMAL_N, LEAST_NORMAL_N]) / scale
    spines = (
        friction_margin * np.array([[c.spine_shear_N, c.spine_shear_N, c.spine_twist_Nm] for c in contacts]) / scale[:3]
    )
    box_low = (problem.boxes.centre_b_m - problem.boxes.half_m).ravel()
    box_high = (problem.boxes.centre_b_m + problem.boxes.half_m).ravel()

    nlp: dict[str, Any] = {"x": ca.veccat(x, q, a), "f": cost, "g": ca.veccat(defects, cones, offsets)}
    solver = ca.nlpsol("p1", "ipopt", nlp, _IPOPT)
    x0, q0 = _start(problem, guess, pairs)
    zeros, many = np.zeros(BODY_STATES * n), len(pairs)
    result = solver(
        x0=np.concatenate([x0.ravel(), (q0 / scale).ravel(), np.zeros(3 * many)]),
        lbx=np.concatenate([low_x.ravel(), np.tile(low_q, many), -spines.ravel()]),
        ubx=np.concatenate([high_x.ravel(), np.tile(high_q, many), spines.ravel()]),
        lbg=np.concatenate([zeros, np.zeros(2 * many), np.tile(box_low, n)]),
        ubg=np.concatenate([zeros, np.full(2 * many, ca.inf), np.tile(box_high, n)]),
    )
    values = np.array(result["x"]).ravel()
    body = values[: x.numel()].reshape(n + 1, BODY_STATES)
    wrenches: list[dict[int, Array]] = [{} for _ in range(n)]
    for (k, limb), scaled in zip(
        pairs, values[x.numel() : x.numel() + q.numel()].reshape(-1, WRENCH_INPUTS), strict=True
    ):
        wrenches[k][limb] = scaled * scale
    stats = solver.stats()
    residual = np.abs(np.array(result["g"]).ravel()[: BODY_STATES * n].reshape(n, BODY_STATES))
    return Solution(
        body=body,
        wrenches=wrenches,
        cost=float(result["f"]) + schedule_cost(schedule, problem),
        iterations=int(stats["iter_count"]),
        status=str(stats["return_status"]),
        solved=bool(stats["success"]),
        position_residual_m=float(residual[:, :3].max()),
        force_residual_N=float(residual[:, 6:9].max()) * problem.mass_kg / problem.dt_s,
    )


def _index(schedule: Schedule, k: int, limb: int) -> int:
    contact = schedule.contacts[k][limb]
    assert contact is not None
    return contact


def _wrench_function(scale: Array) -> ca.Function:
    q, grasp = ca.SX.sym("q", WRENCH_INPUTS), ca.SX.sym("grasp", 9)
    force, moment = gripper_wrench(q * scale, grasp[0:3], grasp[3:6], grasp[6:9])
    return ca.Function("gripper_wrench", [q, grasp], [ca.vertcat(force, moment)])


def _step_function(problem: Problem) -> ca.Function:
    x, total = ca.SX.sym("x", BODY_STATES), ca.SX.sym("total", 6)
    step = euler_step(x, total[0:3], total[3:6], problem.mass_kg, problem.inertia_b, problem.gravity_w, problem.dt_s)
    return ca.Function("euler_step", [x, total], [step])


def _cone_function(problem: Problem, scale: Array) -> ca.Function:
    q, a, friction = ca.SX.sym("q", WRENCH_INPUTS), ca.SX.sym("a", 3), ca.SX.sym("friction")
    demand = cone_demand(q[0:3] * scale[:3], a * scale[:3], problem.patch.k_m)
    room = ca.vertcat(friction * q[3] * scale[3] - demand, friction * q[4] * scale[4] - demand)
    return ca.Function("cone", [q, a, friction], [room / FORCE_SCALE_N])


def _reach_function() -> ca.Function:
    x, grippers = ca.SX.sym("x", BODY_STATES), ca.SX.sym("grippers", 12)
    rows = [offset_in_body(x[0:3], x[3:6], grippers[3 * limb : 3 * limb + 3]) for limb in range(4)]
    return ca.Function("reach", [x, grippers], [ca.vertcat(*rows)])


def _body_cost_function(problem: Problem) -> ca.Function:
    x = ca.SX.sym("x", BODY_STATES)
    return ca.Function("body_cost", [x], [body_cost(x, problem)])


def _wrench_cost_function(problem: Problem, scale: Array) -> ca.Function:
    q = ca.SX.sym("q", WRENCH_INPUTS)
    return ca.Function("wrench_cost", [q], [wrench_cost(q * scale, problem)])


def _body_bounds(problem: Problem, schedule: Schedule) -> tuple[Array, Array]:
    """Bounds (7) of the body states (N + 1, 12); start and goal, and the grippers' yaw range, are bounds as well."""
    body, goal, n = problem.body, problem.goal, problem.steps
    speed, rate = _BOUND_SHARE * body.max_speed_m_s, _BOUND_SHARE * body.max_rate_rad_s
    tilt = _BOUND_SHARE * body.max_tilt_rad
    high = np.tile([ca.inf, ca.inf, body.height_m[1], tilt, tilt, ca.inf, *[speed] * 3, *[rate] * 3], (n + 1, 1))
    low = -high
    low[:, 2] = body.height_m[0]
    yaws = schedule.poses[..., 3]
    low[:, 5] = (yaws - problem.gripper_yaw_rad[1]).max(axis=1)
    high[:, 5] = (yaws - problem.gripper_yaw_rad[0]).min(axis=1)
    low[0] = high[0] = np.concatenate([problem.start.position_m, problem.start.rpy_rad, np.zeros(6)])
    pose = np.concatenate([goal.body.position_m, goal.body.rpy_rad])
    spread = np.array([goal.position_room_m] * 3 + [goal.rotation_room_rad] * 3)
    low[-1] = np.concatenate([np.maximum(low[-1, :6], pose - spread), np.zeros(6)])
    high[-1] = np.concatenate([np.minimum(high[-1, :6], pose + spread), np.zeros(6)])
    return low, high


def _start(problem: Problem, guess: BodyPath, pairs: list[tuple[int, int]]) -> tuple[Array, Array]:
    """Starting point: the quasi-static path, orientation turned evenly, squeeze raised into the cone."""
    n = problem.steps
    x0 = np.zeros((n + 1, BODY_STATES))
    x0[:, 0:3] = guess.positions
    x0[:, 3:6] = np.linspace(problem.start.rpy_rad, problem.goal.body.rpy_rad, n + 1)
    x0[:-1, 6:9] = np.diff(guess.positions, axis=0) / problem.dt_s
    q0 = np.zeros((len(pairs), WRENCH_INPUTS))
    for i, (k, limb) in enumerate(pairs):
        s1, s2, m, axial, normal = guess.wrenches[k][limb]
        q0[i] = [s1, s2, m, normal + max(axial, 0.0), normal + max(-axial, 0.0)]
    return x0, q0
