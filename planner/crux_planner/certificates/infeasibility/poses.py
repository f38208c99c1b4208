"""Whether one pose of the body has several grips in reach: (9a) of all limbs at once.

Reach bounds v = R(theta)^T (c - r) along some directions. In a box of roll, pitch and yaw, v is linear in these angles,
in the body's place in its own frame and in where on its face each grasp is, but for a rest that is bounded: a linear
program. Tilt, place and heading are the same for all limbs, where bounds of each of them alone would choose anew for
each. Boxes of angles are halved until all are shown to have no pose, or one is found.
"""

import itertools
from collections.abc import Iterable, Sequence
from dataclasses import dataclass

import numpy as np
from crux_contracts import N_LIMBS

from crux_planner.model.arrays import Array
from crux_planner.model.contacts import Grip
from crux_planner.model.kinematics import rotation_from_rpy
from crux_planner.model.problem import Problem
from crux_planner.physics.limit_surface import polytope_directions
from crux_planner.solvers.qp import Qp

TOLERANCE_M, TOLERANCE_RAD = 3e-4, 1.2e-3  # more than the check forgives, and than the solvers' rounding
BOXES = 60  # of angles looked at for one question
PROGRAMS = 400  # linear programs solved for one goal
LOOKED_AT = 24  # stances, for how much the best lacks
_LOOKS, _LOOK_RAD = 16, 0.01
_ROUND = 0.01  # share by which a ball's tangents may let a pose be outside it
_REGULAR = 1e-7  # of a program's cost, to make it strictly convex
_PLACE, _ANGLES, _POSE = slice(0, 3), slice(3, 6), 6  # variables: place in the body's own frame, angles, then the grips


@dataclass(frozen=True)
class PoseProgram:
    """rows @ x <= right, low <= x <= high for x = (place, roll, pitch, yaw, (aside, height) of each grip).

    The first `reach` rows are those of (9a).
    """

    reach: int
    rows: Array
    right: Array
    low: Array
    high: Array

    def solve(self) -> tuple[float, Array]:
        """Distance [m] by which all reach must grow at least for a pose to exist (not positive: none), and where that
        leads. The multipliers show it, not the solver's word.
        """
        n = len(self.low) + 1
        cost, linear = _REGULAR * np.eye(n), np.zeros(n)
        linear[-1] = 1.0
        rows = np.column_stack([self.rows, -(np.arange(len(self.rows)) < self.reach).astype(float)])
        low, high = np.append(self.low, -1.0), np.append(self.high, 10.0)
        qp = Qp(cost, linear, None, (rows, None, self.right), low, high, eps_abs=1e-7, max_iter=100)
        found = qp.solve()
        if not found.solved:
            return 0.0, (self.low + self.high) / 2  # nothing shown
        return qp.constraints.shown_least(linear, found.multipliers, found.of_rows), found.x[:-1]


