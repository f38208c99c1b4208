"""(9a) of the exact P1 as the joint limits themselves: what limbs can do, not a convex piece of it.

Rows of a limb, of the body's pose and an upright gripper's: joint 1, joint 2, the cosine of joint 3 (the wrist's
distance: it is defined beyond reach, too), joint 4, the sine of joint 5, and joint 6, not wrapped. They are smooth
wherever the wrist is not above the shoulder. Further rows keep the ends of the links' capsules on one side of planes,
which separate them from the trunk at the body's first path.
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np
from crux_contracts.robot import Limb

from crux_planner.model.arrays import Array
from crux_planner.model.kinematics import rotation_from_rpy, rotation_z
from crux_planner.model.problem import BODY_STATES, Problem
from crux_planner.model.schedule import Schedule
from crux_planner.physics.bounds import body_bounds
from crux_planner.physics.dynamics import rotation
from crux_planner.reach.arm import ArmReach
from crux_planner.reach.poses import GripperPoses
from crux_planner.reach.solids import Capsule
from crux_planner.solvers.mapped import Mapped
from crux_planner.trajectory.stage_functions import POSE, StageFunctions

JOINTS = 6
_SOFT = 1e-4  # sin^2 of joint 3 below which the elbow is rounded off, so that it is smooth beyond a stretched limb
_OFF_TRUNK_M = 0.0045  # of links: half as much again as the check asks for
_NEAR_TRUNK_M = 0.15  # links farther off it need no plane
_ALONG = np.linspace(0.0, 1.0, 17)  # samples of a link
_DAMPING = 10.0
_PATH_YAW_RAD_M = 3.0  # heading that counts as a metre where the body keeps near its first path
_MOVES = [0, 1, 5]  # states of the body that follow the path: x, y, yaw


@dataclass(frozen=True)
class JointLimits:
    """How far joints keep off their limits, and what the body keeps to so that links keep off each other."""

    path: Array  # (N + 1, 12) body states on whose side of the trunk links stay
    margin_rad: Array  # (N + 1, 4, 6)
    near_m: Array  # (N + 1,) how far the body may be from the path; infinite where it need not be near

    @classmethod
    def about(cls, path: Array, margin_rad: float) -> JointLimits:
        """One margin for all joints, the body nowhere bound to the path."""
        return cls(path, np.full((len(path), 4, JOINTS), margin_rad), np.full(len(path), np.inf))


@dataclass(frozen=True)
class JointFunctions(StageFunctions):
    """The stage functions with joint limits for (9a)."""

    reaches: tuple[ArmReach, ...]
    limits: JointLimits

    short_steps, most_iterations = 20, 120  # rows that bend make short steps

    def within(self, limits: JointLimits) -> JointFunctions:
        """The same functions with other limits."""
        other = copy(self)
        other.__dict__["limits"] = limits
        return other

    def damped(self) -> JointFunctions:
        """The same with damped steps, for what does not converge without."""
        other = copy(self)
        other.__dict__["damping"] = _DAMPING
        return other

    @cached_property
    def reach(self) -> Mapped:
        """As in StageFunctions; of grippers (n, 16) x, y, z and yaw, and then the planes' normals (n, 4, P, 3)."""
        counts = [len(each.keep_off.links) for each in self.reaches]
        x, hands, normals = (
            ca.SX.sym(*each) for each in (("x", BODY_STATES), ("hands", 16), ("normals", 3 * sum(counts)))
        )
        rows, planes = [], iter(ca.vertsplit(normals, 3))
        for i, reach in enumerate(self.reaches):
            joints, frames = _posture(reach.limb, x[0:3], x[3:6], hands[4 * i : 4 * i + 4])
            rows.append(joints)
            for capsule in reach.keep_off.links:
                normal, (origin, *axes) = next(planes), frames[capsule.frame]
                for end in _ends(capsule):
                    rows.append(
                        ca.dot(normal, origin + sum(float(e) * axis for e, axis in zip(end, axes, strict=True)))
                    )
        rows = ca.vertcat(*rows)
        multiplier = ca.SX.sym("z", rows.size1())
        hessian = ca.hessian(ca.dot(multiplier, rows), x)[0][:POSE, :POSE]
        given = [x, ca.vertcat(hands, normals), multiplier]
        return Mapped("joints", given, [rows, ca.jacobian(rows, x)[:, :POSE], hessian])

    def grippers(self, schedule: Schedule) -> Array:
        """(N, 16 + 12 P) of knots 1..N."""
        hands = schedule.poses[1:, :, :4]
        normals = [self._planes(hands[:, limb], reach)[0] for limb, reach in enumerate(self.reaches)]
        return np.concatenate([each.reshape(len(hands), -1) for each in (hands, *normals)], axis=1)

    def body_bounds(self, problem: Problem, schedule: Schedule) -> tuple[Array, Array]:
        """As usual, and near the path at knots at which limbs would be in each other's way elsewhere."""
        low, high = body_bounds(problem, schedule)
        for k in np.flatnonzero(np.isfinite(self.limits.near_m))[:-1].tolist():
            if k < 2:
                continue
            half = self.limits.near_m[k] * np.array([1.0, 1.0, _PATH_YAW_RAD_M])
            at = np.clip(self.limits.path[k, _MOVES], low[k, _MOVES], high[k, _MOVES])
            low[k, _MOVES] = np.maximum(low[k, _MOVES], at - half)
            high[k, _MOVES] = np.minimum(high[k, _MOVES], at + half)
        return low, high

    def reach_bounds(self, problem: Problem, schedule: Schedule) -> tuple[Array, Array]:
        """(N, m). Until the first lift-off, limbs count as reaching as far as they do at the start."""
        n, lows, highs = problem.steps, [], []
        for limb, reach in enumerate(self.reaches):
            low, high = _limits(reach.limb, self.limits.margin_rad[1:, limb])
            ends = [len(_ends(capsule)) for capsule in reach.keep_off.links]
            least = np.repeat(self._planes(schedule.poses[1:, limb, :4], reach)[1], ends, axis=1)
            lows += [low, least]
            highs += [high, np.full(least.shape, np.inf)]
        low, high = (np.concatenate(each, axis=1) for each in (lows, highs))
        moved = (schedule.poses[:, :, :3] != schedule.poses[0, :, :3]).any(axis=(1, 2))
        lift_off = int(np.argmax(moved)) - 1 if moved.any() else n
        begun = slice(max(lift_off - 1, 1))
        state = np.concatenate([problem.start.position_m, problem.start.rpy_rad, np.zeros(POSE)])
        grippers = self.grippers(schedule)[begun]
        begin = self.reach(np.tile(state, (len(grippers), 1)), grippers, np.zeros((len(grippers), low.shape[1])))[0]
        low[begun], high[begun] = np.minimum(low[begun], begin), np.maximum(high[begun], begin)
        return low, high

    def _planes(self, hands: Array, reach: ArmReach) -> tuple[Array, Array]:
        """Normals (N, P, 3) in the body frame, at knots 1..N, of planes between the trunk and the limb's capsules on
        the path, and how far along them the ends of the capsules are at least, (N, P); -inf where they are far off.
        """
        path = self.limits.path[1:]
        turn = rotation_from_rpy(path[:, 3:6])
        back = np.swapaxes(turn, 1, 2)
        place = (back @ (hands[:, :3] - path[:, :3])[..., None])[..., 0]
        links = reach.links(GripperPoses.of(place, back @ rotation_z(hands[:, 3])))
        count = len(reach.keep_off.links)
        start, end, radius = links.start_m[:, :count], links.end_m[:, :count], links.radius_m[:count]
        points = start[:, :, None] + _ALONG[:, None] * (end - start)[:, :, None]
        normals, least = np.zeros((len(path), count, 3)), np.full((len(path), count), -np.inf)
        nearest = np.full(least.shape, _NEAR_TRUNK_M)
        for box in reach.keep_off.trunk:
            seen = (points - box.centre_m) @ box.rotation
            off = seen - np.clip(seen, -box.half_m, box.half_m)
            gap = np.linalg.norm(off, axis=-1)
            which = np.argmin(gap, axis=-1)[..., None]
            gap = np.take_along_axis(gap, which, axis=-1)[..., 0]
            away = np.take_along_axis(off, which[..., None], axis=2)[:, :, 0] / np.maximum(gap, 1e-9)[..., None]
            normal = away @ box.rotation.T
            border = normal @ box.centre_m + np.abs(away) @ box.half_m + radius + _OFF_TRUNK_M
            here = np.minimum(*((each * normal).sum(axis=-1) for each in (start, end)))
            near = (gap > 0.0) & (gap < nearest)
            normals[near], least[near], nearest[near] = normal[near], np.minimum(border, here)[near], gap[near]
        return normals, least


