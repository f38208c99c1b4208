"""Numeric inverse kinematics of the limbs for many gripper poses at once: damped Gauss-Newton on the pose error.

A first pose is reached from the nearest of many postures spread over the joint ranges; from its solution a few others
start, and from between these all others; those that fail, or end outside the joint limits, start again from the
nearest sample in time that did not. Where angles jump, they go on from the sample before if the limits allow. Limbs
that differ only in where their first joint sits and how their gripper is mounted have the same arm, and take the first
two steps together.

Every joint of an arm has a frame whose z is its axis, so that each is a turn about z after one constant turn.
libcrux_checker.so walks along the arms.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np
from crux_contracts.compiled import doubles

from crux_planner.checker import native
from crux_planner.checker.geometry import Array, Flags, Indices
from crux_planner.checker.limb_model import Limb, axis_frame

SEED_POSTURES = 1024
SEEDS = 16  # of these, the nearest to a first pose
JUMP_RAD = 0.5  # of a joint between samples: more may be another solution
STRIDE = 8  # samples of which one is solved from the first pose, the others from what lies between two such


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

    def forward(self, q_rad: Array) -> tuple[Array, Array, Array]:
        """Of the end at joint angles (n, J): positions (n, 3), rotations (n, 3, 3), and geometric Jacobians (n, 6, J)
        with rows v, omega.
        """
        angles, n = np.ascontiguousarray(q_rad), len(q_rad)
        placed = np.empty((n, 3)), np.empty((n, 3, 3)), np.empty((n, 6, len(self.lower_rad)))
        native.library().crux_arm_place(self._bare, n, *map(doubles, (angles, *placed)))
        return placed

    def reached(self, q_rad: Array, poses: _Poses) -> tuple[Array, Array]:
        """By damped Gauss-Newton from angles (n, J): angles, and the norms (n, 2) of the errors left of position and
        orientation; with seven joints, what `_compiled` says is spare counts with the latter.
        """
        angles, left = np.array(q_rad, order="C"), np.empty((len(q_rad), 2))
        given = [np.ascontiguousarray(part) for part in (poses.position, poses.rotation)]
        native.library().crux_arm_reach(self._compiled, len(angles), *map(doubles, (*given, angles, left)))
        return angles, left

    def _with(self, spare: Array) -> native.Arm:
        middle = 0.5 * (self.lower_rad + self.upper_rad)
        kept = [np.ascontiguousarray(part, dtype=float) for part in (self.turns, self.offsets, middle, spare)]
        made = native.Arm(len(middle), len(spare), *map(doubles, kept))
        made.kept = kept
        return made

    @cached_property
    def _bare(self) -> native.Arm:
        return self._with(np.zeros((0, len(self.lower_rad))))

    @cached_property
    def _compiled(self) -> native.Arm:
        """With what leaves the end at rest in the middle of the joints' ranges. Of the angles of seven joints those
        count that are none of it off the middle.
        """
        _, _, jacobian = self.forward(0.5 * (self.lower_rad + self.upper_rad)[None])
        return self._with(np.linalg.svd(jacobian[0])[2][6:])


@dataclass(frozen=True)
class Mounting:
    """Where an arm's first joint is in the body, (3,) and (3, 3), and how the gripper is turned at its end, (3, 3)."""

    origin_b_m: Array
    rotation_b: Array
    gripper: Array

    def seen(self, position_b: Array, rotation_b: Array) -> tuple[Array, Array]:
        """Gripper poses (n, 3), (n, 3, 3) in the body as the arm has to place its end."""
        return (position_b - self.origin_b_m) @ self.rotation_b, self.rotation_b.T @ rotation_b @ self.gripper.T


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
    """Where an arm is to have its end: positions (n, 3) and rotations (n, 3, 3)."""

    position: Array
    rotation: Array

    def __len__(self) -> int:
        return len(self.position)

    def __getitem__(self, some: Indices | slice) -> _Poses:
        return _Poses(self.position[some], self.rotation[some])


def _together(poses: Iterable[_Poses]) -> _Poses:
    position, rotation = zip(*((each.position, each.rotation) for each in poses), strict=True)
    return _Poses(np.concatenate(position), np.concatenate(rotation))


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
    first = np.repeat(_firsts(arm, _together(poses[:1] for poses in limbs)), len(some), axis=0)
    between, _ = arm.reached(first, _together(poses[some] for poses in limbs))
    found = []
    for poses, at in zip(limbs, np.split(between, len(limbs)), strict=True):
        start = np.array([np.interp(np.arange(n), some, angles) for angles in at.T]).T
        found.append(_follow(arm, start, poses))
    return found


