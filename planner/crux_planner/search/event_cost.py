"""J (6) of a sequence of moves with given durations, by one small convex program over the body's places at its events.

Between lift-offs, touch-downs and the middles of swings the body goes straight and even; at them the grippers in
stance carry it in static balance. What a stance on all four limbs costs hardly depends on where the body is, and is
computed once a stance. Good enough to rank candidates at a few milliseconds each; the exact NLP has the last word.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from crux_planner.model.arrays import Array, Indices
from crux_planner.model.problem import Problem
from crux_planner.model.schedule import Move, Stance
from crux_planner.physics.bounds import LEAST_NORMAL_N
from crux_planner.physics.cost import swing_cost
from crux_planner.physics.limit_surface import polytope_directions
from crux_planner.physics.reach import body_positions
from crux_planner.search.body_path import SPEED_SHARE, within
from crux_planner.search.equilibrium import FORCE_BOUND_N, TWIST_BOUND_NM, StaticEquilibrium
from crux_planner.search.stances import ReachableSet
from crux_planner.solvers.qp import SparseQp
from crux_planner.swing.swing_cache import SwingCache

_CONE_SHARE = 0.97  # of the polytope that touches the cone (2) from outside: on average as large as the cone
_LONG = 8  # knots of a stance beyond which the body first moves, then rests, then moves
_AT_GOAL = 3  # knots, about, for which the body is at the goal rather than where the last stance is easiest
_LEVEL = np.eye(3)
_WRENCH = 6  # QP variables a gripper: s1, s2, m, F = n1 - n2, their mean a, the smaller n


@dataclass(frozen=True)
class Timed:
    """Moves with the knots of the stance before each, and after the last (n + 1,), and of each swing (n,)."""

    moves: list[Move]
    stances: Array
    swings: Array


@dataclass(frozen=True)
class Estimate:
    """J, the body's places at lift-off and touch-down of each move (n, 2, 3), what a knot more of each swing adds."""

    cost: float
    places: Array
    air_costs: list[float]


@dataclass(frozen=True)
class _Node:
    """The body at a knot, within bounds; on swings the grippers of `support` carry it, there for `share` knots of J."""

    knot: int
    low: Array
    high: Array
    support: tuple[int, ...] = ()
    share: float = 0.0


