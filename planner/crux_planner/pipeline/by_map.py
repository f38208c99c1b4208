"""A plan with all of what the limbs reach, within their joint limits: where convex pieces of it leave no way.

Stances come from `MapSearch`, the body's path over the knots from dynamic programming over the same maps on a finer
grid, and the exact P1 has the joint limits themselves for (9a). Before that, the way is improved by the estimates of J,
with the convex hulls of what limbs reach; the path shows whether the limbs reach as far. A move that no path or plan
goes with is left out of the next way.
"""

from __future__ import annotations

import itertools
from collections import Counter
from collections.abc import Iterator
from dataclasses import dataclass, field, replace
from functools import partial

import numpy as np

from crux_planner.errors import HorizonError
from crux_planner.model.arrays import Array
from crux_planner.model.build import build_problem
from crux_planner.model.poses import point_text
from crux_planner.model.problem import Problem
from crux_planner.model.schedule import Move, Schedule, Stance, stance_after
from crux_planner.pipeline.by_joints import UNLIMITED, solve_by_joints
from crux_planner.pipeline.message import PlanResult
from crux_planner.pipeline.restart import rewritten
from crux_planner.pipeline.session import RefusedWay
from crux_planner.pipeline.solve_and_check import Climb, improved, others_than
from crux_planner.pipeline.two_at_once import TwoAtOnce
from crux_planner.reach.arm import CLEAR_M, reaches_of
from crux_planner.search.body_path import SPEED_SHARE, path_about
from crux_planner.search.ends import aims, clear_start
from crux_planner.search.event_cost import Timed
from crux_planner.search.footing import Footing
from crux_planner.search.map_search import Left, MapSearch, Step
from crux_planner.search.pose_masks import LEVEL_RAD, PoseMasks, grid_about, hulls_of, tilts_of
from crux_planner.search.pose_path import Ended, clear_path
from crux_planner.search.schedule import TURN_SHARE, at_knots
from crux_planner.search.stances import Oracles
from crux_planner.search.stood_on import StoodOn
from crux_planner.search.torque_limits import TorqueLimits
from crux_planner.swing.swing_cache import SwingCache
from crux_planner.trajectory.joint_rows import JointFunctions
from crux_planner.trajectory.link_planes import OFF_M
from crux_planner.trajectory.solution import Start, start_from_path

Steps = tuple[float, float, float, float]
COARSE = (0.02, 0.07, 0.22, 0.21)  # grid of the search: steps [m, rad], and how far it goes around start and goal
FINE = (0.01, 0.035, 0.22, 0.21)  # of the body's path
BESIDE = ((0.03, 0.07, 0.16, 0.0), (0.02, 0.035, 0.16, 0.0))  # both where the body follows surfaces, heights too
SEARCH_RAD, PATH_RAD = 0.04, 0.03  # margins to joint limits
LOOKS, WAYS = 3000, 8  # at moves for one way of stances, and ways
QUICK, NEAR_KNOTS = (100, 2), 80  # the same, and knots to a goal that is not far
SPARE_KNOTS = (1, 2, 4)  # a move, beyond what the swings need
HALVES_M = (0.01, 0.02, 0.04, 0.08)  # how far the first solution may be off the path of the map
MOST_BY_PLACES = 2  # horizons for which the grippers' places give no plan, until no longer one is tried
MORE_KNOTS, MORE_IF_WEAK = 4, 1  # of a stance, and of the swing after it, where the body's path ends
MOST_TOO_LONG = 2  # ways in a row for the horizon: the quickest come first
MOST_LANDINGS = 2  # of a limb from one stance for which motors are too weak, until it is not lifted there any more
AIMS = 12  # goal poses tried for one at which four limbs hold
_SAME_M = 1e-4  # between grippers at one place


