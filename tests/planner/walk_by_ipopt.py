"""The exact walk of a gait as a program for ipopt, written apart from the planner's QP: what that must agree with."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np
from climb_by_ipopt import ONCE
from crux_planner.errors import InfeasibleError
from crux_planner.model.arrays import Array, Indices
from crux_planner.model.gait import longest_step
from crux_planner.model.limb import placed
from crux_planner.model.problem import BODY_STATES
from crux_planner.model.walk_problem import WalkProblem
from crux_planner.physics.bounds import (
    FEET_APART_M,
    foothold_bounds,
    least_load_N,
    rate_steps,
    walk_bounds,
)
from crux_planner.physics.cost import FOOTHOLD_WEIGHT, FORCE_SHARE, body_cost, walk_cost
from crux_planner.physics.dynamics import centre_of_mass, euler_step, on_feet, rotation
from crux_planner.physics.limit_surface import SMOOTHING_N
from crux_planner.physics.reach import offset_in_body
from crux_planner.solvers.ipopt import Nlp, NlpSolution
from crux_planner.trajectory.solution import WalkSolution
from crux_planner.trajectory.stage_functions import FORCE_SCALE_N
from crux_planner.trajectory.walk_qp import WalkKnots


def solve(problem: WalkProblem, knots: WalkKnots, time_limit_s: float) -> WalkSolution:
    """P1 of one gait, from a walk near its solution."""
    n, gait = problem.steps, knots.gait
    stance = gait.stance[:n]
    places = np.argwhere(stance)  # (P, 2) knot and limb
    x = ca.MX.sym("x", BODY_STATES, n + 1)
    f = ca.MX.sym("f", 3, len(places))  # scaled
    h = ca.MX.sym("h", 2, len(gait.steps))
    holds = ca.horzcat(ca.DM(problem.start_feet_h_m.T), h)
    blend = gait.blend.reshape((n + 1) * 4, -1)
    height = problem.step_height_m * gait.height.reshape(1, -1)
    feet = ca.vertcat(holds @ ca.sparsify(ca.DM(blend.T)), ca.DM(height))  # (3, 4 (N + 1)), knot by knot
    here = feet[:, (4 * places[:, 0] + places[:, 1]).tolist()]
    parts = _rows(problem, knots, places, (x, f, holds), feet, here)
    nominal = knots.footholds[4:].T
    objective = ca.sum2(_body_cost_function(problem).map(n + 1)(x))
    objective += FORCE_SHARE * problem.weights.wrench * FORCE_SCALE_N**2 * ca.sumsqr(f)
    objective += FOOTHOLD_WEIGHT * ca.sumsqr(h - ca.DM(nominal))
    body_low, body_high = walk_bounds(problem, gait)
    spots = foothold_bounds(problem, gait)
    if spots is None:
        raise InfeasibleError("goal", f"the gait {', '.join(gait.names)} leaves a foot behind")
    least_N = least_load_N(problem)
    force_low = np.tile([-np.inf, -np.inf, least_N / FORCE_SCALE_N], len(places))
    force_high = np.tile([np.inf, np.inf, problem.max_normal_N / FORCE_SCALE_N], len(places))
    solver = Nlp(
        {
            "x": ca.vertcat(ca.vec(x), ca.vec(f), ca.vec(h)),
            "f": objective,
            "g": ca.vertcat(*[ca.vec(expression) for expression, _, _ in parts]),
        },
        (
            np.concatenate([body_low.ravel(), force_low, spots[0].ravel()]),
            np.concatenate([body_high.ravel(), force_high, spots[1].ravel()]),
        ),
        (
            np.concatenate([np.tile(np.broadcast_to(low, e.shape[0]), e.shape[1]) for e, low, _ in parts]),
            np.concatenate([np.tile(np.broadcast_to(high, e.shape[0]), e.shape[1]) for e, _, high in parts]),
        ),
        {**ONCE, "ipopt.max_cpu_time": time_limit_s},
    )
    start = [knots.body.ravel(), knots.forces[stance].ravel() / FORCE_SCALE_N, nominal.T.ravel()]
    return _solution(problem, knots, solver.solve(np.concatenate(start)), places)


def _rows(
    problem: WalkProblem, knots: WalkKnots, places: Indices, of: tuple[Any, Any, Any], feet: Any, here: Any
) -> list[tuple[Any, Any, Any]]:
    """Expressions of body, forces and footholds `of`, with bounds; `feet` (3, 4 (N + 1)), those in stance `here`."""
    n, (x, f, holds) = problem.steps, of
    stance = knots.gait.stance[:n]
    sums = ca.DM.triplet(range(len(places)), places[:, 0].tolist(), ca.DM.ones(len(places)), len(places), n)

    true_shares = _true_shares_function()
    parts: list[tuple[Any, Any, Any]] = []
    totals = _wrench_function().map(len(places))(f, here) @ sums
    yaws = ca.DM(knots.gait.yaw(float(problem.goal.body.rpy_rad[2]))[:n].T)
    steps = _step_function(problem).map(n)(x[:, :-1], totals, ca.reshape(feet[:, : 4 * n], 12, n), yaws)
    parts.append((steps - x[:, 1:], 0.0, 0.0))
    parts.append((_cone_function(problem).map(len(places))(f), 0.0, np.inf))
    change = rate_steps(problem)
    parts.append((x[6:12, 1:] - x[6:12, :-1], -change, change))
    middle, half = problem.boxes.centre_b_m.ravel(), np.tile(problem.boxes.half_m, 4)
    reach = _reach_function().map(n)(x[:, 1:], ca.reshape(feet[:, 4:], 12, n))
    parts.append((reach, middle - half, middle + half))
    for cut in problem.cuts:
        place = reach[3 * cut.limb : 3 * cut.limb + 3, :]
        parts.append((ca.DM(cut.normal_b).T @ place, -np.inf, cut.most))
    pressed = _pressed(problem, x, feet, knots.gait.yaw(float(problem.goal.body.rpy_rad[2])))
    for k in np.flatnonzero(stance.sum(axis=1) == 3).tolist():
        standing = here[:2, np.flatnonzero(places[:, 0] == k).tolist()]
        for ahead in (0, 1):
            parts.append((true_shares(standing, pressed[:, k + ahead]), problem.profile.true_share, np.inf))
    parts += _step_lengths(problem, knots, holds)
    of_limb = [feet[0, limb::4] for limb in range(4)]
    for front, rear in ((0, 2), (1, 3)):
        parts.append((of_limb[front] - of_limb[rear], FEET_APART_M, np.inf))
    return parts


def _step_lengths(problem: WalkProblem, knots: WalkKnots, holds: Any) -> list[tuple[Any, Any, Any]]:
    """Mean speed of a foot over every interval of its steps, as one bound of each step's length."""
    rows = []
    last = list(range(4))
    for i, step in enumerate(knots.gait.steps):
        longest = longest_step(problem, step)
        rows.append((ca.sumsqr(holds[:, 4 + i] - holds[:, last[step.limb]]), -np.inf, longest**2))
        last[step.limb] = 4 + i
    return rows


