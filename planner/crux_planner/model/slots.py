"""When the feet are in the air: the contact binaries of a walk, written as each limb's slots, and what is next to them.

A limb's slots are the knots (lift, land) of its steps; alpha is 0 from lift to land - 1. Neighbours change a few of
these binaries: a step earlier or later, longer or shorter, two steps or two limbs exchanged, one step more or less.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import combinations, pairwise

import numpy as np

from crux_planner.model.arrays import Flags
from crux_planner.model.gait import LEAST_AIR, Gait, Step
from crux_planner.model.walk_problem import WalkProblem

FIRST_LIFT, LAST_LAND = 2, 2  # knots with all feet down at the start, and before the end
LEAST_GAP = 1  # knots with all feet down between two steps, in which the load moves
_SHIFTS = (-2, -1, 1, 2)

Slot = tuple[int, int]
Change = tuple[str, int, int, int]
"""What was changed, where, and by how many knots."""


@dataclass(frozen=True)
class Slots:
    """(lift, land) of each limb's steps."""

    of_limb: tuple[tuple[Slot, ...], ...]

    @classmethod
    def of(cls, gait: Gait) -> Slots:
        """Those of a gait."""
        return cls(tuple(tuple((s.lift, s.land) for s in gait.steps if s.limb == limb) for limb in range(4)))

    def gait(self, knots: int) -> Gait:
        """The gait: every limb goes its whole way in equal shares."""
        steps = sorted((lift, limb, land) for limb, slots in enumerate(self.of_limb) for lift, land in slots)
        done, shares = [0] * 4, []
        for _, limb, _ in steps:
            done[limb] += 1
            shares.append(done[limb] / len(self.of_limb[limb]))
        return Gait(tuple(Step(limb, lift, land) for lift, limb, land in steps), np.array(shares), knots)

    def alpha(self, knots: int) -> Flags:
        """(knots, 4): which foot stands."""
        on = np.ones((knots, 4), dtype=bool)
        for limb, slots in enumerate(self.of_limb):
            for lift, land in slots:
                on[lift:land, limb] = False
        return on

    def possible(self, problem: WalkProblem, at_once: int = 1) -> bool:
        """Steps of some knots, and no more than `at_once` feet in the air from lift to land."""
        busy = np.zeros(problem.steps + 1, dtype=int)
        for slots in self.of_limb:
            before = -1
            for lift, land in slots:
                if lift < max(FIRST_LIFT, before + LEAST_GAP) or land - lift < LEAST_AIR:
                    return False
                if land > problem.steps - LAST_LAND:
                    return False
                busy[lift : land + LEAST_GAP] += 1
                before = land
        return bool(busy.max() <= at_once)

    def neighbours(self) -> Iterator[tuple[Change, Slots]]:
        """What is one change away, with the name of the change."""
        for lift, land, limb, i in self._each():
            for shift in _SHIFTS:
                yield ("move", limb, i, shift), self._changed(limb, i, lift + shift, land + shift)
        for lift, land, limb, i in self._each():
            for shift in (1, -1):
                yield ("lift", limb, i, shift), self._changed(limb, i, lift + shift, land)
                yield ("land", limb, i, -shift), self._changed(limb, i, lift, land - shift)
        yield from self._exchanged()
        yield from self._squeezed()
        for limb, slots in enumerate(self.of_limb):
            for i in range(len(slots) if len(slots) > 1 else 0):
                yield ("less", limb, i, 0), self._with(limb, slots[:i] + slots[i + 1 :])

    def _with(self, limb: int, slots: tuple[Slot, ...]) -> Slots:
        return Slots((*self.of_limb[:limb], slots, *self.of_limb[limb + 1 :]))

    def _changed(self, limb: int, i: int, lift: int, land: int) -> Slots:
        slots = self.of_limb[limb]
        return self._with(limb, (*slots[:i], (lift, land), *slots[i + 1 :]))

    def _each(self) -> list[tuple[int, int, int, int]]:
        """(lift, land, limb, number) in order of time."""
        steps = [(*slot, limb, i) for limb, slots in enumerate(self.of_limb) for i, slot in enumerate(slots)]
        return sorted(steps)

    def _exchanged(self) -> Iterator[tuple[Change, Slots]]:
        steps = self._each()
        for n, ((lift, land, limb, i), (lift2, land2, limb2, j)) in enumerate(pairwise(steps)):
            if limb != limb2:
                yield ("steps", n, 0, 0), self._changed(limb, i, lift2, land2)._changed(limb2, j, lift, land)
        for limb, limb2 in combinations(range(4), 2):
            slots = list(self.of_limb)
            slots[limb], slots[limb2] = slots[limb2], slots[limb]
            yield ("limbs", limb, limb2, 0), Slots(tuple(slots))

    def _squeezed(self) -> Iterator[tuple[Change, Slots]]:
        """All steps from some one on a knot earlier or later; all steps a knot shorter, one after the other."""
        steps = self._each()
        for first in range(len(steps)):
            for shift in (-1, 1):
                slots = self
                for lift, land, limb, i in steps[first:]:
                    slots = slots._changed(limb, i, lift + shift, land + shift)
                yield ("rest", first, 0, shift), slots
        sooner, later = self, self
        for n, (lift, land, limb, i) in enumerate(steps):
            after = len(steps) - 1 - n
            sooner = sooner._changed(limb, i, lift - n, land - n - 1)
            later = later._changed(limb, i, lift + after + 1, land + after)
        yield ("shorter", 0, 0, -1), sooner
        yield ("shorter", 0, 0, 1), later
