"""The least cost of a knot at which given grasps are held, from multipliers of force and moment (weak duality).

For any multipliers pi of the six rows of balance, (8a) and (8b) at a knot,
    cost of the knot  >=  sum over limbs of the least of R |q|^2 + pi . wrench(q)
                        + least over bodies of Q |x - x_g|^2 - pi . (M (a - g), c x M (a - g) + I alpha + ...),
with accelerations anything that speeds within (7) allow from one knot to the next. The centre of mass c follows body
and grippers, c = r + k sum (p - r) + e, k the same for all limbs and e anything that limbs within (9a) leave open. The
first is bound.carrying, the second falls apart by axes over the boxes of bound.grasps. Good multipliers are those of a
small convex QP of one knot; it need not be trusted.
"""

from __future__ import annotations

from copy import copy
from ctypes import c_double
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from crux_contracts.compiled import doubles, integers

from crux_planner.certificates.bound import native
from crux_planner.certificates.bound.carrying import Carriers
from crux_planner.certificates.bound.centre_of_mass import FOLLOW, CentreOfMass
from crux_planner.certificates.bound.grasps import Grasps
from crux_planner.certificates.bound.places import Orientations
from crux_planner.certificates.bound.swings import airborne
from crux_planner.model.arrays import Array, Indices
from crux_planner.model.mass import gripper_spans, offset_bounds, yawed_bounds
from crux_planner.model.problem import Problem
from crux_planner.physics.limit_surface import polytope_directions
from crux_planner.solvers.qp import Qp
from crux_planner.solvers.sparse_blocks import skews

_BODY = 9  # r, roll, pitch, yaw, centre of mass off where r and the grasps have it
_GRIP = 5  # s1, s2, m / k, n1, n2
_MISSING = 1e-2  # weight of what balance lacks, squared [1/N^2]: multipliers stay finite where there is no balance
_FORCE_N = 300.0


@dataclass(frozen=True)
class Window:
    """Where the body of some nodes is at a knot, and for their pairs the centre of mass with it."""

    box: tuple[Array, Array] | None  # (3,) and (3,), if it is anywhere in particular
    rest: Array  # (P or 1, T, 2, 3) as CentreOfMass.within has it


@dataclass(frozen=True)
class Accelerations:
    """What accelerations may add to the right side of balance at most, and where the centre of mass is off r."""

    offset: tuple[Array, Array]  # (3,) and (3,)
    push_N: float  # largest M a along an axis
    spin_Nm: float  # largest |I alpha + omega x I omega|

    @staticmethod
    def of(problem: Problem, about: Orientations) -> Accelerations:
        """For all speeds within (7) and all headings of `about`."""
        yaw = max(-float(about.yaw_low[0]), float(about.yaw_high[-1]))
        speed, rate, dt = problem.body.max_speed_m_s, problem.body.max_rate_rad_s, problem.dt_s
        inertia = float(np.linalg.eigvalsh(problem.inertia_b).max())
        spin = inertia * (2 * 3**0.5 * rate / dt + 3 * rate**2)
        return Accelerations(
            offset_bounds(problem, gripper_spans(problem), yaw), problem.mass_kg * 2 * speed / dt, spin
        )

    def most(self, multipliers: Array, low: Array, high: Array) -> Array:
        """(n,) for bodies in boxes (n, 3) and multipliers (n, 6)."""
        given = [np.ascontiguousarray(each) for each in (multipliers, low, high)]
        found = np.empty(len(given[1]))
        native.needed().crux_knot_most(self.compiled, len(found), *map(doubles, (*given, found)))
        return found

    @cached_property
    def compiled(self) -> native.Accelerations:
        """As the compiled part has it."""
        return native.Accelerations((c_double * 6)(*np.concatenate(self.offset)), self.push_N, self.spin_Nm)

    def slopes(self, multipliers: Array, low: Array, high: Array) -> Array:
        """Of `most` in multipliers (n, 6)."""
        lever, middle, other = self._levers(multipliers, low, high)
        side, moment = np.sign(lever), multipliers[:, 3:]
        turn = moment / np.maximum(np.linalg.norm(moment, axis=1), 1e-12)[:, None]
        by_moment = self.push_N * (np.cross(middle, side) + np.sign(moment) * other) + self.spin_Nm * turn
        return np.hstack([self.push_N * side, by_moment])

    def _levers(self, multipliers: Array, low: Array, high: Array) -> tuple[Array, Array, Array]:
        """What a newton does in the middle of where the centre of mass is, that, and what is added across each axis."""
        arm_low, arm_high = low + self.offset[0], high + self.offset[1]
        middle, half = (arm_low + arm_high) / 2, np.maximum(arm_high - arm_low, 0.0) / 2
        return multipliers[..., :3] + np.cross(multipliers[..., 3:], middle), middle, half.sum(axis=1)[:, None] - half


