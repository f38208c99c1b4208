"""The methods by name: each decides the contacts, with a body path and forces from which the exact program starts."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from crux_contracts import LIMB_NAMES

from crux_planner.admm.admm import Decided, Settings, multi_block, two_block
from crux_planner.admm.benchmark import Benchmark
from crux_planner.admm.contact_block import ClimbContacts, WalkSteps
from crux_planner.admm.limbs import ClimbLimbs, FootMips, LimbMips, WalkLimbs
from crux_planner.admm.motion_block import MotionBlock
from crux_planner.admm.walk_benchmark import WalkBenchmark
from crux_planner.admm.windows import Windows
from crux_planner.model.problem import Problem
from crux_planner.model.walk_problem import WalkProblem
from crux_planner.physics.cost import FORCE_SHARE
from crux_planner.solvers.relaxation import RELAXATIONS
from crux_planner.solvers.worker import Team, crew
from crux_planner.trajectory.consensus import Scales

RHO, MULTI_RHO = 10.0, 10.0
ITERATIONS, MULTI_ITERATIONS = 40, 80
SCALES = Scales(position=3.0, orientation=3.0, force=0.007, moment=0.5, flag=4.0)
WALK_SCALES = Scales(flag=4.0)


@dataclass(frozen=True)
class Task(Settings):
    """A climb on the grid of its contact blocks, and the method's settings."""

    windows: Windows
    moments: bool = False  # (8b) in two_block's MIP, too, where the paper has none

    @property
    def problem(self) -> Problem:
        """P1."""
        return self.windows.problem


@dataclass(frozen=True)
class WalkTask(Settings):
    """A walk and the method's settings."""

    problem: WalkProblem


def decide_two_block(task: Task | WalkTask) -> Decided[Any]:
    """Equation (19)."""
    contacts: WalkSteps | ClimbContacts
    if isinstance(task, WalkTask):
        contacts = WalkSteps(task.problem, WALK_SCALES)
    else:
        contacts = ClimbContacts(task.windows, SCALES, moments=task.moments)
    return two_block(contacts, MotionBlock(task.problem, scales=contacts.scales), task, RHO, ITERATIONS)


def decide_multi_block(task: Task | WalkTask) -> Decided[Any]:
    """P3: a MIP a limb in parallel processes, and one NLP."""
    rho = task.rho or MULTI_RHO
    with crew(len(LIMB_NAMES) - 1, LimbMips.__module__, log=task.report) as workers:
        if isinstance(task, WalkTask):
            scales = _even(WALK_SCALES, rho, FORCE_SHARE * task.problem.weights.wrench, 1.0)
            feet = Team(workers, FootMips, task.problem, scales)
            limbs: WalkLimbs | ClimbLimbs = WalkLimbs(task.problem, feet, scales)
        else:
            scales = _even(SCALES, rho, task.problem.weights.wrench, task.problem.patch.k_m)
            limbs = ClimbLimbs(task.windows, Team(workers, LimbMips, task.windows, scales), scales)
        motion = MotionBlock(task.problem, scales=scales, body_weight=1.0)
        return multi_block(limbs, motion, limbs.standing(), task, MULTI_RHO, MULTI_ITERATIONS)


def _even(scales: Scales, rho: float, effort: float, twist_m: float) -> Scales:
    """With forces and moments that weigh as much in the consensus as in J, where forces cost `effort` [1/N^2]: with
    contacts that stay, limbs and NLP then halve what is between them from one iteration to the next, and neither a
    larger rho nor a smaller one is as quick.
    """
    force = float(np.sqrt(2 * effort / rho))
    return replace(scales, force=force, moment=force / twist_m)


def decide_benchmark(task: Task | WalkTask) -> Decided[Any]:
    """P1 as one NLP."""
    benchmark = WalkBenchmark(task.problem) if isinstance(task, WalkTask) else Benchmark(task.windows)
    knots, iterations = benchmark.solve(task.deadline, task.report)
    return Decided(knots=knots, relaxations=dict(zip(RELAXATIONS, iterations, strict=True)))


METHODS: dict[str, Callable[[Task | WalkTask], Decided[Any]]] = {
    "two_block": decide_two_block,
    "multi_block": decide_multi_block,
    "benchmark": decide_benchmark,
}
"""All raise InfeasibleError where they find no contacts."""
