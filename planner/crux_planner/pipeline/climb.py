"""Planning a climb: contact search, schedule, quasi-static body path, exact NLP, independent check."""

from collections.abc import Callable
from dataclasses import replace

from crux_planner.certificates.bound.bound_worker import ClimbBoundWorker
from crux_planner.checker import check_plan
from crux_planner.errors import TIME_LIMIT, HorizonError, InfeasibleError, LevelGoalError, wrong
from crux_planner.model.build import build_problem
from crux_planner.model.problem import Problem
from crux_planner.physics.reachable_set import goal_contacts
from crux_planner.pipeline.attempt import attempts
from crux_planner.pipeline.by_map import Tried, missing_at_goal, plan_by_map
from crux_planner.pipeline.cause import cause
from crux_planner.pipeline.explanation import (
    check_clear,
    check_start,
    explain,
    level_stance_at_goal,
    no_way_to,
    stuck_at,
)
from crux_planner.pipeline.fallback import at_last, disproved, farther, without_blamed
from crux_planner.pipeline.message import PlanResult, plan_message
from crux_planner.pipeline.session import Session, method_settings
from crux_planner.pipeline.solve_and_check import Climb, finish, solve_and_check
from crux_planner.search.equilibrium import StaticEquilibrium
from crux_planner.search.stances import Oracles, search
from crux_planner.search.torque_limits import TorqueLimits
from crux_planner.solvers.worker import Worker

QUICKEST = (50.0, 0.5)  # stances looked at for the quickest sequence of contacts: on any way, and for each knot
LEVEL_SHARE = 0.6  # of the time goes at most into the search for plans of a level body with one heading
REASON_SHARE = 0.1  # of the time is kept to find out why there is no plan
TWO_AT_ONCE_HELPS = ("horizon", "passage")  # with two limbs in the air: quicker, and out of each other's way
TIGHTER = 0.8  # of the usual share of the limit surface, where the check finds too little between the knots
ATTEMPTS = 6  # sequences of contacts tried, each without the move on which the one before failed


InParts = Callable[[Climb], PlanResult | None]
"""A checked plan of a far climb, part by part; None where it finds none."""


def plan(session: Session, worker: Worker, prove_s: float | None = None, in_parts: InParts | None = None) -> PlanResult:
    """Plan a climb and check it.

    The gap is what a bound beside the planning, in `worker`, proves of plans of as many steps with a fixed amount of
    work; with `prove_s`, it goes on for up to so long.
    """
    scenario, work = session.scenario, session.work
    if scenario.start.air:
        expected = "not supported here; use Planner.plan"
        raise wrong(scenario, "start.air", ", ".join(scenario.start.air), expected)
    if session.method != "auto" and not session.robot.closed_form:
        expected = f"expected auto: the limbs of {session.robot.name} have no closed-form kinematics"
        raise wrong(scenario, "planner.method", session.method, expected)
    if session.method != "auto" and scenario.not_upright:
        raise wrong(scenario, "planner.method", session.method, f"expected auto: {scenario.not_upright}")
    with work.part("problem", 0.0):
        problem = build_problem(scenario, session.robot)
        equilibrium = StaticEquilibrium(problem, problem.friction_share)
        check_start(scenario, problem, equilibrium)
        check_clear(scenario, problem, session.robot)
        climb = Climb(session, Oracles.of(problem, equilibrium))
    searching = replace(climb, session=replace(session, deadline=session.share_of_time(1.0 - REASON_SHARE)))
    work.bound = ClimbBoundWorker(worker, problem, prove_s)
    try:
        if session.method != "auto":
            return _plan_by_method(climb)
        return _plan_anyhow(searching, in_parts)
    except InfeasibleError as none:
        work.bound = None
        worker.stop()  # what it bounds is of no use any more
        if (last := _by_all_reach(climb, none)) is not None:
            return last
        late = work.cut_short or searching.session.late
        reason = _cause(climb, none) if session.method == "auto" else none
        raise reason.out_of_time() if late and not isinstance(reason, HorizonError) else reason from None


