"""Why there is no plan: the constraint whose relaxation gives one, tried before it is said, with the least amount.

A longer horizon is tried first, on the ways to the goal that gave no plan: contacts are searched however long they
take. Then one thing at a time is made easier (pipeline.relaxations), what the failure names first: what gives a way,
contacts in sequence and a body path in static balance over the horizon, is planned with and checked where it is about
scenario or robot. The work of each search is counted in stances.
"""

import tempfile
from collections.abc import Callable
from dataclasses import dataclass, replace
from math import ceil
from pathlib import Path

import numpy as np
from crux_contracts import LIMB_NAMES
from crux_contracts.scenario import ScenarioError
from crux_contracts.scenario_types import MAX_STEPS

from crux_planner.errors import TIME_LIMIT, HorizonError, InfeasibleError
from crux_planner.model.schedule import Move
from crux_planner.physics.reachable_set import goal_contacts
from crux_planner.pipeline.explanation import LACKING_N
from crux_planner.pipeline.message import PlanResult
from crux_planner.pipeline.relaxations import Relaxation, relaxations
from crux_planner.pipeline.session import RefusedWay
from crux_planner.pipeline.solve_and_check import Climb, evenly, path_to_goal
from crux_planner.search.equilibrium import Query
from crux_planner.search.stances import search
from crux_planner.search.torque_limits import TorqueLimits

WAYS = 3  # of those that gave no plan, and horizons tried on each
LONGER = 1.2  # times as long is the next horizon tried, beyond what is known to be needed
LONG = 2.0  # times as long where nothing is known
HALVINGS = 2  # of the interval in which the least horizon is then
STANCES = (150.0, 0.0)  # that a search looks at, at most
GREED = 2.0  # the factor by which its sequence may be slower than the quickest
BEYOND = (0, 2, 8)  # steps of a relaxation beyond what gives a way, tried for a plan


@dataclass(frozen=True)
class _Found:
    """What so many steps of a relaxation give: a way to the goal, where there was none, or even a plan."""

    relaxation: Relaxation
    count: int
    way: list[Move] | None
    plan: bool = False


Planned = Callable[[Climb], bool]
"""Whether a climb has a plan."""


def cause(climb: Climb, none: InfeasibleError, planned: Planned) -> InfeasibleError:
    """What to say instead of `none`, or the same with what would help; where nothing that is tried does, that."""
    if climb.session.late:
        return none
    with climb.work.part("reason", 0.95):
        if not none.proven and (steps := _enough_steps(climb)) is not None:
            given = climb.problem.steps
            text = f"no plan found in {given} steps of {climb.problem.dt_s:g} s, but one in {steps}"
            return HorizonError(f"{text}; allow as many", steps, tried=True)
        if none.constraint == TIME_LIMIT or none.undecided or isinstance(none, HorizonError):
            return none
        balance = TorqueLimits(climb.problem, climb.problem.friction_share)
        climb = replace(climb, oracles=replace(climb.oracles, equilibrium=balance))
        way = _way(climb) is not None  # then what fails comes after the search
        with tempfile.TemporaryDirectory(prefix="crux-") as folder:
            for relaxation in relaxations(climb, none.constraint, Path(folder)):
                found = (_with_plan if way else _least)(climb, relaxation, planned)
                if found is not None:
                    return _explained(climb, none, found)
    if none.proven or way or climb.session.late:
        return none
    tried = "nor a way with one thing made easier: obstacles, grippers, friction, motors, reach"
    return InfeasibleError("contacts", f"no sequence of contacts found to the goal, {tried}; the search ended: {none}")


def _enough_steps(climb: Climb) -> int | None:
    """Steps in which one of the ways to the goal gave a plan; None where as many as are tried do not help."""
    refused = list(climb.work.refused)
    short = [way for way in refused if isinstance(way.reason, HorizonError)]
    for way in sorted(short, key=lambda way: getattr(way.reason, "needed", 0))[:WAYS]:
        steps = getattr(way.reason, "needed", climb.problem.steps)
        for _ in range(WAYS):
            if _gives_plan(climb, way, steps):
                return steps
            steps = ceil(LONGER * steps)
    for way in [way for way in refused if way not in short][:1]:
        enough, fails = ceil(LONG * climb.problem.steps), climb.problem.steps
        if _gives_plan(climb, way, enough):
            for _ in range(HALVINGS):
                guess = (fails + enough) // 2
                fails, enough = (fails, guess) if _gives_plan(climb, way, guess) else (guess, enough)
            return enough
    return None


def _gives_plan(climb: Climb, way: RefusedWay, steps: int) -> bool:
    if climb.session.late or not climb.problem.steps < steps <= MAX_STEPS:
        return False
    return isinstance(way.again(steps, climb.session.deadline), PlanResult)