class Multipliers:
    """Values of multipliers for the nodes of a problem."""

    def __init__(self, problem: Problem, about: Orientations, nodes: Grasps) -> None:
        self.problem, self.about = problem, about
        self.carriers = Carriers.of(problem)
        yaw = max(-float(about.yaw_low[0]), float(about.yaw_high[-1]))
        spans = gripper_spans(problem)
        self.accelerations = Accelerations.of(problem, about)
        self.masses = CentreOfMass(problem, about)
        self.rest = self.masses.anywhere[0]
        self._off = [np.array(yawed_bounds(low, high, yaw)) for low, high in zip(*spans, strict=True)]
        self._places = np.stack([contact.centre_h_m for contact in problem.contacts])
        self._take(nodes)

    def _take(self, nodes: Grasps) -> None:
        self.nodes = nodes
        self.hands, self.still = [], np.zeros((4, 3), dtype=bool)  # of a limb in the air, off r or where `still`, in H
        for limb, (off, groups) in enumerate(zip(self._off, nodes.groups, strict=True)):
            place = np.array(airborne(self.problem, np.concatenate(groups)))
            self.still[limb] = place[1] - place[0] < off[1] - off[0]
            self.hands.append(np.where(self.still[limb], place, off))
        many = np.array([len(own) for own in nodes.groups])
        known = np.where((nodes.options == many)[..., None], self.still, True).sum(axis=1)
        self._follow = 1.0 - FOLLOW * known  # (n, 3) of c, the body's origin
        self._ends = np.append(nodes.first, len(nodes.node))

    def on(self, nodes: Grasps) -> Multipliers:
        """The same for other nodes of the problem."""
        other = copy(self)
        other._take(nodes)
        return other

    def values(self, multipliers: Array, which: Indices, window: Window | None = None) -> Array:
        """Lower bounds (len(which),) of a knot's cost on nodes, the body in their `window` too; inf if it cannot.

        Multipliers (6,) are for all of them, (len(which), 6) for one each.
        """
        nodes = self.nodes
        pairs, first, counts = self._pairs(which)
        if multipliers.ndim == 2:
            of_pairs, held = np.repeat(multipliers, counts, axis=0), self._held_each(multipliers, which)
        else:
            of_pairs, held = multipliers, self._held(multipliers, which)
        body = self._body(of_pairs, pairs, window or Window(None, self.masses.rest(nodes, pairs)))
        return np.asarray(held + np.minimum.reduceat(body, first))

    def window(self, which: Indices, box: tuple[Array, Array]) -> Window:
        """Of nodes whose body is within a box, too."""
        return Window(box, self.masses.within(self.nodes, self._pairs(which)[0], box))

    def _pairs(self, which: Indices) -> tuple[Indices, Indices, Indices]:
        """Those of nodes, the first of each node among them, and how many each has."""
        counts = self._ends[which + 1] - self._ends[which]
        first = np.concatenate([[0], np.cumsum(counts)[:-1]])
        return np.repeat(self._ends[which] - first, counts) + np.arange(counts.sum()), first, counts

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

    def _body(self, multipliers: Array, pairs: Indices, window: Window) -> Array:
        """Least of the body's part for pairs (P,) in a window, multipliers (6,) or (P, 6), and accelerations."""
        nodes, box = self.nodes, None if window.box is None else np.array(window.box, dtype=float)
        given = nodes.low[pairs], nodes.high[pairs], self._follow[nodes.node[pairs]], window.rest, multipliers
        low, high, follow, rest, pi = (np.ascontiguousarray(each, dtype=float) for each in given)
        cell, found = nodes.cell[pairs], np.empty(len(pairs))
        ends = doubles(low), doubles(high), None if box is None else doubles(box)
        parts = *ends, doubles(follow), doubles(rest), doubles(pi), integers(cell)
        asked = native.KnotPairs(len(pairs), pi.ndim == 1, len(rest) == 1, *parts)
        native.needed().crux_knot_least(self._knot, asked, doubles(found))
        return found

    @cached_property
    def _knot(self) -> native.Knot:
        problem, about = self.problem, self.about
        kept = [np.ascontiguousarray(each) for each in (about.yaw_cost, about.tilt_cost.min(axis=1), about.shift_m)]
        ends = ((c_double * 3)(*each) for each in (problem.weight_N, problem.goal.body.position_m))
        rest = *map(doubles, kept), *ends, problem.weights.position
        made = native.Knot(self.accelerations.compiled, len(about.shift_m), *rest)
        made.kept = kept
        return made


class KnotQp:
    """QPs of one problem."""

    def __init__(self, multipliers: Multipliers) -> None:
        self.problem, self.carriers, self.about = multipliers.problem, multipliers.carriers, multipliers
        self.rest = multipliers.rest
        directions, _ = polytope_directions(1.0)
        self._directions = directions / np.linalg.norm(directions, axis=1)[:, None]

    def multipliers(self, held: dict[int, int], box: tuple[Array, Array], rest: Array | None = None) -> Array:
        """(6,) for contacts held by limbs, about the origin; `rest` (2, 3) of the centre of mass, if it is known."""
        still, hands = self.about.still, self.about.hands
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
        hanging = [limb for limb in range(4) if limb not in held]
        follow = 1.0 - FOLLOW * (many + still[hanging].sum(axis=0))
        rest = (self.rest if rest is None else rest) + FOLLOW * sum(hands[limb] for limb in hanging)
        low = np.concatenate([box[0], [-tilt, -tilt, -1.0], rest[0], np.full(n - _BODY, -_FORCE_N)])
        high = np.concatenate([box[1], [tilt, tilt, 1.0], rest[1], np.full(n - _BODY, _FORCE_N)])
        equal = np.zeros((6, n))
        equal[:, -6:] = np.eye(6)
        turn, places = skews(problem.weight_N), [problem.contacts[c].centre_h_m for c in held.values()]
        equal[3:, :3], equal[3:, 6:9] = -turn * follow, -turn
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
            place = problem.contacts[c].centre_h_m + np.array([0.0, 0.0, problem.boxes.above_m]) - a
            rows += [seen, -seen]
            bounds += [place + half, half - place]
        below = np.vstack(rows), None, np.concatenate(bounds)
        qp = Qp(np.diag(2 * square), linear, (equal, right), below, low, high, eps_abs=1e-6, eps_rel=1e-7)
        return qp.solve().multipliers
