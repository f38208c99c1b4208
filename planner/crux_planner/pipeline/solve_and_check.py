"""From a schedule to a checked plan: body path, exact P1, message, check; and what is to blame where one is refused."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from crux_contracts import LIMB_NAMES

from crux_planner.certificates.other_sequences import OtherSequences, look_at_others
from crux_planner.checker import CheckReport, check_plan
from crux_planner.errors import HorizonError, InfeasibleError, unsolved
from crux_planner.model.problem import Problem
from crux_planner.model.schedule import Move, Schedule
from crux_planner.physics.cost import plan_cost
from crux_planner.pipeline.attempt import attempts, without_waits
from crux_planner.pipeline.by_joints import solve_by_joints
from crux_planner.pipeline.message import PlanResult, plan_message
from crux_planner.pipeline.price import nominal_cost
from crux_planner.pipeline.refusals import CUTS, TooFast, eased, nearer, refused_by, slowed
from crux_planner.pipeline.restart import rewritten
from crux_planner.pipeline.session import RefusedWay, Session, Work
from crux_planner.search.body_path import SPEED_SHARE, BodyPath, knot_path, smooth_events
from crux_planner.search.equilibrium import StaticEquilibrium
from crux_planner.search.event_cost import EventCost, Timed
from crux_planner.search.improve import improve, improve_in_fewest
from crux_planner.search.pose_path import Ended
from crux_planner.search.schedule import at_knots, least_durations, scheduled
from crux_planner.search.stances import Oracles
from crux_planner.trajectory.exact import solve_within_torques
from crux_planner.trajectory.joint_rows import JointFunctions
from crux_planner.trajectory.solution import Start, start_from_path
from crux_planner.trajectory.stage_functions import StageFunctions
from crux_planner.trajectory.waiting import PACES, without_waiting

FAR_CUTS = 1  # times that a plan which uses all of the reach is repaired before limbs keep to their boxes instead
SPARE_KNOTS = (0, 6)  # beyond those that moves need: a body less hurried where the check refuses the first
SLOWINGS = 6  # times that a sequence is scheduled anew with a slower body on the supports that the check names


@dataclass(frozen=True)
class Climb:
    """A climb being planned: whose scenario it is and until when, and what answers the questions of its problem."""

    session: Session
    oracles: Oracles

    @property
    def problem(self) -> Problem:
        """What is planned, in numbers."""
        return self.oracles.problem

    @property
    def work(self) -> Work:
        """What is told and timed on the way."""
        return self.session.work

    def of(self, problem: Problem) -> Climb:
        """The same of another problem, about which the oracles answer as they do about this one."""
        return replace(self, oracles=replace(self.oracles, problem=problem))


@dataclass(frozen=True)
class _Choice:
    """A climb's problem, and where the times of its moves are chosen already, these; whether a MIP chose its moves."""

    problem: Problem
    timed: Timed | None
    by_mip: bool = False
    spare: int | None = None  # knots beyond those that moves need which are not timed; None: all of the horizon


