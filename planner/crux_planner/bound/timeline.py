"""The cheapest way through sets of grasps and time: a dynamic programme over knots, limbs free to move at any knot.

A limb is on a contact, or in the air for so many knots; it may land on a contact once its swing there has lasted as
long as the shortest swing that ends there. The state is all four limbs at once, so that limbs in the air together are
seen as such. What is relaxed: a limb may start a swing from anywhere, and the body's places at different knots need not
fit together.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from crux_planner.arrays import Array, Indices

Stage = Callable[[int], Array]
"""Cost of a knot by options, shape (C_0 + 1, ..., C_3 + 1), the last option of a limb being the air."""


@dataclass(frozen=True)
class Timeline:
    """Least knots in the air before each contact of each limb (C,), cost of a lift-off or a touch-down."""

    least_air: list[Indices]
    change: float

    def forward(self, start: tuple[int, ...], knots: int, stage: Stage, deadline: float = np.inf) -> list[Array] | None:
        """Least cost of the knots 0..k, for k = 0..knots - 1, by state; the last entry is that of arriving at `knots`.

        None where that takes longer than `deadline` of time.monotonic.
        """
        shape = tuple(len(air) + self._ages(limb) for limb, air in enumerate(self.least_air))
        value = np.full(shape, np.inf)
        value[start] = 0.0
        values, costs = [], _Expanded(self)
        for k in range(knots):
            if time.monotonic() > deadline:
                return None
            value = value + costs.of(stage(k))
            values.append(value)
            value = self._step(value)
        return [*values, value]

    def backward(self, ends: list[Indices], knots: int, stage: Stage) -> list[Array]:
        """Least cost of what comes after knot k, by state at k = 0..knots - 1."""
        shape = tuple(len(air) + self._ages(limb) for limb, air in enumerate(self.least_air))
        value = np.full(shape, np.inf)
        value[np.ix_(*ends)] = 0.0
        values, costs = [], _Expanded(self)
        for k in reversed(range(knots)):
            value = self._step_back(value)
            values.append(value)
            value = value + costs.of(stage(k))
        return values[::-1]

    def by_options(self, value: Array) -> Array:
        """The least over the time in the air, by options."""
        for limb, air in enumerate(self.least_air):
            many = len(air)
            front = np.moveaxis(value, limb, 0)
            value = np.moveaxis(np.concatenate([front[:many], front[many:].min(axis=0, keepdims=True)]), 0, limb)
        return value

    def _ages(self, limb: int) -> int:
        return int(self.least_air[limb].max(initial=1))

    def states(self, by_options: Array) -> Array:
        for limb, air in enumerate(self.least_air):
            index = np.minimum(np.arange(len(air) + self._ages(limb)), len(air))
            by_options = np.take(by_options, index, axis=limb)
        return by_options

    def _step(self, value: Array) -> Array:
        for limb, air in enumerate(self.least_air):
            many = len(air)
            old = np.moveaxis(value, limb, 0)
            new = np.empty_like(old)
            ready = np.minimum.accumulate(old[many:][::-1], axis=0)[::-1]  # in the air for at least so long
            np.minimum(old[:many], ready[air - 1] + self.change, out=new[:many])
            new[many] = old[:many].min(axis=0) + self.change
            new[many + 1 :] = old[many:-1]
            np.minimum(new[-1], old[-1], out=new[-1])
            value = np.moveaxis(new, 0, limb)
        return value

    def _step_back(self, value: Array) -> Array:
        for limb, air in enumerate(self.least_air):
            many = len(air)
            old = np.moveaxis(value, limb, 0)
            new = np.empty_like(old)
            np.minimum(old[:many], old[many] + self.change, out=new[:many])
            new[many:-1] = old[many + 1 :]
            new[-1] = old[-1]
            for age in range(1, self._ages(limb) + 1):
                lands = np.flatnonzero(air <= age)
                if len(lands):
                    np.minimum(new[many + age - 1], old[lands].min(axis=0) + self.change, out=new[many + age - 1])
            value = np.moveaxis(new, 0, limb)
        return value


class _Expanded:
    """Costs by state; the table given last is kept, for most knots share theirs."""

    def __init__(self, timeline: Timeline) -> None:
        self._timeline = timeline
        self._table: Array | None = None
        self._states = np.zeros(0)

    def of(self, table: Array) -> Array:
        if table is not self._table:
            self._table, self._states = table, self._timeline.states(table)
        return self._states