def _plan_anyhow(climb: Climb, in_parts: InParts | None) -> PlanResult:
    """By map, then with a body that follows surfaces where these turn; where that finds nothing soon for a goal that is
    far, with limbs in their boxes and then in parts; by map with grasps off the middle too, and last with limbs in
    their boxes.
    """
    tried, none_level = Tried(), None
    if (quick := plan_by_map(climb, tried, quick=True)) is not None:
        return _with_gap(climb, *quick)
    if climb.problem.may_follow and not climb.problem.follows:
        climb, tried = climb.of(replace(climb.problem, follows=True)), Tried()
        if (quick := plan_by_map(climb, tried, quick=True)) is not None:
            return _with_gap(climb, *quick)
    if climb.work.bound is not None and climb.session.wants_gap:
        climb.work.bound.get_ready()
    if tried.far:
        found = _level_or_none(climb)
        if isinstance(found, PlanResult):
            return found
        none_level = found
    held = tried.held_at_goal(climb)
    proof = None if held else disproved(climb, none_level)
    if tried.far and in_parts is not None and (joined := in_parts(climb)) is not None:
        return _with_gap(climb, joined)
    if (by_map := plan_by_map(climb, tried)) is not None:
        return _with_gap(climb, *by_map)
    if none_level is None:
        found = _level_or_none(climb)
        if isinstance(found, PlanResult):
            return found
        none_level = found
    if isinstance(none_level, LevelGoalError) and (missing := missing_at_goal(climb)) is not None:
        none_level = LevelGoalError("reach", missing)
    if tried.too_long:
        none_level = min(tried.short, key=lambda each: each.needed)
    elif tried.unmoved and (none_level.constraint == TIME_LIMIT or (climb.problem.follows and climb.session.late)):
        none_level = _out_of_motion(tried.unmoved)
    by_boxes = held and isinstance(none_level, LevelGoalError)  # which the map contradicts
    searched = tried.search(climb, False)[1] if (climb.problem.follows or by_boxes) and not tried.unmoved else None
    raise at_last(climb, (searched and stuck_at(searched)) or none_level, proof)


def _out_of_motion(sequences: int) -> InfeasibleError:
    text = f"contacts were found, but no motion for them in the time allowed (sequences tried: {sequences})"
    return InfeasibleError(TIME_LIMIT, f"{text}; allow more with --time-limit")


def _level_or_none(climb: Climb) -> PlanResult | InfeasibleError:
    """As `_plan_level`, with a share of the time; or why there is none."""
    try:
        return _plan_level(climb, climb.session.share_of_time(LEVEL_SHARE))
    except InfeasibleError as none:
        return none


def _by_all_reach(climb: Climb, none: InfeasibleError) -> PlanResult | None:
    """A plan of a level body by all of the limbs' inner reach, where their boxes alone have a hold out of it."""
    if climb.session.method != "auto" or none.proven or none.constraint != "reach":
        return None
    try:
        return _plan_level(farther(climb), climb.session.deadline)
    except InfeasibleError:
        return None


def _cause(climb: Climb, none: InfeasibleError) -> InfeasibleError:
    """Why there is no plan; no want of reach where joint limits let a level body stand at the goal."""
    if none.constraint == "contacts":  # of a body that tilts: what helps a level one is no cause
        return none
    reason = cause(farther(climb), none, _level_has_plan)
    wants_reach = reason.constraint == "reach" and not reason.proven
    stance = level_stance_at_goal(climb.problem, climb.session.robot) if wants_reach else None
    return reason if stance is None else no_way_to(climb.problem, stance, reason)


def _level_has_plan(climb: Climb) -> bool:
    """Whether a plan is found for a level body."""
    try:
        _plan_level(climb, climb.session.deadline)
    except InfeasibleError:
        return False
    return True


