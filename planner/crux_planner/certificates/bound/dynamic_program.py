"""The dynamic program over the nodes of a wall; on larger walls over the sets of holds, each at its cheapest faces.

There what a limb does on a hold, which faces it grips and whether it changes them, is free: a relaxation that leaves a
sixteenth of the states. What a way through a node costs is then the way through its holds with the node's own knot.
"""

from collections.abc import Callable

import numpy as np

from crux_planner.certificates.bound.grasps import Grasps
from crux_planner.certificates.bound.swings import quickest_to
from crux_planner.certificates.bound.timeline import Forward, Timeline
from crux_planner.model.arrays import Array
from crux_planner.model.problem import Problem

_LARGE = 250_000  # states, about, beyond which faces are merged: it costs a third of the bound

Stage = Callable[[int], Array]


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
        start = nodes.start
        self._start = None if start is None else int(self._of_node[start])
        self._ends = np.unique(self._of_node[nodes.ending(problem)])

    @property
    def states(self) -> int:
        """Size of the program, a knot."""
        return self._timeline.states

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
