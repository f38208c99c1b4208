"""Equation (6): J = |x - x_g|_Q^2 + |u|_P^2 + zeta p^z + xi d + S nu, summed over the knots (p, d: in the air)."""

from typing import Any

import numpy as np

from crux_planner.model.arrays import Array
from crux_planner.model.gait import Gait
from crux_planner.model.problem import CentroidalProblem, Problem, Weights
from crux_planner.model.schedule import Schedule
from crux_planner.model.walk_problem import WalkProblem

FORCE_SHARE = 0.5  # two pads share a foot's force, so that |u|^2 is half of it
FOOTHOLD_WEIGHT = 0.1  # on footholds off their nominal place [1/m^2]: picks one where J does not


def state_weights(problem: CentroidalProblem) -> tuple[Array, Array]:
    """Q and x_g, (12,) each."""
    weights, goal = problem.weights, problem.goal.body
    q = np.array([weights.position] * 3 + [weights.orientation] * 3 + [weights.velocity] * 6)
    return q, np.concatenate([goal.position_m, goal.rpy_rad, np.zeros(6)])


def body_cost(x: Any, problem: CentroidalProblem) -> Any:
    """|x - x_g|_Q^2 of one knot's body state (casadi)."""
    from casadi import sumsqr  # which walks do without

    weights, goal = problem.weights, problem.goal.body
    turned = weights.orientation * sumsqr(x[3:6] - goal.rpy_rad)
    return weights.position * sumsqr(x[0:3] - goal.position_m) + turned + weights.velocity * sumsqr(x[6:12])


def states_cost(body: Array, problem: CentroidalProblem) -> float:
    """The same summed over body states (N + 1, 12)."""
    weights, goal = problem.weights, problem.goal.body
    total = weights.position * ((body[:, 0:3] - goal.position_m) ** 2).sum()
    total += weights.orientation * ((body[:, 3:6] - goal.rpy_rad) ** 2).sum()
    return float(total + weights.velocity * (body[:, 6:12] ** 2).sum())


def wrench_cost(q: Any, problem: Problem) -> Any:
    """|u|_P^2 of one gripper's two fingers, twists counted as forces at k (casadi)."""
    shear, twist = q[0] ** 2 + q[1] ** 2, (q[2] / problem.patch.k_m) ** 2
    return problem.weights.wrench * (2 * shear + 2 * twist + q[3] ** 2 + q[4] ** 2)


def schedule_cost(schedule: Schedule, problem: Problem) -> float:
    """What contacts alone decide: zeta (height of grippers in the air), xi (their opening) and S (contact changes)."""
    weights = problem.weights
    air = np.array([[c is None for c in knot] for knot in schedule.contacts])
    lifted = float(schedule.poses[..., 2][air].sum())
    opened = float(2 * schedule.poses[..., 4][air].sum())
    changes = int(np.abs(np.diff(air.astype(int), axis=0)).sum())
    return weights.lift * lifted + weights.opening * opened + weights.switching * changes


def swing_cost(weights: Weights, poses: Array) -> float:
    """zeta, xi and S of one swing alone: `poses` (n, 5) of the gripper at its knots in the air, and two changes."""
    return float(weights.lift * poses[:, 2].sum() + 2 * weights.opening * poses[:, 4].sum() + 2 * weights.switching)


def plan_cost(problem: Problem, schedule: Schedule, body: Array, wrenches: list[dict[int, Array]]) -> float:
    """J (6) of a plan."""
    effort = wrench_weights(problem)
    efforts = sum(float(effort @ q**2) for knot in wrenches for q in knot.values())
    return states_cost(body, problem) + problem.weights.wrench * efforts + schedule_cost(schedule, problem)


def wrench_weights(problem: Problem) -> Array:
    """Weights of q^2 in |u|^2 of `wrench_cost`, (5,)."""
    return np.array([2.0, 2.0, 2.0 / problem.patch.k_m**2, 1.0, 1.0])


def walk_cost(problem: WalkProblem, gait: Gait, body: Array, forces: Array) -> float:
    """J of body states (N + 1, 12), foot forces (N, 4, 3) and a gait."""
    effort = FORCE_SHARE * problem.weights.wrench * (forces**2).sum()
    return float(states_cost(body, problem) + effort) + gait_cost(problem, gait)


def gait_cost(problem: WalkProblem, gait: Gait) -> float:
    """What the gait alone decides: zeta (height of feet in the air) and S (contact changes)."""
    weights = problem.weights
    changes = int(np.abs(np.diff(gait.stance.astype(int), axis=0)).sum())
    return weights.lift * problem.step_height_m * float(gait.height.sum()) + weights.switching * changes
