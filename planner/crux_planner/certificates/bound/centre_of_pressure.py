"""The body of a walk for multipliers of where it presses on the ground, and of how it rises and falls.

The centre of pressure of feet on z = 0 is, by (8a) and (8b) about the centre of mass,
    q = r - s (a - g) - (the moment, turned) / (M (gamma + a_z)),    s = z / (gamma + a_z),
with a = dv/dt, g the gravity along the ground and gamma that into it; with h the mean height, to first order
    q ~ r - h/gamma (a - g) + g/gamma (z - h) - g h/gamma^2 a_z :
linear in the body's motion. With |a_z| <= A it is |s - h/gamma| <= (|z - h| + h/gamma |a_z|) / (gamma - A), so that
what is left of multiplier . q costs no more than some part of J that is kept back here for it:
- multiplier (s - h/gamma) a: a square of the multiplier from |z - h|, a square of a_z from the rest, by a share of what
  accelerations along the ground cost;
- the moment, over M gamma: summed by parts over the knots it is the angular momentum, zero at both ends, by the
  multiplier's change from knot to knot, and by the body's turning: squares of the rates;
- a_z with slopes or with the moment: linear in |a_z|.
The centre of mass is off r by what limbs within (9a) make it, which multipliers of q pay for (`aside`).
"""

import numpy as np

from crux_planner.model.arrays import Array
from crux_planner.model.mass import level_spans, offset_bounds
from crux_planner.model.walk_problem import WalkProblem
from crux_planner.physics.cost import FORCE_SHARE

_TILTING_SHARE, _TURNING_SHARE = 0.8, 0.3  # of the cost of rates about the body's x and y, and about its z, kept back
_LATERAL_SHARE = 0.4  # of the cost of accelerations along the ground, kept back
MOST_MULTIPLIER = 0.7  # of the centre of pressure [1/m]


def heading_share(problem: WalkProblem) -> float:
    """Of the weight on the body's rates, what is left for yaw' = (sin(roll) q + cos(roll) r) / cos(pitch)."""
    tilt = problem.body.max_tilt_rad
    spread = np.sin(tilt) ** 2 / (1 - _TILTING_SHARE) + 1 / (1 - _TURNING_SHARE)
    return float(np.cos(tilt) ** 2 / spread)


