"""Planning a walk: gaits scored by a QP, or decided by one of the paper's methods; the exact NLP; the check."""

from __future__ import annotations

import time
from collections.abc import Callable
from contextlib import AbstractContextManager
from typing import Protocol

from crux_contracts.robot import Robot
from crux_contracts.scenario import Scenario

from crux_planner.bound.gap import gap
from crux_planner.bound.walk import lower_bound
from crux_planner.checker import check_plan
from crux_planner.errors import InfeasibleError
from crux_planner.result import PlanResult
from crux_planner.walk.gait import Candidate, candidates
from crux_planner.walk.message import walk_message
from crux_planner.walk.nlp import solve
from crux_planner.walk.problem import WalkProblem, build_walk

ATTEMPTS = 3  # gaits of each kind that get an NLP


class Work(Protocol):
    """Says what is being done and keeps the time of each part."""

    seconds: dict[str, float]

    @property
    def log(self) -> Callable[[str], None]: ...
    def part(self, name: str, share: float) -> AbstractContextManager[None]: ...


def plan_walk(scenario: Scenario, robot: Robot, work: Work, deadline: float, method: str = "auto") -> PlanResult:
    """A checked walk. Raises ScenarioError, or InfeasibleError where no plan exists or none was found."""
    with work.part("problem", 0.0):
        problem = build_walk(scenario, robot)
    if method != "auto":
        return _plan_by_method(scenario, robot, problem, work, deadline, method)
    failure = InfeasibleError(
        "equilibrium",
        "no gait keeps the body in balance and the feet within reach on the straight way to the goal in time",
    )
    for at_once in (1, 2):  # two feet at a time only where one at a time does not do
        with work.part("contacts", 0.1):
            found = candidates(problem, at_once)
        for candidate in found[:ATTEMPTS]:
            attempt = _finish(scenario, robot, problem, candidate, work, deadline, method)
            if isinstance(attempt, PlanResult):
                return attempt
            failure = attempt
            if time.monotonic() > deadline:
                raise failure
    raise failure


def _plan_by_method(
    scenario: Scenario, robot: Robot, problem: WalkProblem, work: Work, deadline: float, method: str
) -> PlanResult:
    """One of the paper's methods decides the gait; the exact NLP and the check are the same for all."""
    from crux_planner.walk.methods import METHODS, WalkTask

    options = scenario.planner
    with work.part("contacts", 0.1):
        decided = METHODS[method](WalkTask(problem, deadline, options.rho, options.iterations, report=work.log))
    alone = walk_message(scenario, robot, problem, decided.knots.gait, decided.solution, method)
    with work.part("check", 0.4):
        alone_report = check_plan(alone, robot)
    attempt = _finish(scenario, robot, problem, decided.candidate, work, deadline, method)
    if isinstance(attempt, InfeasibleError):
        raise attempt
    attempt.iterations, attempt.history = decided.iterations, decided.residuals
    worst = alone_report.to_json()["worst"][:1]
    attempt.alone = {**decided.to_json(), "check": {"ok": alone_report.ok, "worst": worst}}
    return attempt


def _finish(
    scenario: Scenario,
    robot: Robot,
    problem: WalkProblem,
    candidate: Candidate,
    work: Work,
    deadline: float,
    method: str,
) -> PlanResult | InfeasibleError:
    """The exact NLP and the check for a gait, whatever found it."""
    gait = candidate.gait
    with work.part("nlp", 0.5):
        solution = solve(problem, candidate, max(deadline - time.monotonic(), 1.0))
    if not solution.solved:
        text = f"the exact problem has no solution for the gait {', '.join(gait.names)} ({solution.status})"
        return InfeasibleError("dynamics", text)
    with work.part("check", 0.8):
        message = walk_message(scenario, robot, problem, gait, solution, method)
        report = check_plan(message, robot)
    if report.ok:
        return PlanResult(
            ok=True,
            plan=message,
            check=report,
            cost=solution.cost,
            gap=gap(solution.cost, lower_bound(problem)),
            iterations=solution.iterations,
            gait=gait.names,
            position_residual_m=solution.position_residual_m,
            force_residual_N=solution.force_residual_N,
            timing=work.seconds,
        )
    worst = max(report.violations, key=lambda v: v.amount)
    return InfeasibleError(
        worst.constraint,
        f"every walk found fails the check: {worst.constraint} by {worst.amount:.3g} {worst.unit}",
    )
