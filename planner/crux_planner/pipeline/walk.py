"""Planning a walk: gaits by local search on J or by one of the paper's methods; the exact problem; the check."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace

import numpy as np
from crux_contracts import LIMB_NAMES
from crux_contracts.robot import Robot
from crux_contracts.scenario import Scenario

from crux_planner.admm.walk_contact_block import WalkContacts
from crux_planner.certificates.bound.bound_worker import BoundWorker
from crux_planner.certificates.bound.walk import lower_bound
from crux_planner.checker import check_plan
from crux_planner.checker.report import CheckReport
from crux_planner.errors import InfeasibleError, unsolved, wrong
from crux_planner.model.walk_problem import BOLD, BOLDEST, USUAL, WalkProblem, build_walk
from crux_planner.pipeline.message import PlanResult
from crux_planner.pipeline.session import Progress, Work, begin
from crux_planner.pipeline.stretch import CUTS, bent
from crux_planner.pipeline.walk_message import walk_message
from crux_planner.solvers import clock
from crux_planner.solvers.worker import Worker, spare_cores
from crux_planner.trajectory.waiting import walk_without_waiting
from crux_planner.trajectory.walk_exact import of_knots, solve
from crux_planner.trajectory.walk_qp import WalkKnots

FRICTION_SHARE, SPEED_SHARE = 0.7, 0.85  # of its friction or its speeds a walk is left where the check refuses it
PACE_SHARE = 0.97  # of the pace at which a foot's joints would be just fast enough
GENTLER = 3  # times
ATTEMPTS = 3  # gaits of a search that get an exact solution
_SPEEDS = ("swing_speed", "swing_yaw_rate", "body_speed", "body_rate")
_FRICTION = ("limit_surface", "limit_surface_between_knots")


class RefusedError(InfeasibleError):
    """The check refuses a walk; `paces` are shares of each foot's speeds at which its joints keep theirs."""

    def __init__(self, report: CheckReport) -> None:
        worst = max(report.violations, key=lambda v: v.amount)
        text = f"every walk found fails the check: {worst.constraint} by {worst.amount:.3g} {worst.unit}"
        super().__init__(worst.constraint, text)
        paces = dict.fromkeys(LIMB_NAMES, 1.0)
        for joint in report.joints:
            if joint.peak_speed_rad_s > joint.speed_limit_rad_s:
                paces[joint.limb] = min(
                    paces[joint.limb], PACE_SHARE * joint.speed_limit_rad_s / joint.peak_speed_rad_s
                )
        self.paces = tuple(paces.values())


def plan(
    scenario: Scenario,
    robot: Robot,
    *,
    method: str = "auto",
    time_limit_s: float | None = None,
    progress: Progress | None = None,
    log: Callable[[str], None] | None = None,
    worker: Worker | None = None,
) -> PlanResult:
    """A checked walk. Raises ScenarioError, or InfeasibleError where no plan exists or none was found."""
    work, deadline = begin(scenario, method, time_limit_s, progress, log)
    worker = worker or Worker(log=work.log)
    try:
        result = _plan(scenario, robot, work, worker, deadline, method)
    except InfeasibleError as none:
        raise none.out_of_time() if clock.now() > deadline else none from None
    finally:
        worker.stop()
    result.method, result.seconds = method, time.monotonic() - work.began
    return result


def _plan(scenario: Scenario, robot: Robot, work: Work, worker: Worker, deadline: float, method: str) -> PlanResult:
    with work.part("problem", 0.0):
        problem = build_walk(scenario, robot)
    if method != "auto":
        return _plan_by_method(scenario, robot, problem, work, worker, deadline, method)
    failures: list[InfeasibleError] = []
    for walk in _walks(problem, failures):
        found = WalkContacts(walk, workers=_team(worker)).search(deadline)
        result = _first_good(scenario, robot, walk, problem, found, work, worker, deadline, method)
        if isinstance(result, PlanResult):
            return result
        failures.append(result)
        if result.constraint == "horizon" or clock.now() > deadline:
            break
    raise failures[0]


def _walks(problem: WalkProblem, failures: list[InfeasibleError]) -> Iterator[WalkProblem]:
    """The walk with the usual margins, gentler where the check refused what was found, bolder where nothing was."""
    for profile in (USUAL, BOLD, BOLDEST):
        walk = replace(problem, profile=profile)
        for _ in range(1 + GENTLER):
            yield walk
            refused = failures[-1]
            if isinstance(refused, RefusedError) and min(refused.paces) < 1.0:
                walk = slower(walk, refused.paces)
            elif refused.constraint in _SPEEDS:
                walk = gentler(walk, 1.0, SPEED_SHARE)
            elif refused.constraint in _FRICTION:
                walk = gentler(walk, FRICTION_SHARE, 1.0)
            else:
                break


def slower(problem: WalkProblem, paces: Sequence[float]) -> WalkProblem:
    """The walk with feet as much slower as their joints ask for."""
    lf, rf, lr, rr = (pace * share for pace, share in zip(problem.paces, paces, strict=True))
    return replace(problem, paces=(lf, rf, lr, rr))


