"""J (6) of a sequence of moves with given durations, by one small convex program over the body's places at its events.

Between lift-offs, touch-downs and the middles of swings the body goes straight and even; at them the grippers in
stance carry it in static balance. What a stance on all four limbs costs hardly depends on where the body is, and is
computed once a stance. Good enough to rank candidates at a few milliseconds each; the exact NLP has the last word.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from typing import Any

import numpy as np
import scipy.linalg as la

from crux_planner.model.arrays import Array, Flags, Indices
from crux_planner.model.schedule import Move, Stance
from crux_planner.physics.bounds import LEAST_NORMAL_N
from crux_planner.physics.cost import swing_cost
from crux_planner.physics.limit_surface import grip_rows, polytope_directions
from crux_planner.physics.reach import body_positions
from crux_planner.search.body_path import SPEED_SHARE, within
from crux_planner.search.equilibrium import FORCE_BOUND_N, TWIST_BOUND_NM
from crux_planner.search.stances import Oracles
from crux_planner.solvers.qp import Block, SparseQp

_CONE_SHARE = 0.97  # of the polytope that touches the cone (2) from outside: on average as large as the cone
_LONG = 8  # knots of a stance beyond which the body first moves, then rests, then moves
_AT_GOAL = 3  # knots, about, for which the body is at the goal rather than where the last stance is easiest
_LEVEL = np.eye(3)
_ABOUT = 1  # node beside what is different that an estimate near another solves again: the body meets its bounds
_SOLVED = 10
_SAME = 7  # digits [m] to which places of the body are the same
_DIFFERENCE = Block(np.hstack([-np.eye(3), np.eye(3)]))
_BOTH_WAYS = Block(np.vstack([np.hstack([-np.eye(3), np.eye(3)]), np.hstack([np.eye(3), -np.eye(3)])]))
_MINUS_PLUS = np.tile([-1.0, 1.0], (3, 1))
_WRENCH = 6  # QP variables a gripper: s1, s2, m, F = n1 - n2, their mean a, the smaller n


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
class _Node:
    """The body at a knot, within bounds; on swings the grippers of `support` carry it, there for `share` knots of J.

    What `what` says is the same makes the same bounds, support and share.
    """

    what: tuple[object, ...]
    knot: int
    low: Array
    high: Array
    support: tuple[int, ...] = ()
    share: float = 0.0
    grippers: tuple[int, ...] = ()  # contacts in the middle of which they are


@dataclass(frozen=True)
class _Grips:
    """Of the grippers' q on some contacts: bounds, limits @ q <= right, balance @ (q, body's place)."""

    low: Array
    high: Array
    limits: Block
    right: Array
    balance: Block


@dataclass(frozen=True)
class Estimate:
    """J; at every node the body's place (K, 3) and what carrying it takes (K,); what a knot more of each swing adds."""

    cost: float
    nodes: list[_Node]
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
        self._effort = np.array([2.0, 2.0, 2.0 / problem.patch.k_m**2, 0.5, 2.0, 0.0])
        self._directions, _ = polytope_directions(problem.patch.k_m)
        unit = self._directions * np.array([1.0, 1.0, problem.patch.k_m])
        self._load = _CONE_SHARE * equilibrium.margin * np.linalg.norm(unit, axis=1)
        self._grips: dict[tuple[int, ...], _Grips] = {}
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
        if any((node.low > node.high + 1e-9).any() for node in nodes):
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

    def _places(self, nodes: list[_Node], near: Estimate | None) -> tuple[Array, Array] | None:
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

    def _run(self, nodes: list[_Node], body: Array, first: int, last: int) -> tuple[Array, Array] | None:
        """Of the nodes first..last - 1, with the body where it is at those before and after."""
        begin, end = max(first - 1, 0), min(last + 1, len(nodes))
        since = nodes[begin].knot
        fixed = [body[i] for i in (begin, end - 1) if not first <= i < last]
        what = tuple((node.what, node.knot - since) for node in nodes[begin:end])
        key = (first > 0, what, np.round(np.array(fixed), _SAME).tobytes())
        if key not in self._runs:
            self.work += _SOLVED * (last - first)
            self._runs[key] = self._solve([*nodes[begin:end]], fixed, slice(first - begin, last - begin))
        return self._runs[key]

    def _solve(self, nodes: list[_Node], fixed: list[Array], free: slice) -> tuple[Array, Array] | None:
        qp = SparseQp()
        places: list[Indices] = []
        grips: list[Indices] = []
        for i, node in enumerate(nodes):
            if free.start <= i < free.stop:
                places.append(within(qp, self.reach.shape, node.low, np.maximum(node.low, node.high), _LEVEL))
                grips.append(self._carry(qp, places[-1], node.support, node.grippers, node.share))
            else:
                at = fixed[0 if i < free.start else -1]
                places.append(qp.variables(at, at))
        self._move_body(qp, [node.knot for node in nodes], places)
        solution = qp.solve()
        if solution is None:
            return None
        efforts = [float((solution[grip].reshape(-1, _WRENCH) ** 2 @ self._effort).sum()) for grip in grips]
        return solution[np.array(places[free])], np.array(efforts)

    def _path_cost(self, nodes: list[_Node], body: Array, efforts: Array) -> float:
        """Q-terms of positions and velocities between the nodes, R-terms on swings."""
        weights = self.problem.weights
        counts = np.diff([node.knot for node in nodes])
        away = weights.position * ((body - self.problem.goal.body.position_m) ** 2).sum(axis=1)
        way = weights.velocity / self.problem.dt_s**2 * (np.diff(body, axis=0) ** 2).sum(axis=1)
        total = float(counts @ (away[:-1] + away[1:])) / 2 + float((way / np.maximum(counts, 1)).sum())
        return total + weights.wrench * float(efforts @ [node.share for node in nodes])

    def _nodes(self, timed: Timed, stances: list[Stance]) -> list[_Node]:
        """The grid in time: start, events, middles of swings, goal; long stances have two knots more."""
        start, k = self.problem.start.position_m, 0
        nodes = [_Node(("start",), 1, start, start)]  # at rest in knot 0: knot 1 is the same
        for i, stance in enumerate(stances):
            low, high = self._bounds(stance, last=False)
            k += int(timed.stances[i])
            since = nodes[-1].knot
            if k - since > _LONG:
                nodes += [_Node((stance,), since + _LONG // 2, low, high), _Node((stance,), k - _LONG // 2, low, high)]
            if i == len(timed.moves):
                break
            move, air = timed.moves[i], int(timed.swings[i])
            half, what = air // 2, (stance, move.after, air)
            nodes.append(_Node((*what, "off"), k, low, high, move.support, half / 2, stance))
            both = (*stance, *move.after)
            nodes.append(_Node(what, k + half, *self._on_the_way(move, air, half), move.support, air / 2, both))
            k += air
            bounds = self._bounds(move.after, last=False)
            nodes.append(_Node((*what, "down"), k, *bounds, move.support, (air - half) / 2, move.after))
        nodes.append(_Node((stances[-1], "goal"), k, *self._bounds(stances[-1], last=True)))
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
            solution = None
            if (low <= high + 1e-9).all():
                qp = SparseQp()
                place = within(qp, self.reach.shape, low, np.maximum(low, high), _LEVEL)
                self._carry(qp, place, stance, stance, 1.0)
                solution = qp.solve()
            self._standing[key] = np.inf if solution is None else qp.value(solution)
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

    def _carry(
        self, qp: SparseQp, place: Indices, support: tuple[int, ...], grippers: tuple[int, ...], knots: float
    ) -> Indices:
        """Balance at a body place on contacts and its R-term for so many knots; the numbers of the grippers' q."""
        if not support:
            return np.zeros(0, dtype=int)
        if support not in self._grips:
            self._grips[support] = self._gripped(support)
        grips = self._grips[support]
        index = qp.variables(grips.low, grips.high)
        qp.below(grips.limits, index, grips.right)
        effort = np.sqrt(np.tile(self._effort, len(support)))
        qp.squares(index[:, None], effort[:, None], np.zeros(len(index)), self.problem.weights.wrench * knots)
        right = self.equilibrium.weight(self.equilibrium.mean_place(grippers))[1]
        qp.equal(grips.balance, np.concatenate([index, place]), right)
        return index

    def _gripped(self, support: tuple[int, ...]) -> _Grips:
        bound = np.array([FORCE_BOUND_N, FORCE_BOUND_N, TWIST_BOUND_NM, FORCE_BOUND_N, FORCE_BOUND_N, FORCE_BOUND_N])
        equilibrium = self.equilibrium
        limits, balance = [], []
        right: list[Any] = []
        lows: list[Any] = []
        for contact in support:
            surfaces, press_N = equilibrium.limits[contact], equilibrium.press_N[contact]
            rows_of_grip, right_of_grip = grip_rows(surfaces, self._directions, self._load, press_N)
            count = len(self._load) * len(surfaces)
            rows = np.zeros((count + 4, _WRENCH))
            rows[:count, [0, 1, 2, 3, 5 if len(surfaces) == 1 else 4]] = rows_of_grip[:count]
            rows[count:, 3:] = [[0.5, -1.0, 1.0], [-0.5, -1.0, 1.0], [0.5, 1.0, 0.0], [-0.5, 1.0, 0.0]]
            limits.append(rows)
            right += [right_of_grip[:count], [0.0, 0.0], press_N]
            least = LEAST_NORMAL_N if self.problem.contacts[contact].may_press.all() else 0.0
            lows += [-bound[:4], [0.0, least]]
            balance.append(np.pad(equilibrium.maps[contact], ((0, 0), (0, 2))))
        body, _ = equilibrium.weight(np.zeros(3))
        high = np.tile(bound, len(support))
        limit_rows, balance_rows = Block(la.block_diag(*limits)), Block(np.hstack([*balance, body]))
        return _Grips(np.concatenate(lows), high, limit_rows, np.concatenate(right), balance_rows)

    def _move_body(self, qp: SparseQp, knots: list[int], body: list[Indices]) -> None:
        """Q-terms of positions and velocities between the nodes, and the body's speed."""
        weights, goal, dt = self.problem.weights, self.problem.goal.body.position_m, self.problem.dt_s
        for (now, a), (then, b) in pairwise(zip(knots, body, strict=True)):
            count, both = then - now, np.concatenate([a, b])
            if count == 0:
                qp.equal(_DIFFERENCE, both, np.zeros(3))
                continue
            qp.squares(both[:, None], np.ones((6, 1)), np.tile(goal, 2), weights.position * count / 2)
            speed = weights.velocity / (count * dt**2)
            qp.squares(both.reshape(2, 3).T, _MINUS_PLUS, np.zeros(3), speed)
            qp.below(_BOTH_WAYS, both, np.full(6, count * self.step_m))


def _taken_over(nodes: list[_Node], near: Estimate | None) -> tuple[Array, Array, Flags]:
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
