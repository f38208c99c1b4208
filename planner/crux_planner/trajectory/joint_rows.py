"""(9a) of the exact P1 as the joint limits themselves: what limbs can do, not a convex piece of it.

Rows of a limb, of the body's pose and an upright gripper's: joint 1, joint 2, the cosine of joint 3 (the wrist's
distance: it is defined beyond reach, too), joint 4, the sine of joint 5, and joint 6, not wrapped. They are smooth
wherever the wrist is not above the shoulder. Of limbs without a closed form they are the joints' angles. Further rows
keep links off the trunk and off other limbs' by planes (`link_planes`) that separate them on the body's first path.
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np
from crux_contracts.robot import Limb
from crux_contracts.robot_bounds import JOINTS

from crux_planner.model.arrays import Array
from crux_planner.model.chain_limb import followed, way_in
from crux_planner.model.hands import axes_of, hands_of
from crux_planner.model.problem import BODY_STATES, Problem
from crux_planner.model.schedule import Schedule
from crux_planner.physics.bounds import body_bounds
from crux_planner.physics.dynamics import rotation
from crux_planner.reach.arm import cos_elbow_at, wrist_m
from crux_planner.reach.protocol import Reach
from crux_planner.reach.solids import HAND, LINK_OF
from crux_planner.solvers.mapped import Mapped
from crux_planner.trajectory.joint_limits import JointLimits
from crux_planner.trajectory.link_planes import OFF_M, Ends, Planes, farthest_clear, planes_about, unpacked
from crux_planner.trajectory.stage_functions import POSE, Between, StageFunctions

ELBOW = 2  # number of the joint that is straight in a stretched limb
STRETCH_M = 0.004  # that wrists keep off where elbows are as straight as they may be: little of an angle
_SOFT = 1e-4  # sin^2 of joint 3 below which the elbow is rounded off, so that it is smooth beyond a stretched limb
_PATH_RAD_M = 3.0  # turn that counts as a metre where the body keeps near its first path
_MOVES = [0, 1, 5]  # states of the body that follow the path: x, y, yaw


@dataclass(frozen=True, eq=False)
class _Same:
    """Equal to what has the very same reaches: those of a robot are made once in a process."""

    reaches: tuple[Reach, ...]

    def __eq__(self, other: object) -> bool:
        return isinstance(other, _Same) and other.reaches is self.reaches

    def __hash__(self) -> int:
        return id(self.reaches)


@dataclass(frozen=True)
class JointFunctions(StageFunctions):
    """The stage functions with joint limits for (9a)."""

    reaches: tuple[Reach, ...]
    limits: JointLimits
    _known: dict[int, tuple[Schedule, Planes]] = field(default_factory=dict)

    short_steps, most_iterations = 20, 120  # rows that bend make short steps

    def within(self, limits: JointLimits) -> JointFunctions:
        """The same functions with other limits."""
        other = copy(self)
        other.__dict__.update(limits=limits, _known={})
        other.__dict__.pop("_between", None)
        return other

    @property
    def joint_rows(self) -> int:
        """Of all limbs."""
        return sum(len(reach.limb.at_zero.axes) for reach in self.reaches)

    @cached_property
    def ends(self) -> Ends:
        """Of the limbs' capsules."""
        return Ends(self.reaches, self.problem.solids)

    @cached_property
    def _placed(self) -> Mapped:
        """Joints' rows and the ends' places, one after the other, with derivatives, at (n, 12), hands (n, 16) and
        multipliers.
        """
        masses = [each.numbers for each in self.problem.limb_masses]

        def read() -> Mapped:
            given = (
                [reach.limb for reach in self.reaches],
                self.ends.of_limb,
                self.ends.corners,
                masses,
                self.problem.hand_numbers,
            )
            return Mapped.kept(("joints", given), self._make_placed)

        own = _Same(self.reaches), np.array(masses).tobytes(), self.problem.hand_numbers, len(self.ends.corners)
        return Mapped.once(("joints", *own), read)

    def _make_placed(self) -> Mapped:
        x, hands = ca.SX.sym("x", BODY_STATES), ca.SX.sym("hands", self.hand_numbers)
        joints, places, numbers, count = [], [], self.limb_numbers(hands), self.problem.hand_numbers
        for i, reach in enumerate(self.reaches):
            at = x[0:3], x[3:6], hands[count * i : count * (i + 1)]
            closed = reach.limb.closed_form
            angles, frames = _posture(reach.limb, *at) if closed else _chain_posture(reach.limb, numbers[i], *at)
            joints.append(angles)
            for frame, place in self.ends.of_limb[i]:
                origin, *axes = frames[frame]
                places.append(origin + sum(float(p) * axis for p, axis in zip(place, axes, strict=True)))
        if len(self.ends.corners):
            turn = rotation(x[3:6])
            places += [x[0:3] + turn @ place for place in (*places, *map(ca.DM, self.ends.corners))]
        rows = ca.vertcat(*joints, *places)
        multiplier = ca.SX.sym("z", rows.size1())
        hessian = ca.hessian(ca.dot(multiplier, rows), x)[0][:POSE, :POSE]
        return Mapped("joints", [x, hands, multiplier], [rows, ca.jacobian(rows, x)[:, :POSE], hessian])

    def reach_at(self, body: Array, grippers: Array, multiplier: Array) -> tuple[Array, Array, Array]:
        """As in StageFunctions; of `grippers`: hands (n, 16 or 24), and planes as `packed`."""
        knots, first, hands = len(body), self.joint_rows, 4 * self.problem.hand_numbers
        normals, one, other = unpacked(grippers[:, hands:])
        at, count = np.arange(knots)[:, None], self.ends.count
        weighed = normals * multiplier[:, first:, None]
        on_ends = np.zeros((knots, count + 1, 3))
        np.add.at(on_ends, (at, one), weighed)
        np.add.at(on_ends, (at, other), -weighed)
        given = np.concatenate([multiplier[:, :first], on_ends[:, :count].reshape(knots, -1)], axis=1)
        values, slopes, hessian = self._placed(body, self.with_seeds(body, grippers[:, :hands]), given)
        places, moved = np.zeros((knots, count + 1, 3)), np.zeros((knots, count + 1, 3, POSE))
        places[:, :count] = values[:, first:].reshape(knots, count, 3)
        moved[:, :count] = slopes[:, first:].reshape(knots, count, 3, POSE)
        off = ((places[at, one] - places[at, other]) * normals).sum(axis=-1)
        turned = np.einsum("kri,krij->krj", normals, moved[at, one] - moved[at, other])
        rows = np.concatenate([values[:, :first], off], axis=1)
        return rows, np.concatenate([slopes[:, :first], turned], axis=1), hessian

    def planes(self, schedule: Schedule) -> Planes:
        """At knots 1..N, about the body's first path."""
        known = self._known.get(id(schedule))
        if known is None or known[0] is not schedule:
            path = self.limits.path[1:, :POSE]
            given = path, hands_of(schedule.poses[1:]), np.full(len(path), OFF_M + self.problem.unsure_m)
            known = self._known[id(schedule)] = schedule, planes_about(self.ends, *given)
        return known[1]

    def between(self) -> Between:
        """At the limits' moments."""
        return self._between

    @cached_property
    def _between(self) -> Between:
        moments = self.limits.moments
        if not moments:
            return super().between()
        path, share, off = self.limits.at_moments()
        hands, margin_rad = (np.array([getattr(m, name) for m in moments]) for name in ("hands", "margin_rad"))
        planes = planes_about(self.ends, path, hands, np.array([m.apart_m for m in moments]))
        at = np.array([m.interval for m in moments])
        return Between(at, share, off, _given(hands, planes), *self._bounds(margin_rad, planes))

    def _bounds(self, margin_rad: Array, planes: Planes) -> tuple[Array, Array]:
        """(n, m) of the rows, with margins (n, 4, S)."""
        ranges = [_limits(reach.limb, margin_rad[:, limb]) for limb, reach in enumerate(self.reaches)]
        low = np.concatenate([*(each[0] for each in ranges), planes.least], axis=1)
        return low, np.concatenate([*(each[1] for each in ranges), np.full(planes.least.shape, np.inf)], axis=1)

    def nearer(self, limits: JointLimits, schedule: Schedule, first: Array, body: Array) -> JointLimits:
        """Limits with planes about poses on the way from those of a first path (N + 1, 6 or more) to those of a body,
        as near to these as links keep far enough off each other.
        """
        path = body.copy()
        path[:, :POSE] = farthest_clear(self.ends, first[:, :POSE], body[:, :POSE], hands_of(schedule.poses))
        return replace(limits, path=path)

    def grippers(self, schedule: Schedule) -> Array:
        """(N, 16 + 5 R) of knots 1..N; 24 for 16 where grippers are tilted."""
        return _given(hands_of(schedule.poses[1:]), self.planes(schedule))

    def body_bounds(self, problem: Problem, schedule: Schedule) -> tuple[Array, Array]:
        """As usual, and near the path at knots at which limbs would be in each other's way elsewhere."""
        tilt_rad = problem.body.max_tilt_rad if problem.follows else None  # joints' limits hold at any
        low, high = body_bounds(problem, schedule, tilt_rad)
        level = not len(problem.solids.yaw_rad)  # where there are solids, height and tilt keep the trunk off them
        moves = np.array(_MOVES if level else range(POSE))
        per_m = np.where(moves < 3, 1.0, _PATH_RAD_M)
        for k in np.flatnonzero(np.isfinite(self.limits.near_m))[:-1].tolist():
            if k < 2:
                continue
            half = self.limits.near_m[k] * per_m
            at = np.clip(self.limits.path[k, moves], low[k, moves], high[k, moves])
            low[k, moves] = np.maximum(low[k, moves], at - half)
            high[k, moves] = np.minimum(high[k, moves], at + half)
        return low, high

    def reach_bounds(self, problem: Problem, schedule: Schedule) -> tuple[Array, Array]:
        """(N, m). Until the first lift-off, limbs count as reaching as far as they do at the start."""
        n = problem.steps
        margins = np.full((n, len(self.reaches), self.joint_rows // len(self.reaches)), self.limits.margin_rad)
        low, high = self._bounds(margins, self.planes(schedule))
        if self.problem.closed_form:
            self._less_stretched(schedule, high)
        moved = (schedule.poses[:, :, :3] != schedule.poses[0, :, :3]).any(axis=(1, 2))
        lift_off = int(np.argmax(moved)) - 1 if moved.any() else n
        begun = slice(max(lift_off - 1, 1))
        state = np.concatenate([problem.start.position_m, problem.start.rpy_rad, np.zeros(POSE)])
        grippers = self.grippers(schedule)[begun]
        begin = self.reach_at(np.tile(state, (len(grippers), 1)), grippers, np.zeros((len(grippers), low.shape[1])))[0]
        low[begun], high[begun] = np.minimum(low[begun], begin), np.maximum(high[begun], begin)
        return low, high

    def _less_stretched(self, schedule: Schedule, high: Array) -> None:
        """Elbows off straight by `STRETCH_M` and by as far as holds may be off, or as far as they are on the path."""
        off_m = STRETCH_M + self.problem.unsure_m
        grippers = self.grippers(schedule)
        path = self.reach_at(self.limits.path[1:], grippers, np.zeros(high.shape))[0]
        for limb, reach in enumerate(self.reaches):
            row, straight = JOINTS * limb + ELBOW, float(np.cos(reach.limb.lower_rad[ELBOW]))
            wanted = cos_elbow_at(reach.limb, wrist_m(reach.limb, straight) - off_m)
            high[:, row] = np.minimum(high[:, row], np.maximum(wanted, path[:, row]))


def _given(hands: Array, planes: Planes) -> Array:
    """(n, 16 + 5 R) of hands (n, 4, 4); 24 where they are tilted."""
    return np.concatenate([hands.reshape(len(hands), -1), planes.packed], axis=1)


def _posture(limb: Limb, r: Any, theta: Any, hand: Any) -> tuple[Any, list[tuple[Any, Any, Any, Any]]]:
    """Rows (6,) of the joints of a limb with its gripper at hand (4 or 6,), and origin and axes of the frames of
    its capsules, by number, in the body frame (casadi).
    """
    back = rotation(theta).T
    place, (along, across, up) = back @ (hand[0:3] - r), (back @ axis for axis in axes_of(hand))
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
        (shoulder, ca.vertcat(ca_, sa, 0), side, ca.DM([0, 0, 1])),
    ]
    return ca.vertcat(q1, q2, c3, q4, -ca.dot(side, up), q6), frames


def _chain_posture(
    limb: Limb, numbers: Any, r: Any, theta: Any, hand: Any
) -> tuple[Any, dict[int, tuple[Any, Any, Any, Any]]]:
    """The same of a limb without a closed form, whose `numbers` have what its kinematics start from (casadi)."""
    back = rotation(theta).T
    place, (along, _, up) = back @ (hand[0:3] - r), (back @ axis for axis in axes_of(hand))
    angles, origins, _, turned = followed(numbers, *((v[0], v[1], v[2]) for v in (place, up, along)))
    frames = {HAND: (place, along, ca.cross(up, along), up)}
    for frame, i in LINK_OF.items():
        axes = (way_in(turned[i], tuple(axis)) for axis in limb.at_zero.rotations[i].T)
        origin, x, y, z = (ca.vertcat(*v) for v in (origins[i], *axes))
        frames[frame] = origin, x, y, z
    return ca.vertcat(*angles), frames


def _limits(limb: Limb, margin_rad: Array) -> tuple[Array, Array]:
    """(N, S) least and most of the joints' rows, with margins (N, S)."""
    margin_rad = margin_rad.copy()
    margin_rad[:, len(limb.joints) :] = 0.0  # of turns that stay still
    low, high = limb.lower_rad + margin_rad, limb.upper_rad - margin_rad
    if not limb.closed_form:
        return low, high
    low[:, 2], high[:, 2] = np.cos(high[:, 2]), np.cos(low[:, 2])
    low[:, 4], high[:, 4] = np.sin(low[:, 4]), np.sin(high[:, 4])
    return low, high
