"""Planning a climb: contact search, schedule, quasi-static body path, exact NLP, independent check."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from crux_contracts.robot import Robot
from crux_contracts.scenario import METHODS, Scenario

from crux_planner.admm.knot_qp import plan_cost
from crux_planner.bound.beside import Beside
from crux_planner.build import build_problem
from crux_planner.checker import CheckReport, check_plan
from crux_planner.errors import InfeasibleError, wrong
from crux_planner.exact import solve_within_torques
from crux_planner.nlp import Solution, start_from_path
from crux_planner.problem import LIMBS, Problem
from crux_planner.reasons import check_start, explain
from crux_planner.result import PlanResult, plan_message
from crux_planner.search.balance import Balance
from crux_planner.search.body_path import SPEED_SHARE, BodyPath, knot_path, smooth_events
from crux_planner.search.calm import TooHasty, slowed
from crux_planner.search.event_cost import EventCost
from crux_planner.search.improve import improve
from crux_planner.search.schedule import Schedule, at_knots, lay_out
from crux_planner.search.stances import Move, Reach, SearchReport, goal_contacts, search
from crux_planner.search.strength import Strength
from crux_planner.search.ways import Ways
from crux_planner.wider import plan_wider
from crux_planner.work import Culprit, Progress, Work

TIME_LIMIT_S = 60.0
CHECK_S, CHECK_SHARE = 1.0, 0.2  # of the time limit, the less of both is left to the check
IMPROVING_SHARE = 0.1  # of the time left, at most, goes into a cheaper sequence near the one found
IMPROVED_SHARE = 0.92  # of the first sequence's cost that is left when cheaper ones have been tried
QUICKEST_SHARE = 1 / 3  # of the time left goes into the quickest sequence of contacts
GREED = 2.0  # the factor by which a sequence may be slower after that
LEVEL_SHARE = 0.6  # of the time goes at most into plans of a level body with one heading
TWO_AT_ONCE_HELPS = ("horizon", "passage")  # with two limbs in the air: quicker, and out of each other's way
TIGHTER = 0.8  # of the usual share of the limit surface, where the check finds too little between the knots
CALMINGS = 6  # times that a sequence is laid out anew with a slower body on the supports that the check names
ATTEMPTS = 6  # sequences of contacts tried, each without the move on which the one before failed


def plan(
    scenario: Scenario,
    robot: Robot,
    *,
    method: str = "auto",
    time_limit_s: float | None = None,
    progress: Progress | None = None,
    log: Callable[[str], None] | None = None,
    prove_s: float | None = None,
) -> PlanResult:
    """Plan a climb and check it; `log` is told one line at a time what a method reports of its iterations.

    The gap is what a bound beside the planning proves with a fixed amount of work; with `prove_s`, it goes on for up to
    so long.

    Raises ScenarioError where the scenario must be mended, InfeasibleError where no plan exists or none was found.
    """
    if method not in METHODS:
        raise wrong(scenario, "planner.method", method, f"expected {', '.join(METHODS)}: the methods this planner has")
    work = Work(progress or (lambda _what, _share: None), log or (lambda _line: None))
    limit_s = time_limit_s or scenario.planner.time_limit_s or TIME_LIMIT_S
    deadline = work.began + limit_s - min(CHECK_S, CHECK_SHARE * limit_s)
    if scenario.contact.model == "point":
        return _plan_walk(scenario, robot, work, deadline, method)
    with work.part("problem", 0.0):
        problem = build_problem(scenario, robot)
        check_start(scenario, problem, Balance(problem, problem.friction_share))
        reach, ways = Reach(problem), Ways(problem)
    work.bound = Beside(problem, prove_s)
    try:
        if method != "auto":
            return _plan_by_method(scenario, robot, problem, reach, ways, work, deadline, method)
        until = time.monotonic() + LEVEL_SHARE * (deadline - time.monotonic())
        result = _plan_level(scenario, robot, problem, reach, ways, work, until)
    except InfeasibleError as none_level:
        if method != "auto":
            raise
        work.stop_bound()  # it is about fewer grasps than what follows
        result = plan_wider(scenario, robot, problem, none_level, _realise, work, deadline)
    finally:
        work.stop_bound()
    result.method, result.seconds = method, time.monotonic() - work.began
    return result


def _plan_level(
    scenario: Scenario, robot: Robot, problem: Problem, reach: Reach, ways: Ways, work: Work, deadline: float
) -> PlanResult:
    """The body level, with one heading, and grasps in the middle of their faces."""
    failures: list[InfeasibleError] = []
    tight = TIGHTER * problem.friction_share
    for at_once in (1, 2):
        if failures and failures[0].constraint not in TWO_AT_ONCE_HELPS:
            break
        balance = Strength(problem, problem.friction_share)
        for _ in range(ATTEMPTS):
            with work.part("contacts", 0.1):
                moves, seen = _search(problem, balance, reach, ways, at_once, deadline)
            if moves is None:
                failures.append(explain(problem, balance, reach, ways, seen, at_once))
                break
            attempt = _realise(scenario, robot, problem, balance, reach, ways, moves, work, deadline)
            if isinstance(attempt, PlanResult):
                attempt.gap = _proven_gap(work, attempt.cost)
                return attempt
            failure, culprit = attempt
            failures.append(failure)
            if time.monotonic() > deadline:
                break
            if failure.constraint.startswith("limit_surface") and problem.friction_share > tight:
                problem = replace(problem, friction_share=tight)  # more room for what moves between the knots
                balance = Strength(problem, tight)
            elif culprit is None:
                break
            else:
                ways.forbid(*culprit)
        ways.allow_all()
    raise failures[0]


def _plan_walk(scenario: Scenario, robot: Robot, work: Work, deadline: float, method: str) -> PlanResult:
    from crux_planner.walk.planning import plan_walk

    result = plan_walk(scenario, robot, work, deadline, method)
    result.method, result.seconds = method, time.monotonic() - work.began
    return result


def _plan_by_method(
    scenario: Scenario,
    robot: Robot,
    problem: Problem,
    reach: Reach,
    ways: Ways,
    work: Work,
    deadline: float,
    method: str,
) -> PlanResult:
    """One of the paper's methods decides the contacts; the exact NLP and the check are the same for all."""
    from crux_planner.admm.methods import METHODS as DECIDE
    from crux_planner.admm.methods import Task

    failures: list[InfeasibleError] = []
    tight = TIGHTER * problem.friction_share
    aimed = problem.aimed()
    if all(goal_contacts(problem, reach, aimed.goal.aim_m)):
        problem = aimed
    for _ in range(ATTEMPTS):
        balance, options = Balance(problem, problem.friction_share), scenario.planner
        with work.part("contacts", 0.1):
            task = Task(problem, balance, reach, ways, deadline, options.rho, options.iterations, report=work.log)
            decided = DECIDE[method](task)
        alone = plan_message(scenario, robot, problem, decided.schedule, decided.solution, method)
        with work.part("check", 0.4):
            alone_report = check_plan(alone, robot)
        attempt = _finish(scenario, robot, problem, decided.schedule, decided.path, work, deadline, method)
        if isinstance(attempt, PlanResult):
            attempt.gap = _proven_gap(work, attempt.cost)
            attempt.method, attempt.seconds = method, time.monotonic() - work.began
            attempt.iterations, attempt.history = decided.iterations, decided.residuals
            worst = alone_report.to_json()["worst"][:1]
            attempt.alone = {**decided.to_json(), "check": {"ok": alone_report.ok, "worst": worst}}
            return attempt
        failure, culprit = attempt
        failures.append(failure)
        if culprit is None or time.monotonic() > deadline:
            break
        work.log(f"refused: {failure}")
        if failure.constraint.startswith("limit_surface") and problem.friction_share > tight:
            problem = replace(problem, friction_share=tight)
        else:
            ways.forbid(*culprit)
    raise failures[0]