def solve_and_check(climb: Climb, moves: list[Move]) -> PlanResult | InfeasibleError:
    """A checked plan for a sequence of moves, or why there is none: a cheaper one near it if there is one."""
    as_given, (timed, unsure, others) = climb.problem, cheaper_near(climb, moves)
    failures: list[InfeasibleError] = []

    def slower(choice: _Choice, failure: InfeasibleError) -> _Choice | None:
        if not isinstance(failure, TooFast):
            return None
        return replace(choice, problem=replace(choice.problem, speed_limits=failure.speed_limits), timed=None)

    def as_searched(choice: _Choice, _failure: InfeasibleError) -> _Choice | None:
        if not choice.by_mip:
            return None
        failures.clear()
        return replace(first, timed=timed, by_mip=False)

    def untimed(choice: _Choice, failure: InfeasibleError) -> _Choice | None:
        return None if choice.timed is None or isinstance(failure, HorizonError) else replace(choice, timed=None)

    def roomier(choice: _Choice, failure: InfeasibleError) -> _Choice | None:
        if choice.spare is None or isinstance(failure, HorizonError):
            return None
        more = [spare for spare in SPARE_KNOTS if spare > choice.spare]
        return replace(choice, spare=more[0] if more else None)

    def made(choice: _Choice) -> PlanResult | InfeasibleError:
        return _schedule_and_finish(climb.of(choice.problem), choice.timed, moves, choice.spare)

    first = _Choice(as_given, timed, spare=None if climb.session.scenario.planner.idle == "keep" else SPARE_KNOTS[0])
    if others is not None and others.found:
        first = replace(first, timed=others.timed, by_mip=True)
    most = SLOWINGS + (timed is not None) + first.by_mip + (0 if first.spare is None else len(SPARE_KNOTS))
    remedies = (as_searched, slower, untimed, roomier)
    result, made_of = attempts(first, made, remedies, failures, most=most, until=climb.session.deadline)
    if result is not None:
        result.others = None if others is None else replace(others, found=made_of.by_mip)
        return _cheaper(result, made(replace(first, timed=None))) if unsure and made_of.timed is not None else result
    short = [failure for failure in failures if isinstance(failure, HorizonError)]
    climb.work.refused.append(RefusedWay((short or failures)[0], partial(_in_steps, climb, moves)))
    return failures[0]


def cheaper_near(climb: Climb, moves: list[Move]) -> tuple[Timed | None, bool, OtherSequences | None]:
    """The moves or cheaper ones near them, timed, None where nothing is estimated; whether the moves as they are may be
    cheaper; and what a MIP says of others.
    """
    timed, unsure, costs = improved(climb, moves)
    return timed, unsure, None if timed is None else others_than(climb, costs, timed)


def improved(climb: Climb, moves: list[Move]) -> tuple[Timed | None, bool, EventCost]:
    """The first two of `cheaper_near`, and the estimates that they are by."""
    timed, unsure = None, False
    with climb.work.part("improve", 0.3):
        costs = EventCost(climb.oracles)
        if moves:  # its estimates are of a level body that takes steps
            timed, unsure = _improved(climb, costs, moves)
    return timed, unsure, costs


def others_than(climb: Climb, costs: EventCost, timed: Timed) -> OtherSequences | None:
    """What a MIP says of others than some moves."""
    with climb.work.part("mip", 0.35):
        if climb.work.bound is None:  # no time for a bound, as a robot waits, is none for this
            return None
        return look_at_others(costs, timed, climb.session.deadline)


def _cheaper(plan: PlanResult, other: PlanResult | InfeasibleError) -> PlanResult:
    if not isinstance(other, PlanResult) or other.cost >= plan.cost:
        return plan
    other.others = None if plan.others is None else replace(plan.others, found=False)
    return other


def _improved(climb: Climb, costs: EventCost, moves: list[Move]) -> tuple[Timed | None, bool]:
    """The moves or cheaper ones near them, timed, N among what is decided where a plan need not wait; and whether the
    moves as they are may be cheaper.
    """
    if climb.session.scenario.planner.idle == "keep":
        return improve(costs, moves, climb.session.deadline), False
    return improve_in_fewest(costs, _quickest(climb, moves), climb.session.deadline)


def _in_steps(climb: Climb, moves: list[Move], steps: int, deadline: float) -> PlanResult | InfeasibleError:
    """What the same moves give with another horizon, tried without a word; a failure, where later attempts have given
    up the last way of one of its swings.
    """
    swings = {(move.before[limb], move.after[limb]) for move in moves for limb in move.limbs}
    if any(climb.oracles.swings.swing(*swing) is None for swing in swings):
        return InfeasibleError("passage", "a swing of these moves was found wrong, and there is no other")
    silent = replace(climb.work, log=lambda _line: None, bound=None)
    scenario = rewritten(climb.session.scenario, steps=steps)
    longer = replace(climb, session=replace(climb.session, scenario=scenario, work=silent, deadline=deadline))
    return solve_and_check(_over(longer, steps), moves)


