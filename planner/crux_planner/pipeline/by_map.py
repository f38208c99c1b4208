"""A plan with all of what the limbs reach, within their joint limits: where convex pieces of it leave no way.

Stances come from `MapSearch`, the body's path over the knots from dynamic programming over the same maps on a finer
grid, and the exact P1 has the joint limits themselves for (9a). What the check refuses is learnt: joints that come too
near to their limits between two knots get more margin, and limbs that come too near to each other more clearance; if
that does not help, the body keeps near the map's path. A move that no path or plan goes with is left out of the next
way.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from crux_contracts import LIMB_NAMES

from crux_planner.checker import CheckReport, Violation, check_plan
from crux_planner.model.arrays import Array
from crux_planner.model.build import build_problem
from crux_planner.model.problem import Problem
from crux_planner.model.schedule import Move, Schedule
from crux_planner.pipeline.message import PlanResult, plan_message
from crux_planner.pipeline.refusals import eased, slowed
from crux_planner.pipeline.solve_and_check import Climb
from crux_planner.reach.arm import reaches_of
from crux_planner.search.body_path import SPEED_SHARE, path_about
from crux_planner.search.ends import level_aims
from crux_planner.search.map_search import MapSearch, Step
from crux_planner.search.pose_masks import Footing, PoseMasks, grid_about
from crux_planner.search.pose_path import clear_path
from crux_planner.search.schedule import at_knots
from crux_planner.search.stances import Oracles
from crux_planner.trajectory.exact import solve_within_torques
from crux_planner.trajectory.joint_rows import ELBOW, JointFunctions, JointLimits
from crux_planner.trajectory.solution import Solution, Start, start_from_path

COARSE = (0.02, 0.07, 0.22, 0.21)  # grid of the search: steps [m, rad], and how far it goes around start and goal
FINE = (0.01, 0.035, 0.16, 0.105)  # of the body's path
SEARCH_RAD, PATH_RAD, PLAN_RAD = 0.04, 0.03, 0.02  # margins to joint limits
LOOKS, WAYS = 3000, 8  # at moves for one way of stances, and ways
SPARE_KNOTS = (1, 2, 4)  # a move, beyond what the swings need
HALVES_M = (0.01, 0.02, 0.04, 0.08)  # how far the first solution may be off the path of the map
ROUNDS = 6  # of the exact P1 and its check
AIMS = 12  # goal poses tried for one at which four limbs hold
LEVEL_RAD = 0.03  # tilts of start and goal up to which a level body stands for them
_MORE_RAD = 0.01  # beyond what the check misses
_MORE_M, _MOST_MORE_M = 0.0015, 0.003  # of links: beyond what the check misses; where that is more, planes are wrong
_MOST_APART_M = 0.012  # from where the path is kept to
_ANSWERED = ("joint_position", "inverse_kinematics", "clearance_limbs")
_STRETCHED_RAD = 0.05  # off a straight elbow where the check finds a gripper beyond reach
_NEAR_M = 0.02  # of the map's path, where links come too near to each other; a quarter of it the second time


def plan_by_map(climb: Climb) -> PlanResult | None:
    """A checked plan; None where none is found, or start or goal are tilted. Grasps in the middle of their faces come
    first, then also those off it.
    """
    given = climb.problem
    tilts = np.abs([given.start.rpy_rad[:2], given.goal.body.rpy_rad[:2]])
    in_air = not all(given.contacts[c].bears for c in given.start_contacts)
    if in_air or tilts.max() > LEVEL_RAD:
        return None
    for off_centre in (False, True):
        if off_centre:
            with climb.work.part("problem", 0.1):
                climb = _off_centre(climb)
        with climb.work.part("map", 0.2):
            search = next((each for each in _searches(climb) if len(each.goals)), None)
        if search is not None and (found := _planned(climb, search)) is not None:
            return found
        if climb.session.late:
            return None
    return None


def _off_centre(climb: Climb) -> Climb:
    session = climb.session
    wider = build_problem(session.scenario, session.robot, off_centre=True, reach=climb.problem.limb_reach)
    return replace(climb, oracles=Oracles.of(wider, climb.oracles.equilibrium))


def _searches(climb: Climb) -> Iterator[MapSearch]:
    """For the middle of the goal's tolerances, and then for other level poses in them."""
    robot, problem = climb.session.robot, climb.problem.aimed()
    for each in itertools.chain([problem], itertools.islice(level_aims(problem, reaches_of(robot, SEARCH_RAD)), AIMS)):
        grid = grid_about(each, *COARSE)
        yield MapSearch(PoseMasks(each, robot, grid, SEARCH_RAD), Footing(each, grid), climb.oracles.swings)