def _proven_gap(work: Work, cost: float) -> float | None:
    """How far above a proven lower bound the cost is; None where there is no bound."""
    if work.bound is None:
        return None
    with work.part("bound", 0.95):
        return work.bound.gap(cost)


def _search(
    problem: Problem, balance: Balance, reach: Reach, ways: Ways, at_once: int, deadline: float
) -> tuple[list[Move] | None, SearchReport]:
    """The quickest moves, or after a third of the time left, any that are quick enough."""
    now = time.monotonic()
    early = now + (deadline - now) * QUICKEST_SHARE
    moves, seen = search(problem, balance, reach, ways, at_once=at_once, greed=1.0, deadline=early)
    if seen.timed_out:
        moves, seen = search(problem, balance, reach, ways, at_once=at_once, greed=GREED, deadline=deadline)
    return moves, seen


def _realise(
    scenario: Scenario,
    robot: Robot,
    problem: Problem,
    balance: Balance,
    reach: Reach,
    ways: Ways,
    moves: list[Move],
    work: Work,
    deadline: float,
) -> PlanResult | tuple[InfeasibleError, Culprit]:
    """A checked plan for a sequence of moves, or why there is none: a cheaper one near it if there is one."""
    if work.bound is not None and work.bound.hurried:
        with work.part("body", 0.2):
            _begin_bound(problem, balance, reach, ways, moves, work.bound)
    with work.part("improve", 0.3):
        now = time.monotonic()
        costs = EventCost(problem, balance, reach, ways)
        until = now + IMPROVING_SHARE * (deadline - now)
        level = moves and not problem.turns  # its estimates are of a level body that takes steps
        timed = improve(costs, moves, until) if level else None
    first: tuple[InfeasibleError, Culprit] | None = None
    attempt: PlanResult | tuple[InfeasibleError, Culprit]
    choices = [*([timed] if timed is not None else []), *[None] * CALMINGS]
    for choice in choices:
        if first is not None and time.monotonic() > deadline:
            break
        with work.part("body", 0.4):
            try:
                schedule = (
                    at_knots(problem, ways, choice.moves, choice.stances, choice.swings)
                    if choice is not None
                    else _evenly(problem, balance, reach, ways, moves)
                )
            except InfeasibleError as too_short:
                return first or (too_short, None)
            aimed, path = _path(problem, balance, schedule)
        if path is not None:
            attempt = _finish(scenario, robot, aimed, schedule, path, work, deadline)
            if isinstance(attempt, PlanResult):
                return attempt
        else:
            text = f"no body path for the gait {_gait(schedule)}: reach and equilibrium do not meet in time"
            attempt = InfeasibleError("body", text), _longest(problem, schedule.moves)
        first = first or attempt
        if isinstance(attempt[0], TooHasty):
            problem = replace(problem, calm=attempt[0].calm)
        elif choice is None:
            break
    return first or attempt


