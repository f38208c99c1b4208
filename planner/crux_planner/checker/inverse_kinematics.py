"""Numeric inverse kinematics of the limbs for many gripper poses at once: damped Gauss-Newton on the pose error.

A first pose is reached from the nearest of many postures spread over the joint ranges; from its solution a few others
start, and from between these all others; those that fail, or end outside the joint limits, start again from the
nearest sample in time that did not. Limbs that differ only in where their first joint sits and how their gripper is
mounted have the same arm, and take the first two steps together.

Every joint of an arm has a frame whose z is its axis, so that each is a turn about z after one constant turn. Vectors
are (3, n), rotations (3, 3, n) with columns first: component by component over n poses.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from crux_planner.checker.geometry import Array, Flags, Indices, about_z, cross, rotation_vector, solved
from crux_planner.checker.limb_model import Limb, axis_frame

SEED_POSTURES = 1024
SEEDS = 16  # of these, the nearest to a first pose
STRIDE = 8  # samples of which one is solved from the first pose, the others from what lies between two such
ITERATIONS = 30
MAX_STEP_RAD = 0.4
CONVERGED_M = 1e-7
ROTATION_LENGTH_M = 1.0
"""Weighs an orientation error [rad] against a position error [m]."""


@dataclass(frozen=True, eq=False)
class Arm:
    """J joints: constant turns (J - 1, 3, 3) from each joint's frame to the next one's, offsets (J, 3) from each joint
    to the next and to the gripper, in the frame of the former, and limits (J,).
    """

    turns: Array
    offsets: Array
    lower_rad: Array
    upper_rad: Array

    @cached_property
    def alike(self) -> bytes:
        """The same for arms that are the same."""
        parts = (self.turns, self.offsets, self.lower_rad, self.upper_rad)
        return b"".join((part + 0.0).tobytes() for part in parts)  # no -0.0

    def forward(self, q_rad: Array) -> tuple[Array, Array, Array, Array]:
        """Position and rotation of the end for joint angles (J, n), origins and axes (3, J, n) of the joints."""
        joints, n = q_rad.shape
        sine, cosine = np.sin(q_rad), np.cos(q_rad)
        position, columns = np.zeros((3, n)), np.zeros((3, 3, n))
        origins, axes = np.empty((2, 3, joints, n))
        columns[0, 0] = columns[1, 1] = columns[2, 2] = 1.0
        for i in range(joints):
            if i > 0 and (self.turns[i - 1] != _IDENTITY).any():
                columns = (self.turns[i - 1].T @ columns.reshape(3, -1)).reshape(3, 3, n)
            origins[:, i], axes[:, i] = position, columns[2]
            columns = about_z(columns, sine[i], cosine[i])
            for along, column in zip(self.offsets[i], columns, strict=True):
                if along != 0.0:
                    position = position + along * column
        return position, columns, origins, axes


_IDENTITY = np.eye(3)


def jacobian(position: Array, origins: Array, axes: Array) -> Array:
    """Geometric Jacobian (6, J, n) of a point (3, n) that moves with all joints: rows v, omega."""
    found = np.empty((6, *axes.shape[1:]))
    found[:3], found[3:] = cross(axes, position[:, None] - origins), axes
    return found


@dataclass(frozen=True)
class Mounting:
    """Where an arm's first joint is in the body, (3,) and (3, 3), and how the gripper is turned at its end, (3, 3)."""

    origin_b_m: Array
    rotation_b: Array
    gripper: Array

    def seen(self, position_b: Array, rotation_b: Array) -> tuple[Array, Array]:
        """Gripper poses (n, 3), (n, 3, 3) in the body as the arm has to place its end, (3, n) and (3, 3, n)."""
        position = self.rotation_b.T @ (position_b - self.origin_b_m).T
        columns = np.tensordot(self.gripper, rotation_b.T, axes=1)  # of rotation_b gripper^T
        return position, np.tensordot(columns, self.rotation_b, axes=(1, 0)).transpose(0, 2, 1)


@lru_cache(maxsize=16)
def arm_of(limb: Limb) -> tuple[Arm, Mounting]:
    """A limb's arm and how it is mounted."""
    poses: list[tuple[Array, Array]] = []  # of every joint's frame in the one before, and the gripper's in the last
    position, rotation = np.zeros(3), np.eye(3)
    for joint in limb.chain:
        position, rotation = position + rotation @ joint.origin_m, rotation @ joint.rotation
        if joint.kind == "revolute":
            frame = axis_frame(joint.axis)
            poses.append((position, rotation @ frame))
            position, rotation = np.zeros(3), frame.T
    poses.append((position, rotation))
    turns, offsets = np.array([turn for _, turn in poses[1:-1]]), np.array([offset for offset, _ in poses[1:]])
    low = np.where(np.isfinite(limb.lower_rad), limb.lower_rad, -np.pi)  # a whole turn of joints without limits
    high = np.where(np.isfinite(limb.upper_rad), limb.upper_rad, np.pi)
    return Arm(turns, offsets, low, high), Mounting(*poses[0], poses[-1][1])


