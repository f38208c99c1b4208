"""How a plan is read between its knots: msgs/PLAN.md in Python.

A point of plan time is an interval k and the share u in [0, 1] of it that has passed. The end of one interval and the
beginning of the next are two points: at the end a limb about to release is unloaded but still grips.
Every `u` may be a number or an array; results then have u's shape in front.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from crux_msgs import limb_knot_t, plan_t
from numpy.typing import ArrayLike, NDArray

from . import LIMB_NAMES
from .gripper_frames import gripper_rotation
from .pchip import Pchip

Array = NDArray[np.float64]


@dataclass(frozen=True)
class SwingShares:
    """Instants of a swing's first and last interval, as shares of it."""

    lift: float
    """The gripper lifts."""
    arrive: float
    """The gripper stands at its new hold."""
    close: float
    """The fingers close until they press."""
    fingers_move: bool
    """They open and close at a steady speed over the whole interval; else before the lift and from `close` on."""


def swing_shares(plan_format: int) -> SwingShares:
    """The instants in plans of this format."""
    moving = plan_format == plan_t.FORMAT_MOVING_FINGERS
    return SwingShares(0.4, 0.6, 0.6, True) if moving else SwingShares(0.5, 0.55, 0.6, False)


LOAD_BEGIN, LOAD_SPAN = 0.02, 0.4
"""Blend from the last interval's wrench."""
UNLOAD_BEGIN, UNLOAD_SPAN = 0.5, 0.45
"""Blend towards the next interval's wrench."""


@dataclass(frozen=True)
class GripperReference:
    """position_w_m (..., 3), yaw_w_rad (...), opening_m (...): pad face to gripper centre, as commanded; tilt_w_rad
    (..., 2), see gripper_frames. A foot on a foothold has its gripper's frame here too, not the foot point.
    """

    position_w_m: Array
    yaw_w_rad: Array
    opening_m: Array
    tilt_w_rad: Array


def smoothstep(x: ArrayLike) -> Array:
    """s(x) = 3x^2 - 2x^3 with x clipped to [0, 1]."""
    clipped = np.clip(np.asarray(x, dtype=float), 0.0, 1.0)
    result: Array = clipped * clipped * (3.0 - 2.0 * clipped)
    return result


def load_ramp(u: ArrayLike) -> Array:
    """0 to 1 over the interval after a touch-down."""
    return smoothstep((np.asarray(u, dtype=float) - LOAD_BEGIN) / LOAD_SPAN)


def unload_ramp(u: ArrayLike) -> Array:
    """0 to 1 over the interval before a limb releases its hold."""
    return smoothstep((np.asarray(u, dtype=float) - UNLOAD_BEGIN) / UNLOAD_SPAN)


def gripper_wrench(knot: limb_knot_t) -> Array:
    """(6,) force and moment on the robot at the gripper centre, a foot's at its foot point: F = f1 + f2, M = sum
    (p_i - c) x f_i + m_i.
    """
    forces = np.asarray(knot.finger_force_w_n, dtype=float).reshape(2, 3)
    moments = np.asarray(knot.finger_moment_w_nm, dtype=float).reshape(2, 3)
    axis = gripper_rotation(knot.gripper_yaw_w_rad, knot.gripper_tilt_w_rad)[:, 0]
    arms = np.outer([0.5, -0.5], knot.finger_separation_m * axis)
    return np.concatenate([forces.sum(axis=0), (np.cross(arms, forces) + moments).sum(axis=0)])


def knot_times_s(plan: plan_t) -> Array:
    """(N+1,) when each knot stands: every dt_s, or at its own time."""
    if plan.format >= plan_t.FORMAT_OWN_TIMES:
        return np.array([knot.time_s for knot in plan.knots], dtype=float)
    even: Array = np.arange(len(plan.knots), dtype=float) * plan.dt_s
    return even


def is_walk(plan: plan_t) -> bool:
    """Every limb in stance stands on the surface itself (point feet), none on a foothold."""
    standing = [limb for knot in plan.knots for limb in knot.limbs if limb.phase == limb_knot_t.STANCE]
    return all(limb.finger1_face == limb_knot_t.FACE_WALL and limb.hold < 0 for limb in standing)


