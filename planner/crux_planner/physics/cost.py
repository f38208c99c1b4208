"""Equation (6): J = |x - x_g|_Q^2 + |u|_R^2 + zeta' x + xi' (p_1 - p_2) + |z_next - z|_S^2, summed over the knots."""

from __future__ import annotations

from typing import Any, Protocol

import casadi as ca
import numpy as np

from crux_planner.model.arrays import Array
from crux_planner.model.problem import Goal, Problem, Weights
from crux_planner.model.schedule import Schedule


class HasGoal(Protocol):
    """A climb or a walk."""

    @property
    def weights(self) -> Weights: ...
    @property
    def goal(self) -> Goal: ...


def body_cost(x: Any, problem: HasGoal) -> Any:
    """|x - x_g|_Q^2 of one knot's body state (casadi)."""
    weights, goal = problem.weights, problem.goal.body
    return (
        weights.position * ca.sumsqr(x[0:3] - goal.position_m)
        + weights.orientation * ca.sumsqr(x[3:6] - goal.rpy_rad)
        + weights.velocity * ca.sumsqr(x[6:12])
    )


def wrench_cost(q: Any, problem: Problem) -> Any:
    """|u|_R^2 of one gripper's two fingers, twists counted as forces at k (casadi)."""
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
    weights, goal = problem.weights, problem.goal.body
    total = weights.position * ((body[:, 0:3] - goal.position_m) ** 2).sum()
    total += (
        weights.orientation * ((body[:, 3:6] - goal.rpy_rad) ** 2).sum() + weights.velocity * (body[:, 6:12] ** 2).sum()
    )
    effort = wrench_weights(problem)
    total += weights.wrench * sum(float(effort @ q**2) for knot in wrenches for q in knot.values())
    return float(total) + schedule_cost(schedule, problem)


def wrench_weights(problem: Problem) -> Array:
    """Weights of q^2 in |u|^2 of `wrench_cost`, (5,)."""
    return np.array([2.0, 2.0, 2.0 / problem.patch.k_m**2, 1.0, 1.0])
