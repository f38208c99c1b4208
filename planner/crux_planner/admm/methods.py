"""The methods by name: each decides the contacts, with a body path and forces from which the exact program starts."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

from crux_contracts import LIMB_NAMES

from crux_planner.admm.admm import Decided, LimbBlocks, Settings, multi_block, two_block
from crux_planner.admm.benchmark import Benchmark
from crux_planner.admm.climb_limbs import ClimbLimbs
from crux_planner.admm.contact_block import ContactBlock
from crux_planner.admm.limb_block import LimbBlock
from crux_planner.admm.motion_block import MotionBlock
from crux_planner.admm.walk_benchmark import WalkBenchmark
from crux_planner.admm.walk_limb_block import FootBlock
from crux_planner.admm.walk_limbs import WalkLimbs
from crux_planner.admm.windows import Windows
from crux_planner.model.problem import Problem
from crux_planner.model.walk_problem import WalkProblem
from crux_planner.pipeline.walk_contacts import WalkContacts
from crux_planner.search.equilibrium import StaticEquilibrium
from crux_planner.solvers.relaxation import RELAXATIONS
from crux_planner.solvers.worker import Team, Worker, crew
from crux_planner.trajectory.consensus import Scales
from crux_planner.trajectory.knot_qp import KnotSolution
from crux_planner.trajectory.walk_qp import WalkKnots

RHO, MULTI_RHO, WALK_RHO = 10.0, 40.0, 1.5
ITERATIONS, MULTI_ITERATIONS, WALK_MULTI_ITERATIONS = 20, 40, 60
SCALES, WALK_SCALES = Scales(position=3.0, orientation=3.0, force=0.007, moment=0.5), Scales(force=0.03)
MULTI_SCALES = Scales(position=3.0)  # limbs that know nothing of the body follow it faster so


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
    workers: Sequence[Worker] = ()


def decide_two_block(task: Task) -> Decided[KnotSolution]:
    """Equation (19)."""
    contacts, motion = ContactBlock(task.windows, scales=SCALES), MotionBlock(task.problem, scales=SCALES)
    return two_block(contacts, motion, task, RHO, ITERATIONS)


def decide_walk_two_block(task: WalkTask) -> Decided[WalkKnots]:
    """Equation (19), but for a contact block that is the search of `auto` and no MIP."""
    contacts = WalkContacts(task.problem, WALK_SCALES, moments=task.moments, workers=task.workers)
    return two_block(contacts, MotionBlock(task.problem, scales=WALK_SCALES), task, WALK_RHO, ITERATIONS)


def decide_multi_block(task: Task) -> Decided[KnotSolution]:
    """P3: one contact block a limb in parallel processes, a shortest path and no MIP, and one NLP."""
    windows, balance = task.windows, StaticEquilibrium(task.problem, task.problem.friction_share)
    with crew(len(LIMB_NAMES) - 1, LimbBlock.__module__, log=task.report) as workers:
        blocks = Team(workers, LimbBlocks, LimbBlock, windows, balance)
        limbs = ClimbLimbs(windows, balance, blocks, MULTI_SCALES, task.deadline)
        motion = MotionBlock(task.problem, scales=MULTI_SCALES, body_weight=1.0)
        return multi_block(limbs, motion, task, MULTI_RHO, MULTI_ITERATIONS)


def decide_walk_multi_block(task: WalkTask) -> Decided[WalkKnots]:
    """P3: one contact block a limb in parallel processes, which looks at all its steps, and one NLP."""
    with crew(len(LIMB_NAMES) - 1, FootBlock.__module__, log=task.report) as workers:
        limbs = WalkLimbs(task.problem, Team(workers, LimbBlocks, FootBlock, task.problem), WALK_SCALES)
        motion = MotionBlock(task.problem, scales=WALK_SCALES, body_weight=1.0)
        return multi_block(limbs, motion, task, WALK_RHO, WALK_MULTI_ITERATIONS)


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