class GoalPoses:
    """Body poses within the goal's tolerances: distance, and angle of the one rotation."""

    def __init__(self, problem: Problem) -> None:
        self.problem, self.goal = problem, problem.goal
        self._solved = 0
        self.rates = body_rates(self.goal.body.rpy_rad)
        first = polytope_directions(1.0)[0]
        first /= np.linalg.norm(first, axis=1)[:, None]
        self._place_cuts, self._angle_cuts = list(first), list(first)  # unit vectors: tangents of the two balls

    def possible(self, stances: Iterable[tuple[int, ...]], grips: list[Grip]) -> list[tuple[int, ...]]:
        """The stances (numbers of `grips` by limb) that are not shown to be out of reach.

        What the first limbs lack, the whole stance does. After `PROGRAMS`, stances are left as they are.
        """
        kept = np.array(list(stances), dtype=int).reshape(-1, N_LIMBS)
        for count in range(2, N_LIMBS + 1):
            firsts, at = np.unique(kept[:, :count], axis=0, return_inverse=True)
            tried = (
                self._solved >= PROGRAMS or self.lacking(_by_limb(first, grips)) <= 0.0 for first in firsts.tolist()
            )
            kept = kept[np.fromiter(tried, bool, len(firsts))[at.ravel()]]
        return [tuple(stance) for stance in kept.tolist()]

    def shortage(self, stances: Iterable[tuple[int, ...]], grips: list[Grip]) -> float:
        """About how far [m] the best of these stances is from being in reach, by looking where the program leads."""
        return min(self._nearly(_by_limb(stance, grips)) for stance in itertools.islice(stances, LOOKED_AT))

    def _nearly(self, grips: dict[int, Grip]) -> float:
        lowest, highest = low, high = self._angles()
        least = np.inf
        for _ in range(_LOOKS):
            lacking, x = self._program(grips, low, high).solve()
            if not self._cut(x):
                least = lacking
                low, high = np.maximum(lowest, x[_ANGLES] - _LOOK_RAD), np.minimum(highest, x[_ANGLES] + _LOOK_RAD)
        return least + TOLERANCE_M

    def lacking(self, grips: dict[int, Grip]) -> float:
        """How far [m] (9a) of these grips by limb is from being met at once; not positive: nothing is shown."""
        least, boxes = np.inf, [self._angles()]
        for _ in range(BOXES):
            low, high = boxes.pop()
            self._solved += 1
            lacking, x = self._program(grips, low, high).solve()
            if lacking > 0.0:
                least = min(least, lacking)
            elif self._cut(x):
                boxes.append((low, high))
            elif self._holds(grips, x):
                return lacking
            else:
                widest = int(np.argmax(high - low))
                cut = np.eye(3)[widest] * (high - low) / 2
                boxes += [(low, high - cut), (low + cut, high)]
            if not boxes:
                return least
        return 0.0

    def box(self) -> tuple[Array, Array]:
        """Bounds (6,) of x, y, z, yaw, roll and pitch."""
        at, off = self.goal.body.position_m, self.place_m
        low, high = self._angles()
        return np.concatenate([at - off, low[[2, 0, 1]]]), np.concatenate([at + off, high[[2, 0, 1]]])

    def _angles(self) -> tuple[Array, Array]:
        """Bounds of roll, pitch and yaw at the goal."""
        tilt, goal = self.problem.body.max_tilt_rad + TOLERANCE_RAD, self.goal.body.rpy_rad
        slack, most = (1.0 + tilt) * self.angle_rad, np.array([tilt, tilt, np.inf])
        return np.maximum(goal - slack, -most), np.minimum(goal + slack, most)

    @property
    def place_m(self) -> float:
        return self.goal.tolerance_m + TOLERANCE_M

    @property
    def angle_rad(self) -> float:
        """Bound of the change of roll, pitch and yaw as a vector, turned into body rates, at the goal's tolerance.

        Turns about z, y, x in a row differ from one turn by the same vector by terms of third order, and of second
        order where the goal is tilted.
        """
        tolerance = self.goal.tolerance_rad
        higher = 3 * tolerance**2 * (tolerance + np.abs(self.goal.body.rpy_rad[:2]).sum())
        return float(tolerance + higher + TOLERANCE_RAD)

    def _cut(self, x: Array) -> bool:
        """Whether x is outside one of the balls, which then gets another tangent there."""
        turn = self.rates @ (x[_ANGLES] - self.goal.body.rpy_rad)
        outside = False
        for vector, most, cuts in (
            (x[_PLACE], self.place_m, self._place_cuts),
            (turn, self.angle_rad, self._angle_cuts),
        ):
            size = float(np.linalg.norm(vector))
            if size > (1.0 + _ROUND) * most:
                cuts.append(vector / size)
                outside = True
        return outside

    def _program(self, grips: dict[int, Grip], low: Array, high: Array) -> PoseProgram:
        reach = reach_program(self.problem, grips, low, high, self.goal.body.position_m)
        place, angle = np.array(self._place_cuts), np.array(self._angle_cuts) @ self.rates
        rows = np.zeros((len(place) + len(angle), len(reach.low)))
        rows[: len(place), _PLACE] = place
        rows[len(place) :, _ANGLES] = angle
        right = [np.full(len(place), self.place_m), self.angle_rad + angle @ self.goal.body.rpy_rad]
        rows, bounds = np.vstack([reach.rows, rows]), np.concatenate([reach.right, *right])
        return PoseProgram(reach.reach, rows, bounds, reach.low, reach.high)

    def _holds(self, grips: dict[int, Grip], x: Array) -> bool:
        """Whether (9a) itself holds for that place and these angles."""
        boxes, to_body = self.problem.boxes, rotation_from_rpy(x[_ANGLES]).T
        for at, (limb, grip) in zip(range(_POSE, len(x), 2), grips.items(), strict=True):
            centre = _centre(grip, x[at + 1]) + x[at] * grip.contact.tangent - self.goal.body.position_m
            if (boxes.beyond(limb, to_body @ centre - x[_PLACE]) > TOLERANCE_M).any():
                return False
        return True


