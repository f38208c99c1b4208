"""Multipliers of force and moment for a set of grasps: the multipliers of a small convex QP of one knot."""

import numpy as np

from crux_planner.certificates.bound.multipliers import FOLLOW, Multipliers
from crux_planner.model.arrays import Array
from crux_planner.physics.limit_surface import polytope_directions
from crux_planner.solvers.qp import Qp
from crux_planner.solvers.sparse_blocks import skews

_BODY = 9  # r, roll, pitch, yaw, centre of mass off where r and the grasps have it
_GRIP = 5  # s1, s2, m / k, n1, n2
_MISSING = 1e-2  # weight of what balance lacks, squared [1/N^2]: multipliers stay finite where there is no balance
_FORCE_N = 300.0


class KnotQp:
    """QPs of one problem."""

    def __init__(self, multipliers: Multipliers) -> None:
        self.problem, self.carriers = multipliers.problem, multipliers.carriers
        self.rest, self.hands = multipliers.rest, multipliers.hands
        directions, _ = polytope_directions(1.0)
        self._directions = directions / np.linalg.norm(directions, axis=1)[:, None]

    def multipliers(self, held: dict[int, int], box: tuple[Array, Array]) -> Array:
        """(6,) for contacts held by limbs, about the origin."""
        problem, carriers, many = self.problem, self.carriers, len(held)
        n = _BODY + _GRIP * many + 6
        weights, goal = problem.weights, problem.goal.body
        square = np.zeros(n)
        square[:3], square[3:6] = weights.position, weights.orientation
        square[_BODY : _BODY + _GRIP * many] = weights.wrench * np.tile([2.0, 2, 2, 1, 1], many)
        square[-6:] = _MISSING
        linear = np.zeros(n)
        linear[:6] = -2 * square[:6] * np.concatenate([goal.position_m, goal.rpy_rad])
        tilt = problem.body.max_tilt_rad
        hanging = [self.hands[limb] for limb in range(4) if limb not in held]
        rest = [self.rest[end] + sum(FOLLOW * hand[end] for hand in hanging) for end in (0, 1)]
        low = np.concatenate([box[0], [-tilt, -tilt, -1.0], rest[0], np.full(n - _BODY, -_FORCE_N)])
        high = np.concatenate([box[1], [tilt, tilt, 1.0], rest[1], np.full(n - _BODY, _FORCE_N)])
        equal = np.zeros((6, n))
        equal[:, -6:] = np.eye(6)
        turn, places = skews(problem.weight_N), [problem.contacts[c].centre_w_m for c in held.values()]
        equal[3:, :3], equal[3:, 6:9] = (FOLLOW * many - 1.0) * turn, -turn
        right = np.concatenate([-problem.weight_N, FOLLOW * turn @ np.sum(places, axis=0)])
        rows, bounds = [], []
        for i, (limb, c) in enumerate(held.items()):
            at = _BODY + _GRIP * i
            grip = carriers.maps[c]
            equal[:, at : at + 4] = grip
            equal[:, at + 4] = -grip[:, 3]
            low[at + 3 : at + 5], high[at + 3 : at + 5] = 0.0, carriers.most_N
            cone = np.zeros((2 * len(self._directions), n))
            for finger, part in enumerate((cone[: len(self._directions)], cone[len(self._directions) :])):
                part[:, at : at + 3] = self._directions
                part[:, at + 3 + finger] = -carriers.friction[c, finger]
            rows.append(cone)
            bounds.append(np.tile(np.abs(self._directions) @ carriers.spines[c], 2))
            a, half = problem.boxes.centre_b_m[limb], problem.boxes.half_m
            seen = np.hstack([np.eye(3), -skews(a), np.zeros((3, n - 6))])  # r + theta x a
            place = problem.contacts[c].centre_w_m + np.array([0.0, 0.0, problem.boxes.above_m]) - a
            rows += [seen, -seen]
            bounds += [place + half, half - place]
        below = np.vstack(rows), None, np.concatenate(bounds)
        qp = Qp(np.diag(2 * square), linear, (equal, right), below, low, high, eps_abs=1e-6, eps_rel=1e-7)
        return qp.solve().multipliers
