"""The cheapest way through sets of grasps and time: a dynamic program over knots, limbs free to move at any knot.

A limb is on a contact, or in the air for at least so many knots; it may land on a contact once its swing there has
lasted as long as the shortest swing that ends there. The state is all four limbs at once, so that limbs in the air
together are seen as such. What is relaxed: a limb may start a swing from anywhere, and the body's places at different
knots need not fit together. On larger walls it is over the sets of holds, each at its cheapest faces: what a limb does
on a hold, which faces it grips and whether it changes them, is free, which leaves a sixteenth of the states. What a way
through a node costs is then the way through its holds with the node's own knot.

Between two knots first every limb that leaves its contact does so, then those land that do; what lies between, a set of
grasps less some of its limbs, is a node of the program too, where no knot may be spent.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from crux_contracts import N_LIMBS

from crux_planner.certificates.bound.grasps import Grasps
from crux_planner.certificates.bound.swings import quickest_to
from crux_planner.model.arrays import Array, Indices
from crux_planner.model.problem import Problem

Stage = Callable[[int], Array]
"""Cost (n,) of a knot on each node."""

_KEPT = 40  # knots between those whose states are remembered, for long walls
_SUBSETS = np.array([[(mask >> limb) & 1 for limb in range(N_LIMBS)] for mask in range(2**N_LIMBS)], dtype=bool)
_LARGE = 250_000  # states, about, beyond which faces are merged: it costs a third of the bound


@dataclass(frozen=True)
class _Landings:
    """Contacts of one limb that its swings reach in as many knots."""

    standing: Indices  # states with the limb on one of them, those that come from one set of grasps side by side
    groups: Indices  # first of each such set
    in_air: Indices  # (ages, sets) states from which it may land there


@dataclass(frozen=True)
class _Limb:
    """What one limb does between two knots, as lists of states."""

    standing: Indices  # states with the limb on a contact, in the order of what they become when it releases
    lifted: Indices  # that
    groups: Indices  # first of those that become the same
    lifted_once: Indices  # what they become
    lands_from: Indices  # for each state of `standing`, the one in the air for just long enough to land there
    landings: list[_Landings]


@dataclass(frozen=True)
class Forward:
    """The least cost of the whole way; least costs by state every so many knots, and at each knot since the last."""

    least: float
    knots: int
    kept: list[Array]
    recent: list[Array]


class Timeline:
    """The program over nodes (n, 4) of options, the last option of a limb being the air.

    `least_air` (C,) of each limb are the least knots in the air before each contact, `change` is the cost of a lift-off
    or a touch-down.
    """

    def __init__(self, options: Indices, least_air: list[Indices], change: float) -> None:
        self._change, self._least_air = change, least_air
        many = np.array([len(air) for air in least_air])
        self._ages = np.array([int(air.max(initial=1)) + 1 for air in least_air])  # told apart in the air
        self._radix = np.concatenate([np.cumprod((many + 1)[:0:-1])[::-1], [1]]).astype(np.int64)
        every = np.where(_SUBSETS, many, options[:, None]).reshape(-1, N_LIMBS)
        self._codes, found = np.unique(every @ self._radix, return_index=True)
        nodes = every[found]
        self._own = np.searchsorted(self._codes, options @ self._radix)
        sizes = np.where(nodes == many, self._ages, 1)
        self._first = np.concatenate([[0], np.cumsum(sizes.prod(axis=1))]).astype(np.int64)
        self._stride = np.where(nodes == many, np.cumprod(sizes[:, ::-1], axis=1)[:, ::-1] // sizes, 0)
        self._node = np.repeat(np.arange(len(nodes)), np.diff(self._first))
        self.states = len(self._node)
        every_state = np.arange(self.states)
        stride = self._stride[self._node]
        age = (every_state - self._first[self._node])[:, None] // np.maximum(stride, 1) % self._ages + 1
        age[stride == 0] = 0
        self._younger = every_state - np.where(age > 1, stride, 0).sum(axis=1)
        self._older = every_state + np.where((age > 0) & (age < self._ages), stride, 0).sum(axis=1)
        self._table, self._by_state = np.zeros(0), np.zeros(0)  # costs by node, given last, and by state
        self._limbs = [self._of_limb(limb, nodes[:, limb], age) for limb in range(N_LIMBS)]

    def _of_limb(self, limb: int, option: Indices, age: Indices) -> _Limb:
        least = self._least_air[limb]
        standing = np.flatnonzero(age[:, limb] == 0)
        option = option[self._node[standing]]
        without = self._codes[self._node[standing]] + (len(least) - option) * self._radix[limb]
        node = np.searchsorted(self._codes, without)
        lifted = self._first[node] + (np.maximum(age[standing] - 1, 0) * self._stride[node]).sum(axis=1)
        order = np.argsort(lifted, kind="stable")
        standing, lifted, air, step = standing[order], lifted[order], least[option[order]], self._stride[node, limb]
        step = step[order]
        groups = _groups(lifted)
        landings = []
        for knots in np.unique(air):
            own = np.flatnonzero(air == knots)
            first = _groups(lifted[own])
            one = own[first]
            ages = np.arange(knots, self._ages[limb])[:, None]
            landings.append(_Landings(standing[own], first, lifted[one] + ages * step[one]))
        return _Limb(standing, lifted, groups, lifted[groups], lifted + air * step, landings)

    def forward(self, start: int, ends: Indices, knots: int, stage: Stage) -> Forward:
        """The way from node `start` to one of the nodes `ends`, which is reached at knot `knots`."""
        value = np.full(self.states, np.inf)
        value[self._first[self._own[start]]] = 0.0
        kept: list[Array] = []
        recent: list[Array] = []
        for k in range(knots):
            if k % _KEPT == 0:
                kept.append(value)
                recent = []
            value = value + self._costs(stage(k))
            recent.append(value)
            value = self._step(value)
        least = float(value[self._first[self._own[ends]]].min(initial=np.inf))
        return Forward(least, knots, kept, recent)

    def through(self, way: Forward, ends: Indices, stage: Stage) -> Array:
        """The least cost (knots, n) of a whole way that is on a node at a knot."""
        value = np.full(self.states, np.inf)
        value[self._first[self._own[ends]]] = 0.0
        found, recent = np.empty((way.knots, len(self._own))), way.recent
        for part in reversed(range(len(way.kept))):
            first, end = part * _KEPT, min((part + 1) * _KEPT, way.knots)
            if end < way.knots:
                recent, before = [], way.kept[part]
                for k in range(first, end):
                    before = before + self._costs(stage(k))
                    recent.append(before)
                    before = self._step(before)
            for k in reversed(range(first, end)):
                value = self._step_back(value)
                found[k] = np.minimum.reduceat(recent[k - first] + value, self._first[:-1])[self._own]
                value = value + self._costs(stage(k))
        return found

    def _costs(self, by_nodes: Array) -> Array:
        """By state; the table given last is kept: most knots share theirs. No knot may be spent where no node is."""
        if by_nodes is not self._table:
            whole = np.full(len(self._codes), np.inf)
            whole[self._own] = by_nodes
            self._table, self._by_state = by_nodes, whole[self._node]
        return self._by_state

    def _step(self, value: Array) -> Array:
        new: Array = value[self._younger]
        for limb in self._limbs:
            if len(limb.groups):
                left = np.minimum.reduceat(new[limb.standing], limb.groups) + self._change
                new[limb.lifted_once] = np.minimum(new[limb.lifted_once], left)
        for limb in self._limbs:
            new[limb.standing] = np.minimum(new[limb.standing], new[limb.lands_from] + self._change)
        return new

    def _step_back(self, value: Array) -> Array:
        value = value.copy()
        for limb in self._limbs:
            for landing in limb.landings:
                landed = np.minimum.reduceat(value[landing.standing], landing.groups) + self._change
                for states in landing.in_air:
                    value[states] = np.minimum(value[states], landed)
        for limb in self._limbs:
            value[limb.standing] = np.minimum(value[limb.standing], value[limb.lifted] + self._change)
        return np.asarray(value[self._older])


def _groups(values: Indices) -> Indices:
    """First index of each run of equal values."""
    return np.flatnonzero(np.diff(values, prepend=-1))


class DynamicProgram:
    """Ways from the start's grasps to the goal's, `stage` gives the cost (n,) of a knot on each node."""

    def __init__(self, problem: Problem, nodes: Grasps) -> None:
        self._knots = problem.steps
        merge = float((5.0**nodes.in_air).sum()) > _LARGE
        columns, least_air = [], []
        for limb, groups in enumerate(nodes.groups):
            least = quickest_to(problem, groups)
            options = nodes.options[:, limb]
            if merge:
                holds = np.array([problem.contacts[group[0]].hold for group in groups])
                _, first, of_group = np.unique(holds, return_index=True, return_inverse=True)
                order = np.argsort(first, kind="stable")
                rank = np.argsort(order, kind="stable")[of_group]  # the start's stays the first
                merged = np.full(len(first), np.iinfo(least.dtype).max)
                np.minimum.at(merged, rank, least)
                least, options = merged, np.append(rank, len(first))[options]
            columns.append(options)
            least_air.append(least)
        merged_options, self._of_node = np.unique(np.column_stack(columns), axis=0, return_inverse=True)
        self._of_node = self._of_node.reshape(-1)
        self._order = np.argsort(self._of_node, kind="stable")
        self._first = np.flatnonzero(np.diff(self._of_node[self._order], prepend=-1))
        self._timeline = Timeline(merged_options, least_air, problem.weights.switching)
        self.states = self._timeline.states  # a knot
        start = nodes.start
        self._start = None if start is None else int(self._of_node[start])
        self._ends = np.unique(self._of_node[nodes.ending(problem)])

    def forward(self, stage: Stage) -> Forward | None:
        """The cheapest way; None where the start or every end is left out."""
        if self._start is None or not len(self._ends):
            return None
        return self._timeline.forward(self._start, self._ends, self._knots, self._merged(stage))

    def through(self, way: Forward, stage: Stage) -> Array:
        """The least cost (knots, n) of a whole way that is on a node at a knot."""
        merged = self._merged(stage)
        whole = self._timeline.through(way, self._ends, merged)
        found = np.empty((self._knots, len(self._of_node)))
        for knot in range(self._knots):
            rest = whole[knot] - np.where(np.isfinite(merged(knot)), merged(knot), 0.0)
            found[knot] = rest[self._of_node] + stage(knot)
        return found

    def _merged(self, stage: Stage) -> Stage:
        tables: dict[int, tuple[Array, Array]] = {}  # by the table given, which most knots share

        def of(knot: int) -> Array:
            table = stage(knot)
            if id(table) not in tables:
                tables[id(table)] = table, np.minimum.reduceat(table[self._order], self._first)
            return tables[id(table)][1]

        return of