def _begin_bound(
    problem: Problem, balance: Balance, reach: Reach, ways: Ways, moves: list[Move], bound: Beside
) -> None:
    """Begin to bound J while a cheaper sequence is looked for, from what the first one costs."""
    try:
        schedule = _evenly(problem, balance, reach, ways, moves)
    except InfeasibleError:
        return
    path = knot_path(problem, balance, schedule)
    if path is not None:
        start = start_from_path(problem, path)
        bound.start(IMPROVED_SHARE * plan_cost(problem, schedule, start.body, start.wrenches))


def _path(problem: Problem, balance: Balance, schedule: Schedule) -> tuple[Problem, BodyPath | None]:
    """A body path to the middle of the goal's tolerance where there is one, else to where it may end at all."""
    aimed = problem.aimed()
    path = knot_path(aimed, balance, schedule)
    return (aimed, path) if path is not None else (problem, knot_path(problem, balance, schedule))


def _evenly(problem: Problem, balance: Balance, reach: Reach, ways: Ways, moves: list[Move]) -> Schedule:
    """The moves as they are, the time to spare spread over stances and swings. Raises InfeasibleError."""
    moves = smooth_events(problem, balance, reach, ways, moves)
    return lay_out(problem, ways, moves, SPEED_SHARE * problem.body.max_speed_m_s * problem.dt_s)


