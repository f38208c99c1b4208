"""The least cost of a knot at which given grasps are held, from prices of force and moment (weak duality).

For any prices pi of the six rows of balance, (8a) and (8b) at a knot,
    cost of the knot  >=  sum over limbs of the least of R |q|^2 + pi . wrench(q)
                        + least over bodies of Q |x - x_g|^2 - pi . (M (a - g), r x M (a - g) + I alpha + ...),
with accelerations anything that speeds within (7) allow from one knot to the next. The first is bound.carrying, the
second falls apart by axes over the boxes of bound.grasps. Whoever finds good prices need not be trusted.
"""

from __future__ import annotations

import numpy as np

from crux_planner.arrays import Array, Indices
from crux_planner.bound.carrying import Carriers
from crux_planner.bound.grasps import Grasps
from crux_planner.bound.places import Orientations
from crux_planner.problem import Problem


class Prices:
    """Values of prices for the nodes of a problem."""

    def __init__(self, problem: Problem, about: Orientations, nodes: Grasps) -> None:
        self.problem, self.about, self.nodes = problem, about, nodes
        self.carriers = Carriers.of(problem)
        self._ends = np.append(nodes.first, len(nodes.node))
        speed, rate, dt = problem.body.max_speed_m_s, problem.body.max_rate_rad_s, problem.dt_s
        self._push = problem.mass_kg * 2 * speed / dt  # largest M a along an axis
        inertia = float(np.linalg.eigvalsh(problem.inertia_b).max())
        self._spin = inertia * (2 * 3**0.5 * rate / dt + 3 * rate**2)  # largest |I alpha + omega x I omega|

    def values(self, prices: Array, which: Indices, room: tuple[Array, Array] | None = None) -> Array:
        """Lower bounds (len(which),) of a knot's cost on nodes, the body within `room` too; inf if it cannot."""
        nodes = self.nodes
        least = self.carriers.least(prices)
        held = np.zeros(len(which))
        for limb in range(4):
            held += nodes.cheapest(limb, least)[nodes.options[which, limb]]
        counts = self._ends[which + 1] - self._ends[which]
        first = np.concatenate([[0], np.cumsum(counts)[:-1]])
        pairs = np.repeat(self._ends[which] - first, counts) + np.arange(counts.sum())
        low, high = nodes.low[pairs], nodes.high[pairs]
        value: Array = held + np.minimum.reduceat(self._body(prices, low, high, nodes.cell[pairs], room), first)
        return value

    def _body(self, prices: Array, low: Array, high: Array, cell: Indices, room: tuple[Array, Array] | None) -> Array:
        """Least of the body's part for boxes (P, 3), less the largest help of accelerations."""
        problem, about = self.problem, self.about
        force, moment = prices[:3], prices[3:]
        weight = problem.weight_N
        slope = np.cross(weight, moment)  # of  pi_M . (r x M g)  in r
        total = about.yaw_cost[cell] + force @ weight
        help_ = np.zeros(len(low))
        arm_low, arm_high = low.copy(), high.copy()
        for axis in range(3):
            options = []
            shifts = about.shift_m if axis < 2 else np.zeros(1)
            for t, shift in enumerate(shifts):
                near, far = low[:, axis] - shift, high[:, axis] + shift
                if room is not None:
                    near, far = np.maximum(near, room[0][axis]), np.minimum(far, room[1][axis])
                cost = self._axis(axis, slope[axis], near, far)
                cost[near > far] = np.inf
                options.append(cost + (about.tilt_cost[t, axis] if axis < 2 else 0.0))
            total = total + np.minimum.reduce(options)
            arm_low[:, axis], arm_high[:, axis] = near, far
        middle, half = (arm_low + arm_high) / 2, np.maximum(arm_high - arm_low, 0.0) / 2
        help_ = np.abs(force + np.cross(moment, middle)).sum(axis=1)
        size = np.abs(moment)
        help_ += (half[:, [1, 2, 0]] * size[[2, 0, 1]] + half[:, [2, 0, 1]] * size[[1, 2, 0]]).sum(axis=1)
        return np.asarray(total - self._push * help_ - self._spin * np.linalg.norm(moment))

    def _axis(self, axis: int, slope: float, near: Array, far: Array) -> Array:
        """Least of Q (r - g)^2 + slope r for r in [near, far]."""
        weight, goal = self.problem.weights.position, self.problem.goal.body.position_m[axis]
        r = (
            np.clip(goal - slope / (2 * weight), near, np.maximum(near, far))
            if weight > 0
            else np.where(slope > 0, near, far)
        )
        return np.asarray(weight * (r - goal) ** 2 + slope * r)
