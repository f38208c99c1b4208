"""(14) for links: whether limbs keep off cuboids that stand as high as they reach down, before anything is solved.

A limb is three capsules, from shoulder to elbow, wrist and palm, where the inverse kinematics has them for a level
body; one without a closed form is capsules from joint to joint. Only cuboids higher than a palm's lowest place can be
in their way: on most walls there are none.
"""

from itertools import pairwise

import numpy as np
from crux_contracts.robot import Limb

from crux_planner.model.arrays import Array
from crux_planner.model.chain import forward
from crux_planner.model.hands import hands_of, rotations
from crux_planner.model.kinematics import inverse
from crux_planner.model.problem import Problem
from crux_planner.model.schedule import Stance
from crux_planner.swing.swing import Swing
from crux_planner.swing.swing_cache import SwingCache

CLEARANCE_M = 0.008  # of links: twice the checker's, and what lies between two samples of a link
_MOMENTS = 9  # at which a move is looked at
_ALONG = np.linspace(0.0, 1.0, 9)  # samples of a link
_OTHER_WAYS = 3  # tried where a swing's best way brings the limb against something


class LinkClearance:
    """Sees the limbs of one problem among its tall cuboids."""

    def __init__(self, problem: Problem, swings: SwingCache) -> None:
        self.problem, self.swings = problem, swings
        self.tall = problem.solids
        self.anything = bool(len(self.tall.yaw_rad))  # stands that high
        self._radii = problem.limb_radii_m

    def stance_clear(self, stance: Stance, start: Array, end: Array) -> bool:
        """All limbs on `stance` while the body goes straight from one place to another."""
        if not self.anything:
            return True
        bodies = start + np.linspace(0.0, 1.0, 3)[:, None] * (end - start)
        return all(self._limb_clear(limb, bodies, self._standing(c, 3)) for limb, c in enumerate(stance))

    def move_clear(
        self, before: Stance, after: Stance, limbs: tuple[int, ...], lift_off: Array, touch_down: Array
    ) -> bool:
        """The limbs in the air and those in stance; where a way is the cause, another of the same swing replaces it."""
        if not self.anything:
            return True
        bodies = lift_off + np.linspace(0.0, 1.0, _MOMENTS)[:, None] * (touch_down - lift_off)
        standing = [limb for limb in range(4) if limb not in limbs]
        if not all(self._limb_clear(limb, bodies, self._standing(before[limb], _MOMENTS)) for limb in standing):
            return False
        return all(self._swing_clear(limb, bodies, before[limb], after[limb]) for limb in limbs)

    def _swing_clear(self, limb: int, bodies: Array, start: int, end: int) -> bool:
        best = self.swings.passed_over(start, end)
        for further in range(_OTHER_WAYS):
            if further:
                self.swings.pass_over(start, end, best + further)
            swing = self.swings.swing(start, end)
            if swing is None:
                break
            if self._limb_clear(limb, bodies, _along(swing)):
                return True
        self.swings.pass_over(start, end, best)
        return False

    def _standing(self, contact: int, moments: int) -> Array:
        return np.tile(hands_of(self.problem.contacts[contact].pose), (moments, 1))

    def _limb_clear(self, limb: int, bodies: Array, grippers: Array) -> bool:
        return bool((self._gap(limb, bodies, grippers) >= CLEARANCE_M).all())

    def _gap(self, limb: int, bodies: Array, grippers: Array) -> Array:
        """Least clearance (T,) of a limb, for body positions (T, 3) and hands (T, 4 or 6)."""
        model = self.problem.limb_masses[limb].limb
        place = grippers[:, :3] - bodies
        out = place[:, :2] - model.shoulder_b_m[:2]  # elbow and wrist are above this line, lengthened at both ends
        out *= model.upper_link_m / np.maximum(np.linalg.norm(out, axis=1, keepdims=True), 1e-9)
        shoulders = bodies[:, :2] + model.shoulder_b_m[:2]
        margin = max(self._radii) + CLEARANCE_M
        if not len(self.tall.near(np.concatenate([shoulders - out, shoulders + out, grippers[:, :2]]), margin).yaw_rad):
            return np.full(len(bodies), np.inf)
        turned = rotations(grippers)
        q, _ = inverse(model, place, turned)
        if not model.closed_form:
            return self._chain_gap(model, q, bodies, grippers)
        azimuth = q[:, 0] + model.mount_rad
        out = np.stack([np.cos(azimuth) * np.cos(q[:, 1]), np.sin(azimuth) * np.cos(q[:, 1]), np.sin(q[:, 1])], axis=1)
        shoulder = bodies + model.shoulder_b_m
        up = turned[:, :, 2]
        wrist = grippers[:, :3] + model.wrist_to_gripper_m * up
        palm = grippers[:, :3] + self.problem.shape.finger_height * up
        corners = [shoulder, shoulder, shoulder + model.upper_link_m * out, wrist, palm]
        near = self.tall.near(np.concatenate(corners), margin)
        if not len(near.yaw_rad):
            return np.full(len(bodies), np.inf)
        gaps = [
            near.distance(a[:, None] + _ALONG[:, None] * (b - a)[:, None]).min(axis=(1, 2)) - radius
            for (a, b), radius in zip(pairwise(corners), self._radii, strict=True)
        ]
        return np.asarray(np.min(gaps, axis=0))

    def _chain_gap(self, model: Limb, q_rad: Array, bodies: Array, grippers: Array) -> Array:
        """The same of a limb without a closed form: straight from joint to joint and to the palm, as thick as its
        thickest link.
        """
        palm = grippers[:, :3] + self.problem.shape.finger_height * rotations(grippers)[:, :, 2]
        joints = bodies + forward(model.at_zero, q_rad).points_m.transpose(0, 2, 1)
        gaps = [
            self.tall.distance(a[:, None] + _ALONG[:, None] * (b - a)[:, None]).min(axis=(1, 2))
            for a, b in pairwise([*joints, palm])
        ]
        return np.asarray(np.min(gaps, axis=0) - max(self._radii))


def _along(swing: Swing) -> Array:
    """(T, 4 or 6) hands spread over a swing."""
    poses = swing.poses(max(swing.intervals, _MOMENTS - 1))
    return np.asarray(hands_of(poses)[np.linspace(0, len(poses) - 1, _MOMENTS).round().astype(int)])
