"""Why there is no plan: the constraint whose relaxation gives one, tried before it is said, with the least amount.

A longer horizon is tried first, with everything that planning has. Then one thing at a time is made easier: smaller
obstacles, thinner grippers, more friction, stronger motors, further reach; what the failed search names
goes first. What those give is a way: contacts in sequence and a body path in static balance, over the horizon. The work
of each search is counted in stances.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from crux_contracts import LIMB_NAMES
from crux_contracts.scenario import ScenarioError
from crux_contracts.scenario_reader import MAX_STEPS

from crux_planner.errors import TIME_LIMIT, HorizonError, InfeasibleError
from crux_planner.model.build import build_problem
from crux_planner.model.problem import Problem
from crux_planner.model.schedule import Move
from crux_planner.physics.reachable_set import goal_contacts
from crux_planner.pipeline.explanation import LACKING_N
from crux_planner.pipeline.restart import rewritten
from crux_planner.pipeline.solve_and_check import Climb, evenly, path_to_goal
from crux_planner.search.equilibrium import StaticEquilibrium
from crux_planner.search.stances import Oracles, search
from crux_planner.search.torque_limits import TorqueLimits

LONGER = 2  # times as long a horizon is tried
HALVINGS = 3  # of the interval in which the least horizon is
STANCES = (150.0, 0.0)  # that a search looks at, at most
GREED = 2.0  # the factor by which its sequence may be slower than the quickest

Longer = Callable[[Climb], int | None]
"""The steps of a plan for a climb with another horizon, None where none is found."""


@dataclass(frozen=True)
class _Relaxation:
    """Up to `most` steps of `step` on from `given` are tried; `text` says what they amount to."""

    constraint: str
    unit: str
    given: float
    step: float
    most: int
    relaxed: Callable[[Climb, float], Problem]
    text: Callable[[float], str]


def cause(climb: Climb, none: InfeasibleError, longer: Longer) -> InfeasibleError:
    """What to say instead of `none`, or the same with what would help; itself where nothing that is tried does."""
    if none.constraint == TIME_LIMIT or none.undecided or isinstance(none, HorizonError) or climb.late:
        return none
    if not none.proven and (steps := _least_horizon(climb, longer)) is not None:
        given = climb.problem.steps
        text = f"no plan found in {given} steps of {climb.problem.dt_s:g} s, but one in {steps}"
        return HorizonError(f"{text}; allow as many", steps)
    with climb.work.part("reason", 0.95):
        if _way(climb, climb.problem) is not None:
            return none  # what fails comes after the search
        for relaxation in sorted(_relaxations(climb), key=lambda each: each.constraint != none.constraint):
            if (found := _least(climb, relaxation)) is not None:
                return _explained(climb, none, relaxation, *found)
    return none


def _least_horizon(climb: Climb, longer: Longer) -> int | None:
    """The fewest steps in which a plan was found, of those tried; None where as many as are tried do not help."""

    def tried(steps: int) -> int | None:
        other = replace(climb.problem, steps=steps)
        return longer(replace(climb, scenario=rewritten(climb.scenario, steps=steps), problem=other))

    fails = climb.problem.steps
    enough = min(max([LONGER * fails, *(short.needed for short in climb.work.too_short)]), MAX_STEPS)
    taken = tried(enough) if enough > fails else None
    if taken is None:
        return None
    for _ in range(HALVINGS):
        if enough - fails <= 1 or climb.late:
            break
        guess = taken if fails < taken < enough else (fails + enough) // 2
        fewer = tried(guess)
        fails, enough, taken = (guess, enough, enough) if fewer is None else (fails, guess, fewer)
    return enough


def _least(climb: Climb, relaxation: _Relaxation) -> tuple[float, list[Move]] | None:
    """The least amount, and the way that it gives; None where the most gives none."""

    def tried(count: int) -> list[Move] | None:
        amount = relaxation.given + count * relaxation.step
        try:
            return None if climb.late else _way(climb, relaxation.relaxed(climb, amount))
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
    return round(relaxation.given + enough * relaxation.step, 3), way


def _way(climb: Climb, problem: Problem) -> list[Move] | None:
    """Moves of a level body, one limb at a time, to the goal of a problem, for which there is a body path in time."""
    relaxed = replace(climb, **vars(Oracles.of(problem, TorqueLimits(problem, problem.friction_share))))
    if problem.contacts is climb.problem.contacts and problem.swing is climb.problem.swing:
        relaxed = replace(relaxed, swings=climb.swings)
    moves, _ = search(relaxed, at_once=1, greed=GREED, deadline=climb.deadline, most=STANCES)
    if moves is None:
        return None
    try:
        path = path_to_goal(problem, relaxed.equilibrium, evenly(relaxed, moves))[1]
    except HorizonError:
        return None
    return None if path is None else moves


def _relaxations(climb: Climb) -> Iterator[_Relaxation]:
    """What is made easier, in order of likelihood."""
    for obstacle in climb.scenario.obstacles:
        name = obstacle.name

        def size(share: float, name: str = name) -> str:
            return f"with {name} at {100 * share:.0f} % of its size"

        yield _Relaxation("passage", f"of the size of {name}", 1.0, -0.05, 19, partial(_smaller, name), size)
    off, thinner = "m off every side of a gripper", "with grippers {:.0f} mm thinner on every side"
    yield _Relaxation("passage", off, 0.0, 0.001, 12, _thinner, lambda amount_m: thinner.format(1000 * amount_m))
    factors = ("friction", "equilibrium", 40, _rougher), ("motor torque", "torque", 20, _stronger)
    for what, by, most, relaxed in factors:
        yield _Relaxation(by, f"times the {what}", 1.0, 0.05, most, relaxed, f"with {{:.2f}} times the {what}".format)
    further = "with {:.0f} mm more reach of a level body along and across it"
    yield _Relaxation("reach", "m of reach", 0.0, 0.005, 20, _further, lambda amount_m: further.format(1000 * amount_m))


def _smaller(name: str, climb: Climb, share: float) -> Problem:
    def shrink(obstacle: Any) -> Any:
        size = tuple(share * edge for edge in obstacle.size_m)
        return replace(obstacle, size_m=size) if obstacle.name == name else obstacle

    return _built(climb, obstacles=tuple(map(shrink, climb.scenario.obstacles)))


def _thinner(climb: Climb, amount_m: float) -> Problem:
    swing = climb.problem.swing
    clearance_m, body_m = swing.clearance_m - amount_m, swing.body_clearance_m - 2 * amount_m
    return replace(climb.problem, swing=replace(swing, clearance_m=clearance_m, body_clearance_m=body_m))


def _rougher(climb: Climb, factor: float) -> Problem:
    holds = [replace(h, friction=tuple(factor * f for f in h.friction)) for h in climb.scenario.holds]
    return _built(climb, holds=tuple(holds))


def _stronger(climb: Climb, factor: float) -> Problem:
    return replace(climb.problem, torque_limits_Nm=factor * climb.problem.torque_limits_Nm)


def _further(climb: Climb, amount_m: float) -> Problem:
    boxes = climb.problem.boxes
    along_wall = np.hypot(*boxes.directions[:, :2].T)
    return replace(climb.problem, boxes=replace(boxes, extent_m=boxes.extent_m + amount_m * along_wall))


def _built(climb: Climb, **changes: Any) -> Problem:
    built = build_problem(replace(climb.scenario, **changes), climb.robot, reach=climb.problem.limb_reach)
    return replace(built, boxes=climb.problem.boxes)


def _explained(
    climb: Climb, none: InfeasibleError, relaxation: _Relaxation, amount: float, way: list[Move]
) -> InfeasibleError:
    helps = f"{relaxation.text(amount)} a way is found"
    place = _place(climb, way)
    if place is not None:
        helps += f"; without, it ends {place}"
    same = none.proven or none.constraint == relaxation.constraint
    text = f"{none}; {helps}" if same else f"{helps} ({none})"
    reason = InfeasibleError(none.constraint if same else relaxation.constraint, text, proven=none.proven)
    reason.relaxed = {"constraint": relaxation.constraint, "amount": amount, "unit": relaxation.unit, "place": place}
    return reason


def _place(climb: Climb, way: list[Move]) -> str | None:
    """The first move of a way that the problem as it is does not have."""
    problem = climb.problem
    equilibrium = TorqueLimits(problem, problem.friction_share)
    friction = StaticEquilibrium(problem, problem.friction_share)
    for limb, reached in enumerate(goal_contacts(problem, climb.reachable)):
        if not reached:
            return f"with {LIMB_NAMES[limb]} at the goal"
    for move in way:
        swings = [(move.before[limb], move.after[limb]) for limb in move.limbs]
        ends = ((LIMB_NAMES[limb], problem.contacts[move.after[limb]].hold) for limb in move.limbs)
        gone = [f"{name} goes to {problem.hold_names[hold]}" for name, hold in ends]
        where = f"where {' and '.join(gone)}"
        bounds = [climb.reachable.of(stance) for stance in (move.before, move.after)]
        if None in bounds or not climb.swings.free(swings, move.support):
            return where
        for each, stance in zip(bounds, (move.before, move.after), strict=True):
            assert each is not None
            low, high = each
            if equilibrium.position(move.support, low, high, move.lift_off, stance) is None:
                short = friction.missing_force(move.support, low, high, stance)
                return f"{where}: " + (f"short by {short:.1f} N" if short > LACKING_N else "the joints are too weak")
    return None
