"""Where the body may be while limbs hold their contacts, and on which contacts a climb may end."""

from __future__ import annotations

import numpy as np

from crux_planner.model.arrays import Array, Flags, Indices
from crux_planner.model.problem import Problem
from crux_planner.model.schedule import Stance
from crux_planner.physics.reach import between, body_positions

REACH_RESERVE_M = 0.003  # kept of the acceptance boxes for the NLP, whose body may tilt


class ReachableSet:
    """Body positions (level, unturned body) from which limbs have their contacts in the acceptance box, where the body
    turns and tilts from the start's orientation to the goal's.
    """

    def __init__(self, problem: Problem) -> None:
        self.problem, self.shape = problem, between(problem, REACH_RESERVE_M)
        self._spread: Array = np.abs(problem.boxes.directions).sum(axis=1)  # of a cube of half edge 1
        self.usable = self._under_all_headings()
        centres = np.stack([c.centre_h_m for c in problem.contacts])
        bounds = body_positions(centres[:, None], self.shape)
        self.low, self.high = (np.ascontiguousarray(b.swapaxes(0, 1)) for b in bounds)  # (4, C, m)
        self.low[..., 2] = np.maximum(self.low[..., 2], problem.body.height_m[0])
        self.high[..., 2] = np.minimum(self.high[..., 2], problem.body.height_m[1])

        low = np.maximum(self.low[:, :, None], self.low[:, None])
        high = np.minimum(self.high[:, :, None], self.high[:, None])
        self._meet: Flags = np.all(low <= high, axis=3)  # (4, C, C)

    def _under_all_headings(self) -> list[list[int]]:
        """By limb, the contacts that its gripper may turn to under the heading of the start and of the goal alike."""
        problem, (low, high) = self.problem, self.problem.gripper_yaw_rad
        yaw_rad = float(problem.goal.body.rpy_rad[2])
        low, high = low + max(yaw_rad, 0.0), high + min(yaw_rad, 0.0)
        may = [low <= c.yaw_rad <= high or i in problem.start_contacts for i, c in enumerate(problem.contacts)]
        return [[c for c in own if may[c]] for own in problem.limb_contacts]

    def neighbours(self, limb: int, contact: int) -> Indices:
        """Contacts that a limb has in reach from some body position from which it also has `contact`."""
        return np.flatnonzero(self._meet[limb, contact])

    def of(self, stance: Stance) -> tuple[Array, Array] | None:
        """Bounds (m,) of the body position for all four limbs, None where they leave nothing."""
        index = (np.arange(4), list(stance))
        low, high = self.low[index].max(axis=0), self.high[index].min(axis=0)
        if (low > high + 1e-9).any():
            return None
        return low, high

    def may_end(self, _stance: Stance) -> bool:
        """Whether a climb may end on a stance all of whose contacts are in reach of the goal, limb by limb."""
        return True

    def around(self, position: Array, half_m: float) -> tuple[Array, Array]:
        """Bounds (m,) of a cube around a position."""
        along = self.shape.directions @ position
        return along - half_m * self._spread, along + half_m * self._spread


def goal_contacts(problem: Problem, reach: ReachableSet, tolerance_m: float | None = None) -> list[list[int]]:
    """Per limb, the contacts it may end on: the goal's grasp where named, and in reach of the goal pose.

    That is a cube of half edge `tolerance_m`, usually the goal's `position_slack_m`.
    """
    low, high = reach.around(problem.goal.body.position_m, tolerance_m or problem.goal.position_slack_m)
    result = []
    for limb, usable in enumerate(reach.usable):
        ends = [c for c in usable if problem.may_end(limb, problem.contacts[c])]
        near = [c for c in ends if (reach.low[limb, c] <= high).all() and (reach.high[limb, c] >= low).all()]
        result.append(near)
    return result
