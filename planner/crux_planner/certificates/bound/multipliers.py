"""The least cost of a knot at which given grasps are held, from multipliers of force and moment (weak duality).

For any multipliers pi of the six rows of balance, (8a) and (8b) at a knot,
    cost of the knot  >=  sum over limbs of the least of R |q|^2 + pi . wrench(q)
                        + least over bodies of Q |x - x_g|^2 - pi . (M (a - g), c x M (a - g) + I alpha + ...),
with accelerations anything that speeds within (7) allow from one knot to the next. The centre of mass c follows body
and grippers, c = r + k sum (p - r) + e, k the same for all limbs and e anything that limbs within (9a) leave open. The
first is bound.carrying, the second falls apart by axes over the boxes of bound.grasps. Whoever finds good multipliers
need not be trusted.
"""

import numpy as np

from crux_planner.certificates.bound.carrying import Carriers
from crux_planner.certificates.bound.grasps import Grasps
from crux_planner.certificates.bound.places import Orientations
from crux_planner.model.arrays import Array, Indices
from crux_planner.model.mass import gripper_spans, offset_bounds, yawed_bounds
from crux_planner.model.problem import Problem

FOLLOW = 0.098  # k: any number is true, this one leaves little open


class Multipliers:
    """Values of multipliers for the nodes of a problem."""

    def __init__(self, problem: Problem, about: Orientations, nodes: Grasps) -> None:
        self.problem, self.about, self.nodes = problem, about, nodes
        self.carriers = Carriers.of(problem)
        yaw = max(-float(about.yaw_low[0]), float(about.yaw_high[-1]))
        spans = gripper_spans(problem)
        self.offset = offset_bounds(problem, spans, yaw)  # of the centre of mass from r, (3,) and (3,)
        self.rest = offset_bounds(problem, spans, yaw, FOLLOW)  # e
        self.hands = [yawed_bounds(low, high, yaw) for low, high in zip(*spans, strict=True)]
        self._places = np.stack([contact.centre_w_m for contact in problem.contacts])
        self._follow = 1.0 - FOLLOW * (4 - nodes.in_air)  # of c, the body's origin
        self._ends = np.append(nodes.first, len(nodes.node))
        speed, rate, dt = problem.body.max_speed_m_s, problem.body.max_rate_rad_s, problem.dt_s
        self._push = problem.mass_kg * 2 * speed / dt  # largest M a along an axis
        inertia = float(np.linalg.eigvalsh(problem.inertia_b).max())
        self._spin = inertia * (2 * 3**0.5 * rate / dt + 3 * rate**2)  # largest |I alpha + omega x I omega|

    def values(self, multipliers: Array, which: Indices, box: tuple[Array, Array] | None = None) -> Array:
        """Lower bounds (len(which),) of a knot's cost on nodes, the body within `box` too; inf if it cannot.

        Multipliers (6,) are for all of them, (len(which), 6) for one each.
        """
        nodes = self.nodes
        counts = self._ends[which + 1] - self._ends[which]
        first = np.concatenate([[0], np.cumsum(counts)[:-1]])
        pairs = np.repeat(self._ends[which] - first, counts) + np.arange(counts.sum())
        low, high = nodes.low[pairs], nodes.high[pairs]
        if multipliers.ndim == 2:
            multipliers_of_pairs, held = np.repeat(multipliers, counts, axis=0), self._held_each(multipliers, which)
        else:
            multipliers_of_pairs, held = multipliers, self._held(multipliers, which)
        body = self._body(multipliers_of_pairs, low, high, pairs, box)
        return np.asarray(held + np.minimum.reduceat(body, first))

    def places(self, which: Indices) -> Array:
        """Least (len(which),) of Q for the body at a knot, whatever holds it."""
        free = np.zeros(6)
        return np.asarray(self.values(free, which) - self._held(free, which))

    def _held(self, multipliers: Array, which: Indices) -> Array:
        slope = np.cross(self.problem.weight_N, multipliers[3:])
        least = self.carriers.least(multipliers) + FOLLOW * self._places @ slope
        held = np.zeros(len(which))
        for limb, groups in enumerate(self.nodes.groups):
            cheapest, options = self.nodes.cheapest(limb, least), self.nodes.options[which, limb]
            cheapest[len(groups)] = self._hanging(limb, slope)
            held += cheapest[options]
        return held

    def _held_each(self, multipliers: Array, which: Indices) -> Array:
        slope, held = np.cross(self.problem.weight_N, multipliers[:, 3:]), np.zeros(len(which))
        for limb, groups in enumerate(self.nodes.groups):
            options = self.nodes.options[which, limb]
            standing = np.flatnonzero(options < len(groups))
            hanging = options == len(groups)
            held[hanging] += self._hanging(limb, slope[hanging])
            own = [groups[i] for i in options[standing]]
            many = np.array([len(group) for group in own], dtype=int)
            if own:
                contacts, of = np.concatenate(own), np.repeat(standing, many)
                least = self.carriers.least(multipliers[of], contacts)
                least += FOLLOW * (slope[of] * self._places[contacts]).sum(axis=1)
                held[standing] += np.minimum.reduceat(least, np.cumsum(many) - many)
        return held

    def _hanging(self, limb: int, slope: Array) -> Array:
        """Least of what a gripper in the air does by its place about the body, for slopes (..., 3) of c."""
        low, high = self.hands[limb]
        return np.asarray(FOLLOW * np.minimum(slope * low, slope * high).sum(axis=-1))

    def _body(
        self, multipliers: Array, low: Array, high: Array, pairs: Indices, box: tuple[Array, Array] | None
    ) -> Array:
        """Least of the body's part for boxes (P, 3) of pairs (P,), multipliers (6,) or (P, 6), and accelerations."""
        problem, about, cell = self.problem, self.about, self.nodes.cell[pairs]
        force, moment = multipliers[..., :3], multipliers[..., 3:]
        weight = problem.weight_N
        slope = np.cross(weight, moment)  # of  pi_M . (c x M g)  in c
        by_body = self._follow[self.nodes.node[pairs], None] * slope
        total = about.yaw_cost[cell] + force @ weight
        total = total + np.minimum(slope * self.rest[0], slope * self.rest[1]).sum(axis=-1)
        arm_low, arm_high = low.copy(), high.copy()
        for axis in range(3):
            options = []
            shifts = about.shift_m if axis < 2 else np.zeros(1)
            for t, shift in enumerate(shifts):
                near, far = low[:, axis] - shift, high[:, axis] + shift
                if box is not None:
                    near, far = np.maximum(near, box[0][axis]), np.minimum(far, box[1][axis])
                cost = self._axis(axis, by_body[:, axis], near, far)
                cost[near > far] = np.inf
                options.append(cost + (about.tilt_cost[t, axis] if axis < 2 else 0.0))
            total = total + np.minimum.reduce(options)
            arm_low[:, axis], arm_high[:, axis] = near, far
        arm_low, arm_high = arm_low + self.offset[0], arm_high + self.offset[1]
        middle, half = (arm_low + arm_high) / 2, np.maximum(arm_high - arm_low, 0.0) / 2
        help_ = np.abs(force + np.cross(moment, middle)).sum(axis=1)
        size = np.abs(moment)
        help_ += (half[:, [1, 2, 0]] * size[..., [2, 0, 1]] + half[:, [2, 0, 1]] * size[..., [1, 2, 0]]).sum(axis=1)
        return np.asarray(total - self._push * help_ - self._spin * np.linalg.norm(moment, axis=-1))

    def _axis(self, axis: int, slope: Array, near: Array, far: Array) -> Array:
        """Least of Q (r - g)^2 + slope r for r in [near, far]."""
        weight, goal = self.problem.weights.position, self.problem.goal.body.position_m[axis]
        r = np.where(slope > 0, near, far)
        if weight > 0:
            r = np.clip(goal - slope / (2 * weight), near, np.maximum(near, far))
        return np.asarray(weight * (r - goal) ** 2 + slope * r)
