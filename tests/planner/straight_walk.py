"""A walk to begin with: straight to the goal."""

from __future__ import annotations

import numpy as np
from crux_planner.model.gait import Gait, WalkMotion, nominal_footholds, progress
from crux_planner.model.walk_problem import WalkProblem


def straight_motion(problem: WalkProblem, gait: Gait) -> WalkMotion:
    """Straight to the goal in the time of the steps, the weight shared by the feet in stance."""
    stance = gait.stance[: problem.steps]
    shares = stance / np.maximum(stance.sum(axis=1, keepdims=True), 1)
    forces = shares[..., None] * (-problem.mass_kg * problem.gravity_h)
    way = np.interp(np.arange(problem.steps + 1), *progress(problem, gait))
    pose = np.concatenate([problem.start.position_m, problem.start.rpy_rad])
    there = np.concatenate([problem.goal.body.position_m, problem.goal.body.rpy_rad])
    body = np.pad(pose + way[:, None] * (there - pose), ((0, 0), (0, 6)))
    return WalkMotion(gait, body, forces, nominal_footholds(problem, gait))