@dataclass(frozen=True)
class Solution:
    """Joint angles (n, J) and what is left of the pose error: position (n,) [m], orientation (n,) [rad]."""

    q_rad: Array
    position_error_m: Array
    rotation_error_rad: Array


@dataclass(frozen=True)
class _Poses:
    """Where an arm is to have its end: positions (3, n) and rotations (3, 3, n), columns first."""

    position: Array
    columns: Array

    def __len__(self) -> int:
        return int(self.position.shape[1])

    def __getitem__(self, some: Indices | slice | list[int]) -> _Poses:
        return _Poses(self.position[:, some], self.columns[..., some])


def _together(poses: Iterable[_Poses]) -> _Poses:
    position, columns = zip(*((each.position, each.columns) for each in poses), strict=True)
    return _Poses(np.concatenate(position, axis=-1), np.concatenate(columns, axis=-1))


def solve(limbs: Sequence[Limb], position_b_m: Sequence[Array], rotation_b: Sequence[Array]) -> list[Solution]:
    """Joint angles of every limb for its gripper poses (n, 3), (n, 3, 3) in B that follow each other in time."""
    alike: dict[bytes, tuple[Arm, dict[int, _Poses]]] = {}
    for i, limb in enumerate(limbs):
        arm, mounting = arm_of(limb)
        poses = _Poses(*mounting.seen(position_b_m[i], rotation_b[i]))
        alike.setdefault(arm.alike, (arm, {}))[1][i] = poses
    found: dict[int, Solution] = {}
    for arm, wanted in alike.values():
        found |= zip(wanted, _solve_alike(arm, list(wanted.values())), strict=True)
    return [found[i] for i in range(len(limbs))]


def _solve_alike(arm: Arm, limbs: list[_Poses]) -> list[Solution]:
    """The same for limbs that have one arm."""
    n = len(limbs[0])
    some = np.unique(np.append(np.arange(0, n, STRIDE), n - 1))
    first = np.repeat(_firsts(arm, _together(poses[:1] for poses in limbs)), len(some), axis=1)
    between, _ = _descend(arm, first, _together(poses[some] for poses in limbs))
    found = []
    for poses, at in zip(limbs, np.split(between, len(limbs), axis=1), strict=True):
        start = np.array([np.interp(np.arange(n), some, angles) for angles in at])
        found.append(_follow(arm, start, poses))
    return found


def _follow(arm: Arm, start: Array, poses: _Poses) -> Solution:
    """All samples of one limb from angles (J, n) near its solution."""
    q, error = _descend(arm, start, poses)
    for _ in range(3):
        good = _good(arm, q, error)
        if good.all() or not good.any():
            break
        bad, fine = np.flatnonzero(~good), np.flatnonzero(good)
        nearest = fine[np.abs(fine[None, :] - bad[:, None]).argmin(axis=1)]
        again, left = _descend(arm, q[:, nearest], poses[bad])
        better = _good(arm, again, left) | (left.sum(axis=0) < 0.5 * error[:, bad].sum(axis=0))
        q[:, bad[better]], error[:, bad[better]] = again[:, better], left[:, better]
        if not better.any():
            break
    return Solution(q.T, error[0], error[1] / ROTATION_LENGTH_M)


def _good(arm: Arm, q: Array, error: Array) -> Flags:
    angles = q.T
    inside = ((angles >= arm.lower_rad - 1e-9) & (angles <= arm.upper_rad + 1e-9)).all(axis=1)
    return np.asarray(inside & (error.max(axis=0) < 1e-5))


def _firsts(arm: Arm, poses: _Poses) -> Array:
    """Of every pose the best of the descents from the postures nearest to it, (J, n): inside the limits if any is."""
    postures, at = _postures(arm)
    seeds = []
    for i in range(len(poses)):
        away = _pose_error(at, poses[[i]])
        seeds.append(postures[:, np.argsort(np.sqrt((away * away).sum(axis=0)))[:SEEDS]])
    q, error = _descend(arm, np.concatenate(seeds, axis=1), poses[np.repeat(np.arange(len(poses)), SEEDS)])
    lower, upper = arm.lower_rad[:, None], arm.upper_rad[:, None]
    outside = np.maximum(np.maximum(lower - q, q - upper), 0.0).sum(axis=0)
    best = np.argmin((error.sum(axis=0) * 1e3 + outside).reshape(-1, SEEDS), axis=1)
    return q[:, best + SEEDS * np.arange(len(poses))]