def _solution(problem: WalkProblem, knots: WalkKnots, found: NlpSolution, places: Indices) -> WalkSolution:
    n, values = problem.steps, found.x
    size, count = BODY_STATES * (n + 1), 3 * len(places)
    forces = np.zeros((n, 4, 3))
    forces[places[:, 0], places[:, 1]] = FORCE_SCALE_N * values[size : size + count].reshape(-1, 3)
    footholds = np.vstack([problem.start_feet_h_m, values[size + count :].reshape(-1, 2)])
    body = values[:size].reshape(n + 1, BODY_STATES)
    defects = np.abs(found.rows[: BODY_STATES * n].reshape(n, BODY_STATES))
    return WalkSolution(
        gait=knots.gait,
        body=body,
        forces=forces,
        footholds=footholds,
        cost=walk_cost(problem, knots.gait, body, forces),
        iterations=found.iterations,
        status=found.status,
        solved=found.solved,
        position_residual_m=float(defects[:, :3].max()),
        force_residual_N=float(defects[:, 6:9].max()) * problem.mass_kg / problem.dt_s,
    )


def _wrench_function() -> ca.Function:
    f, foot = ca.SX.sym("f", 3), ca.SX.sym("foot", 3)
    force = FORCE_SCALE_N * f
    return ca.Function("foot_wrench", [f, foot], [ca.vertcat(force, ca.cross(foot, force))])


