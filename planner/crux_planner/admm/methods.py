"""The methods by name: each decides the contacts, and a body path with wrenches from which the exact NLP starts."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from crux_contracts import LIMB_NAMES

from crux_planner.admm.admm import Outcome, Run, Settings, multi_block, two_block
from crux_planner.admm.benchmark import Benchmark
from crux_planner.admm.climb_limbs import ClimbLimbs
from crux_planner.admm.contact_block import ContactBlock, ContactPlan
from crux_planner.admm.limb_block import LimbBlocks
from crux_planner.admm.motion_block import MotionBlock
from crux_planner.admm.windows import Windows
from crux_planner.model.arrays import Array
from crux_planner.model.problem import Problem
from crux_planner.model.schedule import Schedule
from crux_planner.search.body_path import BodyPath
from crux_planner.search.equilibrium import StaticEquilibrium
from crux_planner.search.stances import ReachableSet
from crux_planner.solvers.worker import Team, crew
from crux_planner.swing.swing_cache import SwingCache
from crux_planner.trajectory.consensus import Scales
from crux_planner.trajectory.solution import Solution

RHO, MULTI_RHO = 10.0, 40.0
ITERATIONS, MULTI_ITERATIONS = 10, 40
MULTI_SCALES = Scales(position=3.0)  # limbs that know nothing of the body follow it faster so


@dataclass(frozen=True)
class Task(Settings):
    """A problem with what has been computed of it, and the method's settings."""

    problem: Problem
    equilibrium: StaticEquilibrium
    reach: ReachableSet
    swings: SwingCache


@dataclass(frozen=True)
class Decided(Outcome):
    """What a method reached by itself: contacts, body states (N + 1, 12), wrenches q = (s1, s2, m, n1, n2), J."""

    schedule: Schedule
    body: Array
    wrenches: list[dict[int, Array]]
    cost: float

    @property
    def path(self) -> BodyPath:
        """Where the exact NLP starts."""
        return BodyPath(self.body[:, :3], [{limb: _shared(q) for limb, q in knot.items()} for knot in self.wrenches])

    @property
    def solution(self) -> Solution:
        """For the check of what the method reached alone."""
        return Solution(self.body, self.wrenches, self.cost, 0, "", self.converged, 0.0, 0.0, {})

    def to_json(self) -> dict[str, Any]:
        """What `crux plan --json` says of the method alone."""
        return {"cost": self.cost, "converged": self.converged, "gait": self.schedule.gait}


def decide_two_block(task: Task) -> Decided:
    """Equation (19), but for a contact block that begins with the search of `auto` and has (8b) in its MIP."""
    scales = Scales()
    contacts = ContactBlock(
        task.problem, task.equilibrium, task.reach, task.swings, moments=task.moments, scales=scales
    )
    return _decided(two_block(contacts, MotionBlock(task.problem, scales=scales), task, RHO, ITERATIONS))


def decide_multi_block(task: Task) -> Decided:
    """P3: one contact block a limb in parallel processes, a shortest path and no MIP, and one NLP."""
    windows = Windows(task.problem, task.reach, task.swings)
    with crew(len(LIMB_NAMES) - 1, LimbBlocks.__module__, log=task.report) as workers:
        blocks = Team(workers, LimbBlocks, windows, task.equilibrium)
        limbs = ClimbLimbs(windows, task.equilibrium, blocks, MULTI_SCALES, task.deadline)
        motion = MotionBlock(task.problem, scales=MULTI_SCALES, body_weight=1.0)
        return _decided(multi_block(limbs, motion, task, MULTI_RHO, MULTI_ITERATIONS))


def decide_benchmark(task: Task) -> Decided:
    """P1 as one NLP."""
    benchmark = Benchmark(Windows(task.problem, task.reach, task.swings))
    schedule, body, wrenches, cost, iterations = benchmark.solve(task.deadline)
    return Decided(schedule, body, wrenches, cost, converged=True, iterations=iterations)


METHODS: dict[str, Callable[[Task], Decided]] = {
    "two_block": decide_two_block,
    "multi_block": decide_multi_block,
    "benchmark": decide_benchmark,
}
"""All raise InfeasibleError where they find no contacts."""


def _decided(run: Run[ContactPlan]) -> Decided:
    knots = run.plan.knots
    return Decided(run.plan.schedule, knots.body, knots.wrenches, knots.cost, **run.outcome)


def _shared(q: Array) -> Array:
    """(s1, s2, m, F, n): net normal force and the smaller of the two."""
    return np.array([*q[:3], q[3] - q[4], min(q[3], q[4])])
