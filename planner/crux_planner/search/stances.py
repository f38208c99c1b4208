"""Which limb moves to which hold: A* over stances (one contact per limb), by the number of knots the climb takes."""

from __future__ import annotations

import heapq
import itertools
from collections import Counter
from collections.abc import Mapping
from dataclasses import dataclass, field

import numpy as np

from crux_planner.model.arrays import Array
from crux_planner.model.problem import Problem
from crux_planner.model.schedule import Move, Stance, stance_after
from crux_planner.physics.reachable_set import ReachableSet, goal_contacts
from crux_planner.search.equilibrium import StaticEquilibrium, clipped
from crux_planner.solvers import clock
from crux_planner.swing.link_clearance import LinkClearance
from crux_planner.swing.swing_cache import SwingCache

UNREACHABLE = 1e6
ANY = (np.inf, 0.0)  # stances, see `search`
STANCE_KNOTS = 1.0  # between two moves
MOVE_COST = 0.2  # of a move, in knots: fewer moves where time is equal
_TIES = 6  # digits of knots to which ways are as quick


@dataclass
class SearchReport:
    """What the search saw, for the error message when it finds nothing."""

    expanded: int = 0
    looked: int = 0  # at moves, closely
    timed_out: bool = False
    nearest: Stance | None = None  # the stance with the least cost to go
    nearest_cost: float = np.inf
    lifts_without_balance: Counter[int] = field(default_factory=Counter)  # per limb, from the nearest stance


def costs_to_go(problem: Problem, reach: ReachableSet, swings: SwingCache) -> list[dict[int, float]]:
    """Per limb and contact, the least knots to the goal were it alone: an exact shortest path, admissible for all."""
    tables = []
    for limb, ends in enumerate(goal_contacts(problem, reach)):
        usable = set(reach.usable[limb])
        cost: dict[int, float] = {}
        queue = [(0.0, c) for c in ends]
        while queue:
            done, c = heapq.heappop(queue)
            if c in cost:
                continue
            cost[c] = done
            for other in map(int, reach.neighbours(limb, c)):
                if other in usable and other not in cost and swings.swing(other, c) is not None:
                    heapq.heappush(queue, (done + move_cost(swings, [(other, c)]), other))
        tables.append(cost)
    return tables


@dataclass(frozen=True, kw_only=True)
class Oracles:
    """A climb's problem, and what answers the questions of its search and keeps the answers."""

    problem: Problem
    equilibrium: StaticEquilibrium
    reachable: ReachableSet
    swings: SwingCache

    @classmethod
    def of(cls, problem: Problem, equilibrium: StaticEquilibrium | None = None) -> Oracles:
        """New ones; balance is within the problem's share of friction."""
        equilibrium = equilibrium or StaticEquilibrium(problem, problem.friction_share)
        reachable, swings = ReachableSet(problem), SwingCache(problem)
        return cls(problem=problem, equilibrium=equilibrium, reachable=reachable, swings=swings)


def search(
    oracles: Oracles,
    *,
    at_once: int,
    greed: float,
    deadline: float,
    most: tuple[float, float] = ANY,
    known: Mapping[Stance, list[Move]] | None = None,
) -> tuple[list[Move] | None, SearchReport]:
    """Moves to the goal, `at_once` limbs (1 or 2) at a time, None where there are none; and what the search saw.

    With `greed` 1 these are the quickest; above, they take at most `greed` times as long and are found sooner. From
    the stances in `known` the rest of the way is known: the search ends there. It gives up at `deadline` (of clock.now)
    and after so many stances: `most` on any way, and for each knot that it takes at least.
    """
    tree = _Tree(oracles, at_once, greed)
    allowed = most[0] + most[1] * tree.estimate(oracles.problem.start_contacts)
    report = tree.report
    while tree.open and not report.timed_out:
        reached = tree.next()
        if reached is None:
            continue
        cost, stance, body = reached
        if known and stance in known:
            return [*tree.moves_to(stance), *known[stance]], report
        ahead = tree.estimate(stance)
        if ahead < report.nearest_cost:
            report.nearest, report.nearest_cost = stance, ahead
            report.lifts_without_balance.clear()
        if ahead < 1e-9 and _ends_well(oracles, stance):
            return tree.moves_to(stance), report
        report.expanded += 1
        report.timed_out = report.expanded > allowed or clock.now() > deadline
        tree.grow(cost, stance, body)
    return None, report


@dataclass(frozen=True)
class _Way:
    """A move that may lead to a stance; `lift_off` is where the body is as it begins."""

    before: Stance
    limbs: tuple[int, ...]
    lift_off: Array


