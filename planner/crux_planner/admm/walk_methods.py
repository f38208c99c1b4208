"""The paper's methods on walks: each decides the gait, with footholds, body path and forces for the exact NLP."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from typing import Any

from crux_contracts import LIMB_NAMES

from crux_planner.admm.admm import Outcome, Run, Settings, multi_block, two_block
from crux_planner.admm.walk_benchmark import WalkBenchmark
from crux_planner.admm.walk_contact_block import WalkContacts, WalkPlan
from crux_planner.admm.walk_limb_block import FootBlocks
from crux_planner.admm.walk_limbs import WalkLimbs
from crux_planner.admm.walk_motion_block import WalkMotion
from crux_planner.model.walk_problem import WalkProblem
from crux_planner.solvers.relaxation import RELAXATIONS
from crux_planner.solvers.worker import Team, Worker, crew
from crux_planner.trajectory.consensus import Scales
from crux_planner.trajectory.walk_qp import WalkKnots

RHO, ITERATIONS = 1.5, 10
MULTI_RHO, MULTI_ITERATIONS = 1.5, 60
SCALES = Scales(force=0.03)


@dataclass(frozen=True)
class WalkTask(Settings):
    """A walk and the method's settings."""

    problem: WalkProblem
    workers: Sequence[Worker] = ()


@dataclass(frozen=True)
class WalkDecided(Outcome):
    """What a method reached by itself."""

    knots: WalkKnots
    relaxations: dict[float, int] = field(default_factory=dict)  # the benchmark's, and ipopt's iterations for each

    def to_json(self) -> dict[str, Any]:
        """What `crux plan --json` says of the method alone."""
        said = {"cost": self.knots.cost, "converged": self.converged, "gait": self.knots.gait.names}
        return {**said, "relaxations": self.relaxations} if self.relaxations else said


def decide_two_block(task: WalkTask) -> WalkDecided:
    """Equation (19), but for a contact block that is the search of `auto` and no MIP."""
    contacts = WalkContacts(task.problem, SCALES, moments=task.moments, workers=task.workers)
    return _decided(two_block(contacts, WalkMotion(task.problem, SCALES), task, RHO, ITERATIONS))


def decide_multi_block(task: WalkTask) -> WalkDecided:
    """P3: one contact block a limb in parallel processes, which looks at all its steps, and one NLP."""
    with crew(len(LIMB_NAMES) - 1, FootBlocks.__module__, log=task.report) as workers:
        feet = Team(workers, FootBlocks, task.problem)
        limbs, motion = WalkLimbs(task.problem, feet, SCALES), WalkMotion(task.problem, SCALES, body_weight=1.0)
        return _decided(multi_block(limbs, motion, task, MULTI_RHO, MULTI_ITERATIONS))


def decide_benchmark(task: WalkTask) -> WalkDecided:
    """P1 as one NLP."""
    knots, iterations = WalkBenchmark(task.problem).solve(task.deadline, task.report)
    relaxations = dict(zip(RELAXATIONS, iterations, strict=True))
    return WalkDecided(knots, converged=True, iterations=sum(iterations), relaxations=relaxations)


METHODS: dict[str, Callable[[WalkTask], WalkDecided]] = {
    "two_block": decide_two_block,
    "multi_block": decide_multi_block,
    "benchmark": decide_benchmark,
}
"""All raise InfeasibleError where they find no gait."""


def _decided(run: Run[WalkPlan]) -> WalkDecided:
    return WalkDecided(run.plan.knots, **run.outcome)