@dataclass
class Tried:
    """What is known of a climb by map. With grasps in the middle of their faces, `refused` moves are left out."""

    refused: set[Left] = field(default_factory=set)
    searches: dict[bool, tuple[Climb, MapSearch | None]] = field(default_factory=dict)  # by whether off the middle, too
    far: bool = True  # the goal, for a quick search
    unmoved: int = 0  # ways of stances without a plan
    short: list[HorizonError] = field(default_factory=list)  # of those that need more steps

    @property
    def too_long(self) -> bool:
        """Whether the horizon is too short for every way that was found."""
        return 0 < len(self.short) == self.unmoved

    def search(self, climb: Climb, off_centre: bool) -> tuple[Climb, MapSearch | None]:
        """A search to the first pose within the goal's tolerances that has stances on the map, and whose climb it is;
        None where none has any. `off_centre`: also with grasps off the middle.
        """
        if off_centre not in self.searches:
            if off_centre:
                with climb.work.part("problem", 0.1):
                    climb = _off_centre(climb)
            with climb.work.part("map", 0.2):
                found = next((each for each in _searches(climb) if len(each.goals)), None)
            self.searches[off_centre] = climb, found
        return self.searches[off_centre]

    def held_at_goal(self, climb: Climb) -> bool:
        """Whether a body at the goal holds on in balance on the map."""
        searches = (self.search(climb, off_centre)[1] for off_centre in (False, True))
        return any(search is not None and search.held_at_goal for search in searches)


def plan_by_map(climb: Climb, tried: Tried, quick: bool = False) -> tuple[PlanResult, Problem] | None:
    """A checked plan and its problem; None where none is found. Grasps in the middle of their faces come first, then
    also those off it.

    What is found out is kept in `tried`. `quick`: only with the former, and few looks at moves; none where the goal is
    far.
    """
    if tried.too_long and tried.unmoved >= MOST_TOO_LONG:
        return None
    for off_centre in (False,) if quick else (False, True):
        of, search = tried.search(climb, off_centre)
        if search is None:
            continue
        if not off_centre:
            tried.far = search.ahead(of.problem.start_contacts) > NEAR_KNOTS
        if quick and tried.far:
            continue
        without, known = set[Left]() if off_centre else tried.refused, len(climb.work.refused)
        for found in _planned(of, search, without, quick):
            if found is not None:
                return found, search.problem
            tried.unmoved += 1
        reasons = [way.reason for way in climb.work.refused[known:]]
        tried.short += [each for each in reasons if isinstance(each, HorizonError)]
        if climb.session.late:
            return None
    return None


def missing_at_goal(climb: Climb) -> str | None:
    """What a level body at the goal lacks by the map, at the pose in its tolerances where fewest limbs lack a hold.
    None where four limbs hold, or the goal is tilted.
    """
    problem = climb.problem.aimed()
    if np.abs(problem.goal.body.rpy_rad[:2]).max() > LEVEL_RAD:
        return None
    searches = list(_searches(climb))
    if len(searches[0].goals):
        return None
    search = min((each for each in searches if not len(each.goals)), key=lambda each: len(each.idle_at_goal))
    place = point_text(problem, search.problem.goal.body.position_m)
    return f"{search.missing_at_goal()}, for a level body at the goal {place}"


def _grids(problem: Problem) -> tuple[Steps, Steps]:
    return BESIDE if problem.follows else (COARSE, FINE)


def _off_centre(climb: Climb) -> Climb:
    session = climb.session
    wider = build_problem(session.scenario, session.robot, off_centre=True, reach=climb.problem.limb_reach)
    wider = replace(wider, boxes=wider.limb_reach.inner, follows=climb.problem.follows)
    if (start := clear_start(wider, SwingCache(wider))) is not None:
        wider = replace(wider, start_contacts=start)
    return replace(climb, oracles=Oracles.of(wider, climb.oracles.equilibrium))