class _Tree:
    """The stances reached, the cheapest moves known to each, and the ways on which the search may go on.

    Whether a way is open, clear of other grippers and links, in balance where it lands, costs far more to find out than
    how long it takes: it is asked of a way when it comes first.
    """

    def __init__(self, oracles: Oracles, at_once: int, greed: float) -> None:
        self._problem = problem = oracles.problem
        swings = oracles.swings
        self.equilibrium, self.reach, self.swings = oracles.equilibrium, oracles.reachable, swings
        self.report = SearchReport()
        self._to_go, self._at_once, self._greed = costs_to_go(problem, self.reach, swings), at_once, greed
        self._links, self._goal = LinkClearance(problem, swings), problem.goal.body.position_m
        self._groups = [g for n in range(1, at_once + 1) for g in itertools.combinations(range(4), n)]
        self._counter = itertools.count()
        self._parent: dict[Stance, Move] = {}
        self._best: dict[Stance, float] = {}
        self.open: list[tuple[float, float, int, float, Stance, _Way | None]] = []
        self._add(0.0, problem.start_contacts, None, 1.0)

    def estimate(self, stance: Stance) -> float:
        """Least knots to the goal."""
        return sum(self._to_go[limb].get(c, UNREACHABLE) for limb, c in enumerate(stance)) / self._at_once

    def next(self) -> tuple[float, Stance, Array] | None:
        """The cost of getting to the most promising stance, the stance, and where the body is then; None where the way
        there is not open, or longer than one known.
        """
        *_, cost, stance, way = heapq.heappop(self.open)
        if cost >= self._best.get(stance, np.inf) - 1e-9:
            return None
        body = self._problem.start.position_m if way is None else self._landed(stance, way)
        if body is None:
            return None
        self._best[stance] = cost
        if way is not None:
            self._parent[stance] = Move(way.before, stance, way.limbs, way.lift_off, body)
        return cost, stance, body

    def moves_to(self, stance: Stance) -> list[Move]:
        """From the start."""
        moves = []
        while stance in self._parent:
            moves.append(self._parent[stance])
            stance = moves[-1].before
        return moves[::-1]

    def grow(self, cost: float, stance: Stance, body: Array) -> None:
        """Add what moves from a stance lead to."""
        if (bounds := self.reach.of(stance)) is None:
            return
        free = set(self._problem.may_move(stance))
        for limbs in self._groups:
            if not free.issuperset(limbs):
                continue
            support = tuple(c for limb, c in enumerate(stance) if limb not in limbs)
            lift_off = self.equilibrium.position(support, *bounds, body, stance)
            if lift_off is None:
                if stance == self.report.nearest:
                    self.report.lifts_without_balance.update(limbs)
                continue
            if self._links.stance_clear(stance, body, lift_off):
                self._move(cost, stance, limbs, support, lift_off)

    def _move(
        self, cost: float, stance: Stance, limbs: tuple[int, ...], support: tuple[int, ...], lift_off: Array
    ) -> None:
        reach, swings, way = self.reach, self.swings, _Way(stance, limbs, lift_off)
        for ends in itertools.product(*[map(int, reach.neighbours(limb, stance[limb])) for limb in limbs]):
            after = stance_after(stance, limbs, ends)
            moves = [(stance[limb], end) for limb, end in zip(limbs, ends, strict=True)]
            if self.estimate(after) >= UNREACHABLE or not swings.exist(moves, support) or reach.of(after) is None:
                continue
            new_cost = cost + move_cost(swings, moves)
            if new_cost < self._best.get(after, np.inf) - 1e-9:
                self._add(new_cost, after, way, self._greed)

    def _landed(self, after: Stance, way: _Way) -> Array | None:
        """Where the body is when a way has led to a stance; None where the way is not open."""
        moves = [(way.before[limb], after[limb]) for limb in way.limbs]
        support = tuple(c for limb, c in enumerate(way.before) if limb not in way.limbs)
        landing = self.reach.of(after)
        if landing is None or not self.swings.free(moves, support):
            return None
        touch_down = self.equilibrium.position(support, *landing, clipped(self._goal, *landing), after)
        if touch_down is None or not self._links.move_clear(way.before, after, way.limbs, way.lift_off, touch_down):
            return None
        return touch_down

    def _add(self, cost: float, stance: Stance, way: _Way | None, greed: float) -> None:
        """Of ways that promise to be as quick, the one nearest the goal comes first: most orders of the same moves are
        as quick, and a long route has too many of them to look at all.
        """
        ahead = self.estimate(stance)
        promises = round(cost + greed * ahead, _TIES)
        heapq.heappush(self.open, (promises, ahead, next(self._counter), cost, stance, way))


def move_cost(swings: SwingCache, moves: list[tuple[int, int]]) -> float:
    """Knots that limbs take to go from one contact to another each, all at once, and the stance after it."""
    return max(swings.intervals(a, b) for a, b in moves) + STANCE_KNOTS + MOVE_COST * len(moves)


def _ends_well(oracles: Oracles, stance: Stance) -> bool:
    """Whether the goal's body pose is in reach and in balance on a stance."""
    problem, bounds = oracles.problem, oracles.reachable.of(stance)
    if bounds is None:
        return False
    goal = problem.goal.body.position_m
    near = oracles.reachable.around(goal, problem.goal.position_slack_m)
    low, high = np.maximum(bounds[0], near[0]), np.minimum(bounds[1], near[1])
    return bool((low <= high).all()) and oracles.equilibrium.position(stance, low, high, goal) is not None
