"""J (6) of a walk."""

from __future__ import annotations

import numpy as np

from crux_planner.model.arrays import Array
from crux_planner.model.gait import Gait
from crux_planner.model.walk_problem import WalkProblem

FOOTHOLD_WEIGHT = 0.1  # on footholds off their nominal place [1/m^2]: picks one where J does not
FORCE_SHARE = 0.5  # two pads share a foot's force, so that |u|^2 is half of it


def walk_cost(problem: WalkProblem, gait: Gait, body: Array, forces: Array) -> float:
    """J of body states (N + 1, 12), foot forces (N, 4, 3) and a gait."""
    weights, goal = problem.weights, problem.goal.body
    total = weights.position * ((body[:, 0:3] - goal.position_m) ** 2).sum()
    total += weights.orientation * ((body[:, 3:6] - goal.rpy_rad) ** 2).sum()
    total += weights.velocity * (body[:, 6:12] ** 2).sum()
    total += FORCE_SHARE * weights.wrench * (forces**2).sum()
    return float(total) + gait_cost(problem, gait)


def gait_cost(problem: WalkProblem, gait: Gait) -> float:
    """What the gait alone decides: zeta (height of feet in the air) and S (contact changes)."""
    weights = problem.weights
    changes = int(np.abs(np.diff(gait.stance.astype(int), axis=0)).sum())
    return weights.lift * problem.step_height_m * float(gait.height.sum()) + weights.switching * changes
