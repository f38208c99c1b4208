"""The methods by name: each decides the contacts, with a body path and forces from which the exact program starts."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

from crux_contracts import LIMB_NAMES

from crux_planner.admm.admm import Decided, Settings, multi_block, two_block
from crux_planner.admm.benchmark import Benchmark
from crux_planner.admm.climb_limbs import ClimbLimbs, LimbMips
from crux_planner.admm.contact_block import ContactBlock
from crux_planner.admm.motion_block import MotionBlock
from crux_planner.admm.walk_benchmark import WalkBenchmark
from crux_planner.admm.walk_block import WalkBlock
from crux_planner.admm.walk_limbs import FootMips, WalkLimbs
from crux_planner.admm.windows import Windows
from crux_planner.model.problem import Problem
from crux_planner.model.walk_problem import WalkProblem
from crux_planner.solvers.relaxation import RELAXATIONS
from crux_planner.solvers.worker import Team, crew
from crux_planner.trajectory.consensus import Scales
from crux_planner.trajectory.knot_qp import KnotSolution
from crux_planner.trajectory.walk_qp import WalkKnots

RHO, MULTI_RHO = 10.0, 10.0
ITERATIONS, MULTI_ITERATIONS = 20, 20
SCALES = Scales(position=3.0, orientation=3.0, force=0.007, moment=0.5)
WALK_SCALES = Scales()


@dataclass(frozen=True)
class Task(Settings):
    """A climb on the grid of its contact blocks, and the method's settings."""

    windows: Windows

    @property
    def problem(self) -> Problem:
        """P1."""
        return self.windows.problem


@dataclass(frozen=True)
class WalkTask(Settings):
    """A walk and the method's settings."""

    problem: WalkProblem


def decide_two_block(task: Task) -> Decided[KnotSolution]:
    """Equation (19)."""
    contacts, motion = ContactBlock(task.windows, scales=SCALES), MotionBlock(task.problem, scales=SCALES)
    return two_block(contacts, motion, task, RHO, ITERATIONS)


def decide_walk_two_block(task: WalkTask) -> Decided[WalkKnots]:
    """Equation (19)."""
    contacts, motion = WalkBlock(task.problem, WALK_SCALES), MotionBlock(task.problem, scales=WALK_SCALES)
    return two_block(contacts, motion, task, RHO, ITERATIONS)


def decide_multi_block(task: Task) -> Decided[KnotSolution]:
    """P3: a MIP a limb in parallel processes, and one NLP."""
    with crew(len(LIMB_NAMES) - 1, LimbMips.__module__, log=task.report) as workers:
        limbs = ClimbLimbs(task.windows, Team(workers, LimbMips, task.windows, SCALES), SCALES)
        motion = MotionBlock(task.problem, scales=SCALES, body_weight=1.0)
        first = motion.project(limbs.standing(), task.rho or MULTI_RHO)
        return multi_block(limbs, motion, first, task, MULTI_RHO, MULTI_ITERATIONS)


def decide_walk_multi_block(task: WalkTask) -> Decided[WalkKnots]:
    """P3: a MIP a foot in parallel processes, and one NLP."""
    with crew(len(LIMB_NAMES) - 1, FootMips.__module__, log=task.report) as workers:
        limbs = WalkLimbs(task.problem, Team(workers, FootMips, task.problem, WALK_SCALES), WALK_SCALES)
        motion = MotionBlock(task.problem, scales=WALK_SCALES, body_weight=1.0)
        first = motion.project(limbs.standing(), task.rho or MULTI_RHO)
        return multi_block(limbs, motion, first, task, MULTI_RHO, MULTI_ITERATIONS)


def decide_benchmark(task: Task | WalkTask) -> Decided[Any]:
    """P1 as one NLP."""
    benchmark = WalkBenchmark(task.problem) if isinstance(task, WalkTask) else Benchmark(task.windows)
    knots, iterations = benchmark.solve(task.deadline, task.report)
    return Decided(knots=knots, relaxations=dict(zip(RELAXATIONS, iterations, strict=True)))


METHODS: dict[str, Callable[[Task], Decided[KnotSolution]]] = {
    "two_block": decide_two_block,
    "multi_block": decide_multi_block,
    "benchmark": decide_benchmark,
}
WALK_METHODS: dict[str, Callable[[WalkTask], Decided[WalkKnots]]] = {
    "two_block": decide_walk_two_block,
    "multi_block": decide_walk_multi_block,
    "benchmark": decide_benchmark,
}
"""All raise InfeasibleError where they find no contacts."""
