"""Plans that bounds are held against: nobody steps, or one limb once."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from crux_planner.admm.windows import Windows
from crux_planner.model.problem import Problem
from crux_planner.physics.reachable_set import ReachableSet
from crux_planner.search.equilibrium import StaticEquilibrium
from crux_planner.swing.swing_cache import SwingCache
from crux_planner.trajectory.consensus import Scales
from crux_planner.trajectory.knot_qp import solve_knots


def without_margin(problem: Problem) -> Problem:
    """Plans that use the whole limit surface: what the bound is about."""
    return replace(problem, friction_share=1.0)


def staying_and_stepping(problem: Problem) -> list[float]:
    """J of plans without a step, and with each limb's first possible swing."""
    equilibrium, windows = (
        StaticEquilibrium(problem, problem.friction_share),
        Windows(problem, ReachableSet(problem), SwingCache(problem)),
    )
    path = np.linspace(problem.start.position_m, problem.goal.body.position_m, problem.steps + 1)
    first = [[windows.swinging(limb, windows.arcs[limb][0])] for limb in range(4)]
    plans = [
        solve_knots(problem, equilibrium, windows.schedule(swings), 0.0, None, Scales(), path, True)
        for swings in ([], *first)
    ]
    return [plan.cost for plan in plans if plan is not None]
