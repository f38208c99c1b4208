"""Where a limb is stretched so far that its joints are too fast: that corner of its box (9a) is left out.

Near the stretched limb a foot that keeps its speed needs joints without bounds. The planner knows no joints; it learns
from the check's joint speeds which corner to keep away from.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from crux_contracts import LIMB_NAMES

from crux_planner.checker.report import CheckReport
from crux_planner.model.gait import Gait
from crux_planner.model.kinematics import rotation_from_rpy
from crux_planner.model.walk_problem import Cut, WalkProblem
from crux_planner.trajectory.solution import WalkSolution

CUTS = 3  # times in a row
_LEFT_OUT = 0.12  # of the way from the middle of the box to the place
_FAR = 0.85  # of the box, along an axis: nearer to the middle a limb is not stretched


def bent(problem: WalkProblem, gait: Gait, solution: WalkSolution, report: CheckReport) -> WalkProblem | None:
    """The walk without the corners in which joints are too fast; None where that is not what is wrong."""
    cuts = []
    for violation in report.violations:
        if violation.constraint == "joint_speed" and violation.limb is not None and violation.time_s is not None:
            limb = LIMB_NAMES.index(violation.limb)
            cut = _cut(problem, gait, solution, limb, int(violation.time_s / problem.dt_s))
            cuts += [] if cut is None else [cut]
    return replace(problem, cuts=(*problem.cuts, *cuts)) if cuts else None


def _cut(problem: WalkProblem, gait: Gait, solution: WalkSolution, limb: int, knot: int) -> Cut | None:
    """What leaves out the corner that the foot is nearest to about a knot."""
    about = np.clip(np.arange(knot - 1, knot + 3), 0, problem.steps)
    plan = np.einsum("kj,ja->ka", gait.blend[about, limb], solution.footholds)
    feet = np.column_stack([plan, problem.step_height_m * gait.height[about, limb]])
    rotation = rotation_from_rpy(solution.body[about, 3:6])
    places = np.einsum("kba,kb->ka", rotation, feet - solution.body[about, :3])
    centre, half = problem.boxes.centre_b_m[limb], problem.boxes.half_m
    shares = (places - centre) / half
    corner = shares[int(np.argmax((shares**2).sum(axis=1)))]
    if np.abs(corner).max() < _FAR:
        return None
    normal = corner / half
    return Cut(limb, normal, float(normal @ centre + (1.0 - _LEFT_OUT) * corner @ corner))