def _posture(limb: Limb, r: Any, theta: Any, hand: Any) -> tuple[Any, list[tuple[Any, Any, Any, Any]]]:
    """Rows (6,) of the joints of a limb with its gripper at hand (x, y, z, yaw), and origin and axes of the frames of
    its capsules, by number, in the body frame (casadi).
    """
    back = rotation(theta).T
    place, up = back @ (hand[0:3] - r), back[:, 2]
    along = back @ ca.vertcat(ca.cos(hand[3]), ca.sin(hand[3]), 0)
    across = back @ ca.vertcat(-ca.sin(hand[3]), ca.cos(hand[3]), 0)
    wrist = place + limb.wrist_to_gripper_m * up - ca.DM(limb.shoulder_b_m)
    l1, l2 = limb.upper_link_m, limb.lower_link_m
    radius = ca.sqrt(wrist[0] ** 2 + wrist[1] ** 2 + 1e-12)
    ca_, sa = wrist[0] / radius, wrist[1] / radius
    c1, s1 = np.cos(limb.mount_rad), np.sin(limb.mount_rad)
    q1 = ca.atan2(c1 * sa - s1 * ca_, c1 * ca_ + s1 * sa)
    c3 = (radius**2 + wrist[2] ** 2 - l1**2 - l2**2) / (2 * l1 * l2)
    squared = 1 - c3**2
    s3 = ca.sqrt((squared + ca.sqrt(squared**2 + 4 * _SOFT**2)) / 2)
    q2 = ca.atan2(wrist[2], radius) + ca.atan2(l2 * s3, l1 + l2 * c3)
    elevation = q2 - ca.atan2(s3, c3)
    ce, se = ca.cos(elevation), ca.sin(elevation)
    forearm, side = ca.vertcat(ca_ * ce, sa * ce, se), ca.vertcat(-sa, ca_, 0)
    above = ca.vertcat(-ca_ * se, -sa * se, ce)
    q4 = ca.atan2(ca.dot(forearm, up), ca.dot(above, up))
    level = hand[3] - theta[2] - q1 - (limb.mount_rad + limb.gripper_mount_rad)  # joint 6 of a level body
    cm, sm = np.cos(limb.gripper_mount_rad), np.sin(limb.gripper_mount_rad)
    one, other = ca.dot(side, along), ca.dot(side, across)
    s6, c6, sl, cl = one * cm - other * sm, other * cm + one * sm, ca.sin(level), ca.cos(level)
    q6 = level + ca.atan2(s6 * cl - c6 * sl, c6 * cl + s6 * sl)
    shoulder, upper = ca.DM(limb.shoulder_b_m), ca.vertcat(ca_ * ca.cos(q2), sa * ca.cos(q2), ca.sin(q2))
    rolled = ca.cross(side, up)
    rolled /= ca.sqrt(ca.sumsqr(rolled) + 1e-12)
    tilted = ca.cross(up, rolled)
    frames = [
        (shoulder, upper, side, ca.cross(upper, side)),
        (shoulder + l1 * upper, forearm, side, above),
        (shoulder + wrist, rolled, side, ca.cross(rolled, side)),
        (shoulder + wrist, rolled, tilted, ca.cross(rolled, tilted)),
        (place, along, across, up),
    ]
    return ca.vertcat(q1, q2, c3, q4, -ca.dot(side, up), q6), frames


def _limits(limb: Limb, margin_rad: Array) -> tuple[Array, Array]:
    """(N, 6) least and most of the joints' rows, with margins (N, 6)."""
    low, high = limb.lower_rad + margin_rad, limb.upper_rad - margin_rad
    low[:, 2], high[:, 2] = np.cos(high[:, 2]), np.cos(low[:, 2])
    low[:, 4], high[:, 4] = np.sin(low[:, 4]), np.sin(high[:, 4])
    return low, high


def _ends(capsule: Capsule) -> list[Array]:
    """One of a ball."""
    same = (capsule.start_m == capsule.end_m).all()
    return [capsule.start_m] if same else [capsule.start_m, capsule.end_m]
