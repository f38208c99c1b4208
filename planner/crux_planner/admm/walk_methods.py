"""The paper's methods on walks: each decides the gait, with footholds, body path and forces for the exact NLP."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass, field
from typing import Any

from crux_contracts import LIMB_NAMES

from crux_planner.admm.admm import Report, Run, multi_block, two_block
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
class WalkTask:
    """A walk and the method's settings."""

    problem: WalkProblem
    deadline: float  # of clock.now
    rho: float | None = None
    iterations: int | None = None
    moments: bool = True  # (8b) in the contact block
    to_the_end: bool = False  # all iterations, thresholds or not
    report: Report = lambda _line: None
    workers: Sequence[Worker] = ()


@dataclass(frozen=True)
class WalkDecided:
    """What a method reached by itself."""

    knots: WalkKnots
    converged: bool
    iterations: int
    residuals: list[dict[str, float]] = field(default_factory=list)
    gaits: list[list[str]] = field(default_factory=list)
    relaxations: dict[float, int] = field(default_factory=dict)  # the benchmark's, and ipopt's iterations for each

    def to_json(self) -> dict[str, Any]:
        """What `crux plan --json` says of the method alone."""
        said = {"cost": self.knots.cost, "converged": self.converged, "gait": self.knots.gait.names}
        return {**said, "relaxations": self.relaxations} if self.relaxations else said


def decide_two_block(task: WalkTask) -> WalkDecided:
    """Equation (19), but for a contact block that is the search of `auto` and no MIP."""
    contacts = WalkContacts(task.problem, SCALES, moments=task.moments, workers=task.workers)
    run = two_block(
        contacts,
        WalkMotion(task.problem, SCALES),
        rho=task.rho or RHO,
        iterations=task.iterations or ITERATIONS,
        deadline=task.deadline,
        report=task.report,
        to_the_end=task.to_the_end,
    )
    return _decided(run)


def decide_multi_block(task: WalkTask) -> WalkDecided:
    """P3: one contact block a limb in parallel processes, which looks at all its steps, and one NLP."""
    with crew(len(LIMB_NAMES) - 1, FootBlocks.__module__, log=task.report) as workers:
        feet = Team(workers, FootBlocks, task.problem)
        run = multi_block(
            WalkLimbs(task.problem, feet, SCALES),
            WalkMotion(task.problem, SCALES, body_weight=1.0),
            rho=task.rho or MULTI_RHO,
            iterations=task.iterations or MULTI_ITERATIONS,
            deadline=task.deadline,
            report=task.report,
            to_the_end=task.to_the_end,
        )
    return _decided(run)


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
    return WalkDecided(
        knots=run.plan.knots,
        converged=run.converged,
        iterations=len(run.residuals),
        residuals=[asdict(r) for r in run.residuals],
        gaits=run.gaits,
    )
