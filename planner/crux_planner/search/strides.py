"""How long a foot is in the air for its way and turn, and the gaits a search begins with: every order of the feet."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np

from crux_planner.errors import InfeasibleError
from crux_planner.model.gait import LEAST_AIR, Step, longest_step, most_turn
from crux_planner.model.slots import FIRST_LIFT, LAST_LAND, LEAST_GAP, Slot, Slots
from crux_planner.model.walk_problem import FINAL_FOOT_M, WalkProblem

LONGEST_STRIDE = 0.9  # of the workspace's length, in the gaits that are tried first
_MORE_GAP = 2  # knots between two steps beyond the least, where there is time
_MORE_LEAD = 4  # knots before the first step beyond the least, where there is time


class Strides:
    """What steps of one problem may be."""

    def __init__(self, problem: WalkProblem) -> None:
        self.problem = problem
        airs = range(problem.steps)
        steps = [[Step(limb, 0, max(air, LEAST_AIR)) for air in airs] for limb in range(4)]
        self._longest = np.array([[longest_step(problem, step) for step in own] for own in steps])
        self._turn = np.array([[most_turn(problem, step) for step in own] for own in steps])
        swings = np.maximum(np.abs(problem.goal_feet_w_m - problem.start_feet_w_m) - FINAL_FOOT_M, 0.0)
        self._way = np.linalg.norm(swings, axis=1)
        self._usual = np.linalg.norm(problem.goal_feet_w_m - problem.start_feet_w_m, axis=1) - FINAL_FOOT_M / 2
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
        ranges, longest = problem.foothold_ranges_w_m, LONGEST_STRIDE * 2 * problem.boxes.half_m[0]
        detours = ranges.fewest - 1 + np.ceil(ranges.passing_m / longest)
        return max(1, int(np.ceil(float(strides.max()) - 1e-9)), int(detours.max()))

    def starts(self, rounds: int) -> list[Slots]:
        """Every order of the feet, each stepping `rounds` times. Raises InfeasibleError where time is too short."""
        if rounds == 0:
            return [Slots(((), (), (), ()))]
        found = [self._laid_out(order * rounds) for order in itertools.permutations(range(4))]
        if found[0] is None:
            n, least = self.problem.steps, self._least_knots([0, 1, 2, 3] * rounds)
            text = f"horizon.steps: {4 * rounds} steps of the feet need at least {least} knots, there are {n}"
            raise InfeasibleError("horizon", text)
        return [slots for slots in found if slots is not None]

    def in_order(self, order: list[int]) -> list[Slots]:
        """The steps in an order, evenly in time; none where time is too short."""
        slots = self._laid_out(order)
        return [] if slots is None else [slots]

    def _laid_out(self, order: Sequence[int]) -> Slots | None:
        """Steps one after the other, as short as they may be, with some space between them."""
        airs = [self._least_air(limb, max(list(order).count(limb), 1)) for limb in range(4)]
        spare = self.problem.steps - self._least_knots(order)
        if spare < 0:
            return None
        gap = min(_MORE_GAP, spare // (len(order) + 1))
        lead = min(_MORE_LEAD, (spare - gap * (len(order) - 1)) // 2)
        slots: list[list[Slot]] = [[], [], [], []]
        k = FIRST_LIFT + lead
        for limb in order:
            slots[limb].append((k, k + airs[limb]))
            k += airs[limb] + LEAST_GAP + gap
        return Slots(tuple(tuple(each) for each in slots))

    def _least_knots(self, order: Sequence[int]) -> int:
        airs = [self._least_air(limb, list(order).count(limb)) for limb in order]
        return FIRST_LIFT + LAST_LAND + sum(airs) + (len(order) - 1) * LEAST_GAP

    def _least_air(self, limb: int, steps: int) -> int:
        """Knots in the air that the longest of equal steps to the goal needs."""
        ranges = self.problem.foothold_ranges_w_m
        passing = max(steps - int(ranges.fewest[limb]) + 1, 1)  # steps that lead on past an obstacle
        far = steps * self._longest[limb] >= self._usual[limb]
        far &= passing * self._longest[limb] >= ranges.passing_m[limb]
        enough = far & (steps * self._turn[limb] >= self._goal_turn)
        return max(LEAST_AIR, int(np.argmax(enough))) if enough.any() else len(enough)
