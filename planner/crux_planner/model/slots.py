"""When the feet are in the air: the contact binaries of a walk, written as each limb's slots, and what is next to them;
how long a foot is in the air for its way and turn, and the gaits a search begins with: every order of the feet.

A limb's slots are the knots (lift, land) of its steps; alpha is 0 from lift to land - 1. Neighbours change a few of
these binaries: a step earlier or later, longer or shorter, two steps or two limbs exchanged, one step more or less.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from itertools import combinations, pairwise

import numpy as np

from crux_planner.errors import InfeasibleError
from crux_planner.model.arrays import Flags
from crux_planner.model.gait import LEAST_AIR, Gait, Step, longest_step, most_turn
from crux_planner.model.walk_problem import FINAL_FOOT_M, WalkProblem

FIRST_LIFT, LAST_LAND = 2, 2  # knots with all feet down at the start, and before the end
LEAST_GAP = 1  # knots with all feet down between two steps, in which the load moves
_SHIFTS = (-2, -1, 1, 2)

Slot = tuple[int, int]
Change = tuple[str, int, int, int]
"""What was changed, where, and by how many knots."""
LONGEST_STRIDE = 0.9  # of the workspace's length, in the gaits that are tried first
_MORE_GAP = 2  # knots between two steps beyond the least, where there is time
_MORE_LEAD = 4  # knots before the first step beyond the least, where there is time


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


class Strides:
    """What steps of one problem may be."""

    def __init__(self, problem: WalkProblem) -> None:
        self.problem = problem
        airs = range(problem.steps)
        steps = [[Step(limb, 0, max(air, LEAST_AIR)) for air in airs] for limb in range(4)]
        self._longest = np.array([[longest_step(problem, step) for step in own] for own in steps])
        self._turn = np.array([[most_turn(problem, step) for step in own] for own in steps])
        swings = np.maximum(np.abs(problem.goal_feet_h_m - problem.start_feet_h_m) - FINAL_FOOT_M, 0.0)
        self._way = np.linalg.norm(swings, axis=1)
        self._usual = np.linalg.norm(problem.goal_feet_h_m - problem.start_feet_h_m, axis=1) - FINAL_FOOT_M / 2
        self._goal_turn = abs(float(problem.goal.body.rpy_rad[2]))

    def long_enough(self, slots: Slots) -> bool:
        """Whether every foot can go its way, and turn, in its steps."""
        for limb, own in enumerate(slots.of_limb):
            airs = np.array([land - lift for lift, land in own], dtype=int)
            if self._longest[limb, airs].sum() < self._way[limb]:
                return False
            if (self._turn[limb, airs] * len(own) < self._goal_turn).any():
                return False
        return True

    def fewest_rounds(self) -> int:
        """How often every foot must step for the straight way; 0 at the goal."""
        problem = self.problem
        straight = np.abs(problem.goal.body.position_m - problem.start.position_m)[:2]
        slack = problem.goal.position_slack_m
        if np.linalg.norm(straight) <= slack and self._goal_turn <= problem.goal.rotation_slack_rad:
            return 0
        strides = straight / (LONGEST_STRIDE * 2 * problem.boxes.half_m[:2])
        ranges, longest = problem.foothold_ranges_h_m, LONGEST_STRIDE * 2 * problem.boxes.half_m[0]
        detours = ranges.fewest - 1 + np.ceil(ranges.passing_m / longest)
        return max(1, int(np.ceil(float(strides.max()) - 1e-9)), int(detours.max()))

    def starts(self, rounds: int) -> list[Slots]:
        """Every order of the feet, each stepping `rounds` times. Raises InfeasibleError where time is too short."""
        if rounds == 0:
            return [Slots(((), (), (), ()))]
        found = [slots for order in itertools.permutations(range(4)) for slots in self.in_order(order * rounds)]
        if not found:
            n, least = self.problem.steps, self._least_knots([0, 1, 2, 3] * rounds)
            text = f"horizon.steps: {4 * rounds} steps of the feet need at least {least} knots, there are {n}"
            raise InfeasibleError("horizon", text)
        return found

    def in_order(self, order: Sequence[int]) -> list[Slots]:
        """Steps one after the other, as short as they may be, with some space between them; none where time is too
        short.
        """
        airs = [self._least_air(limb, max(list(order).count(limb), 1)) for limb in range(4)]
        spare = self.problem.steps - self._least_knots(order)
        if spare < 0:
            return []
        gap = min(_MORE_GAP, spare // (len(order) + 1))
        lead = min(_MORE_LEAD, (spare - gap * (len(order) - 1)) // 2)
        slots: list[list[Slot]] = [[], [], [], []]
        k = FIRST_LIFT + lead
        for limb in order:
            slots[limb].append((k, k + airs[limb]))
            k += airs[limb] + LEAST_GAP + gap
        return [Slots(tuple(tuple(each) for each in slots))]

    def _least_knots(self, order: Sequence[int]) -> int:
        airs = [self._least_air(limb, list(order).count(limb)) for limb in order]
        return FIRST_LIFT + LAST_LAND + sum(airs) + (len(order) - 1) * LEAST_GAP

    def _least_air(self, limb: int, steps: int) -> int:
        """Knots in the air that the longest of equal steps to the goal needs."""
        ranges = self.problem.foothold_ranges_h_m
        passing = max(steps - int(ranges.fewest[limb]) + 1, 1)  # steps that lead on past an obstacle
        far = steps * self._longest[limb] >= self._usual[limb]
        far &= passing * self._longest[limb] >= ranges.passing_m[limb]
        enough = far & (steps * self._turn[limb] >= self._goal_turn)
        return max(LEAST_AIR, int(np.argmax(enough))) if enough.any() else len(enough)
