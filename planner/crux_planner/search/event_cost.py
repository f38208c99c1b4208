"""J (6) of a sequence of moves with given durations, by one small convex program over the body's places at its events.

Between lift-offs, touch-downs and the middles of swings the body goes straight and even; at them the grippers in
stance carry it in static balance. What a stance on all four limbs costs hardly depends on where the body is, and is
computed once a stance. Good enough to rank candidates at a few milliseconds each; the exact NLP has the last word.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from crux_planner.model.arrays import Array, Flags
from crux_planner.model.schedule import Move, Stance
from crux_planner.physics.cost import swing_cost
from crux_planner.physics.reach import body_positions
from crux_planner.search.body_path import SPEED_SHARE
from crux_planner.search.event_path import EventPath, Node
from crux_planner.search.stances import Oracles

_LONG = 8  # knots of a stance beyond which the body first moves, then rests, then moves
_AT_GOAL = 3  # knots, about, for which the body is at the goal rather than where the last stance is easiest
_EMPTY_M = 1e-9  # by which bounds may be the wrong way round
_ABOUT = 1  # node beside what is different that an estimate near another solves again: the body meets its bounds
_SOLVED = 10
_SAME = 7  # digits [m] to which places of the body are the same


@dataclass(frozen=True)
class Timed:
    """Moves with the knots of the stance before each, and after the last (n + 1,), and of each swing (n,)."""

    moves: list[Move]
    stances: Array
    swings: Array

    @property
    def knots(self) -> int:
        """Of the whole climb, the one at its start left out."""
        return int(self.stances.sum() + self.swings.sum())

    def same(self, other: Timed | None) -> bool:
        """Whether the same limbs go to the same contacts at the same knots."""
        return other is not None and all(
            (
                [(move.limbs, move.after) for move in self.moves] == [(move.limbs, move.after) for move in other.moves],
                np.array_equal(self.stances, other.stances),
                np.array_equal(self.swings, other.swings),
            )
        )


@dataclass(frozen=True)
class Estimate:
    """J; at every node the body's place (K, 3) and what carrying it takes (K,); what a knot more of each swing adds."""

    cost: float
    nodes: list[Node]
    body: Array
    efforts: Array
    air_costs: list[float]

    @property
    def places(self) -> Array:
        """Of the body at lift-off and touch-down of each move (n, 2, 3)."""
        flown = [i for i, node in enumerate(self.nodes) if node.support]  # three a move
        return np.asarray(self.body[np.array([flown[::3], flown[2::3]], dtype=int).T])