def _finish(
    scenario: Scenario,
    robot: Robot,
    problem: Problem,
    schedule: Schedule,
    path: BodyPath,
    work: Work,
    deadline: float,
    method: str = "auto",
) -> PlanResult | tuple[InfeasibleError, Culprit]:
    """The exact NLP and the check for a schedule, whatever method found it."""
    if work.bound is not None and work.bound.idle:
        start = start_from_path(problem, path)
        work.bound.start(plan_cost(problem, schedule, start.body, start.wrenches))
    with work.part("nlp", 0.5):
        solution = solve_within_torques(problem, schedule, path, deadline)
    if not solution.solved:
        return InfeasibleError(
            "dynamics", f"the exact problem has no solution for the gait {_gait(schedule)} ({solution.status})"
        ), _longest(problem, schedule.moves)
    with work.part("check", 0.8):
        message = plan_message(scenario, robot, problem, schedule, solution, method)
        report = check_plan(message, robot)
    if not report.ok:
        speed = np.abs(solution.body[:, 6:9]).max(axis=1)
        calm = slowed(problem.calm, report, schedule.contacts, speed, problem.dt_s)
        refused = _refused(report) if calm is None else TooHasty(_refused(report), calm)
        return refused, _blamed(report, schedule, problem)
    return _result(message, report, schedule, solution, work)


def _result(message: Any, report: CheckReport, schedule: Schedule, solution: Solution, work: Work) -> PlanResult:
    return PlanResult(
        ok=True,
        plan=message,
        check=report,
        cost=solution.cost,
        iterations=solution.iterations,
        gait=schedule.gait,
        position_residual_m=solution.position_residual_m,
        force_residual_N=solution.force_residual_N,
        timing=work.seconds,
    )


def _gait(schedule: Schedule) -> str:
    return ", ".join(schedule.gait) or "without a step"


def _refused(report: CheckReport) -> InfeasibleError:
    first = max(report.violations, key=lambda v: v.amount)
    who = " ".join(part for part in (first.limb, f"finger {first.finger}" if first.finger else None) if part)
    when = "" if first.time_s is None else f" at {first.time_s:.1f} s"
    return InfeasibleError(
        first.constraint,
        f"every plan found fails the check: {first.constraint}{' of ' + who if who else ''}{when} by "
        f"{first.amount:.3g} {first.unit} {first.detail}".rstrip(),
    )


def _blamed(report: CheckReport, schedule: Schedule, problem: Problem) -> Culprit:
    """The move during which the check found the worst violation of a limb; else the longest."""
    for violation in sorted(report.violations, key=lambda v: -v.amount):
        if violation.limb is None or violation.time_s is None:
            continue
        limb, k = LIMBS.index(violation.limb), int(violation.time_s / problem.dt_s)
        if (move := _move_at(schedule, k, limb)) is not None:
            return move
    return _longest(problem, schedule.moves)


def _move_at(schedule: Schedule, k: int, limb: int) -> Culprit:
    """The move of a limb that is in the air at a knot."""
    before = [c for knot in schedule.contacts[: k + 1] if (c := knot[limb]) is not None]
    after = [c for knot in schedule.contacts[k:] if (c := knot[limb]) is not None]
    return (before[-1], after[0]) if before and after and before[-1] != after[0] else None


def _longest(problem: Problem, moves: list[Move]) -> Culprit:
    """The move over the greatest distance."""
    pairs = [(move.before[limb], move.after[limb]) for move in moves for limb in move.limbs]
    contacts = problem.contacts
    if not pairs:
        return None
    return max(pairs, key=lambda p: float(abs(contacts[p[1]].centre_w_m - contacts[p[0]].centre_w_m).sum()))