def _planned(climb: Climb, search: MapSearch) -> PlanResult | None:
    """By one way of stances after the other."""
    problem, session, without = search.problem, climb.session, set[Step]()
    fine = PoseMasks(problem, session.robot, grid_about(problem, *FINE), PATH_RAD)
    planner = _ByMap(climb, problem, fine)
    for _ in range(WAYS):
        with climb.work.part("map", 0.2):
            way = search.find(without, LOOKS, session.deadline)
        if way is None:
            return None
        found = planner.plan(way)
        if isinstance(found, PlanResult):
            return found
        if session.late:
            climb.work.cut_short = True
        if session.late or not way:
            return None
        without.add(way[found])
    return None


class _ByMap:
    """From ways of stances to plans of one problem."""

    def __init__(self, climb: Climb, problem: Problem, masks: PoseMasks) -> None:
        self.climb, self.problem, self.masks = climb, problem, masks
        self.footing = Footing(problem, masks.grid)
        reaches = reaches_of(climb.session.robot)
        self.functions = self.undamped = JointFunctions(
            problem, reaches, JointLimits.about(np.zeros((0, 12)), PLAN_RAD)
        )

    def plan(self, way: list[Step]) -> PlanResult | int:
        """A checked plan, or the number of the move that is to blame for there being none."""
        at = self.problem.start.position_m
        moves = [Move(before, after, (limb,), at, at) for before, limb, after in way]
        swings, blamed, refused = self.climb.oracles.swings, -1, 0
        self.functions = self.undamped
        quickest = np.array([swings.intervals(m.before[i], m.after[i]) for m in moves for i in m.limbs], dtype=int)
        away_m = np.abs(self.problem.goal.body.position_m - self.problem.start.position_m).max()
        travel = int(np.ceil(away_m / (SPEED_SHARE * self.problem.body.max_speed_m_s * self.problem.dt_s)))
        least, most = max(int(quickest.sum()) + len(moves), travel) + 2, self.problem.steps
        wanted = {least + (len(moves) + 1) * spare for spare in SPARE_KNOTS}
        if self.climb.session.scenario.planner.idle == "keep":
            wanted = {most}
        for steps in sorted(each for each in {*wanted, most} if least <= each <= most):
            problem = replace(self.problem, steps=steps)
            schedule = _schedule(problem, self.climb, moves, quickest)
            with self.climb.work.part("body", 0.4):
                start = self._start(problem, schedule)
            if isinstance(start, int):
                before, blamed = blamed, _move_at(schedule, start)
                if before == blamed:
                    break  # more time does not help
                continue
            if start is not None and (found := self._solve(problem, schedule, start)) is not None:
                return found
            refused += 1
            if refused == len(SPARE_KNOTS) or self.climb.session.late:
                break  # as much time as there is helps no better
        return blamed if blamed >= 0 else len(moves) - 1

    def _start(self, problem: Problem, schedule: Schedule) -> Start | int | None:
        """Where the exact P1 starts; or the knot at which the body's path ends, None where no wrenches go with it."""
        poses, last = clear_path(problem, self.masks, self.footing, schedule)
        if poses is None:
            return last
        for half_m in HALVES_M:
            path = path_about(problem, self.footing.oracle, schedule, poses, half_m)
            if path is not None:
                return start_from_path(problem, path, poses[:, 3])
        return None

    def _solve(self, problem: Problem, schedule: Schedule, first: Start) -> PlanResult | None:
        """A checked plan for a schedule; what the check refuses is answered, `ROUNDS` times at most."""
        session, work, start = self.climb.session, self.climb.work, first
        limits = JointLimits.about(first.body, PLAN_RAD)
        for _ in range(ROUNDS):
            with work.part("nlp", 0.5):
                self.functions = self.functions.within(limits)
                solution = self._solved(problem, schedule, start)
            if not solution.solved:
                return None
            with work.part("check", 0.8):
                message = plan_message(session.scenario, session.robot, problem, schedule, solution, session.method)
                report = check_plan(message, session.robot)
            if report.ok:
                return PlanResult.of(message, report, solution, schedule.gait, work)
            answer, others = _answered(limits, report, problem.dt_s)
            if any(each.constraint == "clearance_limbs" for each in report.violations):
                answer = self.functions.nearer(answer, schedule, first.body, solution.body)
            again = (answer.near_m != limits.near_m).any()
            easier = _easier(problem, replace(report, violations=others), schedule, solution.body) if others else None
            if others and easier is None:
                return None
            limits, problem = answer, easier or problem
            torques_Nm = np.minimum(problem.torque_limits_Nm, solution.torque_limits_Nm)
            problem, start = replace(problem, torque_limits_Nm=torques_Nm), first if again else solution.start
        return None

    def _solved(self, problem: Problem, schedule: Schedule, start: Start) -> Solution:
        """The exact P1's; where it does not converge, with damped steps from then on."""
        until = self.climb.session.deadline
        solution = solve_within_torques(problem, schedule, start, until, self.functions)
        if not solution.solved and not self.functions.damping:
            self.functions = self.functions.damped()
            solution = solve_within_torques(problem, schedule, start, until, self.functions)
        return solution