def _schedule_and_finish(
    climb: Climb, timed: Timed | None, moves: list[Move], spare: int | None
) -> PlanResult | InfeasibleError:
    with climb.work.part("body", 0.4):
        try:
            if timed is None:
                if spare is not None:
                    climb = _over(climb, min(climb.problem.steps, least_steps(climb, moves) + spare))
                schedule = evenly(climb, moves)
            else:
                climb = _over(climb, timed.knots)
                swings = climb.oracles.swings
                schedule = at_knots(climb.problem, swings, timed.moves, timed.stances, timed.swings)
        except HorizonError as too_short:
            return too_short
        aimed, path = path_to_goal(climb.problem, climb.oracles.equilibrium, schedule)
    if path is None:
        text = f"no body path for the gait {gait(schedule)}: reach and equilibrium do not meet in time"
        return InfeasibleError("body", text).blaming(longest(climb.problem, schedule.moves))
    return finish(climb.of(aimed), schedule, start_from_path(aimed, path))


def _over(climb: Climb, steps: int) -> Climb:
    """The same climb, of so many of the horizon's steps."""
    return climb.of(replace(climb.problem, steps=steps))


def evenly(climb: Climb, moves: list[Move]) -> Schedule:
    """The moves as they are, the time to spare spread over stances and swings. Raises HorizonError."""
    problem = climb.problem
    moves = smooth_events(climb.oracles, moves)
    return scheduled(problem, climb.oracles.swings, moves, SPEED_SHARE * problem.body.max_speed_m_s * problem.dt_s)


def least_steps(climb: Climb, moves: list[Move]) -> int:
    """Steps that the moves need, with the body where it has short ways."""
    return _quickest(climb, moves).knots


def _quickest(climb: Climb, moves: list[Move]) -> Timed:
    """The moves over the steps that they need."""
    problem, moves = climb.problem, smooth_events(climb.oracles, moves)
    step = SPEED_SHARE * problem.body.max_speed_m_s * problem.dt_s
    return Timed(moves, *least_durations(problem, climb.oracles.swings, moves, step))


def in_time(climb: Climb, moves: list[Move], spare: int = 0) -> tuple[Climb, Schedule]:
    """The same over the steps that the moves need, if these are more than the problem's, and `spare` more."""
    climb = _over(climb, max(climb.problem.steps, least_steps(climb, moves)) + spare)
    return climb, evenly(climb, moves)


def path_to_goal(
    problem: Problem, equilibrium: StaticEquilibrium, schedule: Schedule
) -> tuple[Problem, BodyPath | None]:
    """A body path to the middle of the goal's tolerance where there is one, else to where it may end at all."""
    aimed = problem.aimed()
    path = knot_path(aimed, equilibrium, schedule)
    return (aimed, path) if path is not None else (problem, knot_path(problem, equilibrium, schedule))


def finish(
    climb: Climb, schedule: Schedule, start: Start, functions: JointFunctions | None = None
) -> PlanResult | InfeasibleError:
    """The exact NLP and the check for a schedule, whatever method found it: first with the joint limits themselves
    where there are `functions` for them, else with all of the limbs' inner reach, where the body leans farther than
    their boxes allow; and then in these.
    """
    ways = [without_waiting(climb.problem, schedule, start, pace) for pace in PACES]
    shorter = [(climb.of(fewer), moving, begun) for fewer, moving, begun in ways if fewer.steps < climb.problem.steps]
    first = shorter[0][0] if shorter and climb.session.scenario.planner.idle != "keep" else climb

    def finish_as_it_is(way: tuple[Climb, Schedule, Start]) -> PlanResult | InfeasibleError:
        climb, schedule, start = way
        far = climb.problem.farther()
        if far is not climb.problem and climb is first:
            quiet = replace(climb.session, work=replace(climb.work, log=lambda _line: None))
            found: PlanResult | InfeasibleError | Ended | None
            if functions is None:
                found = _finish_as_it_is(replace(climb, session=quiet).of(far), schedule, start, FAR_CUTS)
            else:
                begun = functions.started_elsewhere(climb.problem)
                found = solve_by_joints(quiet, climb.problem, schedule, start, begun)
            if isinstance(found, PlanResult):
                return found
        return _finish_as_it_is(climb, schedule, start, CUTS)

    return without_waits(climb.session, (climb, schedule, start), shorter, finish_as_it_is)


