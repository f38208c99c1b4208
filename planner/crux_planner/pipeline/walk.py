"""Planning a walk: gaits by local search on J or by one of the paper's methods; the exact problem; the check."""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from math import ceil

import numpy as np
from crux_contracts import LIMB_NAMES
from crux_contracts.scenario_types import MAX_STEPS

from crux_planner.certificates.bound.bound_worker import BoundWorker
from crux_planner.certificates.bound.walk import lower_bound
from crux_planner.checker import check_plan
from crux_planner.checker.report import CheckReport
from crux_planner.errors import HorizonError, InfeasibleError, unsolved
from crux_planner.model.walk_problem import BOLD, BOLDEST, USUAL, WalkProblem, build_walk
from crux_planner.pipeline.attempt import attempts, without_waits
from crux_planner.pipeline.message import PlanResult, walk_message
from crux_planner.pipeline.refusals import CUTS, bent
from crux_planner.pipeline.restart import edited
from crux_planner.pipeline.session import Session, method_settings
from crux_planner.pipeline.walk_contacts import WalkContacts
from crux_planner.solvers.worker import Worker, spare_cores
from crux_planner.trajectory.waiting import PACES, walk_without_waiting
from crux_planner.trajectory.walk_qp import WalkKnots, of_knots, solve

FRICTION_SHARE, SPEED_SHARE = 0.7, 0.85  # of its friction or its speeds a walk is left where the check refuses it
PACE_SHARE = 0.97  # of the pace at which a foot's joints would be just fast enough
FIRMER_SHARE = 0.02  # of the weight, by which a foot that would pull is to press harder
GENTLER = 3  # times
LONGER = (1.5, 2.0)  # times as long a horizon is tried where there is no plan
ATTEMPTS = 3  # gaits of a search that get an exact solution
_SPEEDS = ("swing_speed", "swing_yaw_rate", "body_speed", "body_rate")
_FRICTION = ("limit_surface", "limit_surface_between_knots")


@dataclass(frozen=True)
class Walk:
    """A walk with the margins it is planned with, and as it was asked for; what its worker has to spare."""

    session: Session
    problem: WalkProblem
    asked: WalkProblem
    worker: Worker


class RefusedError(InfeasibleError):
    """The check refuses a walk; `paces` are shares of each foot's speeds at which its joints keep theirs."""

    def __init__(self, report: CheckReport) -> None:
        worst = max(report.violations, key=lambda v: v.amount)
        text = f"every walk found fails the check: {worst.constraint} by {worst.amount:.3g} {worst.unit}"
        super().__init__(worst.constraint, text)
        paces = dict.fromkeys(LIMB_NAMES, 1.0)
        for joint in report.joints:
            if joint.peak_speed_rad_s > joint.speed_limit_rad_s:
                pace = PACE_SHARE * joint.speed_limit_rad_s / joint.peak_speed_rad_s
                paces[joint.limb] = min(paces[joint.limb], pace)
        self.paces = tuple(paces.values())


def plan(session: Session, worker: Worker) -> PlanResult:
    """A checked walk; `worker` bounds its cost, and helps to search where it is free."""
    with session.work.part("problem", 0.0):
        problem = build_walk(session.scenario, session.robot)
    walk = Walk(session, problem, problem, worker)
    try:
        return _plan(walk)
    except InfeasibleError as none:
        reason = none if walk.session.late else _cause(walk, none)
        raise reason.out_of_time() if walk.session.late and not isinstance(reason, HorizonError) else reason from None


def _cause(walk: Walk, none: InfeasibleError) -> InfeasibleError:
    """The horizon, where a longer one gives a plan, which is tried; else `none`."""
    if walk.session.method != "auto" or none.constraint == "horizon":
        return none
    given = walk.asked.steps
    for steps in (ceil(longer * given) for longer in LONGER):
        if steps > MAX_STEPS:
            break
        try:
            _plan(_with_horizon(walk, steps))
        except InfeasibleError:
            continue
        text = f"no plan found in {given} steps of {walk.asked.dt_s:g} s, but one in {steps}; allow as many"
        return HorizonError(text, steps, tried=True)
    return none


def _with_horizon(walk: Walk, steps: int) -> Walk:
    scenario = edited(walk.session.scenario, lambda content: content["horizon"].update(steps=steps))
    problem = build_walk(scenario, walk.session.robot)
    return replace(walk, session=replace(walk.session, scenario=scenario), problem=problem, asked=problem)


def _plan(walk: Walk) -> PlanResult:
    """With the usual margins, then bolder where nothing was found; gentler where the check refused what was found."""
    attempt = _by_search if walk.session.method == "auto" else _by_method
    failures: list[InfeasibleError] = []
    for profile in (USUAL, BOLD, BOLDEST):
        given = replace(walk, problem=replace(walk.asked, profile=profile))
        remedies = (_slower_feet, _gentler, _firmer)
        result, _ = attempts(given, attempt, remedies, failures, most=1 + GENTLER, until=walk.session.deadline)
        if result is not None:
            return result
        if failures[-1].constraint == "horizon" or walk.session.late:
            break
    raise failures[0]