def _schedule(problem: Problem, climb: Climb, moves: list[Move], swings: Array) -> Schedule:
    """Swings at their quickest; the stances share the other knots evenly."""
    stances = np.ones(len(moves) + 1, dtype=int)
    stances[-1] = 2
    for _ in range(problem.steps - int(swings.sum() + stances.sum())):
        stances[int(np.argmin(stances))] += 1
    return at_knots(problem, climb.oracles.swings, moves, stances, swings)


def _answered(limits: JointLimits, report: CheckReport, dt_s: float) -> tuple[JointLimits, list[Violation]]:
    """Limits under which joints and links may pass, and the violations that limits do not answer."""
    others, margin_rad, apart_m, near_m = [], limits.margin_rad.copy(), limits.apart_m.copy(), limits.near_m.copy()
    for each in report.violations:
        if each.time_s is None or each.constraint not in _ANSWERED:
            others.append(each)
            continue
        k = int(each.time_s / dt_s)
        if each.constraint == "clearance_limbs":
            about, at = slice(max(0, k - 2), k + 4), slice(k, k + 2)
            if (limits.apart_m[at] < _MOST_APART_M).all():
                apart_m[at] = np.maximum(apart_m[at], limits.apart_m[at] + min(each.amount, _MOST_MORE_M) + _MORE_M)
                continue
            if (limits.near_m[about] < _NEAR_M).all():
                others.append(each)
            near_m[about] = np.minimum(near_m[about], np.where(np.isfinite(limits.near_m[about]), _NEAR_M / 4, _NEAR_M))
            continue
        joint, lacking_rad = (each.joint, each.amount) if each.joint is not None else (ELBOW, _STRETCHED_RAD)
        margin_rad[k : k + 2, LIMB_NAMES.index(each.limb or ""), joint] += lacking_rad + _MORE_RAD
    return replace(limits, margin_rad=margin_rad, apart_m=apart_m, near_m=near_m), others


def _easier(problem: Problem, report: CheckReport, schedule: Schedule, body: Array) -> Problem | None:
    """The problem with less of the joints, or a slower body, where the check asks for it."""
    if (easier := eased(problem, report)) is not None:
        return easier
    speed = np.abs(body[:, 6:9]).max(axis=1)
    slow = slowed(problem.speed_limits, report, schedule.contacts, speed, problem.dt_s)
    return None if slow in (None, dict(problem.speed_limits)) else replace(problem, speed_limits=slow or {})


def _move_at(schedule: Schedule, k: int) -> int:
    """The number of the move whose limb is in the air at knot k, or next after it."""
    begun, up = 0, False
    for j, knot in enumerate(schedule.contacts):
        air = None in knot
        begun += air and not up
        up = air
        if j >= k and air:
            break
    return max(min(begun, len(schedule.moves)) - 1, 0)