def _follow(arm: Arm, start: Array, poses: _Poses) -> Solution:
    """All samples of one limb from angles (n, J) near its solution."""
    q, error = arm.reached(start, poses)
    for _ in range(3):
        good = _good(arm, q, error)
        if good.all() or not good.any():
            break
        bad, fine = np.flatnonzero(~good), np.flatnonzero(good)
        nearest = fine[np.abs(fine[None, :] - bad[:, None]).argmin(axis=1)]
        again, left = arm.reached(q[nearest], poses[bad])
        better = _good(arm, again, left) | (left.sum(axis=1) < 0.5 * error[bad].sum(axis=1))
        q[bad[better]], error[bad[better]] = again[better], left[better]
        if not better.any():
            break
    _continue(arm, q, error, poses)
    return Solution(q, *error.T)


def _continue(arm: Arm, q: Array, error: Array, poses: _Poses) -> None:
    """Goes on from the sample before wherever angles (n, J) jump to another solution, such as that of a turned wrist,
    although the limits allow to.
    """
    at = 0
    for jump in np.flatnonzero(np.abs(np.diff(q, axis=0)).max(axis=1) > JUMP_RAD) + 1:
        at = max(at, int(jump))
        while at < len(q) and np.abs(q[at] - q[at - 1]).max() > JUMP_RAD:
            again, left = arm.reached(q[at - 1 : at], poses[at : at + 1])
            if not _good(arm, again, left)[0] or np.abs(again[0] - q[at - 1]).max() > JUMP_RAD:
                break
            q[at], error[at] = again[0], left[0]
            at += 1


def _good(arm: Arm, q: Array, error: Array) -> Flags:
    inside = ((q >= arm.lower_rad - 1e-9) & (q <= arm.upper_rad + 1e-9)).all(axis=1)
    return np.asarray(inside & (error.max(axis=1) < 1e-5))


def _firsts(arm: Arm, poses: _Poses) -> Array:
    """Of every pose the best of the descents from the postures nearest to it, (n, J): inside the limits if any is, and
    of these the one nearest to their middle.
    """
    postures, at = _postures(arm)
    cosine = 0.5 * (np.einsum("nij,mij->nm", poses.rotation, at.rotation) - 1.0)
    away = ((poses.position[:, None] - at.position) ** 2).sum(axis=2) + np.arccos(np.clip(cosine, -1.0, 1.0)) ** 2
    away[:, 0] = -1.0  # the middle posture is always one of them
    seeds = np.argsort(away, axis=1)[:, :SEEDS].ravel()
    q, error = arm.reached(postures[seeds], poses[np.repeat(np.arange(len(poses)), SEEDS)])
    outside = np.maximum(np.maximum(arm.lower_rad - q, q - arm.upper_rad), 0.0).sum(axis=1)
    middle, half = (arm.lower_rad + arm.upper_rad) / 2, (arm.upper_rad - arm.lower_rad) / 2
    off = np.where(_good(arm, q, error), np.abs((q - middle) / half).max(axis=1), 1.0)
    best = np.argmin((error.sum(axis=1) * 1e3 + outside + off).reshape(-1, SEEDS), axis=1)
    return np.asarray(q[best + SEEDS * np.arange(len(poses))])


@lru_cache(maxsize=16)
def _postures(arm: Arm) -> tuple[Array, _Poses]:
    """Postures (m, J), the middle of the joint ranges and others spread over them, and where the arm's end is there."""
    spread = np.vstack([np.full(len(arm.lower_rad), 0.5), _evenly_spread(SEED_POSTURES, len(arm.lower_rad))])
    postures = arm.lower_rad + spread * (arm.upper_rad - arm.lower_rad)
    return postures, _Poses(*arm.forward(postures)[:2])


def _evenly_spread(count: int, dimension: int) -> Array:
    """Low-discrepancy points (count, dimension) of the unit cube: multiples of powers of 1/phi_d, modulo 1, with phi_d
    the positive root of x^(d + 1) = x + 1 (Roberts 2018).
    """
    root = 1.5
    for _ in range(40):
        root = (1.0 + root) ** (1.0 / (dimension + 1))
    return np.asarray(np.outer(np.arange(1, count + 1), root ** -np.arange(1.0, dimension + 1)) % 1.0)