def frame_position(plan: plan_t, limb: limb_knot_t) -> Array:
    """(3,) in W of a gripper's frame at a knot of a climb: midway between the pads, which is above the foot point of a
    limb that stands on a foothold.
    """
    place = np.array(limb.gripper_position_w_m, dtype=float)
    if limb.phase != limb_knot_t.STANCE or limb.finger1_face != limb_knot_t.FACE_WALL or limb.hold < 0:
        return place
    up = gripper_rotation(limb.gripper_yaw_w_rad, limb.gripper_tilt_w_rad)[:, 2]
    raised: Array = place + plan.holds[limb.hold].size_m[0] / 2 * up
    return raised


class PlanReference:
    """Everything a plan asks for at a point of its time, frame W. Raises ValueError where its swings make no
    sense.
    """

    def __init__(self, plan: plan_t) -> None:
        if len(plan.knots) < 2:
            raise ValueError(f"a plan needs two knots at least, this one has {len(plan.knots)}")
        self.intervals = len(plan.knots) - 1
        self.time_s = knot_times_s(plan)
        """(N+1,) of the knots"""
        own_times = plan.format >= plan_t.FORMAT_OWN_TIMES
        self.step_s = np.diff(self.time_s) if own_times else np.full(self.intervals, plan.dt_s)
        """(N,) from each knot to the next"""
        self.shares = swing_shares(plan.format)
        limbs = [[knot.limbs[limb] for limb in range(len(LIMB_NAMES))] for knot in plan.knots]
        self.air = np.array([[limb.phase == limb_knot_t.AIR for limb in knot] for knot in limbs])
        """(N+1, 4)"""
        self.point_feet = is_walk(plan)
        self._check_swings(plan.format == plan_t.FORMAT or self.point_feet)
        self._position_w_m = np.array([[frame_position(plan, limb) for limb in knot] for knot in limbs])
        self._yaw_w_rad = np.array([[limb.gripper_yaw_w_rad for limb in knot] for knot in limbs], dtype=float)
        self._tilt_w_rad = np.array([[limb.gripper_tilt_w_rad for limb in knot] for knot in limbs], dtype=float)
        self._opening_m = np.array([[limb.finger_separation_m / 2 for limb in knot] for knot in limbs], dtype=float)
        self._limbs = limbs
        poses = np.array([[*knot.body_position_w_m, *knot.body_rpy_rad] for knot in plan.knots], dtype=float)
        self._body = Pchip(self.time_s, poses)
        feet = np.concatenate([self._position_w_m, self._yaw_w_rad[..., None]], axis=2)
        self._feet = Pchip(self.time_s, feet)

    @cached_property
    def _wrench(self) -> Array:
        """(N+1, 4, 6); motion alone does without."""
        return np.array([[gripper_wrench(limb) for limb in knot] for knot in self._limbs])

    @property
    def end_s(self) -> float:
        """s, the plan's duration."""
        return float(self.time_s[-1])

    def lets_go(self, k: int, limb: int) -> bool:
        """Knot k is the first of a swing of this limb (k0 of PLAN.md), in the air at the plan's first knot too."""
        return bool(k <= self.intervals and self.air[k, limb] and (k == 0 or not self.air[k - 1, limb]))

    def takes_hold(self, k: int, limb: int) -> bool:
        """Knot k is the first after a swing of this limb (k1 + 1 of PLAN.md)."""
        return bool(0 < k <= self.intervals and not self.air[k, limb] and self.air[k - 1, limb])

    def at(self, time_s: float) -> tuple[int, float]:
        """Interval and share of a plan time, clipped to the plan; a knot's time begins its interval."""
        k = int(np.clip(np.searchsorted(self.time_s, time_s, side="right") - 1, 0, self.intervals - 1))
        return k, float(np.clip((time_s - self.time_s[k]) / self.step_s[k], 0.0, 1.0))

    def body(self, time_s: ArrayLike) -> tuple[Array, Array]:
        """Position (..., 3) in W and roll-pitch-yaw (..., 3)."""
        pose = self._body(np.clip(time_s, 0.0, self.end_s))
        return pose[..., :3], pose[..., 3:]

    def body_rates(self, time_s: ArrayLike) -> tuple[Array, Array]:
        """Time derivatives of `body`: velocity (..., 3) and rates of roll, pitch, yaw (..., 3)."""
        rate = self._body.rate(np.clip(time_s, 0.0, self.end_s))
        return rate[..., :3], rate[..., 3:]

    def limb(self, limb: int, k: int, u: ArrayLike) -> GripperReference:
        """Gripper pose and finger opening. Motion starts and ends smoothly where a swing does; fingers open as soon as
        the swing begins and close at the end of its last interval, or over it. Point feet run through the knots as the
        body does."""
        share = np.asarray(u, dtype=float)
        if self.point_feet:
            foot = self._feet(np.clip(self.time_s[k] + share * self.step_s[k], 0.0, self.end_s))[..., limb, :]
            opening, upright = np.full_like(share, self._opening_m[k, limb]), np.zeros((*share.shape, 2))
            return GripperReference(foot[..., :3], foot[..., 3], opening, upright)
        here, after = self._opening_m[k, limb], self._opening_m[k + 1, limb]
        shares, steady = self.shares, here + (after - here) * share
        if not self.air[k, limb]:
            progress, opening = np.zeros_like(share), np.full_like(share, here)
        elif self.lets_go(k, limb):
            progress, opening = smoothstep((share - shares.lift) / (1 - shares.lift)), np.full_like(share, after)
        elif self.takes_hold(k + 1, limb):
            progress = smoothstep(share / shares.arrive)
            opening = np.where(share > shares.close, after, steady if shares.fingers_move else here)
        else:
            progress, opening = share, steady
        start, end = self._position_w_m[k, limb], self._position_w_m[k + 1, limb]
        yaw, yaw_end = self._yaw_w_rad[k, limb], self._yaw_w_rad[k + 1, limb]
        tilt, tilt_end = self._tilt_w_rad[k, limb], self._tilt_w_rad[k + 1, limb]
        place, tilted = start + progress[..., None] * (end - start), tilt + progress[..., None] * (tilt_end - tilt)
        return GripperReference(place, yaw + progress * (yaw_end - yaw), opening, tilted)

    def wrench(self, limb: int, k: int, u: ArrayLike) -> Array:
        """(..., 6) planned force and moment on the robot at the gripper centre, a foot's at its foot point, frame W."""
        here = self._wrench[k, limb]
        shifted_before = k == 0 or self._anyone_lets_go(k)
        before = here if shifted_before else self._wrench[k - 1, limb]
        wrench: Array = before + load_ramp(u)[..., None] * (here - before)
        if self._anyone_lets_go(k + 1):
            wrench = wrench + unload_ramp(u)[..., None] * (self._wrench[k + 1, limb] - wrench)
        return wrench

    def load(self, limb: int, k: int, u: ArrayLike) -> Array:
        """(...) share of its planned wrench that the limb bears: 0 in the air, 1 in full stance."""
        share = np.asarray(u, dtype=float)
        if self.air[k, limb]:
            return np.zeros_like(share)
        load = load_ramp(share) if self.takes_hold(k, limb) else np.ones_like(share)
        return load * (1.0 - unload_ramp(share)) if self.lets_go(k + 1, limb) else load

    def _anyone_lets_go(self, k: int) -> bool:
        return any(self.lets_go(k, limb) for limb in range(len(LIMB_NAMES)))

    def _check_swings(self, from_stance: bool) -> None:
        for limb, name in enumerate(LIMB_NAMES):
            air = self.air[:, limb]
            for end, knot in (("first", 0), ("last", self.intervals)):
                if air[knot] and (knot > 0 or from_stance):
                    raise ValueError(f"{name} is in the air at the {end} knot")
            for k in range(self.intervals):
                if self.lets_go(k, limb) and not air[k + 1]:
                    raise ValueError(f"{name} is in the air at knot {k} alone; a swing needs two knots")