def _searches(climb: Climb) -> Iterator[MapSearch]:
    """For the middle of the goal's tolerances, and then for other poses in them, tilted as its middle."""
    robot, problem = climb.session.robot, climb.problem.aimed()
    margin_rad = SEARCH_RAD + problem.unsure_rad
    for each in itertools.chain([problem], itertools.islice(aims(problem, reaches_of(robot, margin_rad)), AIMS)):
        grid = grid_about(each, *_grids(each)[0])
        masks = PoseMasks(each, robot, grid, margin_rad, CLEAR_M + problem.unsure_m)
        yield MapSearch(masks, Footing(each, grid), climb.oracles.swings)


def _planned(climb: Climb, search: MapSearch, without: set[Left], quick: bool) -> Iterator[PlanResult | None]:
    """By one way of stances after the other, None for each without a plan; its move that is to blame is added to those
    it goes `without`.
    """
    problem, session = search.problem, climb.session
    knot_m, (step_m, *others) = SPEED_SHARE * problem.body.max_speed_m_s * problem.dt_s, _grids(problem)[1]
    grid = grid_about(problem, knot_m / np.ceil(knot_m / step_m), *others)  # so that the body may be as fast as it may
    fine = PoseMasks(problem, session.robot, grid, PATH_RAD + problem.unsure_rad, OFF_M + problem.unsure_m)
    planner = _ByMap(climb, search, fine)
    (looks, ways), refused = QUICK if quick else (LOOKS, WAYS), Counter[tuple[Stance, int]]()
    stood = False  # all the time, in vain
    for _ in range(ways):
        with climb.work.part("map", 0.2):
            way = search.find(without, looks, session.deadline, moves=stood)
        if way is None:
            return
        found = planner.plan(way)
        yield found if isinstance(found, PlanResult) else None
        if session.late:
            climb.work.cut_short = True
        if isinstance(found, PlanResult) or session.late or planner.too_long == MOST_TOO_LONG:
            return
        if not way:
            stood = True
            continue
        without |= _turned(problem, way[found]) if planner.by_places else {way[found]}
        refused[way[found][:2]] += bool(planner.by_places)
        if refused[way[found][:2]] == MOST_LANDINGS:
            without |= {(before, limb, None) for before, limb, _ in _turned(problem, way[found])}


def _turned(problem: Problem, step: Step) -> set[Step]:
    """A move, and those with all grippers at the same places and turned otherwise: motors bear these no better."""
    before, limb, after = step
    places = np.array([contact.centre_h_m for contact in problem.contacts])

    def there(contact: int) -> list[int]:
        return np.flatnonzero(np.linalg.norm(places - places[contact], axis=1) < _SAME_M).tolist()

    one, two, three, four = (there(contact) for contact in before)
    stances = itertools.product(one, two, three, four)
    return {(each, limb, stance_after(each, (limb,), (end,))) for each in stances for end in there(after[limb])}