def _step_function(problem: WalkProblem) -> ca.Function:
    x, total = ca.SX.sym("x", BODY_STATES), ca.SX.sym("total", 6)
    feet, yaws = ca.SX.sym("feet", 12), ca.SX.sym("yaws", 4)
    step = euler_step(x, total[0:3], total[3:6], centre_of_mass(problem, x, on_feet(problem, feet, yaws)), problem)
    return ca.Function("euler_step", [x, total, feet, yaws], [step])


def _cone_function(problem: WalkProblem) -> ca.Function:
    """Coulomb's cone exactly, smoothed from inside at its apex."""
    f = ca.SX.sym("f", 3)
    demand = ca.sqrt(f[0] ** 2 + f[1] ** 2 + (SMOOTHING_N / FORCE_SCALE_N) ** 2)
    return ca.Function("cone", [f], [problem.friction * f[2] - demand])


def _pressed(problem: WalkProblem, x: Any, feet: Any, yaws: Array) -> Any:
    """Where (2, N + 1) the ground's force passes with no moment along it, every link a point mass."""
    state, stand, turn = ca.SX.sym("x", BODY_STATES), ca.SX.sym("feet", 12), ca.SX.sym("yaws", 4)
    to_b, hands = rotation(state[3:6]).T, on_feet(problem, stand, turn)
    links = []
    for limb, hand in zip(problem.limb_masses, hands, strict=True):
        axis = to_b @ ca.vertcat(ca.cos(hand[3]), ca.sin(hand[3]), 0)
        gripper, up = to_b @ (hand[:3] - state[:3]), to_b[:, 2]
        links += placed(limb.numbers, *((v[0], v[1], v[2]) for v in (gripper, up, axis))).links
    of_body = problem.mass_kg - sum(mass for _, _, mass in links)
    masses = ca.DM([[mass for _, _, mass in links] + [of_body]])
    inside = [ca.vertcat(*place) for _, place, _ in links] + [ca.DM(problem.body_moment_kg_m / of_body)]
    link_places = ca.Function("links", [state, stand, turn], [ca.vertcat(*(state[:3] + to_b.T @ v for v in inside))])
    n = x.shape[1]
    places = link_places.map(n)(x, ca.reshape(feet, 12, n), ca.DM(yaws.T))
    inner = (places[:, 2:] - 2 * places[:, 1:-1] + places[:, :-2]) / problem.dt_s**2
    still = ca.DM.zeros(places.shape[0], 1)
    pull = ca.horzcat(still, inner, still) - ca.repmat(ca.DM(problem.gravity_h), len(inside), n)
    (px, py, pz), (ax, ay, az) = ([each[i::3, :] for i in range(3)] for each in (places, pull))
    return ca.vertcat(masses @ (px * az - pz * ax), masses @ (py * az - pz * ay)) / ca.repmat(masses @ az, 2, 1)


def _true_shares_function() -> ca.Function:
    """Shares of the weight on three feet in stance that press together at a point."""
    standing, point = ca.SX.sym("standing", 2, 3), ca.SX.sym("point", 2)
    corners = [standing[:, i] - point for i in range(3)]
    areas = [_area(corners[(i + 1) % 3], corners[(i + 2) % 3]) for i in range(3)]
    shares = ca.vertcat(*areas) / (areas[0] + areas[1] + areas[2])
    return ca.Function("true_shares", [standing, point], [shares])


def _area(a: Any, b: Any) -> Any:
    return a[0] * b[1] - a[1] * b[0]


def _reach_function() -> ca.Function:
    x, feet = ca.SX.sym("x", BODY_STATES), ca.SX.sym("feet", 12)
    offsets = [offset_in_body(x[0:3], x[3:6], feet[3 * limb : 3 * limb + 3]) for limb in range(4)]
    return ca.Function("reach", [x, feet], [ca.vertcat(*offsets)])


def _body_cost_function(problem: WalkProblem) -> ca.Function:
    x = ca.SX.sym("x", BODY_STATES)
    return ca.Function("body_cost", [x], [body_cost(x, problem)])
