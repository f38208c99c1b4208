"""Which stances a body at the goal may hold, by the outer maps of the limbs: joint limits as they are, links off the
trunk.

The goal's tolerances are covered by boxes of poses. A stance is ruled out where in every box one of its limbs cannot
have its gripper anywhere on the grip.
"""

import itertools
from collections.abc import Collection

import numpy as np
from crux_contracts import N_LIMBS
from crux_contracts.robot import Robot

from crux_planner.certificates.infeasibility import goal_boxes
from crux_planner.certificates.infeasibility.connection import CLEARANCE_M, Grips
from crux_planner.certificates.infeasibility.poses import TOLERANCE_M, TOLERANCE_RAD, GoalPoses
from crux_planner.model.arrays import Array, Flags
from crux_planner.model.contacts import Grip
from crux_planner.model.problem import Problem
from crux_planner.reach.arm import reaches_of
from crux_planner.reach.body_grid import BodyGrid
from crux_planner.solvers import clock

_PLACES, _ANGLES = (2, 4, 4), (4, 3, 3)  # boxes along z, x and y; along yaw, roll and pitch
_FEW_LOOKS, _LOOKS = 5_000, 4_000_000  # at two limbs at once, and at those in each other's way or all
_BENT = 1.1  # factor of angles of one rotation as roll, pitch and yaw, for the tilts that a goal may have


class GoalMap:
    """Of one problem; limbs' masks over the boxes, each made once."""

    def __init__(self, problem: Problem, robot: Robot, grips: list[Grip]) -> None:
        goal = problem.goal
        off_m, off_rad = goal.tolerance_m + TOLERANCE_M, _BENT * goal.tolerance_rad + TOLERANCE_RAD
        (x, y, z), (roll, pitch, yaw) = goal.body.position_m, goal.body.rpy_rad
        angles = [_middles(at, off_rad, n) for at, n in zip((yaw, roll, pitch), _ANGLES, strict=True)]
        self._grid = BodyGrid(*angles, *(_middles(at, off_m, n) for at, n in zip((z, x, y), _PLACES, strict=True)))
        self._reaches, self._exact, self._grips = reaches_of(robot), reaches_of(robot, 0.0, 0.0), grips
        self._masks: dict[tuple[int, int], Flags] = {}

    def possible(self, stances: list[Grips]) -> list[Grips]:
        """Those that are not ruled out."""
        everything = np.array(stances, dtype=int).reshape(-1, N_LIMBS)
        kept = np.arange(len(everything))
        boxes = np.full((len(everything), 1), 0xFF, dtype=np.uint8)  # a bit for each that is left
        for limb in range(N_LIMBS):
            if not len(kept):
                break
            numbers, at = np.unique(everything[kept, limb], return_inverse=True)
            masks = np.array([np.packbits(self._may(limb, number)) for number in numbers.tolist()])
            boxes = boxes & masks[at]
            some = boxes.any(axis=1)
            kept, boxes = kept[some], boxes[some]
        return [stances[i] for i in kept]

    def possible_closely(self, stances: list[Grips], poses: GoalPoses) -> list[Grips]:
        """The same with finer boxes, made of the goal's `poses` for each limb and grip alone."""
        for limb, number in sorted({pair for stance in stances for pair in enumerate(stance)}):
            if goal_boxes.cannot(poses, self._exact, [(limb, self._grips[number])]):
                self._masks[limb, number] = np.zeros(self._grid.shape, dtype=bool)
        return self.possible(stances)

    def at_once(self, stances: list[Grips], poses: GoalPoses, deadline: float = np.inf) -> bool:
        """Whether a body may hold one of the stances with the links of limbs off each other; True where the time does
        not do to say.

        A few looks show most pairs of limbs to be out of each other's way; those of the others are asked about first.
        """
        every = np.array(stances, dtype=int).reshape(-1, N_LIMBS)
        held = [(limb, number) for limb in range(N_LIMBS) for number in np.unique(every[:, limb]).tolist()]
        on = np.array([every[:, limb] == number for limb, number in held], dtype=float)  # (grips, stances)
        together = on @ on.T > 0.0

        def cannot(limbs: Collection[int], looks: int) -> bool | None:
            own = [i for i, (limb, _) in enumerate(held) if limb in limbs]
            grips = [(limb, self._grips[number]) for limb, number in (held[i] for i in own)]
            seconds = deadline - clock.now()
            return goal_boxes.cannot(poses, self._exact, grips, together[np.ix_(own, own)], CLEARANCE_M, looks, seconds)

        told = {pair: cannot(pair, _FEW_LOOKS) for pair in itertools.combinations(range(N_LIMBS), 2)}
        near = {limb for pair, none in told.items() if none is None for limb in pair}
        if True in told.values() or (0 < len(near) < N_LIMBS and cannot(near, _LOOKS)):
            return False
        return not cannot(range(N_LIMBS), _LOOKS)

    def stuck(self, stances: list[Grips]) -> list[int]:
        """The limbs that none of the stances' grips is in reach of."""
        return [limb for limb in range(N_LIMBS) if not any(self._may(limb, each[limb]).any() for each in stances)]

    def _may(self, limb: int, number: int) -> Flags:
        """Boxes in which a limb may hold, with its fingers either way round."""
        if (limb, number) not in self._masks:
            grip = self._grips[number]
            contact, (low, high) = grip.contact, grip.height_m
            slack = np.append(np.abs(contact.tangent[:2]) * grip.aside_m, [(high - low) / 2, 0.0])
            ruled_out = np.ones(self._grid.shape, dtype=bool)
            for yaw in (contact.yaw_rad, contact.yaw_rad + np.pi):
                at = np.array([*contact.centre_h_m[:2], (low + high) / 2, yaw])
                ruled_out &= self._grid.ruled_out(self._reaches[limb], at, slack)
            self._masks[limb, number] = ~ruled_out
        return self._masks[limb, number]


def _middles(at: float, off: float, count: int) -> Array:
    """Of so many intervals that cover what is up to `off` from a number."""
    return at + off * (2 * np.arange(count) + 1 - count) / count
