"""The plan between its knots, as msgs/PLAN.md reads it, at many moments at once.

Own, vectorised reading of that page (the golden vectors of the contracts hold it equal to the player's): the checker
looks at some thousand moments, and must not inherit a misreading from the code it checks.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np

from crux_planner.checker.contact import Swing, swings
from crux_planner.checker.geometry import Array, Flags, Indices, rotation_from_rpy, rotation_of_gripper
from crux_planner.checker.plan_arrays import PlanArrays

STANCE_SAMPLES = 12
SWING_SAMPLES = 40
"""Moments per interval; with a limb in the air a pad moves a few millimetres from one to the next."""


@dataclass(frozen=True)
class Samples:
    """The reference at T moments; limbs on axis 1."""

    time_s: Array
    interval: Indices
    body_position: Array
    body_rpy: Array
    rotation: Array
    gripper_position: Array
    gripper_yaw: Array
    gripper_tilt: Array
    opening: Array
    force: Array
    moment: Array
    load: Array
    own_hold: Indices
    """Hold between whose faces the fingers are while closed, opening or closing; the surface that a foot is on, leaves
    or comes to, as Footholds.surface has it; -1 elsewhere."""
    below_m: Array
    """From a gripper to where its force acts, (T, 4, 3): 0 but of feet on footholds."""

    @cached_property
    def foot(self) -> Flags:
        """(T, 4): stands on a foothold."""
        return np.asarray(self.below_m.any(axis=2))

    @property
    def opening_axis(self) -> Array:
        """e, (T, 4, 3)."""
        return self.gripper_rotation[..., 0]

    @cached_property
    def gripper_rotation(self) -> Array:
        """W <- gripper, (T, 4, 3, 3)."""
        return rotation_of_gripper(self.gripper_yaw, self.gripper_tilt)


def on_pads(samples: Samples, pad_radius_m: float) -> Samples:
    """Samples of point feet with the gripper, and what moments are about, one pad radius above the foot point."""
    above = np.array([0.0, 0.0, pad_radius_m])
    moment = samples.moment + np.cross(-above, samples.force)
    return replace(samples, gripper_position=samples.gripper_position + above, moment=moment)


def smooth(x: Array) -> Array:
    """s(x) = 3x^2 - 2x^3 with x clipped to [0, 1]."""
    x = np.clip(x, 0.0, 1.0)
    return x * x * (3.0 - 2.0 * x)


def pchip(step: Array, values: Array, interval: Indices, share: Array) -> Array:
    """Monotone piecewise cubic through knots (K, D), `step` (K - 1,) apart (Fritsch & Carlson 1980; one-sided
    three-point ends), at share (T,) of intervals (T,).
    """
    rise = np.diff(values, axis=0) / step[:, None]
    slope = np.zeros_like(values)
    if len(values) == 2:
        slope[:] = rise[0]
    else:
        before, after = rise[:-1], rise[1:]
        same = before * after > 0.0
        weight = ((step[:-1] + 2.0 * step[1:]) / (3.0 * (step[:-1] + step[1:])))[:, None]
        total = np.where(same, weight * after + (1.0 - weight) * before, 1.0)
        slope[1:-1] = np.where(same, before * after / total, 0.0)  # harmonic mean, weighted
        for end, near, far, ends in ((0, rise[0], rise[1], step[:2]), (-1, rise[-1], rise[-2], step[:-3:-1])):
            value = near + ends[0] / ends.sum() * (near - far)
            value = np.where(np.sign(value) != np.sign(near), 0.0, value)
            limited = (np.sign(near) != np.sign(far)) & (np.abs(value) > 3.0 * np.abs(near))
            slope[end] = np.where(limited, 3.0 * near, value)
    u = share[:, None]
    h00, h10 = (1.0 + 2.0 * u) * (1.0 - u) ** 2, u * (1.0 - u) ** 2
    h01, h11 = u * u * (3.0 - 2.0 * u), u * u * (u - 1.0)
    a, b = interval, interval + 1
    length = step[a, None]
    return h00 * values[a] + length * h10 * slope[a] + h01 * values[b] + length * h11 * slope[b]


def sample(plan: PlanArrays) -> Samples:
    """Moments spread evenly over every interval, more where a limb swings, and the last knot."""
    air = np.any(~plan.stance, axis=1)[:-1]
    counts = np.where(air, SWING_SAMPLES, STANCE_SAMPLES)
    interval = np.append(np.repeat(np.arange(len(counts)), counts), len(counts) - 1)
    share = np.append(np.concatenate([np.arange(n) / n for n in counts]), 1.0)
    return sample_at(plan, interval, share)


def sample_at(plan: PlanArrays, interval: Indices, share: Array) -> Samples:
    """The reference at `share` (T,) in [0, 1] of the intervals `interval` (T,)."""
    k, u = interval, share
    pose = np.concatenate([plan.body_position, plan.body_rpy], axis=1)
    body = pchip(plan.step_s, pose, k, u)
    position, yaw, tilt = plan.gripper_position[k].copy(), plan.gripper_yaw[k].copy(), plan.gripper_tilt[k].copy()
    opening = 0.5 * plan.separation[k]
    surface = plan.foothold_surface
    own = np.where(plan.standing, surface, plan.gripped_hold)[k]
    force, moment = _blend(plan, k, u)
    load = plan.stance[k].astype(float)
    feet = plan.point_feet
    if feet:
        way = np.concatenate([plan.gripper_position, plan.gripper_yaw[..., None]], axis=2)
        way = pchip(plan.step_s, way.reshape(plan.n_knots, -1), k, u).reshape(-1, 4, 4)
        position, yaw = way[..., :3], way[..., 3]
    for swing in swings(plan):
        if not feet:
            _swing(plan, swing, k, u, position, yaw, tilt, opening, own)
        limb = swing.limb
        leaving, landed = k == swing.first - 1, k == swing.last + 1
        load[leaving, limb] *= 1.0 - smooth((u[leaving] - 0.5) / 0.45)
        load[landed, limb] *= smooth((u[landed] - 0.02) / 0.4)
    turned, time_s = rotation_from_rpy(body[:, 3:]), plan.time_s[k] + u * plan.step_s[k]
    below = -plan.above_foot[k]
    parts = turned, position, yaw, tilt, opening, force, moment, load, own, below
    return Samples(time_s, k, body[:, :3], body[:, 3:], *parts)


def _swing(
    plan: PlanArrays,
    swing: Swing,
    k: Indices,
    u: Array,
    position: Array,
    yaw: Array,
    tilt: Array,
    opening: Array,
    own: Indices,
) -> None:
    """Overwrite the samples of one swing."""
    limb, first, last = swing.limb, swing.first, swing.last
    rows = np.flatnonzero((k >= first) & (k <= last) & (k < plan.n_knots - 1))
    kr, ur = k[rows], u[rows]
    share = ur.copy()
    lifting, closing = kr == first, kr == last
    lift, arrive, close = (0.4, 0.6, 0.6) if plan.fingers_move else (0.5, 0.55, 0.6)
    share[lifting] = smooth((ur[lifting] - lift) / (1.0 - lift))
    share[closing & ~lifting] = smooth(ur[closing & ~lifting] / arrive)
    c, psi, half = plan.gripper_position[:, limb], plan.gripper_yaw[:, limb], 0.5 * plan.separation[:, limb]
    position[rows, limb] = c[kr] + share[:, None] * (c[kr + 1] - c[kr])
    yaw[rows, limb] = psi[kr] + share * (psi[kr + 1] - psi[kr])
    leaned = plan.gripper_tilt[:, limb]
    tilt[rows, limb] = leaned[kr] + share[:, None] * (leaned[kr + 1] - leaned[kr])
    gap = half[kr] + ur * (half[kr + 1] - half[kr])
    if not plan.fingers_move:
        gap = np.where(lifting, half[kr] + np.clip(ur / lift, 0.0, 1.0) * (half[kr + 1] - half[kr]), gap)
        closed = half[kr] + np.clip((ur - close) / (1.0 - close), 0.0, 1.0) * (half[kr + 1] - half[kr])
        gap = np.where(closing & ~lifting, closed, gap)
    opening[rows, limb] = gap
    still = rows[lifting & (ur < lift)]
    own[still, limb] = plan.hold_before[first, limb]
    if last < plan.n_knots - 1:
        near = rows[closing & (ur >= close)]
        own[near, limb] = plan.gripped_hold[last + 1, limb]
    for foot, there in ((first - 1, rows[lifting]), (last + 1, rows[closing])):
        if 0 <= foot < plan.n_knots and plan.standing[foot, limb]:
            own[there, limb] = plan.foothold_surface[foot, limb]


def _blend(plan: PlanArrays, k: Indices, u: Array) -> tuple[Array, Array]:
    """Gripper forces and moments (T, 4, 3) by the blending rule of the wrenches."""
    arm = plan.force_position - plan.gripper_position[:, :, None, :]
    about_centre = (np.cross(arm, plan.finger_force) + plan.finger_moment).sum(axis=2)
    wrench = np.concatenate([plan.finger_force.sum(axis=2), about_centre], axis=2)
    wrench[-1] = wrench[-2]
    releases = np.zeros(plan.n_knots + 1, dtype=bool)
    for swing in swings(plan):
        releases[swing.first] = True
    settled = releases[k] | (k == 0)
    before = wrench[np.where(settled, k, k - 1)]
    now, after = wrench[k], wrench[k + 1]
    blended = before + (now - before) * smooth((u - 0.02) / 0.4)[:, None, None]
    onward = np.where(releases[k + 1], smooth((u - 0.5) / 0.45), 0.0)[:, None, None]
    blended = blended + (after - blended) * onward
    return blended[..., :3], blended[..., 3:]
