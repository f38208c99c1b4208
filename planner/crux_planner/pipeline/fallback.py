"""What `auto` tries where level bodies and centred grasps find no plan: another heading, then grasps off the middle.

Proofs that no plan exists come first where they are quick, and last where they need a search.
"""

import itertools
from collections.abc import Callable
from dataclasses import replace

from crux_planner.certificates.bound.bound_worker import AIM, PATIENCE_S, gap
from crux_planner.certificates.bound.climb import EFFORT, lower_bound
from crux_planner.certificates.infeasibility.infeasible import Proof
from crux_planner.errors import FOR_ALL_REACH, InfeasibleError
from crux_planner.model.arrays import Flags
from crux_planner.model.build import build_problem
from crux_planner.model.problem import Problem
from crux_planner.model.schedule import Move
from crux_planner.physics.reachable_set import ReachableSet
from crux_planner.pipeline.attempt import attempts
from crux_planner.pipeline.message import PlanResult
from crux_planner.pipeline.solve_and_check import Climb, solve_and_check
from crux_planner.search.ends import aimed, clear_start
from crux_planner.search.equilibrium import StaticEquilibrium
from crux_planner.search.heading_search import HeadingSearch
from crux_planner.search.stances import Oracles
from crux_planner.swing.swing_cache import SwingCache

GREED = 3.0
ATTEMPTS = 8

SolveAndCheck = Callable[[Climb, list[Move]], PlanResult | InfeasibleError]

TILT_SLACK_M, RESERVE_M = 0.008, 0.0015  # of a tilting body, and what is kept of the boxes for terms of second order
PASSING_M = 0.006  # between grippers that pass each other where they leave no more space; the check asks for 3 mm
AIMS = 4  # goal poses tried, each with ends in reach that none before has
LEVELS = ((False, 0.0, None), (True, TILT_SLACK_M, None), (True, TILT_SLACK_M, PASSING_M))
"""Grasps off the middle, space for a tilt, and clearance of passing grippers, None: the usual."""
SLOWER, TIGHTER = 0.4, 0.92  # of body speed and limit surface, where the check finds too little between the knots
GENTLER = ((1.0, SLOWER), (TIGHTER, SLOWER), (TIGHTER**2, SLOWER))  # of limit surface and speed, one after the other
GOAL_PROOF, FIRST_PROOF, LAST_PROOF = 300, 250, 3000  # programs for the goal's equilibrium, and for disconnected parts
TURN_SHARE = 0.4  # of the looks that are left, for one pose and one kind of grasps
LOOKS, LOOKS_PER_S = 24_000, 400.0  # at moves by searches that choose headings, and for each second of the time limit


def farther(climb: Climb) -> Climb:
    """The same with all of the limbs' inner reach."""
    problem = climb.problem.farther()
    return replace(climb, oracles=replace(climb.oracles, problem=problem, reachable=ReachableSet(problem)))


def disproved(climb: Climb, none_near: InfeasibleError) -> Proof | None:
    """What can be shown about the climb, where nothing quick shows that it has no plan; else raises InfeasibleError.
    None of limbs without closed-form kinematics: nothing is shown of these.
    """
    if not climb.problem.closed_form:
        return None
    proof = Proof(climb.session.scenario, climb.session.robot, climb.problem)
    with climb.work.part("proof", 0.1):
        impossible = proof.quick() or proof.goal_equilibrium(GOAL_PROOF, climb.session.deadline)
        if impossible is not None:
            raise impossible
        impossible = proof.disconnected(FIRST_PROOF, climb.session.deadline)
    if impossible is not None:
        raise _explained(proof.instead_of(none_near), impossible)
    return proof


def plan_wider(climb: Climb, none_level: InfeasibleError, proof: Proof | None, further: bool = False) -> PlanResult:
    """A plan with other headings or off-centre grasps. Raises InfeasibleError, the level problem's if unproven.

    Where the search goes `further`, no long proof follows.
    """
    work = climb.work
    none_level = none_level if proof is None else proof.instead_of(none_level)
    if none_level.constraint == "horizon":
        raise none_level  # what follows takes longer still
    found = plan_turning(climb, looks(climb))
    if found is not None:
        result, wide = found
        with work.part("bound", 0.95):  # of the problem with this aim and these grasps
            bound = lower_bound(replace(wide, steps=result.steps), (1.0 - AIM) * result.cost, PATIENCE_S, effort=EFFORT)
            result.gap = gap(result.cost, bound)
        return result
    if further or proof is None:
        raise none_level
    with work.part("proof", 0.9):
        impossible = proof.disconnected(LAST_PROOF, climb.session.deadline)
    raise none_level if impossible is None else _explained(none_level, impossible)


