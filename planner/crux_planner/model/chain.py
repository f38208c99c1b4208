"""Kinematics of a limb of any revolute joints, for many grippers at once: forward, and numeric inverse on a branch.

A pose may have several solutions. The branch is the one that connects to the limb's posture, the middle of its joint
limits, with no singular posture in between: the sign of det J stays. Of limbs of fewer than six joints J has the turns
that they lack (crux_contracts.still_turns), which are no angles of theirs but what a pose misses. Of seven joints those
angles count that are least far from the posture, to first order there: J has a row for it.

Postures near a lattice of upright grippers are found once a limb, each from a neighbour's, and kept; any pose starts
from the nearest of them, by Newton's method.

Arrays of many poses have the pose last: vectors (3, n), rotations (3, 3, n) by row and column.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from crux_contracts.robot import Limb
from crux_contracts.robot_types import AtZero

from crux_planner.model import chain_native, kept
from crux_planner.model.arrays import Array, Flags, Indices

STEP_M, STEP_RAD = 0.05, 0.35  # of the lattice
SEEDS, NEAREST = 4096, 24  # postures, and how many of them a first pose is looked for from
BEYOND_RAD = 0.3  # that lattice postures may be beyond joint limits: poses near them start there
FREE_RAD = 0.9  # that lattice postures may be turned in ways in which a limb has no joint
LARGEST_STEP_RAD = 0.5  # of Newton's method
FARTHEST_RAD = 1.2  # between neighbours' angles: more is another branch
CLOSE = 1e-9  # [m] and [rad] off a pose that is reached
POSE = 6  # numbers of a pose
LEAST_DAMPING, MOST_DAMPING = 1e-3, 0.1  # of Newton's method for an error of 1, from a neighbour, and from far away
ITERATIONS, MOST_ITERATIONS = 7, 48  # from a neighbour, and from far away
_DAMPING = 1e-10  # of the inverse Jacobian where a pose is reached
_DAMPED = 1e-3  # and where it is not


@dataclass(frozen=True, eq=False)
class Placed:
    """Of a chain at n postures: its joints' axes and points on them (S, 3, n), links' rotations relative to those at
    zero (S, 3, 3, n), the gripper's place (3, n) and rotation (3, 3, n).
    """

    axes: Array
    points_m: Array
    turns: Array
    gripper_m: Array
    rotation: Array

    def jacobian(self) -> Array:
        """(n, 6, S) of the gripper: rows v, omega."""
        arm = self.gripper_m - self.points_m
        linear = np.stack([_cross(axis, off) for axis, off in zip(self.axes, arm, strict=True)])
        return np.ascontiguousarray(np.concatenate([linear, self.axes], axis=1).transpose(2, 1, 0))


def forward(at_zero: AtZero, q_rad: Array) -> Placed:
    """Of joint angles (n, S)."""
    count = len(q_rad)
    turn = np.broadcast_to(np.eye(3)[..., None], (3, 3, count))
    place = np.zeros((3, count))
    axes, points, turns = [], [], []
    for axis, point, angle in zip(at_zero.axes, at_zero.points_m, q_rad.T, strict=True):
        axes.append(_turned(turn, axis))
        points.append(place + _turned(turn, point))
        turn = np.einsum("ijn,jkn->ikn", turn, about(axis, angle))
        place = points[-1] - _turned(turn, point)
        turns.append(turn)
    rotation = np.einsum("ijn,jk->ikn", turn, at_zero.gripper_rotation)
    gripper = place + _turned(turn, at_zero.gripper_m)
    return Placed(np.stack(axes), np.stack(points), np.stack(turns), gripper, rotation)


def about(axis: Array, angle: Array) -> Array:
    """Rotations (3, 3, n) about one axis."""
    x, y, z = axis
    skew = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    sine, cosine = np.sin(angle), np.cos(angle)
    return np.asarray(np.eye(3)[..., None] + sine * skew[..., None] + (1.0 - cosine) * (skew @ skew)[..., None])


def pose_error(placed: Placed, place: Array, rotation: Array) -> Array:
    """(6, n) from the gripper to places (3, n) and rotations (3, 3, n): to first order what joints have to do."""
    columns = zip(placed.rotation.transpose(1, 0, 2), rotation.transpose(1, 0, 2), strict=True)
    turn = sum(_cross(here, there) for here, there in columns)
    return np.concatenate([place - placed.gripper_m, 0.5 * np.asarray(turn)])


@dataclass(frozen=True, eq=False)
class ChainInverse:
    """Inverse kinematics of one limb."""

    limb: Limb

    @cached_property
    def middle_rad(self) -> Array:
        """(S,) the posture whose branch it is."""
        return self.limb.middle_rad

    @cached_property
    def _free_rad(self) -> tuple[Array, Array]:
        """(S,), (S,) limits of the joints, and how far poses of the lattice may be turned in other ways."""
        low, high, own = self.limb.lower_rad, self.limb.upper_rad, len(self.limb.joints)
        low[own:], high[own:] = -FREE_RAD, FREE_RAD
        return low, high

    @cached_property
    def _rule(self) -> Array:
        """(S - 6, S) what leaves the gripper at rest in the posture: angles are none of it off that."""
        _, _, ways = np.linalg.svd(forward(self.limb.at_zero, self.middle_rad[None]).jacobian()[0])
        return np.asarray(ways[POSE:])

    @cached_property
    def sign(self) -> float:
        """Of det J on the branch."""
        return float(np.sign(np.linalg.det(self._jacobian(self.middle_rad[None]))[0]))

    @cached_property
    def _origin_m(self) -> Array:
        return np.asarray(self.limb.at_zero.points_m[0])

    @cached_property
    def _half(self) -> int:
        """Nodes of the lattice on either side of the first joint, along each axis."""
        return int(np.ceil(self.limb.longest_m / STEP_M))

    @cached_property
    def _turns(self) -> int:
        """Of yaws."""
        return int(np.ceil(2 * np.pi / STEP_RAD))

    @cached_property
    def _lattice(self) -> Array:
        """(x, y, z, yaw, S) angles of upright grippers; NaN where the branch has none nearby."""
        name = "postures", self.limb.at_zero, self.middle_rad, self.limb.lower_rad, self.limb.upper_rad
        lattice: Array = kept.arrays(__file__, name, lambda: {"q": _spread(self._postures())})["q"]
        return lattice

    def _postures(self) -> Array:
        """The lattice, node by node from those found first."""
        side = 2 * self._half + 1
        shape = (side, side, side, self._turns)
        found = np.full((*shape, len(self.middle_rad)), np.nan)
        tried = np.zeros(shape, dtype=bool)
        front = self._first(found, tried)
        steps = [each for axis in range(4) for each in (np.eye(4, dtype=int)[axis], -np.eye(4, dtype=int)[axis])]
        while len(front):
            new: list[Indices] = []
            for step in steps:
                to = front + step
                to[:, 3] %= self._turns
                inside = ((to >= 0) & (to < shape)).all(axis=1)
                flat = np.ravel_multi_index(tuple(to[inside].T), shape)
                flat, first = np.unique(flat, return_index=True)
                begin = front[inside][first]
                fresh = ~tried.reshape(-1)[flat]
                flat, begin = flat[fresh], begin[fresh]
                if not len(flat):
                    continue
                node = np.stack(np.unravel_index(flat, shape), axis=1)
                start = found[tuple(begin.T)]
                q, ok = self.from_near(start, *self._poses(node))
                ok &= (np.abs(q - start).max(axis=1) < FARTHEST_RAD) & self._near_limits(q)
                found[tuple(node[ok].T)] = q[ok]
                tried.reshape(-1)[flat[ok]] = True
                new.append(node[ok])
            front = np.concatenate(new) if new else np.zeros((0, 4), dtype=int)
        return found

    def _first(self, found: Array, tried: Flags) -> Indices:
        """Nodes (n, 4) near the grippers of postures that connect to the middle one straight away."""
        low, high = self._free_rad
        seeds = self.limb.lower_rad + _evenly_spread(SEEDS, len(low)) * (self.limb.upper_rad - self.limb.lower_rad)
        shares = np.linspace(0.0, 1.0, 12)[:, None, None]
        way = (self.middle_rad + shares * (seeds - self.middle_rad)).reshape(-1, len(low))
        same = (np.sign(np.linalg.det(self._jacobian(way))) == self.sign).reshape(len(shares), -1).all(axis=0)
        seeds = seeds[same]
        placed = forward(self.limb.at_zero, seeds)
        upright = np.argsort(-placed.rotation[2, 2], kind="stable")[: SEEDS // NEAREST]
        seeds, place, turn = seeds[upright], placed.gripper_m[:, upright], placed.rotation[..., upright]
        node = self._nearest(place, turn)
        q, ok = self._solved(seeds, *self._poses(node), damped=True)
        ok &= ((q >= low) & (q <= high)).all(axis=1)
        way = (self.middle_rad + shares * (q - self.middle_rad)).reshape(-1, len(low))
        ok &= (np.sign(np.linalg.det(self._jacobian(way))) == self.sign).reshape(len(shares), -1).all(axis=0)
        found[tuple(node[ok].T)] = q[ok]
        tried[tuple(node[ok].T)] = True
        return np.unique(node[ok], axis=0)

    def inverse(self, position_b_m: Array, rotation_b: Array) -> tuple[Array, Flags]:
        """Angles (..., S) of poses (..., 3), (..., 3, 3), and whether they are reached on the branch (...)."""
        shape = np.broadcast_shapes(position_b_m.shape[:-1], rotation_b.shape[:-2])
        places = np.broadcast_to(position_b_m, (*shape, 3)).reshape(-1, 3)
        turns = np.broadcast_to(rotation_b, (*shape, 3, 3)).reshape(-1, 3, 3)
        compiled = chain_native.library()
        if compiled is None:
            q, reached = self._from_lattice(places.T, turns.transpose(1, 2, 0))
        else:
            q, reached = chain_native.found(compiled, self.compiled, self.compiled_lattice, places, turns)
        return q.reshape(*shape, len(self.middle_rad)), reached.reshape(shape)

    def _from_lattice(self, place: Array, turn: Array) -> tuple[Array, Flags]:
        """Of poses (3, n), (3, 3, n)."""
        start = self._lattice[tuple(self._nearest(place, turn).T)]
        known = ~np.isnan(start[:, 0])
        q = np.tile(self.middle_rad, (place.shape[1], 1))
        reached = np.zeros(len(q), dtype=bool)
        q[known], reached[known] = self.from_near(start[known], place[:, known], turn[..., known])
        return q, reached

    def from_near(self, start: Array, place: Array, turn: Array) -> tuple[Array, Flags]:
        """Angles (n, S) of poses (3, n), (3, 3, n) from those of poses near by, and whether they are reached on the
        branch. By numpy where the compiled part is missing.
        """
        compiled = chain_native.library()
        if compiled is None:
            return self._solved(start, place, turn)
        return chain_native.inverse(compiled, self.compiled, start, place.T, turn.transpose(2, 0, 1))

    @cached_property
    def compiled(self) -> chain_native.Chain:
        """As the compiled part has the limb."""
        numbers = CLOSE, LEAST_DAMPING, LARGEST_STEP_RAD, ITERATIONS
        return chain_native.chain(self.limb.at_zero, self._rule, self.middle_rad, self.sign, numbers)

    @cached_property
    def compiled_lattice(self) -> chain_native.Lattice:
        """As the compiled part has the lattice."""
        return chain_native.lattice(self._lattice, self._origin_m, STEP_M)

    def seeds(self, q_rad: Array, reached: Flags) -> Array:
        """(n, 7 S) what smooth kinematics near solutions (n, S) start from: the angles and the inverse Jacobians."""
        damping, compiled = np.where(reached, _DAMPING, _DAMPED), chain_native.library()
        if compiled is None:
            jacobian = self._jacobian(q_rad)
            across = np.swapaxes(jacobian, 1, 2)
            normal = jacobian @ across + damping[:, None, None] * np.eye(q_rad.shape[1])
            back = (across @ np.linalg.inv(normal))[..., :POSE]
        else:
            back = chain_native.back(compiled, self.compiled, q_rad, damping)
        return np.concatenate([q_rad, back.reshape(len(q_rad), POSE * q_rad.shape[1])], axis=1)

    def _solved(self, start: Array, place: Array, turn: Array, *, damped: bool = False) -> tuple[Array, Flags]:
        """Angles (n, S), and whether they have the pose and are on the branch."""
        q, reached = start.copy(), np.zeros(len(start), dtype=bool)
        active = np.arange(len(q))
        for _ in range(MOST_ITERATIONS if damped else ITERATIONS):
            placed = forward(self.limb.at_zero, q[active])
            error = pose_error(placed, place[:, active], turn[..., active])
            if len(self._rule):
                error = np.concatenate([error, self._rule @ (self.middle_rad - q[active]).T])
            facing = (placed.rotation * turn[..., active]).sum(axis=(0, 1)) > 1.0  # less than a right angle off
            left = np.abs(error).max(axis=0)
            jacobian = self._with_rule(placed)
            here = (left < CLOSE) & facing
            done = active[here]
            reached[done] = np.sign(np.linalg.det(jacobian[here])) == self.sign
            active, error, jacobian = active[~here], error[:, ~here], jacobian[~here]
            if not len(active):
                break
            back = np.swapaxes(jacobian, 1, 2)
            more = np.minimum(left[~here], 1.0) ** 2 * (MOST_DAMPING if damped else LEAST_DAMPING) + 1e-13
            normal = jacobian @ back + more[:, None, None] * np.eye(len(error))
            move = (back @ np.linalg.solve(normal, error.T[..., None]))[..., 0]
            most = np.abs(move).max(axis=1, keepdims=True)
            q[active] += move * np.minimum(1.0, LARGEST_STEP_RAD / np.maximum(most, 1e-12))
        return q, reached

    def _jacobian(self, q_rad: Array) -> Array:
        """(n, S, S)"""
        return self._with_rule(forward(self.limb.at_zero, q_rad))

    def _with_rule(self, placed: Placed) -> Array:
        found = placed.jacobian()
        if not len(self._rule):
            return found
        return np.concatenate([found, np.broadcast_to(self._rule, (len(found), *self._rule.shape))], axis=1)

    def _near_limits(self, q: Array) -> Flags:
        low, high = self._free_rad
        return np.asarray(((q >= low - BEYOND_RAD) & (q <= high + BEYOND_RAD)).all(axis=1))

    def _poses(self, node: Indices) -> tuple[Array, Array]:
        """Of upright grippers at nodes (n, 4)."""
        place = self._origin_m + STEP_M * (node[:, :3] - self._half)
        yaw = np.asarray(2 * np.pi / self._turns * node[:, 3], dtype=np.float64)
        return place.T, about(np.array([0.0, 0.0, 1.0]), yaw)

    def _nearest(self, place: Array, turn: Array) -> Indices:
        """The nodes (n, 4) nearest to poses."""
        yaw = np.arctan2(turn[1, 0], turn[0, 0])
        at = np.rint((place.T - self._origin_m) / STEP_M).astype(int) + self._half
        around = np.rint(yaw / (2 * np.pi / self._turns)).astype(int) % self._turns
        return np.concatenate([np.clip(at, 0, 2 * self._half), around[:, None]], axis=1)


_KNOWN: dict[bytes, ChainInverse] = {}


def chain_inverse(limb: Limb) -> ChainInverse:
    """Once a process for limbs that are the same."""
    zero = limb.at_zero
    limits = limb.middle_rad, limb.lower_rad, limb.upper_rad
    parts = (zero.axes, zero.points_m, zero.gripper_m, zero.gripper_rotation, *limits)
    key = b"".join(part.tobytes() for part in parts)
    if key not in _KNOWN:
        _KNOWN[key] = ChainInverse(limb)
    return _KNOWN[key]


def _spread(postures: Array) -> Array:
    """The same, with nodes of no posture next to others from theirs, to start from: along x, y, z and yaw."""
    for axis in range(4):
        for step in (1, -1):
            near = np.roll(postures, step, axis=axis)
            if axis < 3:
                edge: list[slice | int] = [slice(None)] * 5
                edge[axis] = 0 if step > 0 else -1
                near[tuple(edge)] = np.nan
            postures = np.where(np.isnan(postures), near, postures)
    return postures


def _evenly_spread(count: int, dimension: int) -> Array:
    """Points (count, dimension) of the unit cube: multiples of powers of 1/phi, modulo 1 (Roberts 2018)."""
    root = 1.5
    for _ in range(40):
        root = (1.0 + root) ** (1.0 / (dimension + 1))
    return np.asarray(np.outer(np.arange(1, count + 1), root ** -np.arange(1.0, dimension + 1)) % 1.0)


def _turned(turn: Array, vector: Array) -> Array:
    """(3, n) of rotations (3, 3, n) and one vector (3,)."""
    return np.asarray(turn[:, 0] * vector[0] + turn[:, 1] * vector[1] + turn[:, 2] * vector[2])


def _cross(a: Array, b: Array) -> Array:
    return np.stack([a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]])