def _least(climb: Climb, relaxation: Relaxation, planned: Planned) -> _Found | None:
    """The least that gives a way, or a plan little beyond; None where the most gives no way."""

    def tried(count: int) -> list[Move] | None:
        try:
            return None if climb.session.late else _way(relaxation.climb(climb, count))
        except (ScenarioError, InfeasibleError):
            return None

    way, fails, enough = tried(relaxation.most), 0, relaxation.most
    if way is None:
        return None
    while enough - fails > 1:
        guess = (fails + enough) // 2
        if (other := tried(guess)) is None:
            fails = guess
        else:
            way, enough = other, guess
    found = _with_plan(climb, relaxation, planned, enough)
    return _Found(relaxation, enough, way) if found is None else replace(found, way=way)


def _with_plan(climb: Climb, relaxation: Relaxation, planned: Planned, least: int = 0) -> _Found | None:
    """The least that gives a plan, of some few from `least` on."""
    counts = {min(least + more, relaxation.most) for more in BEYOND} - {0}
    for count in sorted(counts) if relaxation.whole else ():
        if climb.session.late:
            return None
        try:
            if planned(relaxation.climb(climb, count)):
                return _Found(relaxation, count, None, plan=True)
        except (ScenarioError, InfeasibleError):
            return None
    return None


def _way(climb: Climb) -> list[Move] | None:
    """Moves of a level body, one limb at a time, to the goal, for which there is a body path in time."""
    problem = climb.problem
    moves, _ = search(climb.oracles, at_once=1, greed=GREED, deadline=climb.session.deadline, most=STANCES)
    if moves is None:
        return None
    try:
        path = path_to_goal(problem, climb.oracles.equilibrium, evenly(climb, moves))[1]
    except HorizonError:
        return None
    return None if path is None else moves


def _explained(climb: Climb, none: InfeasibleError, found: _Found) -> InfeasibleError:
    relaxation, amount = found.relaxation, found.relaxation.amount(found.count)
    helps = f"{relaxation.text(amount)} a {'plan' if found.plan else 'way'} is found"
    place = None if found.way is None else _place(climb, found, found.way)
    if place is not None:
        helps += f"; without, it ends {place}"
    same = none.proven or relaxation.is_about(none.constraint)
    text = f"{none}; {helps}" if same else f"{helps} ({none})"
    reason = InfeasibleError(none.constraint if none.proven else relaxation.constraint, text, proven=none.proven)
    reason.relaxed = {"constraint": relaxation.constraint, "amount": amount, "unit": relaxation.unit, "place": place}
    return reason


def _place(climb: Climb, found: _Found, way: list[Move]) -> str | None:
    """The first move of a way that the problem as it is does not have."""
    problem = climb.problem
    balance = TorqueLimits(problem, problem.friction_share)
    for limb, reached in enumerate(goal_contacts(problem, climb.oracles.reachable)):
        if not reached:
            return f"with {LIMB_NAMES[limb]} at the goal"
    for move in way:
        swings = [(move.before[limb], move.after[limb]) for limb in move.limbs]
        ends = ((LIMB_NAMES[limb], problem.contacts[move.after[limb]].hold) for limb in move.limbs)
        gone = [f"{name} goes to {problem.hold_names[hold]}" for name, hold in ends]
        where = f"where {' and '.join(gone)}"
        bounds = [climb.oracles.reachable.of(stance) for stance in (move.before, move.after)]
        if None in bounds or not climb.oracles.swings.free(swings, move.support):
            return where
        for each, stance in zip(bounds, (move.before, move.after), strict=True):
            assert each is not None
            query = Query(move.support, *each, move.lift_off, stance)
            if balance.position(*query) is None:
                short = balance.missing_force(move.support, *each, stance)
                if short == np.inf:
                    return f"{where}: no balance found"
                return f"{where}: " + (f"short by {short:.1f} N" if short > LACKING_N else _weak(climb, found, query))
    return None


def _weak(climb: Climb, found: _Found, query: Query) -> str:
    """Which joints are too weak for a body in balance; where stronger motors were tried, as few as are enough there."""
    if found.relaxation.constraint != "torque":
        return "the joints are too weak"
    balance, factor = TorqueLimits(climb.problem, climb.problem.friction_share), found.relaxation.amount(found.count)
    stronger = np.full(balance.limits_Nm.shape, factor)
    for joint in np.ndindex(stronger.shape):
        fewer = stronger.copy()
        fewer[joint] = 1.0
        if balance.within(fewer * balance.limits_Nm).position(*query) is not None:
            stronger = fewer
    weak = [climb.session.robot.limbs[limb].joints[joint] for limb, joint in np.argwhere(stronger > 1.0)]
    would = (f"{joint.name} would need {factor * joint.effort:.2f} N m, it has {joint.effort:g}" for joint in weak)
    return "; ".join(would)