@lru_cache(maxsize=16)
def _postures(arm: Arm) -> tuple[Array, _Poses]:
    """Postures (J, m) spread over the joint ranges, and where the arm's end is there."""
    spread = _evenly_spread(SEED_POSTURES, len(arm.lower_rad))
    postures = np.ascontiguousarray((arm.lower_rad + spread * (arm.upper_rad - arm.lower_rad)).T)
    return postures, _Poses(*arm.forward(postures)[:2])


@lru_cache(maxsize=16)
def _spare(arm: Arm) -> Array:
    """(J - 6, J) what leaves the end at rest in the middle of the joints' ranges. Of the angles of seven joints those
    count that are none of it off the middle.
    """
    middle = 0.5 * (arm.lower_rad + arm.upper_rad)[:, None]
    position, _, origins, axes = arm.forward(middle)
    _, _, ways = np.linalg.svd(jacobian(position, origins, axes)[..., 0])
    return np.asarray(ways[6:])


def _evenly_spread(count: int, dimension: int) -> Array:
    """Low-discrepancy points (count, dimension) of the unit cube: multiples of powers of 1/phi_d, modulo 1, with phi_d
    the positive root of x^(d + 1) = x + 1 (Roberts 2018).
    """
    root = 1.5
    for _ in range(40):
        root = (1.0 + root) ** (1.0 / (dimension + 1))
    return np.asarray(np.outer(np.arange(1, count + 1), root ** -np.arange(1.0, dimension + 1)) % 1.0)


def _pose_error(at: _Poses, wanted: _Poses) -> Array:
    """Position and weighted rotation vector (6, n) from poses to the wanted ones."""
    columns, there = at.columns, wanted.columns
    skew = 0.5 * (cross(columns[0], there[0]) + cross(columns[1], there[1]) + cross(columns[2], there[2]))
    cosine = np.clip(0.5 * ((columns * there).sum(axis=(0, 1)) - 1.0), -1.0, 1.0)
    sine = np.sqrt((skew * skew).sum(axis=0))
    turning = sine > 1e-9
    turn = skew * np.where(turning, np.arctan2(sine, cosine) / np.where(turning, sine, 1.0), 1.0)
    half_turn = np.flatnonzero((sine <= 1e-6) & (cosine < 0.0))
    if len(half_turn) > 0:
        shape = np.broadcast_shapes(columns.shape, there.shape)
        columns, there = np.broadcast_to(columns, shape), np.broadcast_to(there, shape)
        difference = np.einsum("icn,ijn->ncj", there[..., half_turn], columns[..., half_turn])
        turn[:, half_turn] = rotation_vector(difference).T
    return np.concatenate([wanted.position - at.position, ROTATION_LENGTH_M * turn])


def _descend(arm: Arm, start: Array, poses: _Poses) -> tuple[Array, Array]:
    """Damped Gauss-Newton from angles (J, n); returns angles and the norms (2, n) of position and weighted orientation
    errors.
    """
    q = angles = start.copy()
    left = np.full((2, q.shape[1]), np.inf)
    active = np.arange(q.shape[1])
    weight = np.array([1.0, 1.0, 1.0, ROTATION_LENGTH_M, ROTATION_LENGTH_M, ROTATION_LENGTH_M])[:, None, None]
    spare = ROTATION_LENGTH_M * _spare(arm) if len(q) > 6 else np.zeros((0, len(q)))
    middle = 0.5 * (arm.lower_rad + arm.upper_rad)[:, None]
    for iteration in range(ITERATIONS):
        position, columns, origins, axes = arm.forward(angles)
        error = _pose_error(_Poses(position, columns), poses)
        if len(spare):
            error = np.concatenate([error, spare @ (middle - angles)])
        squares = error * error
        left[:, active] = now = np.sqrt([squares[:3].sum(axis=0), squares[3:].sum(axis=0)])
        moving = np.flatnonzero(now.max(axis=0) > CONVERGED_M)
        if iteration == ITERATIONS - 1 or len(moving) == 0:
            break
        if len(moving) < len(active):
            active, angles, poses = active[moving], angles[:, moving], poses[moving]
            position, origins, axes = position[:, moving], origins[..., moving], axes[..., moving]
            error, squares = error[:, moving], squares[:, moving]
        by_angle = weight * jacobian(position, origins, axes)
        if len(spare):
            by_angle = np.concatenate([by_angle, np.broadcast_to(spare[..., None], (*spare.shape, len(moving)))])
        normal = np.einsum("ijn,kjn->ikn", by_angle, by_angle)
        every = range(len(normal))
        normal[every, every] += 0.01 * squares.sum(axis=0) + 1e-12
        step = np.einsum("ijn,in->jn", by_angle, solved(normal, error))
        size = np.abs(step).max(axis=0)
        angles = angles + step * np.minimum(1.0, MAX_STEP_RAD / np.maximum(size, 1e-12))
        q[:, active] = angles
    return middle + (q - middle + np.pi) % (2.0 * np.pi) - np.pi, left