def _plan_level(climb: Climb, until: float) -> PlanResult:
    """The body level, with one heading, and grasps in the middle of their faces; by the quickest sequences of contacts,
    while these are found soon and until then.
    """
    failures: list[InfeasibleError] = []
    tighter = _tighter(climb)
    for at_once in (1, 2):
        if failures and failures[0].constraint not in TWO_AT_ONCE_HELPS:
            break

        def attempt(climb: Climb, at_once: int = at_once) -> PlanResult | InfeasibleError | None:
            with climb.work.part("contacts", 0.1):
                found = search(climb.oracles, at_once=at_once, greed=1.0, deadline=until, most=QUICKEST)
            moves, seen = found
            if moves is not None:
                return solve_and_check(climb, moves)
            failures.append(explain(climb.oracles, seen, at_once))
            return None

        climb = _within_torques(climb, climb.problem.friction_share)
        result, climb = attempts(climb, attempt, (tighter, without_blamed), failures, most=ATTEMPTS, until=until)
        if result is not None:
            return _with_gap(climb, result)
        climb.oracles.swings.allow_all()
    raise failures[0]


def _tighter(given: Climb) -> Callable[[Climb, InfeasibleError], Climb | None]:
    """A remedy where the check refuses what grips carry: more is left for what moves between the knots, once."""
    tight = TIGHTER * given.problem.friction_share

    def tighter(climb: Climb, failure: InfeasibleError) -> Climb | None:
        if not failure.constraint.startswith("limit_surface") or climb.problem.friction_share <= tight:
            return None
        return _within_torques(climb, tight)

    return tighter


def _within_torques(climb: Climb, friction_share: float) -> Climb:
    """The climb with a share of the limit surface, and balance within joint torques."""
    problem = replace(climb.problem, friction_share=friction_share)
    equilibrium = TorqueLimits(problem, friction_share)
    return replace(climb, oracles=replace(climb.oracles, problem=problem, equilibrium=equilibrium))


def _plan_by_method(climb: Climb) -> PlanResult:
    """One of the paper's methods decides the contacts; the exact NLP and the check are the same for all."""
    from crux_planner.admm.methods import METHODS, Task
    from crux_planner.admm.windows import Windows

    session, work = climb.session, climb.work
    failures: list[InfeasibleError] = []
    aimed = climb.problem.aimed()
    if all(goal_contacts(climb.problem, climb.oracles.reachable, aimed.goal.aim_m)):
        climb = climb.of(aimed)

    def attempt(climb: Climb) -> PlanResult | InfeasibleError:
        problem = climb.problem
        with work.part("contacts", 0.1):
            windows = Windows(problem, climb.oracles.reachable, climb.oracles.swings)
            decided = METHODS[session.method](Task(windows, **method_settings(session)))
        knots = decided.knots
        scenario, robot = session.scenario, session.robot
        reached = plan_message(scenario, robot, problem, knots.schedule, knots.solution, session.method)
        with work.part("check", 0.4):
            reached_report = check_plan(reached, robot)
        found = finish(climb, knots.schedule, knots.start())
        if isinstance(found, PlanResult):
            _with_gap(climb, found).found_by(decided, reached_report)
        else:
            work.log(f"refused: {found}")
        return found

    remedies = (_tighter(climb), without_blamed)
    result, _ = attempts(climb, attempt, remedies, failures, most=ATTEMPTS, until=session.deadline)
    if result is None:
        raise failures[0]
    return result


def _with_gap(climb: Climb, plan: PlanResult, planned: Problem | None = None) -> PlanResult:
    """The plan, and how far above a proven lower bound its cost is, where one is worked out; of the `planned` problem,
    where that has grasps that the climb's has not.
    """
    if (bound := climb.work.bound) is None or not climb.session.wants_gap:
        return plan
    with climb.work.part("bound", 0.95):
        if planned is not None and len(planned.contacts) > len(climb.problem.contacts):
            plan.gap = bound.gap_here(replace(planned, steps=plan.steps), plan.cost)
        else:
            plan.gap = bound.gap_of(plan.steps, plan.cost)
    return plan