class CentreOfPressure:
    """Least of the body's part of J with multipliers on its outputs at N knots: q along, q across, vertical
    acceleration.

    For multipliers p (3 N) it is free + p . outputs - p . yielding p / 2.
    """

    def __init__(self, problem: WalkProblem) -> None:
        n, dt, weights = problem.steps, problem.dt_s, problem.weights
        self.problem, self.steps = problem, n
        self.gamma, self.along = -float(problem.gravity_h[2]), problem.gravity_h[:2]
        self.kappa = problem.pendulum_s2
        self.effort = FORCE_SHARE * weights.wrench * problem.mass_kg**2  # of an acceleration by one foot
        self.most_rising, self._most_turning = problem.profile.acceleration
        self.least_weight = self.gamma - self.most_rising  # per mass
        yaw = abs(float(problem.goal.body.rpy_rad[2])) + problem.goal.tolerance_rad + problem.foot_yaw_rad[1]
        feet = problem.boxes
        heights = feet.centre_b_m[0, 2] - feet.half_m[2], feet.centre_b_m[0, 2] + feet.half_m[2]
        low, high = level_spans(feet, heights, problem.body.max_tilt_rad)
        above = np.array([0.0, 0.0, problem.pad_radius_m])
        self.aside_m = np.abs(offset_bounds(problem, (low + above, high + above), yaw)).max(axis=0)  # off r
        speeds = np.vstack([np.zeros(n), dt * np.tri(n)])
        places = dt * np.vstack([np.zeros(n), np.cumsum(speeds, axis=0)[:-1]])
        start, goal = problem.start.position_m, problem.goal.body.position_m
        pressing, zero = places[:n] - self.kappa * np.eye(n), np.zeros((n, n))
        lean = self.along / self.gamma
        rows = [[pressing, zero, lean[0] * pressing], [zero, pressing, lean[1] * pressing], [zero, zero, np.eye(n)]]
        outputs = np.block(rows)
        still = np.zeros((3, n))
        height = self.kappa * self.gamma
        still[:2] = (start[:2] + self.kappa * self.along + lean * (start[2] - height))[:, None]
        self.free = self.effort / 4 * n * float(self.along @ self.along)
        gains, leanings = np.zeros((3 * n, 3 * n)), np.zeros(3 * n)
        for axis in range(3):
            own = slice(axis * n, (axis + 1) * n)
            square = weights.position * places.T @ places + weights.velocity * speeds.T @ speeds
            square += ((1 - _LATERAL_SHARE) * self.effort / 4 if axis < 2 else 1e-9) * np.eye(n)
            inverse = np.linalg.inv(2 * square)
            stop = inverse @ speeds[n]  # at rest at the end
            gains[own, own] = inverse - np.outer(stop, stop) / (speeds[n] @ stop)
            away = float(start[axis] - goal[axis])
            leanings[own] = 2 * weights.position * away * places.sum(axis=0)
            self.free += weights.position * away**2 * (n + 1)
        self.free -= float(leanings @ gains @ leanings) / 2
        self.outputs = still.ravel() - outputs @ gains @ leanings
        self.yielding = outputs @ gains @ outputs.T
        self.paid = self._paid() if self.least_weight > 0.0 else None  # (N, N), of multipliers along, and across
        if self.paid is not None:
            for own in (slice(0, n), slice(n, 2 * n)):
                self.yielding[own, own] += 2 * self.paid

    def _paid(self) -> Array | None:
        """The squares of multipliers in the remainder; None where rates cost too little to pay for it."""
        problem, n = self.problem, self.steps
        height = self.kappa * self.gamma
        self._room = max(problem.body.height_m[1] - height, height - problem.body.height_m[0]) + float(self.aside_m[2])
        self._kept = _LATERAL_SHARE * self.effort / 4
        square = (self._room / self.least_weight) ** 2 / (2 * self._kept) * np.eye(n)
        inertia, tilt = problem.inertia_b, problem.body.max_tilt_rad
        largest, weight_N = float(np.linalg.norm(inertia, 2)), problem.mass_kg * self.gamma
        turned = 3**0.5 * (1 / np.cos(tilt) + np.tan(tilt))  # of R from knot to knot, for each rad/s and second
        shaken = (1 + turned) * largest * MOST_MULTIPLIER / weight_N  # on the squares of rates
        change = np.diff(np.eye(n), axis=0) / (weight_N * problem.dt_s)
        for rows, share in ((inertia[:2], _TILTING_SHARE), (inertia[2:], _TURNING_SHARE)):
            spin = share * problem.weights.velocity - shaken
            arm = np.linalg.norm(rows[:, :2], 2) + 2**0.5 * tilt * np.linalg.norm(rows[:, 2])
            if spin <= 0.0:
                return None
            square += arm**2 * change.T @ change / (4 * spin)
        moment = largest * (3**0.5 * self._most_turning + 3 * problem.body.max_rate_rad_s**2)
        self._moment = moment / (problem.mass_kg * self.gamma * self.least_weight)
        return square

    def least(self, multipliers: Array) -> float:
        """For multipliers (3 N)."""
        return self.free + float(multipliers @ (self.outputs - self.yielding @ multipliers / 2))

    def aside(self, multipliers: Array) -> Array:
        """What multipliers (..., 2) of q save at most as the centre of mass is off the body's origin, and in height."""
        lean = np.abs(self.along) / self.gamma * self.aside_m[2] + self.aside_m[:2]
        return np.asarray(np.abs(multipliers) @ lean)

    def remainder(self, multiplier: Array) -> tuple[Array, Array]:
        """What multipliers (..., 2) of q may save at a knot: `linear` |a_z| + `square` a_z^2 at most."""
        square = (multiplier**2).sum(axis=-1) * (self.kappa / self.least_weight) ** 2 / (2 * self._kept)
        slope = np.abs(multiplier @ self.along)
        linear = slope * (self._room + self.kappa * self.most_rising) / (self.gamma * self.least_weight)
        return linear + np.linalg.norm(multiplier, axis=-1) * self._moment, square
