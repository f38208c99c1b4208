"""A mixed-integer program over the stances of a climb: which sequence of as many moves is cheapest, and what none is.

In each move one limb goes from one contact to another, which binaries choose; the body's places at lift-off and
touch-down are free within the reach of all limbs, whose bounds are linear in the contacts. J (6) is from below: what
stances and supports carry by Lagrange multipliers on balance, where each contact's share is a number
(certificates.bound.carrying), so that one cut holds for all sequences; the body's way by tangents; a swing's own terms
exactly. Cuts are added where a solution asks for them, and each sequence that comes out is judged by the search's own
estimate of J, then left out.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from crux_planner.certificates.bound.carrying import Carriers
from crux_planner.certificates.bound.swings import shared_weight
from crux_planner.model.arrays import Array, Indices
from crux_planner.physics.limit_surface import polytope_directions
from crux_planner.physics.reachable_set import goal_contacts
from crux_planner.search.body_path import SPEED_SHARE
from crux_planner.search.event_cost import EventCost
from crux_planner.solvers.milp import Milp, MilpResult
from crux_planner.solvers.qp import Qp

Swing = tuple[int, int]
"""From one contact to another."""
Sequence = tuple[tuple[int, Swing], ...]
"""The limb of each move and its swing."""

_MISSING = 100.0  # weight of what balance lacks, squared [1/N^2]: multipliers stay finite where there is none
_FORCE_N = 500.0
_AT_GOAL = 2  # knots of the last stance


class Loads:
    """Multipliers on balance for grippers on contacts, and what a knot costs with them from below."""

    def __init__(self, costs: EventCost) -> None:
        self.balance, self.carriers = costs.equilibrium, Carriers.of(costs.problem)
        directions, _ = polytope_directions(1.0)
        self._directions = directions / np.linalg.norm(directions, axis=1)[:, None]
        self.body, self.right = self.balance.weight(np.zeros(3))
        columns = [self.balance.weight(axis)[1] - self.right for axis in np.eye(3)]
        self.follow = np.stack(columns, axis=1)  # (6, 3): of the grippers' mean place

    def multipliers(self, support: list[int], mean_h_m: Array, body_h_m: Array) -> Array:
        """(6,) of the cheapest wrenches of grippers on `support` that carry a body at a place."""
        carriers, many = self.carriers, len(support)
        count = 5 * many + 6
        square = np.append(np.tile(carriers.weight * np.array([2.0, 2, 2, 1, 1]), many), np.full(6, _MISSING))
        equal = np.zeros((6, count))
        equal[:, -6:] = np.eye(6)
        rows = np.zeros((2 * many * len(self._directions), count))
        most = np.zeros(len(rows))
        high = np.full(count, _FORCE_N)
        low = -high
        for i, contact in enumerate(support):
            at = 5 * i
            equal[:, at : at + 4] = carriers.maps[contact]
            equal[:, at + 4] = -carriers.maps[contact][:, 3]
            low[at + 3 : at + 5], high[at + 3 : at + 5] = 0.0, carriers.most_N
            for finger in (0, 1):
                of = slice((2 * i + finger) * len(self._directions), (2 * i + finger + 1) * len(self._directions))
                rows[of, at : at + 3] = self._directions
                rows[of, at + 3 + finger] = -carriers.friction[contact, finger]
                most[of] = np.abs(self._directions) @ carriers.spines[contact]
        right = self.right + self.follow @ mean_h_m - self.body @ body_h_m
        qp = Qp(np.diag(2 * square), np.zeros(count), (equal, right), (rows, None, most), low, high, eps_abs=1e-6)
        return qp.solve().multipliers


@dataclass
class _Move:
    """Variables of a move."""

    swings: list[Indices]  # binaries, per limb
    lift_off: Indices
    touch_down: Indices
    carried: Indices  # what a knot of its swing costs at least
    way: Indices  # what the body's way costs at least


class StanceMip:
    """The program for so many moves, with the swings that each limb may make."""

    def __init__(self, costs: EventCost, loads: Loads, moves: int, swings: list[list[Swing]]) -> None:
        self.costs, self.problem, self.loads, self.swings = costs, costs.problem, loads, swings
        start = self.problem.start_contacts
        self.contacts = [sorted({start[limb], *(c for s in own for c in s)}) for limb, own in enumerate(swings)]
        air = [[costs.swings.intervals(*swing) for swing in own] for own in swings]
        self.air = [np.array(own, dtype=float) for own in air]
        self.least_air = float(min(min(own) for own in air if own))
        self.most_air = float(max(max(own) for own in air if own))
        self.milp = Milp(mip_allow_restart=False)  # which takes twice the time here
        self.cost: list[tuple[Indices, Array]] = []
        self.ends = [set(ends) for ends in goal_contacts(self.problem, costs.reach)]
        self.stances = [self._stance(m, moves) for m in range(moves + 1)]
        self.standing = [self._priced(1.0 if m < moves else _AT_GOAL) for m in range(moves + 1)]
        self.longer = [self._priced(float(shared_weight(self.problem)[0])) for _ in range(moves + 1)]
        self.moves = [self._move() for _ in range(moves)]
        self.end = self.milp.variables(3, -np.inf, np.inf)
        self._link()

    def solve(
        self, *, gap: float = 0.0, nodes: int = 0, time_limit_s: float = np.inf, relaxed: bool = False
    ) -> MilpResult:
        """With the cuts there are; limits are those of Milp.solve."""
        cost = np.zeros(self.milp.size)
        for index, values in self.cost:
            cost[index] += values
        return self.milp.solve(cost, gap=gap, time_limit_s=time_limit_s, nodes=nodes, relaxed=relaxed)

    def fix(self, sequence: Sequence) -> None:
        """Nothing but this sequence."""
        for move, (limb, swing) in zip(self.moves, sequence, strict=True):
            self.milp.row(move.swings[limb][[self.swings[limb].index(swing)]], [1.0], 1.0, 1.0)

    def leave_out(self, sequence: Sequence) -> None:
        """Anything but this sequence."""
        chosen = [m.swings[limb][self.swings[limb].index(s)] for m, (limb, s) in zip(self.moves, sequence, strict=True)]
        self.milp.row(np.array(chosen), np.ones(len(chosen)), -np.inf, len(chosen) - 1.0)

    def keep_apart(self, limb: int, swing: Swing, other: int, contact: int) -> None:
        """No such swing while another limb has that contact."""
        i, k = self.swings[limb].index(swing), self.contacts[other].index(contact)
        for move, held in zip(self.moves, self.stances[:-1], strict=True):
            self.milp.row([move.swings[limb][i], held[other][k]], [1.0, 1.0], -np.inf, 1.0)

    def sequence(self, values: Array) -> Sequence:
        """The moves of a solution."""
        chosen = []
        for move in self.moves:
            limb = int(np.argmax([values[own].max(initial=0.0) for own in move.swings]))
            chosen.append((limb, self.swings[limb][int(np.argmax(values[move.swings[limb]]))]))
        return tuple(chosen)

    def cut(self, values: Array, worth: float) -> list[Array]:
        """Add what a solution violates by more than `worth`; the multipliers of it."""
        new = []
        for m, move in enumerate(self.moves):
            self._cut_way(move, values, worth)
            held = self._held(values, m)
            away = int(np.argmax([values[own].sum() for own in move.swings]))
            after = self._held(values, m + 1)
            middle = (values[move.lift_off] + values[move.touch_down]) / 2
            places = self.loads.balance.centres
            mean = (places[held].mean(axis=0) + places[after].mean(axis=0)) / 2
            support = [c for limb, c in enumerate(held) if limb != away]
            new.append(self.loads.multipliers(support, mean, middle))
            new.append(self.loads.multipliers(held, places[held].mean(axis=0), values[move.lift_off]))
        last = self._held(values, len(self.moves))
        new.append(self.loads.multipliers(last, places[last].mean(axis=0), values[self.end]))
        for multipliers in new:
            self.carry(multipliers, values, worth)
        return new

    def carry(self, multipliers: Array, values: Array | None = None, worth: float = 0.0) -> None:
        """What these multipliers say of every stance and swing, or of those in a solution that it tells more of."""
        least, places = self.loads.carriers.least(multipliers), self.loads.balance.centres
        of_place = places @ (self.loads.follow.T @ multipliers)  # (C,)
        right, slope = float(multipliers @ self.loads.right), multipliers @ self.loads.body
        for m, held in enumerate(self.stances):
            place = self.moves[m].lift_off if m < len(self.moves) else self.end
            shares = [least[own] - of_place[own] / 4 for own in self.contacts]
            self._row(self.standing[m], [*zip(held, shares, strict=True), (place, slope)], right, values, worth)
        for m, move in enumerate(self.moves):
            terms: list[tuple[Indices, Array]] = [(move.lift_off, slope / 2), (move.touch_down, slope / 2)]
            for limb, own in enumerate(self.contacts):
                terms.append((self.stances[m][limb], least[own] - of_place[own] / 8))
                terms.append((self.stances[m + 1][limb], -of_place[own] / 8))
                terms.append((move.swings[limb], -least[[a for a, _ in self.swings[limb]]]))
            self._row(move.carried, terms, right, values, worth)

    def _row(
        self, bounded: Indices, terms: list[tuple[Indices, Array]], right: float, values: Array | None, worth: float
    ) -> None:
        """bounded >= sum of terms - right."""
        columns = np.concatenate([bounded, *(index for index, _ in terms)])
        factors = np.concatenate([[1.0], *(-share for _, share in terms)])
        if values is None or factors @ values[columns] < -right - worth:
            self.milp.row(columns, factors, -right, np.inf)

    def _cut_way(self, move: _Move, values: Array, worth: float) -> None:
        """The tangent of a move's Q-terms where a solution is."""
        weights, goal = self.problem.weights, self.problem.goal.body.position_m
        a, b = values[move.lift_off], values[move.touch_down]
        middle, speed = (a + b) / 2 - goal, weights.velocity / (self.most_air * self.problem.dt_s**2)
        value = weights.position * (((a - goal) ** 2).sum() + self.least_air * (middle**2).sum())
        value += speed * ((b - a) ** 2).sum()
        by_b = weights.position * self.least_air * middle + 2 * speed * (b - a)
        by_a = 2 * weights.position * (a - goal) + weights.position * self.least_air * middle - 2 * speed * (b - a)
        terms = [(move.lift_off, by_a), (move.touch_down, by_b)]
        self._row(move.way, terms, float(by_a @ a + by_b @ b - value), values, worth)

    def _held(self, values: Array, m: int) -> list[int]:
        return [own[int(np.argmax(values[x]))] for own, x in zip(self.contacts, self.stances[m], strict=True)]

    def _priced(self, price: float) -> Indices:
        index = self.milp.variables(1, 0.0, np.inf)
        self.cost.append((index, np.array([price])))
        return index

    def _stance(self, m: int, moves: int) -> list[Indices]:
        """Shares of the contacts that limbs have in stance m."""
        held = []
        for limb, own in enumerate(self.contacts):
            may = np.ones(len(own))
            if m == 0:
                may = np.array([float(c == self.problem.start_contacts[limb]) for c in own])
            elif m == moves:
                may = np.array([float(c in self.ends[limb]) for c in own])
            held.append(self.milp.variables(len(own), 0.0, may))
        holds: dict[int, list[int]] = {}
        for own, x in zip(self.contacts, held, strict=True):
            self.milp.row(x, np.ones(len(x)), 1.0, 1.0)
            for contact, column in zip(own, x, strict=True):
                holds.setdefault(self.problem.contacts[contact].hold, []).append(int(column))
        for columns in holds.values():
            self.milp.row(columns, np.ones(len(columns)), -np.inf, 1.0)
        return held

    def _move(self) -> _Move:
        floor = float(shared_weight(self.problem)[1])
        swings = []
        for own, air in zip(self.swings, self.air, strict=True):
            index = self.milp.variables(len(own), 0.0, 1.0, integer=True)
            prices = [self.costs.swing_price(*swing, int(knots)) for swing, knots in zip(own, air, strict=True)]
            self.cost.append((index, np.array(prices) + (air - self.least_air) * floor))
            swings.append(index)
        lift_off, touch_down = (self.milp.variables(3, -np.inf, np.inf) for _ in range(2))
        carried, way = (self._priced(price) for price in (self.least_air, 1.0))
        return _Move(swings, lift_off, touch_down, carried, way)

    def _link(self) -> None:
        """Moves lead from stance to stance, the body stays in reach and within its speed, and all ends in time."""
        problem, reach = self.problem, self.costs.reach
        step = SPEED_SHARE * problem.body.max_speed_m_s * problem.dt_s
        spare = problem.steps - (len(self.moves) + _AT_GOAL)
        knots = [(index, np.ones(1)) for index in self.longer]
        before, there = None, problem.start.position_m
        for m, move in enumerate(self.moves):
            self._choose(m, move)
            self._in_reach(move.lift_off, self.stances[m])
            self._in_reach(move.touch_down, self.stances[m + 1])
            self._within(before, move.lift_off, there, step, [(self.longer[m], np.array([step]))])
            air = [(own, step * of) for own, of in zip(move.swings, self.air, strict=True)]
            self._within(move.lift_off, move.touch_down, there, 0.0, air)
            knots += [*zip(move.swings, self.air, strict=True)]
            before = move.touch_down
        self._in_reach(self.end, self.stances[-1])
        self._within(before, self.end, there, step, [(self.longer[-1], np.array([step]))])
        low, high = reach.around(problem.goal.body.position_m, problem.goal.position_slack_m)
        for direction, least, most in zip(reach.shape.directions, low, high, strict=True):
            self.milp.row(self.end, direction, least, most)
        columns, each = (np.concatenate(parts) for parts in zip(*knots, strict=True))
        self.milp.row(columns, each, -np.inf, spare)

    def _choose(self, m: int, move: _Move) -> None:
        every = np.concatenate(move.swings)
        self.milp.row(every, np.ones(len(every)), 1.0, 1.0)
        for limb, own in enumerate(self.contacts):
            for i, contact in enumerate(own):
                leaves = move.swings[limb][[a == contact for a, _ in self.swings[limb]]]
                comes = move.swings[limb][[b == contact for _, b in self.swings[limb]]]
                now, then = self.stances[m][limb][i], self.stances[m + 1][limb][i]
                flow = np.concatenate([[1.0, -1.0], -np.ones(len(leaves)), np.ones(len(comes))])
                self.milp.row(np.concatenate([[now, then], leaves, comes]), flow, 0.0, 0.0)
                if len(leaves):
                    self.milp.row(np.append(leaves, now), np.append(np.ones(len(leaves)), -1.0), -np.inf, 0.0)

    def _in_reach(self, place: Indices, stance: list[Indices]) -> None:
        reach = self.costs.reach
        for limb, (own, x) in enumerate(zip(self.contacts, stance, strict=True)):
            columns = np.append(place, x)
            for k, direction in enumerate(reach.shape.directions):
                high, low = reach.high[limb, own, k], reach.low[limb, own, k]
                self.milp.row(columns, np.append(direction, -high), -np.inf, 0.0)
                self.milp.row(columns, np.append(direction, -low), 0.0, np.inf)

    def _within(
        self, a: Indices | None, b: Indices, there: Array, step: float, more: list[tuple[Indices, Array]]
    ) -> None:
        """Along each axis b is off a, or off a place, by no more than a step and what `more` gives."""
        columns, factors = [index for index, _ in more], [-of for _, of in more]
        for axis in range(3):
            for sign in (1.0, -1.0):
                ends = [b[axis]] if a is None else [b[axis], a[axis]]
                most = step + (sign * there[axis] if a is None else 0.0)
                row = np.concatenate([ends, *columns])
                self.milp.row(row, np.concatenate([[sign, -sign][: len(ends)], *factors]), -np.inf, most)