def gentler(problem: WalkProblem, friction: float, speed: float) -> WalkProblem:
    """The walk with a share of its friction and of its speeds."""
    body = replace(problem.body, max_speed_m_s=speed * problem.body.max_speed_m_s)
    return replace(
        problem,
        friction=friction * problem.friction,
        foot_speed_m_s=speed * problem.foot_speed_m_s,
        foot_yaw_rate_rad_s=speed * problem.foot_yaw_rate_rad_s,
        body=body,
    )


def _plan_by_method(
    scenario: Scenario, robot: Robot, problem: WalkProblem, work: Work, worker: Worker, deadline: float, method: str
) -> PlanResult:
    """One of the paper's methods decides the gait; the exact problem and the check are the same for all."""
    from crux_planner.admm.walk_methods import METHODS, WalkTask

    if method not in METHODS:
        raise wrong(scenario, "planner.method", method, f"expected auto, {', '.join(METHODS)} with contact.model point")
    options, failures = scenario.planner, list[InfeasibleError]()
    for walk in _walks(problem, failures):
        contacts = WalkContacts(walk, workers=_team(worker))
        try:
            with work.part("contacts", 0.1):
                contacts.begin(deadline)
                task = WalkTask(walk, deadline, options.rho, options.iterations, report=work.log, workers=_team(worker))
                decided = METHODS[method](task)
        except InfeasibleError as none:
            failures.append(none)
            continue
        alone = walk_message(scenario, robot, problem, decided.knots.gait, of_knots(walk, decided.knots, 0), method)
        with work.part("check", 0.4):
            alone_report = check_plan(alone, robot)
        near = contacts.near(decided.knots.gait, deadline)
        result = _first_good(scenario, robot, walk, problem, near, work, worker, deadline, method)
        if isinstance(result, PlanResult):
            result.iterations, result.history = decided.iterations, decided.residuals
            worst = alone_report.to_json()["worst"][:1]
            result.alone = {**decided.to_json(), "check": {"ok": alone_report.ok, "worst": worst}}
            return result
        failures.append(result)
        if clock.now() > deadline:
            break
    raise failures[0]


def _team(worker: Worker) -> list[Worker]:
    """What the search shares its work with, where the machine has a second core."""
    return [worker] if spare_cores() else []


def _first_good(
    scenario: Scenario,
    robot: Robot,
    problem: WalkProblem,
    asked: WalkProblem,
    found: Iterator[WalkKnots],
    work: Work,
    worker: Worker,
    deadline: float,
    method: str,
) -> PlanResult | InfeasibleError:
    """The first of the walks found that is exact and passes the check, or why none is: without its waits, unless that
    fails or the scenario keeps them.
    """
    failure: InfeasibleError | None = None
    bound = BoundWorker(worker, np.inf)
    for _ in range(ATTEMPTS):
        try:
            with work.part("contacts", 0.1):
                knots = next(found, None)
        except InfeasibleError as none:
            return failure or none
        if knots is None:
            break
        attempt = _finish(scenario, robot, problem, asked, bound, knots, work, deadline, method)
        if isinstance(attempt, PlanResult):
            return attempt
        failure = failure or attempt
    bound.stop()
    assert failure is not None
    return failure


def _finish(
    scenario: Scenario,
    robot: Robot,
    problem: WalkProblem,
    asked: WalkProblem,
    bound: BoundWorker,
    knots: WalkKnots,
    work: Work,
    deadline: float,
    method: str,
) -> PlanResult | InfeasibleError:
    """The exact problem and the check for a gait, whatever found it: without its waits, unless that fails or the
    scenario keeps them.
    """
    if scenario.planner.idle != "keep":
        shorter, moving = walk_without_waiting(problem, knots)
        if shorter.steps < problem.steps:
            attempt = _finish_as_it_is(scenario, robot, shorter, asked, bound, moving, work, deadline, method)
            if isinstance(attempt, PlanResult):
                return attempt
            work.log(f"refused without its waits: {attempt}")
    return _finish_as_it_is(scenario, robot, problem, asked, bound, knots, work, deadline, method)


def _finish_as_it_is(
    scenario: Scenario,
    robot: Robot,
    problem: WalkProblem,
    asked: WalkProblem,
    bound: BoundWorker,
    knots: WalkKnots,
    work: Work,
    deadline: float,
    method: str,
) -> PlanResult | InfeasibleError:
    bounded = replace(asked, profile=problem.profile, steps=problem.steps)
    bound.start((bounded.steps, bounded.profile), lower_bound, bounded)
    gait = knots.gait
    for _ in range(1 + CUTS):
        with work.part("nlp", 0.5):
            solution = solve(problem, knots, deadline)
        if not solution.solved:
            return unsolved(", ".join(gait.names), solution.status)
        with work.part("check", 0.8):
            message = walk_message(scenario, robot, problem, gait, solution, method)
            report = check_plan(message, robot)
        less = None if report.ok else bent(problem, gait, solution, report)
        if less is None:
            break
        problem = less
    if report.ok:
        with work.part("bound", 0.95):
            proven = bound.gap(solution.cost)
        return PlanResult(
            ok=True,
            plan=message,
            check=report,
            cost=solution.cost,
            gap=proven,
            iterations=solution.iterations,
            gait=gait.names,
            position_residual_m=solution.position_residual_m,
            force_residual_N=solution.force_residual_N,
            timing=work.seconds,
        )
    return RefusedError(report)