def _slower_feet(walk: Walk, refused: InfeasibleError) -> Walk | None:
    """Feet as much slower as their joints ask for."""
    if not isinstance(refused, RefusedError) or min(refused.paces) >= 1.0:
        return None
    lf, rf, lr, rr = (pace * share for pace, share in zip(walk.problem.paces, refused.paces, strict=True))
    return replace(walk, problem=replace(walk.problem, paces=(lf, rf, lr, rr)))


def _gentler(walk: Walk, refused: InfeasibleError) -> Walk | None:
    """A share of the walk's speeds, or of its friction."""
    speed = SPEED_SHARE if refused.constraint in _SPEEDS else 1.0
    friction = FRICTION_SHARE if refused.constraint in _FRICTION else 1.0
    if speed == friction == 1.0:
        return None
    problem = walk.problem
    gentler = replace(
        problem,
        friction=friction * problem.friction,
        foot_speed_m_s=speed * problem.foot_speed_m_s,
        foot_yaw_rate_rad_s=speed * problem.foot_yaw_rate_rad_s,
        body=replace(problem.body, max_speed_m_s=speed * problem.body.max_speed_m_s),
    )
    return replace(walk, problem=gentler)


def _firmer(walk: Walk, refused: InfeasibleError) -> Walk | None:
    """Feet that are to press harder between the knots, where one would have to pull."""
    if refused.constraint != "foot_pull":
        return None
    profile = walk.problem.profile
    firmer = replace(profile, between_share=max(profile.between_share, 0.0) + FIRMER_SHARE)
    return replace(walk, problem=replace(walk.problem, profile=firmer))


def _by_search(walk: Walk) -> PlanResult | InfeasibleError:
    return _first_good(walk, WalkContacts(walk.problem, workers=_team(walk.worker)).search(walk.session.deadline))


def _by_method(walk: Walk) -> PlanResult | InfeasibleError:
    """One of the paper's methods decides the gait; the exact problem and the check are the same for all."""
    from crux_planner.admm.methods import METHODS, WalkTask

    session, problem, work = walk.session, walk.problem, walk.session.work
    workers = _team(walk.worker)
    contacts = WalkContacts(problem, workers=workers)
    try:
        with work.part("contacts", 0.1):
            contacts.begin(session.deadline)
            decided = METHODS[session.method](WalkTask(problem, **method_settings(session)))
    except InfeasibleError as none:
        return none
    gait = decided.knots.gait
    reached = walk_message(
        session.scenario, session.robot, walk.asked, of_knots(problem, decided.knots, 0), session.method
    )
    with work.part("check", 0.4):
        reached_report = check_plan(reached, session.robot)
    result = _first_good(walk, contacts.near(gait, session.deadline))
    if isinstance(result, PlanResult):
        result.found_by(decided, reached_report)
    return result


def _team(worker: Worker) -> list[Worker]:
    """What the search shares its work with, where the machine has a second core."""
    return [worker] if spare_cores() else []


def _first_good(walk: Walk, found: Iterator[WalkKnots]) -> PlanResult | InfeasibleError:
    """The first of the walks found that is exact and passes the check, or why none is."""
    failure: InfeasibleError | None = None
    bound = BoundWorker(walk.worker, np.inf)
    for _ in range(ATTEMPTS):
        try:
            with walk.session.work.part("contacts", 0.1):
                knots = next(found, None)
        except InfeasibleError as none:
            return failure or none
        if knots is None:
            break
        attempt = _finish(walk, bound, knots)
        if isinstance(attempt, PlanResult):
            return attempt
        failure = failure or attempt
    bound.stop()
    assert failure is not None
    return failure


def _finish(walk: Walk, bound: BoundWorker, knots: WalkKnots) -> PlanResult | InfeasibleError:
    """The exact problem and the check for a gait, whatever found it."""
    ways = [walk_without_waiting(walk.problem, knots, pace) for pace in PACES]
    shorter = [(replace(walk, problem=less), moving) for less, moving in ways if less.steps < walk.problem.steps]
    return without_waits(walk.session, (walk, knots), shorter, lambda way: _finish_as_it_is(way[0], bound, way[1]))


def _finish_as_it_is(walk: Walk, bound: BoundWorker, knots: WalkKnots) -> PlanResult | InfeasibleError:
    problem, work, gait = walk.problem, walk.session.work, knots.gait
    bounded = replace(walk.asked, profile=problem.profile, steps=problem.steps)
    bound.start((bounded.steps, bounded.profile), lower_bound, bounded)
    for _ in range(1 + CUTS):
        with work.part("nlp", 0.5):
            solution = solve(problem, knots, walk.session.deadline)
        if not solution.solved:
            return unsolved(", ".join(gait.names), solution.status)
        with work.part("check", 0.8):
            message = walk_message(walk.session.scenario, walk.session.robot, problem, solution, walk.session.method)
            report = check_plan(message, walk.session.robot)
        less = None if report.ok else bent(problem, solution, report)
        if less is None:
            break
        problem = less
    if not report.ok:
        return RefusedError(report)
    result = PlanResult.of(message, report, solution, gait.names, work)
    with work.part("bound", 0.95):
        result.gap = bound.gap(result.cost)
    return result
