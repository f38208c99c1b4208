"""The cheapest way through sets of grasps and time: a dynamic program over knots, limbs free to move at any knot.

A limb is on a contact, or in the air for at least so many knots; it may land on a contact once its swing there has
lasted as long as the shortest swing that ends there. The state is all four limbs at once, so that limbs in the air
together are seen as such. What is relaxed: a limb may start a swing from anywhere, and the body's places at different
knots need not fit together. On larger walls it is over the sets of holds, each at its cheapest faces: what a limb does
on a hold, which faces it grips and whether it changes them, is free, which leaves a sixteenth of the states. What a way
through a node costs is then the way through its holds with the node's own knot.

Between two knots first every limb that leaves its contact does so, then those land that do; what lies between, a set of
grasps less some of its limbs, is a node of the program too, where no knot may be spent. libcrux_bound.so
lists the states and takes the steps from knot to knot (planner/native/timeline.h).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from crux_contracts import N_LIMBS
from crux_contracts.compiled import doubles, integers

from crux_planner.certificates.bound import native
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
        self._compiled = native.needed()
        many = np.array([len(air) for air in least_air])
        ages = np.array([int(air.max(initial=1)) + 1 for air in least_air])  # told apart in the air
        radix = np.concatenate([np.cumprod((many + 1)[:0:-1])[::-1], [1]]).astype(np.int64)
        every = np.where(_SUBSETS, many, options[:, None]).reshape(-1, N_LIMBS)
        codes, found = np.unique(every @ radix, return_index=True)
        nodes = np.ascontiguousarray(every[found], dtype=np.int64)
        self._own = np.searchsorted(codes, options @ radix)
        aloft = nodes == many
        sizes = np.where(aloft, ages, 1).prod(axis=1)
        self.states = int(sizes.sum())
        self._first = np.empty(len(nodes) + 1, dtype=np.int32)
        self._node = np.repeat(np.arange(len(nodes)), sizes)
        self._lists = [np.empty((2, self.states), dtype=np.int32)]
        self._lists += [np.empty((5, int(sizes[~air].sum())), dtype=np.int32) for air in aloft.T]
        limbs = (native.TimelineLimb * N_LIMBS)(
            *(native.TimelineLimb(0, *map(native.short_integers, own)) for own in self._lists[1:])
        )
        both = map(native.short_integers, self._lists[0])
        self._timeline = native.Timeline(
            self.states, len(nodes), *both, native.short_integers(self._first), change, limbs
        )
        airs = [np.ascontiguousarray(air, dtype=np.int64) for air in least_air]
        given = (
            native.TimelineOptions(len(air), age, integers(air)) for air, age in zip(airs, ages.tolist(), strict=True)
        )
        self._compiled.crux_timeline_states((native.TimelineOptions * N_LIMBS)(*given), integers(nodes), self._timeline)
        self._table, self._by_state = np.zeros(0), np.zeros(0)  # costs by node, given last, and by state

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
            spent, value = self._forward(value, stage(k))
            recent.append(spent)
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
                    spent, before = self._forward(before, stage(k))
                    recent.append(spent)
            for k in reversed(range(first, end)):
                onwards, least = np.empty(self.states), np.empty(self._timeline.nodes)
                floats = value, self._costs(stage(k)), recent[k - first], onwards, least
                self._compiled.crux_timeline_backward(self._timeline, *map(doubles, floats))
                found[k], value = least[self._own], onwards
        return found

    def _costs(self, by_nodes: Array) -> Array:
        """By state; the table given last is kept: most knots share theirs. No knot may be spent where no node is."""
        if by_nodes is not self._table:
            whole = np.full(self._timeline.nodes, np.inf)
            whole[self._own] = by_nodes
            self._table, self._by_state = by_nodes, whole[self._node]
        return self._by_state

    def _forward(self, value: Array, by_nodes: Array) -> tuple[Array, Array]:
        """The least costs of ways to the states, with the knot's own and to the states at the next knot."""
        spent, after = np.empty(self.states), np.empty(self.states)
        floats = value, self._costs(by_nodes), spent, after
        self._compiled.crux_timeline_forward(self._timeline, *map(doubles, floats))
        return spent, after


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
