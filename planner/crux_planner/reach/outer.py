"""The outer map of a limb that yaws, pitches and pitches, with a spherical wrist: what it cannot reach, for certain.

The same comparisons as in the inner map (`arm.py`), over intervals: a box of poses gives an interval of every joint's
angle, without any margin and modulo whole turns. Where one misses its joint's limits, no pose of the box can be had.
What meets them is cut to the limits before it goes on, for only angles within them are asked for. The wrist may also be
behind the shoulder's axis, seen along joint 1, which inverse kinematics never has: both are looked at.

A link is in the trunk for certain where a point on its axis is nearer to the trunk, wherever the intervals have it,
than the link is thick.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from crux_contracts.robot import Limb

from crux_planner.model.arrays import Array, Flags
from crux_planner.reach.interval import ROUNDING, Interval, cosine, direction, sine
from crux_planner.reach.poses import GripperPoses
from crux_planner.reach.solids import FOREARM, UPPER, Box, Capsule, Solids

_ALONG = np.linspace(0.0, 1.0, 5)  # points of a link's axis that are looked at
Place = tuple[Interval, Interval, Interval]


def cannot(limb: Limb, shapes: Solids, low: GripperPoses, high: GripperPoses) -> Flags:
    """Where no pose between `low` and `high`, of the same shape, is within joint limits with links off the trunk."""
    found = np.ones(low.shape, dtype=bool)
    for ahead in (1.0, -1.0):
        fits, *_ = _wrist(limb, _body(limb, low, high), ahead)
        some = np.flatnonzero(np.broadcast_to(fits, low.shape))  # about half: the rest is looked at there alone
        body = _body(limb, low.where(some), high.where(some))
        found.reshape(-1)[some] &= ~_possible(limb, shapes, body, ahead)
    return found


@dataclass(frozen=True)
class _Body:
    """Boxes of poses, and what the limb's first joint does not change."""

    above_m: float
    x: Interval
    y: Interval
    z: Interval
    yaw: Interval
    roll: Interval
    pitch: Interval

    @property
    def wrist(self) -> Place:
        """In the body frame."""
        high, across = self.z + self.above_m, self.y
        cr, sr, cp, sp = cosine(self.roll), sine(self.roll), cosine(self.pitch), sine(self.pitch)
        above = sp * self.x + cp * high
        return cp * self.x - sp * high, cr * across + sr * above, cr * above - sr * across

    @property
    def up(self) -> Place:
        """W's z in the body frame."""
        cp = cosine(self.pitch)
        return -sine(self.pitch), sine(self.roll) * cp, cosine(self.roll) * cp


def _body(limb: Limb, low: GripperPoses, high: GripperPoses) -> _Body:
    poses = [Interval(np.asarray(a), np.asarray(b)) for a, b in zip(low.arrays, high.arrays, strict=True)]
    return _Body(limb.wrist_to_gripper_m, *poses)


def _wrist(limb: Limb, body: _Body, ahead: float) -> tuple[Flags, Interval, Interval, Interval, Interval]:
    """Where joints 1 and 3 can bring the wrist into its place, before the shoulder's axis (`ahead` 1) or behind it
    (-1); their angles, and the square of the wrist's radius and its height.
    """
    low, high = limb.lower_rad, limb.upper_rad
    l1, l2 = limb.upper_link_m, limb.lower_link_m
    x, y, h = (each - float(at) for each, at in zip(body.wrist, limb.shoulder_b_m, strict=True))
    behind = 0.0 if ahead > 0.0 else np.pi
    fits, q1 = (direction(x, y) + behind - limb.mount_rad).meets_turned(low[0], high[0])
    squared = x.squared + y.squared
    elbow = (squared + h.squared + (-l1 * l1 - l2 * l2)) * (1.0 / (2 * l1 * l2))
    ends = float(np.cos(high[2])), float(np.cos(low[2]))
    fits, elbow = fits & elbow.meets(*ends), elbow.clipped(*ends)
    return fits, q1, Interval(np.arccos(elbow.high), np.arccos(elbow.low)), squared, h


