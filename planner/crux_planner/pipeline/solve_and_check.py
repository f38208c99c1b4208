"""From a schedule to a checked plan: body path, exact P1, message, check; and what is to blame where one is refused."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from crux_contracts import LIMB_NAMES
from crux_contracts.robot import Robot
from crux_contracts.scenario import Scenario

from crux_planner.checker import CheckReport, check_plan
from crux_planner.errors import InfeasibleError, unsolved
from crux_planner.model.problem import Problem
from crux_planner.model.schedule import Move, Schedule
from crux_planner.physics.cost import plan_cost
from crux_planner.pipeline.message import PlanResult, plan_message
from crux_planner.pipeline.too_fast import TooFast, slowed
from crux_planner.pipeline.work import BlamedMove, Work
from crux_planner.search.body_path import SPEED_SHARE, BodyPath, knot_path, smooth_events
from crux_planner.search.equilibrium import StaticEquilibrium
from crux_planner.search.schedule import least_durations, scheduled
from crux_planner.search.stances import ReachableSet
from crux_planner.swing.swing_cache import SwingCache
from crux_planner.trajectory.exact import solve_within_torques
from crux_planner.trajectory.solution import Start
from crux_planner.trajectory.stage_functions import StageFunctions
from crux_planner.trajectory.waiting import without_waiting

Failure = tuple[InfeasibleError, BlamedMove]
"""Why there is no plan, and the move without which there may be one."""


def evenly(
    problem: Problem, equilibrium: StaticEquilibrium, reach: ReachableSet, swings: SwingCache, moves: list[Move]
) -> Schedule:
    """The moves as they are, the time to spare spread over stances and swings. Raises InfeasibleError."""
    moves = smooth_events(problem, equilibrium, reach, swings, moves)
    return scheduled(problem, swings, moves, SPEED_SHARE * problem.body.max_speed_m_s * problem.dt_s)


def in_time(
    problem: Problem,
    equilibrium: StaticEquilibrium,
    reach: ReachableSet,
    swings: SwingCache,
    moves: list[Move],
    spare: int = 0,
) -> tuple[Problem, Schedule]:
    """The same over the steps that the moves need, if these are more than the problem's, and `spare` more."""
    moves = smooth_events(problem, equilibrium, reach, swings, moves)
    step = SPEED_SHARE * problem.body.max_speed_m_s * problem.dt_s
    needed = int(sum(part.sum() for part in least_durations(problem, swings, moves, step)))
    problem = replace(problem, steps=max(problem.steps, needed) + spare)
    return problem, scheduled(problem, swings, moves, step)


def path_to_goal(
    problem: Problem, equilibrium: StaticEquilibrium, schedule: Schedule
) -> tuple[Problem, BodyPath | None]:
    """A body path to the middle of the goal's tolerance where there is one, else to where it may end at all."""
    aimed = problem.aimed()
    path = knot_path(aimed, equilibrium, schedule)
    return (aimed, path) if path is not None else (problem, knot_path(problem, equilibrium, schedule))


def finish(
    scenario: Scenario,
    robot: Robot,
    problem: Problem,
    schedule: Schedule,
    start: Start,
    work: Work,
    deadline: float,
    method: str = "auto",
    functions: StageFunctions | None = None,
) -> PlanResult | Failure:
    """The exact NLP and the check for a schedule, whatever method found it: without its waits, unless that fails or the
    scenario keeps them.
    """
    if scenario.planner.idle != "keep":
        shorter = without_waiting(problem, schedule, start)
        if shorter[0].steps < problem.steps:
            attempt = _finish_as_it_is(scenario, robot, *shorter, work, deadline, method, functions)
            if isinstance(attempt, PlanResult):
                return attempt
            work.log(f"refused without its waits: {attempt[0]}")
    return _finish_as_it_is(scenario, robot, problem, schedule, start, work, deadline, method, functions)


def _finish_as_it_is(
    scenario: Scenario,
    robot: Robot,
    problem: Problem,
    schedule: Schedule,
    start: Start,
    work: Work,
    deadline: float,
    method: str,
    functions: StageFunctions | None,
) -> PlanResult | Failure:
    if work.bound is not None:
        work.bound.start_with(problem.steps, plan_cost(problem, schedule, start.body, start.wrenches))
    with work.part("nlp", 0.5):
        solution = solve_within_torques(problem, schedule, start, deadline, functions)
    if not solution.solved:
        return unsolved(gait(schedule), solution.status), longest(problem, schedule.moves)
    with work.part("message", 0.8):
        message = plan_message(scenario, robot, problem, schedule, solution, method)
    with work.part("check", 0.8):
        report = check_plan(message, robot)
    if not report.ok:
        speed = np.abs(solution.body[:, 6:9]).max(axis=1)
        speed_limits = slowed(problem.speed_limits, report, schedule.contacts, speed, problem.dt_s)
        refused = _refused(report) if speed_limits is None else TooFast(_refused(report), speed_limits)
        return refused, _blamed(report, schedule, problem)
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


def gait(schedule: Schedule) -> str:
    """The limbs in the order in which they release, as text."""
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


def _blamed(report: CheckReport, schedule: Schedule, problem: Problem) -> BlamedMove:
    """The move during which the check found the worst violation of a limb; else the longest."""
    for violation in sorted(report.violations, key=lambda v: -v.amount):
        if violation.limb is None or violation.time_s is None:
            continue
        limb, k = LIMB_NAMES.index(violation.limb), int(violation.time_s / problem.dt_s)
        if (move := _move_at(schedule, k, limb)) is not None:
            return move
    return longest(problem, schedule.moves)


def _move_at(schedule: Schedule, k: int, limb: int) -> BlamedMove:
    """The move of a limb that is in the air at a knot."""
    before = [c for knot in schedule.contacts[: k + 1] if (c := knot[limb]) is not None]
    after = [c for knot in schedule.contacts[k:] if (c := knot[limb]) is not None]
    return (before[-1], after[0]) if before and after and before[-1] != after[0] else None


def longest(problem: Problem, moves: list[Move]) -> BlamedMove:
    """The move over the greatest distance."""
    pairs = [(move.before[limb], move.after[limb]) for move in moves for limb in move.limbs]
    contacts = problem.contacts
    if not pairs:
        return None
    return max(pairs, key=lambda p: float(abs(contacts[p[1]].centre_w_m - contacts[p[0]].centre_w_m).sum()))
