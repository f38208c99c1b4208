"""Pairs of faces of a hold as pads meet them: upright, or leaning in to the hold's middle."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from crux_contracts.robot import Robot
from crux_contracts.scenario import Grip, Hold

from crux_planner.model.contacts import FACE_NAMES

PASSING_CLEARANCE_M = 0.01  # of palms and fingers among grippers and beside tall cuboids: twice the tracking error


def faces_of(pair: int) -> list[int]:
    """Numbers of the plus and the minus face of a pair."""
    return [2 * pair, 2 * pair + 1]


def usable_friction(hold: Hold, face: int) -> float:
    """Friction of a face for plans: so much less as less of a pad bears, which is inside (2) with so much less k."""
    return hold.friction[face] * hold.pad_share[face]


def smooth_faces(hold: Hold, pair: int) -> list[str]:
    """The faces of a pair that have no friction, so that it cannot be gripped.

    Spines alone do not make a grasp: the runtime squeezes until friction bears the load, without them.
    """
    return [FACE_NAMES[face] for face in faces_of(pair) if hold.friction[face] <= 0.0]


@dataclass(frozen=True)
class Faces:
    """A pair of faces where the pads of a gripper meet them, their middles `height_m` over the wall."""

    height_m: float
    half_m: float  # of the way between the pads
    lean_rad: float  # of the one that leans more
    width_m: float  # of the narrower face, where the patch ends
    off_m: float  # of the gripper's middle from the hold's, along the axis
    aside_m: float  # and across it
    beyond_m: float  # the faces' edges, or the pads' range of heights, by which a grip has its pads

    @staticmethod
    def top_over_pads_m(robot: Robot) -> float:
        """How far the top of a hold may be over the pads that grip it: palms keep off it."""
        return float(robot.gripper.finger_height_m - PASSING_CLEARANCE_M)

    @classmethod
    def of(cls, hold: Hold, pair: int, robot: Robot, patch_radius_m: float, grip: Grip | None) -> Faces | None:
        """In the middle, or at one of the hold's grips. None where the hold is too low or too high for the pads."""
        mine, others = ([hold.lean_rad[face] for face in faces_of(which)] for which in (pair, 1 - pair))
        radius, size = robot.gripper.pad_radius_m, hold.size_m
        allowed = robot.grasp.pad_height_m
        low, high = pad_heights(size[2], allowed, patch_radius_m, cls.top_over_pads_m(robot), mine, radius)
        if low > high:
            return None
        height = float(np.clip((allowed[0] + allowed[1]) / 2, low, high))
        height = height if grip is None or grip.height_m is None else grip.height_m
        # A ball touches a leaning face when its middle is so far beyond it along the axis.
        out = [size[pair] / 2 - height * np.tan(lean) + radius * (1.0 / np.cos(lean) - 1.0) for lean in mine]
        patch_end = height + max(patch_radius_m * np.cos(lean) - radius * np.sin(lean) for lean in mine)
        ends = [size[1 - pair] / 2 - patch_end * np.tan(lean) for lean in others]
        half, off = (out[0] + out[1]) / 2, (out[0] - out[1]) / 2
        aside = (ends[0] - ends[1]) / 2 if grip is None else grip.aside_m
        beyond = max(low - height, height - high, aside - ends[0] + patch_radius_m, patch_radius_m - ends[1] - aside)
        return cls(height, half, max(mine), sum(ends), off, aside * (1 - 2 * pair), 0.0 if grip is None else beyond)

    def palm_gap_m(self, hold: Hold, pair: int, grip: Grip, robot: Robot) -> float:
        """How far the palm of a gripper at a grip at an angle is off the hold, seen along the opening axis, less where
        corners are nearest; negative inside. The palm is endless along the axis, and off the hold.
        """
        c, s = np.cos(grip.tilt_rad), np.sin(grip.tilt_rad)
        across, up = np.array([c, s]), np.array([-s, c])  # the gripper's, along the faces and off the hold's foot
        foot = np.array([self.aside_m, self.height_m]) + robot.gripper.finger_height_m * up
        ends = foot + np.outer([-1.0, 1.0], robot.gripper.pad_radius_m * across)
        lean = np.array([hold.lean_rad[face] for face in faces_of(1 - pair)])[:: 1 - 2 * pair]
        half, top = hold.size_m[1 - pair] / 2, hold.size_m[2]
        at_top = half - top * np.tan(lean)
        corners = np.array([[half, 0.0], [-half, 0.0], [at_top[0], top], [-at_top[1], top]])
        ways = np.array([[0.0, 1.0], [np.cos(lean[0]), np.sin(lean[0])], [-np.cos(lean[1]), np.sin(lean[1])]])
        off_hold = [(ends @ n).min() - (corners @ n).max() for n in ways if n @ up >= 0.0]
        off_palm = [(corners @ n).min() - (ends @ n).max() for n in (across, -across, -up)]
        return float(max(off_hold + off_palm))


def pad_heights(
    hold_height_m: float,
    allowed_m: tuple[float, float],
    patch_radius_m: float,
    palm_above_pad_m: float,
    lean_rad: Sequence[float] = (0.0, 0.0),
    pad_radius_m: float = 0.0,
) -> tuple[float, float]:
    """Least and greatest height of the pads above the foot: the whole patch on the face and the palm above the hold. On
    a face that leans the patch is under the pad's middle. The least is above the greatest where the hold is too low or
    too high to be gripped.
    """
    under, patch = pad_radius_m * np.sin(lean_rad), patch_radius_m * np.cos(lean_rad)
    low = max(allowed_m[0], float((patch + under).max()), hold_height_m - palm_above_pad_m)
    return low, min(allowed_m[1], hold_height_m - float((patch - under).max()))


def too_steep(hold: Hold, pair: int) -> str | None:
    """Why friction holds no pad on one of a pair's faces, if it leans so much."""
    for face in faces_of(pair):
        lean, friction = hold.lean_rad[face], usable_friction(hold, face)
        if 0.0 < friction <= np.tan(lean):
            text = f"face {FACE_NAMES[face]} leans by {np.degrees(lean):.0f} degrees"
            return f"{text}, with friction {friction:g} pads slide off from {np.degrees(np.arctan(friction)):.0f}"
    return None