def _possible(limb: Limb, shapes: Solids, body: _Body, ahead: float) -> Flags:
    """Where the limb may have its gripper, with its wrist ahead or behind."""
    low, high = limb.lower_rad, limb.upper_rad
    l1, l2 = limb.upper_link_m, limb.lower_link_m
    possible, q1, q3, squared, h = _wrist(limb, body, ahead)
    to_wrist = direction(squared.root * ahead, h)
    fits, q2 = (to_wrist + triangle(q3, l1, l2)).meets_turned(low[1], high[1])
    elevation = to_wrist - triangle(q3, l2, l1)
    azimuth = q1 + limb.mount_rad
    ca, sa = cosine(azimuth), sine(azimuth)
    ux, uy, uz = body.up
    turned, _ = (elevation + direction(uz, ux * ca + uy * sa)).meets_turned(low[3], high[3])
    sin_roll = ux * sa - uy * ca
    possible = possible & fits & turned & sin_roll.meets(float(np.sin(low[4])), float(np.sin(high[4])))
    side = azimuth + _leaning(body, ca, sa)
    last, _ = (body.yaw - side - limb.gripper_mount_rad).meets_turned(low[5], high[5])
    return possible & last & ~_in_trunk(limb, shapes, body.wrist, (ca, sa), q2)


def triangle(q3: Interval, near: float, far: float) -> Interval:
    """The angle at the end of link `near` between it and the line to the other end of `far`, with this elbow."""
    one, other = (np.arctan2(far * np.sin(q), near + far * np.cos(q)) for q in (q3.low, q3.high))
    low, high = np.minimum(one, other), np.maximum(one, other)
    if far < near:  # it grows up to a right angle between far and the line, and then falls
        widest = np.arccos(-far / near)
        high = np.where((q3.low <= widest) & (widest <= q3.high), np.arcsin(far / near), high)
    return Interval(low, high)


def _leaning(body: _Body, ca: Interval, sa: Interval) -> Interval:
    """The azimuth of the limb's side seen along W's z less that seen along the body's."""
    cr, cp, both = cosine(body.roll), cosine(body.pitch), sine(body.roll) * sine(body.pitch)
    product = ca * sa
    return direction(cr * ca.squared + cp * sa.squared - both * product, product * (cp - cr) - both * ca.squared)


def _in_trunk(limb: Limb, shapes: Solids, wrist: Place, azimuth: tuple[Interval, Interval], q2: Interval) -> Flags:
    """Where some point of the upper or the lower link is in the trunk whatever the joints are within these."""
    out, up = cosine(q2), sine(q2)
    upper = azimuth[0] * out, azimuth[1] * out, up
    shoulder = [Interval(np.asarray(at), np.asarray(at)) for at in limb.shoulder_b_m]
    elbow = [s + u * limb.upper_link_m for s, u in zip(shoulder, upper, strict=True)]
    inside = np.zeros(np.shape(q2.low), dtype=bool)
    for capsule in shapes.links:
        if capsule.frame not in (UPPER, FOREARM) or not _on_axis(capsule):
            continue
        fore = capsule.frame == FOREARM
        first, last = (elbow, list(wrist)) if fore else (shoulder, elbow)
        length = limb.lower_link_m if fore else limb.upper_link_m
        for share in (capsule.start_m[0] + _ALONG * (capsule.end_m[0] - capsule.start_m[0])) / length:
            point = [a * (1.0 - share) + b * share for a, b in zip(first, last, strict=True)]
            for box in shapes.trunk:
                inside = inside | (_farthest(point, box) < capsule.radius_m - ROUNDING)
    return inside


def _on_axis(capsule: Capsule) -> bool:
    """Whether a capsule is about its link's axis."""
    return not np.abs([capsule.start_m[1:], capsule.end_m[1:]]).max() > ROUNDING


def _farthest(point: list[Interval], box: Box) -> Array:
    """The most that a point can be off a box."""
    squares: Array = np.zeros(())
    for axis in range(3):
        along = [(p - float(c)) * float(r) for p, c, r in zip(point, box.centre_m, box.rotation[:, axis], strict=True)]
        beyond = np.maximum((along[0] + along[1] + along[2]).size.high - box.half_m[axis], 0.0)
        squares = squares + beyond**2
    return np.asarray(np.sqrt(squares))