def _finish_as_it_is(climb: Climb, schedule: Schedule, start: Start, cuts: int) -> PlanResult | InfeasibleError:
    problem, session, work = climb.problem, climb.session, climb.work
    if work.bound is not None and session.wants_gap:
        work.bound.start_with(problem.steps, plan_cost(problem, schedule, start.body, start.wrenches))
    functions, refused = StageFunctions(problem), None
    for _ in range(1 + cuts):
        with work.part("nlp", 0.5):
            solution = solve_within_torques(problem, schedule, start, session.deadline, functions)
        if not solution.solved:
            unfound = refused or unsolved(gait(schedule), solution.status)
            return unfound.blaming(longest(problem, schedule.moves))
        with work.part("message", 0.8):
            message = plan_message(session.scenario, session.robot, problem, schedule, solution, session.method)
        with work.part("check", 0.8):
            report = check_plan(message, session.robot)
        problem = replace(problem, torque_limits_Nm=solution.torque_limits_Nm)
        if report.ok:
            break
        near = nearer(problem, report, schedule.contacts)
        easier = eased(near or problem, report) or near
        if easier is None:
            break
        refused = refused or refused_by(report)
        work.log(f"{refused}; once more with less of those joints or of their reach")
        problem, start = easier, solution.start
    if not report.ok:
        speed = np.abs(solution.body[:, 6:9]).max(axis=1)
        slow = slowed(problem.speed_limits, report, schedule.contacts, speed, problem.dt_s)
        refused = refused_by(report)
        refused = refused if slow in (None, dict(problem.speed_limits)) else TooFast(refused, slow or {})
        return refused.blaming(_blamed(report, schedule, problem))
    result = PlanResult.of(message, report, solution, schedule.gait, work)
    result.nominal_cost = nominal_cost(session, problem, schedule, solution)
    return result


def gait(schedule: Schedule) -> str:
    """The limbs in the order in which they release, as text."""
    return ", ".join(schedule.gait) or "without a step"


def _blamed(report: CheckReport, schedule: Schedule, problem: Problem) -> tuple[int, int] | None:
    """The move during which the check found the worst violation of a limb; else the longest."""
    for violation in sorted(report.violations, key=lambda v: -v.amount):
        if violation.limb is None or violation.time_s is None:
            continue
        limb, k = LIMB_NAMES.index(violation.limb), int(violation.time_s / problem.dt_s)
        if (move := _move_at(schedule, k, limb)) is not None:
            return move
    return longest(problem, schedule.moves)


def _move_at(schedule: Schedule, k: int, limb: int) -> tuple[int, int] | None:
    """The move of a limb that is in the air at a knot."""
    before = [c for knot in schedule.contacts[: k + 1] if (c := knot[limb]) is not None]
    after = [c for knot in schedule.contacts[k:] if (c := knot[limb]) is not None]
    return (before[-1], after[0]) if before and after and before[-1] != after[0] else None


def longest(problem: Problem, moves: list[Move]) -> tuple[int, int] | None:
    """The move over the greatest distance."""
    pairs = [(move.before[limb], move.after[limb]) for move in moves for limb in move.limbs]
    contacts = problem.contacts
    if not pairs:
        return None
    return max(pairs, key=lambda p: float(abs(contacts[p[1]].centre_h_m - contacts[p[0]].centre_h_m).sum()))