def looks(climb: Climb) -> int:
    """At moves that searches which choose headings may take: counted, so that a plan depends on no clock."""
    return max(LOOKS, int(LOOKS_PER_S * climb.session.limit_s))


def plan_turning(
    climb: Climb, looks: int, solve_and_check: SolveAndCheck = solve_and_check
) -> tuple[PlanResult, Problem] | None:
    """A plan with other headings or off-centre grasps and its problem; None where so many looks at moves find none."""
    work, reach = climb.work, climb.problem.limb_reach
    aims: dict[tuple[bool, int], tuple[Problem, Flags] | None] = {}
    for aim, (off_centre, tilt_m, passing_m) in [(0, LEVELS[0]), *itertools.product(range(AIMS), LEVELS[1:])]:
        if aim > 0 and aims[off_centre, aim - 1] is None:
            break
        if climb.session.late:
            work.cut_short = True
            break
        if (off_centre, aim) not in aims:
            tried = [pose[1] for (off, _), pose in aims.items() if pose is not None and off == off_centre]
            with work.part("problem", 0.1):
                wider = build_problem(climb.session.scenario, climb.session.robot, off_centre=off_centre, reach=reach)
                aims[off_centre, aim] = aimed(replace(wider, boxes=reach.inner), tried)
        found = aims[off_centre, aim]
        if found is None:
            continue
        wide = replace(found[0], reach_reserve_m=RESERVE_M, tilt_slack_m=tilt_m)
        if passing_m is not None:
            wide = replace(wide, swing=replace(wide.swing, body_clearance_m=passing_m))
        if off_centre and (start := clear_start(wide, SwingCache(wide))) is not None:
            wide = replace(wide, start_contacts=start)
        result, looked = _plan_aimed(climb, wide, found[1], solve_and_check, int(TURN_SHARE * looks))
        looks -= looked
        if result is not None:
            return result, wide
    return None


def _explained(none_level: InfeasibleError, impossible: InfeasibleError) -> InfeasibleError:
    """What stops a level body names the place best; the proof is about all others too."""
    return InfeasibleError(none_level.constraint, f"{none_level} (proven {FOR_ALL_REACH}: {impossible})", proven=True)


def _plan_aimed(
    climb: Climb, problem: Problem, ends: Flags, solve_and_check: SolveAndCheck, looks: int
) -> tuple[PlanResult | None, int]:
    """A plan whose search chooses headings, None where so many looks find none; and the looks taken."""
    work, given, gentler, left = climb.work, problem, list(GENTLER), looks

    def attempt(climb: Climb) -> PlanResult | InfeasibleError | None:
        nonlocal left
        if left <= 0 or climb.session.late:
            work.cut_short = True
            return None
        with work.part("headings", 0.2):
            headings = HeadingSearch(climb.problem, climb.oracles.reachable, climb.oracles.swings, ends)
            moves, seen = headings.search(greed=GREED, deadline=climb.session.deadline, most=left)
        left -= seen.looked
        work.cut_short |= seen.timed_out
        if moves is None:
            return None
        equilibrium = StaticEquilibrium(climb.problem, climb.problem.friction_share)
        found = solve_and_check(replace(climb, oracles=replace(climb.oracles, equilibrium=equilibrium)), moves)
        if isinstance(found, InfeasibleError):
            work.log(f"refused: {found}")
        return found

    def gentle(climb: Climb, failure: InfeasibleError) -> Climb | None:
        if not failure.constraint.startswith("limit_surface") or not gentler:
            return None
        share, speed = gentler.pop(0)
        body = replace(given.body, max_speed_m_s=speed * given.body.max_speed_m_s)
        return climb.of(replace(given, friction_share=share * given.friction_share, body=body))

    wide = replace(climb, oracles=Oracles.of(problem, climb.oracles.equilibrium))
    return attempts(wide, attempt, (gentle, without_blamed), [], most=ATTEMPTS)[0], looks - left


def without_blamed(climb: Climb, failure: InfeasibleError) -> Climb | None:
    """A remedy: the move that is to blame goes another way from now on, or none."""
    if failure.blamed is None:
        return None
    climb.oracles.swings.forbid(*failure.blamed)
    return climb
