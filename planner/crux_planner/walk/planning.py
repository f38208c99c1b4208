"""Planning a walk: gaits by local search on J, or decided by one of the paper's methods; the exact NLP; the check."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager
from dataclasses import replace
from typing import Protocol

from crux_contracts.robot import Robot
from crux_contracts.scenario import Scenario

from crux_planner.admm.consensus import Scales
from crux_planner.bound.gap import gap
from crux_planner.bound.walk import lower_bound
from crux_planner.checker import check_plan
from crux_planner.errors import InfeasibleError, wrong
from crux_planner.result import PlanResult
from crux_planner.walk.contact_block import WalkContacts, as_candidate
from crux_planner.walk.gait import Candidate, Gait, candidates
from crux_planner.walk.message import walk_message
from crux_planner.walk.nlp import solve
from crux_planner.walk.problem import WalkProblem, build_walk

CAUTION = ((1.0, 1.0), (0.7, 1.0), (0.85, 0.85))  # of friction and of speeds, in turn where the check refuses a walk
ORACLES = 40  # asked by the local search over gaits
ATTEMPTS = 2  # regular gaits of each kind that get an NLP


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
    failure: InfeasibleError | None = None
    for walk, candidate in _candidates(problem, work, deadline):
        attempt = _finish(scenario, robot, walk, problem, candidate, work, deadline, method)
        if isinstance(attempt, PlanResult):
            return attempt
        failure = failure or attempt
        if time.monotonic() > deadline:
            break
    raise failure or InfeasibleError(
        "equilibrium",
        "no gait keeps the body in balance and the feet within reach on the straight way to the goal in time",
    )


def _candidates(problem: WalkProblem, work: Work, deadline: float) -> Iterator[tuple[WalkProblem, Candidate]]:
    """The local search's gait, a gentler one should the exact problem or the check refuse it, then regular ones."""
    for caution in CAUTION:
        walk = gentler(problem, *caution)
        with work.part("contacts", 0.1):
            try:
                found = WalkContacts(walk, Scales(), oracles=ORACLES).minimise(0.0, None, deadline)
            except InfeasibleError:
                if walk.friction == problem.friction and walk.foot_speed_m_s == problem.foot_speed_m_s:
                    raise
                continue
        yield walk, as_candidate(found.knots)
    for at_once in (1, 2):  # two feet at a time only where one at a time does not do
        try:
            with work.part("contacts", 0.1):
                regular = candidates(problem, at_once)
        except InfeasibleError:  # too short a horizon
            continue
        yield from ((problem, candidate) for candidate in regular[:ATTEMPTS])


def gentler(problem: WalkProblem, friction: float, speed: float) -> WalkProblem:
    """The walk with a share of its friction and of its speeds."""
    body = replace(problem.body, max_speed_m_s=speed * problem.body.max_speed_m_s)
    return replace(
        problem, friction=friction * problem.friction, foot_speed_m_s=speed * problem.foot_speed_m_s, body=body
    )


def _plan_by_method(
    scenario: Scenario, robot: Robot, problem: WalkProblem, work: Work, deadline: float, method: str
) -> PlanResult:
    """One of the paper's methods decides the gait; the exact NLP and the check are the same for all."""
    from crux_planner.walk.methods import METHODS, WalkTask

    if method not in METHODS:
        raise wrong(scenario, "planner.method", method, f"expected auto, {', '.join(METHODS)} with contact.model point")
    options, failure = scenario.planner, None
    for caution in CAUTION:
        walk = gentler(problem, *caution)
        with work.part("contacts", 0.1):
            decided = METHODS[method](WalkTask(walk, deadline, options.rho, options.iterations, report=work.log))
        candidate = _mended(walk, decided.knots.gait, deadline) or decided.candidate
        alone = walk_message(scenario, robot, problem, decided.knots.gait, decided.solution, method)
        with work.part("check", 0.4):
            alone_report = check_plan(alone, robot)
        attempt = _finish(scenario, robot, walk, problem, candidate, work, deadline, method)
        if isinstance(attempt, PlanResult):
            attempt.iterations, attempt.history = decided.iterations, decided.residuals
            worst = alone_report.to_json()["worst"][:1]
            attempt.alone = {**decided.to_json(), "check": {"ok": alone_report.ok, "worst": worst}}
            return attempt
        failure = failure or attempt
        if time.monotonic() > deadline:
            break
    assert failure is not None
    raise failure


def _mended(problem: WalkProblem, gait: Gait, deadline: float) -> Candidate | None:
    """The gait, or where feet that decided each for itself leave no body path in balance, the best near it."""
    knots = WalkContacts(problem, Scales()).near(gait, deadline)
    return None if knots is None else as_candidate(knots)


def _finish(
    scenario: Scenario,
    robot: Robot,
    problem: WalkProblem,
    asked: WalkProblem,
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
            gap=gap(solution.cost, lower_bound(asked)),
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