class EventCost:
    """Estimates of one problem; what belongs to one stance or swing is kept."""

    def __init__(self, oracles: Oracles) -> None:
        problem, equilibrium = oracles.problem, oracles.equilibrium
        self.problem, self.equilibrium = problem, equilibrium
        self.reach, self.swings = oracles.reachable, oracles.swings
        self.work = 0  # counted in nodes looked at; one that is solved counts for `_SOLVED` of them
        self.step_m = SPEED_SHARE * problem.body.max_speed_m_s * problem.dt_s
        self._path = EventPath(problem, equilibrium, self.reach.shape, self.step_m)
        self._runs: dict[Any, tuple[Array, Array] | None] = {}
        self._reached: dict[Any, tuple[Array, Array]] = {}
        self._standing: dict[tuple[Stance, bool], float] = {}
        self._in_air: dict[tuple[int, int, int], float] = {}

    def estimate(self, timed: Timed, near: Estimate | None = None) -> Estimate | None:
        """J of timed moves; None where reach, balance and speed leave no body path.

        With `near`, the body stays where it is there but about what is different: no less than J without it.
        """
        moves = timed.moves
        stances = [self.problem.start_contacts, *(move.after for move in moves)]
        standing = [self._stance_effort(stance, last=False) for stance in stances]
        at_goal = self._stance_effort(stances[-1], last=True)
        if not np.isfinite([*standing, at_goal]).all():
            return None
        nodes = self._nodes(timed, stances)
        if any((node.low > node.high + _EMPTY_M).any() for node in nodes):
            return None
        places = self._places(nodes, near)
        if places is None:
            return None
        body, efforts = places
        carried = efforts[[i for i, node in enumerate(nodes) if node.support][1::3]]
        in_air = [self._swing_costs(move, int(air)) for move, air in zip(moves, timed.swings, strict=True)]
        longer = [
            self.problem.weights.wrench * effort + later - now - min(before, after)
            for effort, (now, later), before, after in zip(carried, in_air, standing[:-1], standing[1:], strict=True)
        ]
        total = self._path_cost(nodes, body, efforts) + float(np.dot(standing, timed.stances))
        total += sum(now for now, _ in in_air) + (at_goal - standing[-1]) * min(_AT_GOAL, int(timed.stances[-1]))
        return Estimate(total, nodes, body, efforts, longer)

    def has_places(self, timed: Timed) -> bool:
        """Whether the reach of the limbs leaves the body a place at every node."""
        stances = [self.problem.start_contacts, *(move.after for move in timed.moves)]
        return not any((node.low > node.high + _EMPTY_M).any() for node in self._nodes(timed, stances))

    def _places(self, nodes: list[Node], near: Estimate | None) -> tuple[Array, Array] | None:
        """The body at the nodes and what carrying it there takes; None where there is no path."""
        self.work += len(nodes)
        body, efforts, free = _taken_over(nodes, near)
        ends = np.flatnonzero(np.diff(free, prepend=False, append=False))
        for first, last in ends.reshape(-1, 2).tolist():  # runs of free nodes
            run = self._run(nodes, body, first, last)
            if run is None:
                return None
            body[first:last], efforts[first:last] = run
        return body, efforts

    def _run(self, nodes: list[Node], body: Array, first: int, last: int) -> tuple[Array, Array] | None:
        """Of the nodes first..last - 1, with the body where it is at those before and after."""
        begin, end = max(first - 1, 0), min(last + 1, len(nodes))
        since = nodes[begin].knot
        fixed = [body[i] for i in (begin, end - 1) if not first <= i < last]
        what = tuple((node.what, node.knot - since) for node in nodes[begin:end])
        key = (first > 0, what, np.round(np.array(fixed), _SAME).tobytes())
        if key not in self._runs:
            self.work += _SOLVED * (last - first)
            self._runs[key] = self._path.solve(nodes[begin:end], fixed, slice(first - begin, last - begin))
        return self._runs[key]

    def _path_cost(self, nodes: list[Node], body: Array, efforts: Array) -> float:
        """Q-terms of positions and velocities between the nodes, R-terms on swings."""
        weights = self.problem.weights
        counts = np.diff([node.knot for node in nodes])
        away = weights.position * ((body - self.problem.goal.body.position_m) ** 2).sum(axis=1)
        way = weights.velocity / self.problem.dt_s**2 * (np.diff(body, axis=0) ** 2).sum(axis=1)
        total = float(counts @ (away[:-1] + away[1:])) / 2 + float((way / np.maximum(counts, 1)).sum())
        return total + weights.wrench * float(efforts @ [node.share for node in nodes])

    def _nodes(self, timed: Timed, stances: list[Stance]) -> list[Node]:
        """The grid in time: start, events, middles of swings, goal; long stances have two knots more."""
        start, k = self.problem.start.position_m, 0
        nodes = [Node(("start",), 1, start, start)]  # at rest in knot 0: knot 1 is the same
        for i, stance in enumerate(stances):
            low, high = self._bounds(stance, last=False)
            k += int(timed.stances[i])
            since = nodes[-1].knot
            if k - since > _LONG:
                nodes += [Node((stance,), since + _LONG // 2, low, high), Node((stance,), k - _LONG // 2, low, high)]
            if i == len(timed.moves):
                break
            move, air = timed.moves[i], int(timed.swings[i])
            half, what = air // 2, (stance, move.after, air)
            nodes.append(Node((*what, "off"), k, low, high, move.support, half / 2, stance))
            both = (*stance, *move.after)
            nodes.append(Node(what, k + half, *self._on_the_way(move, air, half), move.support, air / 2, both))
            k += air
            bounds = self._bounds(move.after, last=False)
            nodes.append(Node((*what, "down"), k, *bounds, move.support, (air - half) / 2, move.after))
        nodes.append(Node((stances[-1], "goal"), k, *self._bounds(stances[-1], last=True)))
        return nodes

    def _bounds(self, stance: Stance, *, last: bool) -> tuple[Array, Array]:
        """Of the body's place on all four limbs; the lower above the upper where there is none."""
        key = (stance, last)
        if key not in self._reached:
            nothing = np.ones(len(self.reach.shape.directions))
            low, high = self.reach.of(stance) or (nothing, -nothing)
            if last:
                near = self.reach.around(self.problem.goal.body.position_m, self.problem.goal.position_slack_m)
                low, high = np.maximum(low, near[0]), np.minimum(high, near[1])
            self._reached[key] = low, high
        return self._reached[key]

    def _on_the_way(self, move: Move, air: int, knots: int) -> tuple[Array, Array]:
        """Bounds of the body's place `knots` after lift-off."""
        key = (move.before, move.after, air, knots)
        if key not in self._reached:
            reach = self.reach
            on = [limb for limb in range(4) if limb not in move.limbs]
            lows, highs = [*reach.low[on, list(move.support)]], [*reach.high[on, list(move.support)]]
            for limb in move.limbs:
                poses = self.swings.way(move.before[limb], move.after[limb]).poses(air)
                low, high = body_positions(poses[knots, None, :3], reach.shape)
                lows.append(low[limb])
                highs.append(high[limb])
            self._reached[key] = np.max(lows, axis=0), np.min(highs, axis=0)
        return self._reached[key]

    def waiting_costs(self, timed: Timed, estimate: Estimate) -> list[float]:
        """What a knot more of each stance (n + 1) adds to J, about, the body half way between its places there."""
        goal = self.problem.goal.body.position_m
        arrived = np.vstack([self.problem.start.position_m, estimate.places[:, 1]])
        leaving = np.vstack([estimate.places[:, 0], goal])
        away = self.problem.weights.position * (((arrived + leaving) / 2 - goal) ** 2).sum(axis=1)
        away[-1] = 0.0  # it waits at the goal
        stances = [self.problem.start_contacts, *(move.after for move in timed.moves)]
        last = len(stances) - 1
        return [self._stance_effort(s, last=i == last) + float(away[i]) for i, s in enumerate(stances)]

    def _stance_effort(self, stance: Stance, *, last: bool) -> float:
        """R-term of one knot on all four limbs, the body where it is least; inf where it has no place."""
        key = (stance, last)
        if key not in self._standing:
            low, high = self._bounds(stance, last=last)
            somewhere = (low <= high + 1e-9).all()
            self._standing[key] = self._path.stance_effort(low, high, stance) if somewhere else np.inf
        return self._standing[key]

    def _swing_costs(self, move: Move, air: int) -> tuple[float, float]:
        """What J says of a move's swings whatever the body does, in the air `air` knots and one more."""
        swings = [(move.before[limb], move.after[limb]) for limb in move.limbs]
        now, later = (sum(self.swing_price(*swing, knots) for swing in swings) for knots in (air, air + 1))
        return now, later

    def swing_price(self, start: int, end: int, air: int) -> float:
        """What J says of a swing in the air for so many knots, whatever the body does."""
        key = (start, end, air)
        if key not in self._in_air:
            self._in_air[key] = swing_cost(self.problem.weights, self.swings.way(start, end).poses(air)[:-1])
        return self._in_air[key]


def _taken_over(nodes: list[Node], near: Estimate | None) -> tuple[Array, Array, Flags]:
    """Places and efforts as they are in an estimate near, and which nodes are free: those about what differs."""
    body, efforts, count = np.zeros((len(nodes), 3)), np.zeros(len(nodes)), len(nodes)
    if near is None:
        return body, efforts, np.ones(count, dtype=bool)
    new, old = ([node.what for node in each] for each in (nodes, near.nodes))
    most = min(count, len(old))
    before = next((i for i in range(most) if new[i] != old[i]), most)
    after = next((i for i in range(most - before) if new[-1 - i] != old[-1 - i]), most - before)
    at = np.full(count, -1)  # the node of `near` that each is
    at[:before] = np.arange(before)
    at[count - after :] = np.arange(len(old) - after, len(old))
    known = at >= 0
    body[known], efforts[known] = near.body[at[known]], near.efforts[at[known]]
    knots, then = np.array([node.knot for node in nodes]), np.array([node.knot for node in near.nodes])[at]
    same = known[:-1] & known[1:] & (np.diff(at) == 1) & (np.diff(knots) == np.diff(then))
    differs = np.append(~same, False) | np.append(False, ~same)
    free = np.convolve(differs, np.ones(2 * _ABOUT + 1), mode="same") > 0.5
    return body, efforts, free if differs.any() else ~free
