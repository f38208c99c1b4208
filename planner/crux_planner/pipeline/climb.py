"""Planning a climb: contact search, schedule, quasi-static body path, exact NLP, independent check."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import replace

import numpy as np
from crux_contracts.robot import Robot
from crux_contracts.scenario import Scenario
from crux_contracts.scenario_reader import MAX_STEPS

from crux_planner.certificates.bound.bound_worker import ClimbBoundWorker
from crux_planner.checker import check_plan
from crux_planner.errors import TIME_LIMIT, HorizonError, InfeasibleError
from crux_planner.model.build import build_problem
from crux_planner.model.problem import Problem
from crux_planner.model.schedule import Move
from crux_planner.physics.speed_limits import foreseen
from crux_planner.pipeline.explanation import check_start, explain
from crux_planner.pipeline.fallback import plan_turning, plan_wider
from crux_planner.pipeline.message import PlanResult, plan_message
from crux_planner.pipeline.solve_and_check import Failure, evenly, finish, gait, longest, path_to_goal
from crux_planner.pipeline.too_fast import TooFast
from crux_planner.pipeline.work import Progress, Work, begin
from crux_planner.search.equilibrium import StaticEquilibrium
from crux_planner.search.event_cost import EventCost
from crux_planner.search.improve import improve
from crux_planner.search.schedule import at_knots
from crux_planner.search.stances import ReachableSet, SearchReport, goal_contacts, search
from crux_planner.search.torque_limits import TorqueLimits
from crux_planner.solvers import clock
from crux_planner.solvers.worker import Worker
from crux_planner.swing.swing_cache import SwingCache
from crux_planner.trajectory.solution import start_from_path

IMPROVING_SHARE = 0.1  # of the time left, at most, is computed on a cheaper sequence near the one found
QUICKEST_SHARE = 1 / 3  # of the time left is computed on the quickest sequence of contacts
GREED = 2.0  # the factor by which a sequence may be slower after that
WIDER_SHARE = 0.4  # goes at most into the search for other headings before that for a level body goes on
LEVEL_SHARE = 0.6  # of the time goes at most into plans of a level body with one heading
TWO_AT_ONCE_HELPS = ("horizon", "passage")  # with two limbs in the air: quicker, and out of each other's way
TIGHTER = 0.8  # of the usual share of the limit surface, where the check finds too little between the knots
SLOWINGS = 6  # times that a sequence is scheduled anew with a slower body on the supports that the check names
LONGER = 2  # times as long a horizon is tried where nothing is found
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
    worker: Worker | None = None,
) -> PlanResult:
    """Plan a climb and check it; `log` is told one line at a time what a method reports of its iterations.

    The gap is what a bound beside the planning, in `worker`, proves of plans of as many steps with a fixed amount of
    work; with `prove_s`, it goes on for up to so long.

    Raises ScenarioError where the scenario must be corrected, InfeasibleError where no plan exists or none was found.
    """
    work, deadline = begin(scenario, method, time_limit_s, progress, log)
    with work.part("problem", 0.0):
        problem = build_problem(scenario, robot)
        check_start(scenario, problem, StaticEquilibrium(problem, problem.friction_share))
        reach, swings = ReachableSet(problem), SwingCache(problem)
    worker = worker or Worker(log=work.log)
    work.bound = ClimbBoundWorker(worker, problem, prove_s)
    try:
        if method != "auto":
            return _plan_by_method(scenario, robot, problem, reach, swings, work, deadline, method)
        result = _plan_anyhow(scenario, robot, problem, reach, swings, work, deadline)
    except InfeasibleError as none:
        work.bound = None
        worker.stop()  # what it bounds is of no use any more
        reason, late = none, work.cut_short
        if method == "auto":
            reason = _cause(scenario, robot, problem, reach, swings, work, deadline, none)
        raise reason.out_of_time() if reason is none and (late or clock.now() > deadline) else reason from None
    finally:
        worker.stop()
    result.method, result.seconds = method, time.monotonic() - work.began
    return result


def _plan_anyhow(
    scenario: Scenario,
    robot: Robot,
    problem: Problem,
    reach: ReachableSet,
    swings: SwingCache,
    work: Work,
    deadline: float,
) -> PlanResult:
    """A level body, then other headings; where the level search takes long, other headings before it goes on."""

    def level(quick: bool) -> PlanResult:
        now = clock.now()
        until = now + LEVEL_SHARE * (deadline - now)
        return _plan_level(scenario, robot, problem, reach, swings, work, until, quick)

    try:
        return level(quick=True)
    except InfeasibleError as none_quick:
        none_level = none_quick
    bound, work.bound = work.bound, None  # it is about fewer grasps than what follows
    if none_level.constraint != TIME_LIMIT:
        if bound is not None:
            bound.stop()
        return plan_wider(scenario, robot, problem, none_level, solve_and_check, work, deadline)
    try:
        return plan_wider(scenario, robot, problem, none_level, solve_and_check, work, deadline, share=WIDER_SHARE)
    except InfeasibleError as none_wider:
        if none_wider.proven or clock.now() > deadline:
            raise
        work.bound = bound
        return level(quick=False)
    finally:
        if bound is not None and work.bound is None:
            bound.stop()


def _cause(
    scenario: Scenario,
    robot: Robot,
    problem: Problem,
    reach: ReachableSet,
    swings: SwingCache,
    work: Work,
    deadline: float,
    none: InfeasibleError,
) -> InfeasibleError:
    """Why there is no plan: before another cause is blamed, whether a longer horizon has one."""
    if none.proven or none.constraint == TIME_LIMIT or isinstance(none, HorizonError):
        return none
    given = problem.steps
    steps = min(max([LONGER * given, *(short.needed for short in work.too_short)]), MAX_STEPS)
    if steps > given and clock.now() < deadline:
        from crux_planner.pipeline.restart import rewritten  # which needs this module

        scenario, problem = rewritten(scenario, steps=steps), replace(problem, steps=steps)
        try:
            _plan_level(scenario, robot, problem, reach, swings, work, deadline, quick=True)
            found = True
        except InfeasibleError:
            until = clock.now() + WIDER_SHARE * (deadline - clock.now())
            found = plan_turning(scenario, robot, problem, solve_and_check, work, until, deadline) is not None
        if found:
            text = f"no plan found in {given} steps of {problem.dt_s:g} s, but one in {steps}"
            return HorizonError(f"{text}; allow as many", steps)
    return none


def _plan_level(
    scenario: Scenario,
    robot: Robot,
    problem: Problem,
    reach: ReachableSet,
    swings: SwingCache,
    work: Work,
    deadline: float,
    quick: bool,
) -> PlanResult:
    """The body level, with one heading, and grasps in the middle of their faces.

    `quick`: only by the quickest sequences of contacts, and only while these are found soon.
    """
    failures: list[InfeasibleError] = []
    tight = TIGHTER * problem.friction_share
    for at_once in (1, 2):
        if failures and failures[0].constraint not in TWO_AT_ONCE_HELPS:
            break
        equilibrium = TorqueLimits(problem, problem.friction_share)
        for _ in range(ATTEMPTS):
            with work.part("contacts", 0.1):
                moves, seen = _search(problem, equilibrium, reach, swings, at_once, deadline, quick)
            if moves is None:
                failures.append(explain(problem, equilibrium, reach, swings, seen, at_once))
                break
            attempt = solve_and_check(scenario, robot, problem, equilibrium, reach, swings, moves, work, deadline)
            if isinstance(attempt, PlanResult):
                attempt.gap = _proven_gap(work, attempt.cost)
                return attempt
            failure, blamed = attempt
            failures.append(failure)
            if clock.now() > deadline:
                break
            if failure.constraint.startswith("limit_surface") and problem.friction_share > tight:
                problem = replace(problem, friction_share=tight)  # more space for what moves between the knots
                equilibrium = TorqueLimits(problem, tight)
            elif blamed is None:
                break
            else:
                swings.forbid(*blamed)
        swings.allow_all()
    raise failures[0]


def _plan_by_method(
    scenario: Scenario,
    robot: Robot,
    problem: Problem,
    reach: ReachableSet,
    swings: SwingCache,
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
        equilibrium, options = StaticEquilibrium(problem, problem.friction_share), scenario.planner
        with work.part("contacts", 0.1):
            task = Task(problem, equilibrium, reach, swings, deadline, options.rho, options.iterations, report=work.log)
            decided = DECIDE[method](task)
        alone = plan_message(scenario, robot, problem, decided.schedule, decided.solution, method)
        with work.part("check", 0.4):
            alone_report = check_plan(alone, robot)
        start = start_from_path(problem, decided.path, decided.schedule.yaw_rad)
        attempt = finish(scenario, robot, problem, decided.schedule, start, work, deadline, method)
        if isinstance(attempt, PlanResult):
            attempt.gap = _proven_gap(work, attempt.cost)
            attempt.method, attempt.seconds = method, time.monotonic() - work.began
            attempt.iterations, attempt.history = decided.iterations, decided.residuals
            worst = alone_report.to_json()["worst"][:1]
            attempt.alone = {**decided.to_json(), "check": {"ok": alone_report.ok, "worst": worst}}
            return attempt
        failure, blamed = attempt
        failures.append(failure)
        if blamed is None or clock.now() > deadline:
            break
        work.log(f"refused: {failure}")
        if failure.constraint.startswith("limit_surface") and problem.friction_share > tight:
            problem = replace(problem, friction_share=tight)
        else:
            swings.forbid(*blamed)
    raise failures[0]


def _proven_gap(work: Work, cost: float) -> float | None:
    """How far above a proven lower bound the cost is; None where there is no bound."""
    if work.bound is None:
        return None
    with work.part("bound", 0.95):
        return work.bound.gap(cost)


def _search(
    problem: Problem,
    equilibrium: StaticEquilibrium,
    reach: ReachableSet,
    swings: SwingCache,
    at_once: int,
    deadline: float,
    quick: bool,
) -> tuple[list[Move] | None, SearchReport]:
    """The quickest moves if they are found with so much work, else any that are quick enough."""
    greed, busy_until = (1.0, _busy_until(QUICKEST_SHARE, deadline)) if quick else (GREED, np.inf)
    return search(
        problem, equilibrium, reach, swings, at_once=at_once, greed=greed, deadline=deadline, busy_until=busy_until
    )


def _busy_until(share: float, deadline: float) -> float:
    """When (of time.process_time) this process has worked for a share of the time left."""
    return time.process_time() + share * (deadline - clock.now())


def solve_and_check(
    scenario: Scenario,
    robot: Robot,
    problem: Problem,
    equilibrium: StaticEquilibrium,
    reach: ReachableSet,
    swings: SwingCache,
    moves: list[Move],
    work: Work,
    deadline: float,
) -> PlanResult | Failure:
    """A checked plan for a sequence of moves, or why there is none: a cheaper one near it if there is one."""
    with work.part("improve", 0.3):
        costs = EventCost(problem, equilibrium, reach, swings)
        level = moves and not problem.turns  # its estimates are of a level body that takes steps
        busy_until = _busy_until(IMPROVING_SHARE, deadline)
        timed = improve(costs, moves, deadline, busy_until=busy_until) if level else None
    first: Failure | None = None
    attempt: PlanResult | Failure
    as_given = problem
    stances = [held for move in moves for held in (move.before, move.held, move.after)]
    slow = foreseen(problem.contacts, problem.weight_N, problem.dt_s, stances)
    problem = replace(problem, speed_limits={**slow, **problem.speed_limits})
    choices = [*([timed] if timed is not None else []), *[None] * SLOWINGS]
    for choice in choices:
        if first is not None and clock.now() > deadline:
            break
        with work.part("body", 0.4):
            try:
                schedule = (
                    at_knots(problem, swings, choice.moves, choice.stances, choice.swings)
                    if choice is not None
                    else evenly(problem, equilibrium, reach, swings, moves)
                )
            except InfeasibleError as too_short:
                if problem.speed_limits == as_given.speed_limits or first is not None:
                    return first or (too_short, None)
                problem = as_given  # the check may forgive what was foreseen
                continue
            aimed, path = path_to_goal(problem, equilibrium, schedule)
        if path is not None:
            start = start_from_path(aimed, path, schedule.yaw_rad)
            attempt = finish(scenario, robot, aimed, schedule, start, work, deadline)
            if isinstance(attempt, PlanResult):
                return attempt
        else:
            text = f"no body path for the gait {gait(schedule)}: reach and equilibrium do not meet in time"
            attempt = InfeasibleError("body", text), longest(problem, schedule.moves)
        first = first or attempt
        if isinstance(attempt[0], TooFast):
            problem = replace(problem, speed_limits=attempt[0].speed_limits)
        elif choice is None:
            break
    return first or attempt