class _ByMap:
    """From ways of stances to plans of one problem."""

    def __init__(self, climb: Climb, search: MapSearch, masks: PoseMasks, steps: int | None = None) -> None:
        """Of as many steps as the search's problem has, or so many."""
        self.climb, self.search, self.masks = climb, search, masks
        problem = self.problem = replace(search.problem, steps=steps or search.problem.steps)
        self.footing = Footing(problem, masks.grid)
        self.functions = JointFunctions(problem, reaches_of(climb.session.robot), UNLIMITED)
        self.by_places = 0  # horizons of one way that fail by the grippers' places
        self.too_long = 0  # ways in a row that the horizon is too short for
        self._hulls: dict[float, Oracles] = {}

    def plan(self, way: list[Step]) -> PlanResult | int:
        """A checked plan, or the number of the move that is to blame for there being none."""
        at = self.problem.start.position_m
        moves = [Move(before, after, (limb,), at, at) for before, limb, after in way]
        self.by_places = 0
        if (cheaper := self._cheaper(moves)) is not None:
            return self._in_pairs(*cheaper)
        if (needed := _least_steps(self.problem, self.climb.oracles.swings, moves)) > self.problem.steps:
            text = f"{self.problem.steps} steps are too few for {len(moves)} moves; allow at least {needed}"
            self.climb.work.refused.append(RefusedWay(HorizonError(text, needed), partial(self._in_steps, way)))
            self.too_long += 1
            return len(moves) - 1
        self.too_long = 0
        blamed = len(moves) - 1
        for timed in self._evenly(moves):
            found = self._timed(timed)
            if isinstance(found, PlanResult):
                return self._in_pairs(found, timed)
            before, blamed = blamed, blamed if found is None else found
            if before == found or self.by_places >= MOST_BY_PLACES:
                break  # more time does not help
            if self.climb.session.late:
                break
        return blamed

    def _in_steps(self, way: list[Step], steps: int, deadline: float) -> PlanResult | int:
        """What the same way gives with another horizon, tried without a word."""
        session = self.climb.session
        silent = replace(self.climb.work, log=lambda _line: None, bound=None)
        scenario = rewritten(session.scenario, steps=steps)
        longer = replace(self.climb, session=replace(session, scenario=scenario, work=silent, deadline=deadline))
        return _ByMap(longer, self.search, self.masks, steps).plan(way)

    def _evenly(self, moves: list[Move]) -> Iterator[Timed]:
        """Swings at their quickest; the stances share some knots to spare, more each time, or all that there are."""
        problem, swings = self.problem, self.climb.oracles.swings
        quickest, least, most = _quickest(swings, moves), _least_steps(problem, swings, moves), problem.steps
        keeps = self.climb.session.scenario.planner.idle == "keep"
        wanted = {most} if keeps else {min(most, least + (len(moves) + 1) * spare) for spare in SPARE_KNOTS}
        for steps in sorted(each for each in wanted if each >= least):
            stances = np.ones(len(moves) + 1, dtype=int)
            stances[-1] = 2
            for _ in range(steps - int(quickest.sum() + stances.sum())):
                stances[int(np.argmin(stances))] += 1
            yield Timed(moves, stances, quickest)

    def _in_pairs(self, found: PlanResult, timed: Timed) -> PlanResult:
        """The plan of timed moves; where time counts, with one in which two limbs move at once where these can."""
        if self.climb.session.scenario.planner.objective != "time":
            return found

        def stands(move: Move) -> bool:
            grips = [self.problem.contacts[c] for c in move.before]
            middle_m = np.mean([grip.centre_h_m for grip in grips], axis=0)
            return all(grip.bears for grip in grips) and self.footing.stands(move.held, middle_m) is not None

        found.in_pairs = TwoAtOnce(self.climb.oracles.swings, stands, self._timed).plan(timed)
        return found

    def _cheaper(self, moves: list[Move]) -> tuple[PlanResult, Timed] | None:
        """A checked plan of the moves or cheaper ones near them, timed, the body in the convex hulls of the limbs'
        reach as the estimates have it; None where the map has no path for any of these.
        """
        if not moves or (np.ptp(tilts_of(self.problem), axis=0) > self.problem.boxes.max_tilt_rad).any():
            return None
        turns = 0.0, max(COARSE[3], abs(float(self.problem.goal.body.rpy_rad[2])))
        hulls = (self._by_hulls(turn_rad) for turn_rad in turns)
        oracles = next((each for each in hulls if all(each.reachable.of(m.after) for m in moves)), None)
        if oracles is None:
            return None
        climb = replace(self.climb, oracles=oracles)
        timed, _, costs = improved(climb, moves)
        found = None if timed is None else self._timed(timed)
        if timed is None or not isinstance(found, PlanResult):
            return None
        others = others_than(climb, costs, timed)
        if others is not None and others.found:
            better = self._timed(others.timed)
            others = replace(others, found=isinstance(better, PlanResult) and better.cost < found.cost)
            if isinstance(better, PlanResult) and others.found:
                found, timed = better, others.timed
        found.others = others
        return found, timed

    def _by_hulls(self, turn_rad: float) -> Oracles:
        """Of a body that turns up to so far, as if it were level and did not."""
        if turn_rad not in self._hulls:
            start, goal = self.problem.start, self.problem.goal
            ends = replace(start, rpy_rad=np.zeros(3)), replace(goal, body=replace(goal.body, rpy_rad=np.zeros(3)))
            boxes = hulls_of(self.masks.reaches, self.problem, turn_rad)
            hulls = replace(self.problem, boxes=boxes, start=ends[0], goal=ends[1])
            oracles = Oracles.of(hulls, TorqueLimits(hulls, hulls.friction_share))
            reachable = StoodOn(hulls, self.search)
            self._hulls[turn_rad] = replace(oracles, swings=self.climb.oracles.swings, reachable=reachable)
        return self._hulls[turn_rad]

    def _timed(self, timed: Timed) -> PlanResult | int | None:
        """A checked plan of timed moves, with more knots where the body's path ends; or the number of the move at which
        it ends or motors are too weak, None where there is no plan for another reason.
        """
        longer = Counter[int]()
        while timed.knots <= self.problem.steps:
            problem, swings = replace(self.problem, steps=timed.knots), self.climb.oracles.swings
            schedule = at_knots(problem, swings, timed.moves, timed.stances, timed.swings)
            with self.climb.work.part("body", 0.4):
                start = self._start(problem, schedule)
            if start is None:
                return None
            if isinstance(start, Start):
                given = problem, schedule, start, self.functions, self.masks.clear_near
                found = solve_by_joints(self.climb.session, *given)
                if not isinstance(found, Ended):
                    return found
                self.by_places += found.by_places
                return _move_at(schedule, found.knot)
            j, end = _move_at(schedule, start.knot), start.knot > len(schedule.contacts) - 3 and bool(timed.moves)
            if start.by_places:
                self.by_places = MOST_BY_PLACES
                return j
            if longer[j] == (MORE_IF_WEAK if start.weak else MORE_KNOTS) or self.climb.session.late:
                self.by_places += start.weak
                return j
            longer[j] += 1
            stances, flown = timed.stances.copy(), timed.swings.copy()
            stances[j + end] += 1
            if None in schedule.contacts[start.knot]:
                flown[j] += 1
            timed = replace(timed, stances=stances, swings=flown)
        return None

    def _start(self, problem: Problem, schedule: Schedule) -> Start | Ended | None:
        """Where the exact P1 starts; or where the body's path ends, None where no wrenches go with it."""
        poses = clear_path(problem, self.masks, self.footing, schedule)
        if isinstance(poses, Ended):
            return poses
        for half_m in HALVES_M:
            path = path_about(problem, self.footing.oracle, schedule, poses, half_m)
            if path is not None:
                return replace(start_from_path(problem, path, poses[:, 3:]), clear=poses)
        return None


def _quickest(swings: SwingCache, moves: list[Move]) -> Array:
    """Knots of each swing."""
    return np.array([swings.intervals(m.before[i], m.after[i]) for m in moves for i in m.limbs], dtype=int)


def _least_steps(problem: Problem, swings: SwingCache, moves: list[Move]) -> int:
    """Steps that the moves need at least, and the body on a straight way to the goal."""
    start, goal, body = problem.start, problem.goal.body, problem.body
    away_m, turn_rad = np.abs(goal.position_m - start.position_m), np.abs(goal.rpy_rad - start.rpy_rad)
    rates = SPEED_SHARE * body.max_speed_m_s, TURN_SHARE * body.max_rate_rad_s
    travel = int(np.ceil(max(away_m.max() / rates[0], turn_rad.max() / rates[1]) / problem.dt_s))
    return max(int(_quickest(swings, moves).sum()) + len(moves), travel) + 2


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
