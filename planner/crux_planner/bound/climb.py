"""A proven lower bound of J (6) of every climb: the cheapest way through grasps and time, each knot at its own best.

The relaxation, step by step; each only allows more or asks less:
1. Contacts, swings, friction, boxes of (9a), bounds (7): the planner's (Problem). Swings are straight up, across,
   straight down; a limb in the air needs no more than the quickest of those to where it lands, from anywhere.
2. Every knot has its own body pose and its own wrenches: at most in reach of start and goal at full speed. Its cost is
   bounded by weak duality (bound.prices), whatever the QP that proposes the prices does.
3. (8) asks for balance up to the largest accelerations that speeds within (7) allow.
4. Height and opening of limbs in the air earn what they can at most; speeds cost nothing.
5. A dynamic programme over all sets of grasps and knots (bound.timeline) adds up the cheapest way.
Sets of grasps are priced only where the cheapest way goes. Plans that stray so far that they cost more than the J
asked about are left out: the bound is never above that J.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from crux_planner.arrays import Array, Flags, Indices
from crux_planner.bound.grasps import Grasps, grasps
from crux_planner.bound.knot_qp import KnotQp
from crux_planner.bound.places import orientations
from crux_planner.bound.prices import Prices
from crux_planner.bound.room import body_room, excursion_cost, yaw_room
from crux_planner.bound.swings import detours, earned, ends, floor, quickest_to, shared_weight
from crux_planner.bound.timeline import Timeline
from crux_planner.problem import Problem

TIME_LIMIT_S = 20.0
LARGEST = 300_000  # states of the dynamic programme
_WINDOW = 8  # knots after the start and before the goal at which full speed says where the body can be
_ROUND = 40  # sets of grasps priced in a round, those on the cheapest ways
_SHARED = 4  # times as many learn from their prices


def lower_bound(
    problem: Problem,
    cost: float = np.inf,
    time_limit_s: float = TIME_LIMIT_S,
    report: Callable[[float], None] = lambda _bound: None,
) -> float | None:
    """A number that J of no plan is below, at most `cost`; None where there is none.

    There is none where (2) is not what holds, and where too many sets of grasps lie on ways that cost less than `cost`.
    `report` is told each better bound, so that one may stop listening at any time.
    """
    if problem.limit_surface == "paper":  # it lets pass what (2) does not
        return None
    deadline = time.monotonic() + time_limit_s
    search = _Search.begin(problem, cost)
    if search is None:
        return None
    bound = min(search.run(deadline, lambda better: report(min(better, cost))), cost)
    return bound if np.isfinite(bound) else None


@dataclass
class _Search:
    """The dynamic programme with what is priced so far."""

    problem: Problem
    cost: float
    nodes: Grasps
    prices: Prices
    qp: KnotQp
    room: tuple[Array, Array]
    timeline: Timeline
    ends: list[Indices]
    value: Array  # (n,) of each node, at any knot
    windows: dict[int, Array]  # knot -> (n,)
    known: Flags  # (n,) priced by prices of its own
    known_at: set[tuple[int, int]]  # (knot, node)
    _tables: dict[int, Array] = field(default_factory=dict)

    @staticmethod
    def begin(problem: Problem, cost: float) -> _Search | None:
        spare = cost - floor(problem)
        room = body_room(problem, spare)
        about = orientations(problem, *yaw_room(problem, spare))
        nodes = grasps(problem, about, *room)
        prices = Prices(problem, about, nodes)
        qp = KnotQp(problem, prices.carriers)
        everything = np.arange(len(nodes.options))
        value = np.full(len(everything), -np.inf)
        for held in _examples(problem, nodes):
            value = np.maximum(value, prices.values(qp.prices(held, room), everything))
        excess = value - shared_weight(problem)[nodes.in_air]
        for limb, own in enumerate(nodes.contacts):
            around = detours(problem, limb, own)
            excess += np.append(around - around.min(), 0.0)[nodes.options[:, limb]]
        kept = excess + excursion_cost(problem, about, nodes) <= spare
        nodes = nodes.reduced(kept)
        least_air = [quickest_to(problem, own) for own in nodes.contacts]
        if np.prod([len(air) + air.max() for air in least_air]) > LARGEST:
            return None
        return _Search(
            problem,
            cost,
            nodes,
            Prices(problem, about, nodes),
            qp,
            room,
            Timeline(least_air, problem.weights.switching),
            [ends(problem, limb, own) for limb, own in enumerate(nodes.contacts)],
            value[kept],
            {},
            np.zeros(int(kept.sum()), dtype=bool),
            set(),
        )

    def run(self, deadline: float, report: Callable[[float], None]) -> float:
        """The bound when all that the cheapest way meets is priced, or when the time is up."""
        problem, bound = self.problem, -np.inf
        start = tuple(0 for _ in range(4))  # the start's contacts come first
        while True:
            self._tables = {}
            before = self.timeline.forward(start, problem.steps, self._stage, deadline)
            if before is None:
                return bound
            bound = max(bound, float(before[-1][np.ix_(*self.ends)].min()))
            report(bound)
            if bound >= self.cost or time.monotonic() > deadline:
                return bound
            after = self.timeline.backward(self.ends, problem.steps, self._stage)
            through = np.stack(
                [self._of_nodes(self.timeline.by_options(a + b)) for a, b in zip(before, after, strict=False)]
            )
            through = self._drop(through)
            if not self._price(through, bound, deadline):
                return bound

    def _drop(self, through: Array) -> Array:
        """Leave out the nodes on no way that costs less than what is asked about; what is left of `through`."""
        kept = through.min(axis=0) <= self.cost
        if kept.all():
            return through
        old = np.flatnonzero(kept)
        place = {int(node): i for i, node in enumerate(old)}
        self.nodes = self.nodes.reduced(kept)
        self.prices = Prices(self.problem, self.prices.about, self.nodes)
        self.value, self.known = self.value[kept], self.known[kept]
        self.windows = {knot: value[kept] for knot, value in self.windows.items()}
        self.known_at = {(knot, place[node]) for knot, node in self.known_at if node in place}
        least_air = [quickest_to(self.problem, own) for own in self.nodes.contacts]
        self.timeline = Timeline(least_air, self.problem.weights.switching)
        self.ends = [ends(self.problem, limb, own) for limb, own in enumerate(self.nodes.contacts)]
        return through[:, kept]

    def _stage(self, knot: int) -> Array:
        key = knot if knot in self.windows else -1
        if key not in self._tables:
            table = np.full(self.nodes.shape, np.inf)
            value = self.windows.get(knot, self.value)
            table[tuple(self.nodes.options.T)] = value + earned(self.problem) * self.nodes.in_air
            self._tables[key] = table
        return self._tables[key]

    def _of_nodes(self, table: Array) -> Array:
        return np.asarray(table[tuple(self.nodes.options.T)])

    def _price(self, through: Array, bound: float, deadline: float) -> bool:
        """Find prices for the nodes on the cheapest ways; False where those of the cheapest have theirs already."""
        on_way = through <= bound + 1e-9
        found = False
        outer = [k for k in range(len(through)) if min(k, len(through) - k) <= _WINDOW]
        for k in outer:
            for node in np.flatnonzero(on_way[k]):
                if (k, int(node)) in self.known_at:
                    continue
                self.known_at.add((k, int(node)))
                found = True
                self._price_at(k, int(node), np.flatnonzero(on_way[k]))
        inner = [k for k in range(len(through)) if k not in outer]
        least = through[inner].min(axis=0) if inner else through.min(axis=0)
        found |= bool((~self.known[on_way[inner].any(axis=0)]).any())
        if not found:
            return False
        order = np.argsort(least)
        wanted = order[~self.known[order] & (least[order] <= self.cost)][:_ROUND]
        others = order[: _SHARED * _ROUND]
        for node in wanted:
            if time.monotonic() > deadline:
                break
            proposed = self.qp.prices(self.nodes.held(int(node)), self.room)
            self._raise(others, self.prices.values(proposed, others))
            self._raise(np.array([node]), self.prices.values(proposed, np.array([node])))
            self.known[node] = True
        return True

    def _raise(self, which: Indices, value: Array) -> None:
        self.value[which] = np.maximum(self.value[which], value)
        for window in self.windows.values():
            window[which] = np.maximum(window[which], value)

    def _price_at(self, knot: int, node: int, others: Indices) -> None:
        problem = self.problem
        step = problem.body.max_speed_m_s * problem.dt_s
        before, after = step * max(knot - 1, 0), step * (problem.steps - knot) + problem.goal.position_room_m
        start, goal = problem.start.position_m, problem.goal.body.position_m
        low = np.maximum(np.maximum(start - before, goal - after), self.room[0])
        high = np.minimum(np.minimum(start + before, goal + after), self.room[1])
        high = np.maximum(low, high)
        proposed = self.qp.prices(self.nodes.held(node), (low, high))
        window = self.windows.setdefault(knot, self.value.copy())
        window[others] = np.maximum(window[others], self.prices.values(proposed, others, (low, high)))


def _examples(problem: Problem, nodes: Grasps) -> list[dict[int, int]]:
    """Sets of grasps whose prices say something of most others: the start's and the goal's, and each less one limb."""
    start, goal = dict(enumerate(problem.start_contacts)), {}
    for limb, own in enumerate(nodes.contacts):
        last = own[ends(problem, limb, own)]
        goal[limb] = int(last[0]) if len(last) else start[limb]
    sets = [start] if goal == start else [start, goal]
    return [{limb: c for limb, c in held.items() if limb != out} for held in sets for out in (None, 0, 1, 2, 3)]