class EventCost:
    """Estimates of one problem; what belongs to one stance or swing is kept."""

    def __init__(
        self, problem: Problem, equilibrium: StaticEquilibrium, reach: ReachableSet, swings: SwingCache
    ) -> None:
        self.problem, self.equilibrium, self.reach, self.swings = problem, equilibrium, reach, swings
        self.count = 0  # of estimates
        self._step_m = SPEED_SHARE * problem.body.max_speed_m_s * problem.dt_s
        self._effort = np.array([2.0, 2.0, 2.0 / problem.patch.k_m**2, 0.5, 2.0, 0.0])
        self._directions, _, _ = polytope_directions(problem.patch.k_m)
        unit = self._directions * np.array([1.0, 1.0, problem.patch.k_m])
        self._load = _CONE_SHARE * equilibrium.margin * np.linalg.norm(unit, axis=1)
        self._rows: dict[int, tuple[Array, Array]] = {}
        self._standing: dict[tuple[Stance, bool], float] = {}
        self._in_air: dict[tuple[int, int, int], float] = {}

    def estimate(self, timed: Timed) -> Estimate | None:
        """J of timed moves; None where reach, balance and speed leave no body path."""
        self.count += 1
        moves = timed.moves
        stances = [self.problem.start_contacts, *(move.after for move in moves)]
        standing = [self._stance_effort(stance, last=False) for stance in stances]
        at_goal = self._stance_effort(stances[-1], last=True)
        if not np.isfinite([*standing, at_goal]).all():
            return None
        nodes = self._nodes(timed, stances)
        if any((node.low > node.high + 1e-9).any() for node in nodes):
            return None
        qp = SparseQp()
        body = [self._place(qp, node.low, node.high) for node in nodes]
        grips = [self._carry(qp, place, node.support, node.share) for node, place in zip(nodes, body, strict=True)]
        self._move_body(qp, [node.knot for node in nodes], body)
        solution = qp.solve()
        if solution is None:
            return None
        flown = [i for i, node in enumerate(nodes) if node.support]  # three a move
        efforts = [sum(float(self._effort @ solution[grip] ** 2) for grip in grips[i]) for i in flown[1::3]]
        places = solution[np.array([[body[i], body[i + 2]] for i in flown[::3]], dtype=int).reshape(-1, 2, 3)]
        in_air = [self._swing_costs(move, int(air)) for move, air in zip(moves, timed.swings, strict=True)]
        longer = [
            self.problem.weights.wrench * effort + later - now - min(before, after)
            for effort, (now, later), before, after in zip(efforts, in_air, standing[:-1], standing[1:], strict=True)
        ]
        total = qp.value(solution) + float(np.dot(standing, timed.stances)) + sum(now for now, _ in in_air)
        total += (at_goal - standing[-1]) * min(_AT_GOAL, int(timed.stances[-1]))
        return Estimate(total, places, longer)

    def _nodes(self, timed: Timed, stances: list[Stance]) -> list[_Node]:
        """The grid in time: start, events, middles of swings, goal; long stances have two knots more."""
        start, k = self.problem.start.position_m, 0
        nodes = [_Node(1, start, start)]  # at rest in knot 0: knot 1 is the same
        for i, stance in enumerate(stances):
            low, high = self._bounds(stance, last=False)
            k += int(timed.stances[i])
            since = nodes[-1].knot
            if k - since > _LONG:
                nodes += [_Node(since + _LONG // 2, low, high), _Node(k - _LONG // 2, low, high)]
            if i == len(timed.moves):
                break
            move, air = timed.moves[i], int(timed.swings[i])
            half = air // 2
            nodes.append(_Node(k, low, high, move.support, half / 2))
            nodes.append(_Node(k + half, *self._on_the_way(move, air, half), move.support, air / 2))
            k += air
            nodes.append(_Node(k, *self._bounds(move.after, last=False), move.support, (air - half) / 2))
        nodes.append(_Node(k, *self._bounds(stances[-1], last=True)))
        return nodes

    def _bounds(self, stance: Stance, *, last: bool) -> tuple[Array, Array]:
        """Of the body's place on all four limbs; the lower above the upper where there is none."""
        nothing = np.ones(len(self.reach.shape.directions))
        low, high = self.reach.of(stance) or (nothing, -nothing)
        if not last:
            return low, high
        near = self.reach.around(self.problem.goal.body.position_m, self.problem.goal.position_slack_m)
        return np.maximum(low, near[0]), np.minimum(high, near[1])

    def _place(self, qp: SparseQp, low: Array, high: Array) -> Indices:
        return within(qp, self.reach.shape, low, np.maximum(low, high), _LEVEL)

    def _on_the_way(self, move: Move, air: int, knots: int) -> tuple[Array, Array]:
        """Bounds of the body's place `knots` after lift-off."""
        reach = self.reach
        on = [limb for limb in range(4) if limb not in move.limbs]
        lows, highs = [*reach.low[on, list(move.support)]], [*reach.high[on, list(move.support)]]
        for limb in move.limbs:
            swing = self.swings.swing(move.before[limb], move.after[limb])
            assert swing is not None
            low, high = body_positions(swing.poses(air)[knots, None, :3], reach.shape)
            lows.append(low[limb])
            highs.append(high[limb])
        return np.max(lows, axis=0), np.min(highs, axis=0)

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
                self._carry(qp, self._place(qp, low, high), stance, 1.0)
                solution = qp.solve()
            self._standing[key] = np.inf if solution is None else qp.value(solution)
        return self._standing[key]

    def _swing_costs(self, move: Move, air: int) -> tuple[float, float]:
        """What J says of a move's swings whatever the body does, in the air `air` knots and one more."""
        now, later = (
            sum(self._swing_cost(move.before[limb], move.after[limb], knots) for limb in move.limbs)
            for knots in (air, air + 1)
        )
        return now, later

    def _swing_cost(self, start: int, end: int, air: int) -> float:
        key = (start, end, air)
        if key not in self._in_air:
            swing = self.swings.swing(start, end)
            assert swing is not None
            self._in_air[key] = swing_cost(self.problem.weights, swing.poses(air)[:-1])
        return self._in_air[key]

    def _carry(self, qp: SparseQp, place: Indices, support: tuple[int, ...], knots: float) -> list[Indices]:
        """Balance at a body place on contacts and its R-term for so many knots; the numbers of the grippers' q."""
        if not support:
            return []
        bound = np.array([FORCE_BOUND_N, FORCE_BOUND_N, TWIST_BOUND_NM, FORCE_BOUND_N, FORCE_BOUND_N, FORCE_BOUND_N])
        grips = []
        for contact in support:
            rows, right = self._limit_rows(contact)
            least = LEAST_NORMAL_N if self.problem.contacts[contact].may_press.all() else 0.0
            grip = qp.variables(np.append(-bound[:4], [0.0, least]), bound)
            grips.append(grip)
            qp.below(rows, grip, right)
            weight = self.problem.weights.wrench * knots
            qp.squares(grip[:, None], np.sqrt(self._effort)[:, None], np.zeros(_WRENCH), weight)
        maps = np.concatenate([self.equilibrium.maps[c] for c in support], axis=1)
        columns = np.concatenate([*[grip[:4] for grip in grips], place])
        moment = np.vstack([np.zeros((3, 3)), -self.equilibrium.weight_moment])
        qp.equal(np.hstack([maps, moment]), columns, self.equilibrium.right_side(np.zeros(3)))
        return grips

    def _limit_rows(self, contact: int) -> tuple[Array, Array]:
        if contact not in self._rows:
            equilibrium, count = self.equilibrium, len(self._load)
            rows = np.zeros((count + 4, _WRENCH))
            rows[:count, :3] = self._directions
            rows[:count, 5] = -self._load * equilibrium.friction[contact]
            rows[count:, 3:] = [[0.5, -1.0, 1.0], [-0.5, -1.0, 1.0], [0.5, 1.0, 0.0], [-0.5, 1.0, 0.0]]
            right = np.concatenate([equilibrium.spine[contact], [0.0, 0.0], equilibrium.press_N[contact]])
            self._rows[contact] = rows, right
        return self._rows[contact]

    def _move_body(self, qp: SparseQp, knots: list[int], body: list[Indices]) -> None:
        """Q-terms of positions and velocities between the nodes, and the body's speed."""
        weights, goal, dt = self.problem.weights, self.problem.goal.body.position_m, self.problem.dt_s
        difference = np.hstack([-np.eye(3), np.eye(3)])
        for (now, a), (then, b) in pairwise(zip(knots, body, strict=True)):
            count, both = then - now, np.concatenate([a, b])
            if count == 0:
                qp.equal(difference, both, np.zeros(3))
                continue
            for place in (a, b):
                qp.squares(place[:, None], np.ones((3, 1)), goal, weights.position * count / 2)
            speed = weights.velocity / (count * dt**2)
            qp.squares(np.column_stack([a, b]), np.tile([-1.0, 1.0], (3, 1)), np.zeros(3), speed)
            qp.below(np.vstack([difference, -difference]), both, np.full(6, count * self._step_m))