def reach_program(problem: Problem, grips: dict[int, Grip], low: Array, high: Array, origin_m: Array) -> PoseProgram:
    """(9a) for `grips` by limb, of a body whose angles are in [low, high] and whose place counts from `origin_m`."""
    boxes, middle, half = problem.boxes, (low + high) / 2, (high - low) / 2
    to_body = rotation_from_rpy(middle).T
    tilt = float(np.sin(np.abs([low[:2], high[:2]]).max()))
    n = _POSE + 2 * len(grips)
    rows, right = [], []
    lower, upper = np.full(n, -10.0), np.full(n, 10.0)
    lower[_ANGLES], upper[_ANGLES] = low, high
    for at, (limb, grip) in zip(range(_POSE, n, 2), grips.items(), strict=True):
        height = float(np.mean(grip.height_m))
        away = _centre(grip, height) - origin_m
        lower[at : at + 2] = -grip.aside_m, grip.height_m[0]
        upper[at : at + 2] = grip.aside_m, grip.height_m[1]
        part = np.zeros((3, n))
        part[:, _PLACE] = -np.eye(3)
        part[:, _ANGLES] = _slopes(middle, away)
        part[:, at], part[:, at + 1] = to_body @ grip.contact.tangent, to_body[:, 2]
        moved = np.array([*np.abs(grip.contact.tangent[:2]) * grip.aside_m, grip.height_m[1] - height])
        rest = _second_order(_largest(away, middle[2], half[2]), half, tilt)
        rest += _first_order(_largest(moved, None, half[2]), half, tilt)
        slack = boxes.extent_m[limb] + TOLERANCE_M + np.abs(boxes.directions) @ rest
        off = to_body @ away - part[:, _ANGLES] @ middle - height * to_body[:, 2]
        off, part = boxes.directions @ off - boxes.middle_m[limb], boxes.directions @ part
        rows += [part, -part]
        right += [slack - off, slack + off]
    return PoseProgram(2 * len(boxes.directions) * len(grips), np.vstack(rows), np.concatenate(right), lower, upper)


def _by_limb(stance: Sequence[int], grips: list[Grip]) -> dict[int, Grip]:
    return {limb: grips[g] for limb, g in enumerate(stance)}


def body_rates(rpy_rad: Array) -> Array:
    """(3, 3) body-frame angular velocity of the rates of roll, pitch and yaw."""
    roll = float(rpy_rad[0])
    up = rotation_from_rpy(np.array([roll, rpy_rad[1], 0.0]))[2]
    return np.column_stack([[1.0, 0.0, 0.0], [0.0, np.cos(roll), -np.sin(roll)], up])


def _centre(grip: Grip, height_m: float) -> Array:
    return np.append(grip.contact.centre_h_m[:2], height_m)


def _slopes(rpy_rad: Array, away: Array) -> Array:
    """(3, 3) derivatives of R(theta)^T away by roll, pitch and yaw: away is fixed, so it turns against the body."""
    seen = rotation_from_rpy(rpy_rad).T @ away
    return np.asarray(np.cross(seen, body_rates(rpy_rad).T).T)


def _largest(away: Array, yaw_rad: float | None, half_rad: float) -> Array:
    """Largest |x|, |y|, |z| of a vector as bodies of any yaw within `half_rad` of one see it (None: any at all)."""
    if yaw_rad is None:
        flat = float(np.hypot(away[0], away[1]))
        return np.array([flat, flat, abs(away[2])])
    c, s = np.cos(yaw_rad), np.sin(yaw_rad)
    x, y = np.abs([c * away[0] + s * away[1], c * away[1] - s * away[0]])
    return np.array([x + half_rad * y, y + half_rad * x, abs(away[2])])


def _first_order(q: Array, half: Array, tilt: float) -> Array:
    """Bound of the change of Rx(roll)^T Ry(pitch)^T q by angles within `half` of middles no more than `tilt` off."""
    x, y, z = q
    roll, pitch, yaw = half
    return np.array(
        [
            (z + tilt * x) * pitch + y * yaw,
            (z + tilt * (x + y)) * roll + tilt * (x + z) * pitch + (x + tilt * y) * yaw,
            (y + tilt * (x + z)) * roll + (x + tilt * z) * pitch + tilt * (x + y) * yaw,
        ]
    )


def _second_order(q: Array, half: Array, tilt: float) -> Array:
    """Bound of the rest of that change beyond its linear part, by the second derivatives; |q| <= (x, y, z)."""
    x, y, z = q
    roll, pitch, yaw = half
    up, along = z + tilt * x, x + tilt * z
    return np.array(
        [
            (along * pitch**2 + x * yaw**2) / 2 + tilt * y * pitch * yaw,
            ((y + tilt * up) * roll**2 + tilt * up * pitch**2 + (y + tilt**2 * x) * yaw**2) / 2
            + along * roll * pitch
            + tilt * (x + y) * roll * yaw
            + tilt * y * pitch * yaw,
            ((up + tilt * y) * roll**2 + up * pitch**2 + tilt * (x + y) * yaw**2) / 2
            + tilt * along * roll * pitch
            + (x + tilt**2 * y) * roll * yaw
            + y * pitch * yaw,
        ]
    )
