"""A lower bound of J where there are too many sets of grasps: limbs and body each by themselves, tied by multipliers.

Lagrange multipliers of every knot stand for two things that tie limbs and body together:
1. force and moment balance (pi, as in bound.multipliers), and
2. reach: the wrist is within a stretched limb of its shoulder, |p + above - r - Rz(yaw) b| <= length along the wall,
   also in a swing, so that  nu . (p - r) - (nu . Rz b + |nu| length) <= 0  may be added to J for any nu (2,).
For given multipliers J falls apart: what each limb pays on its cheapest way over contacts and swings (bound.limb_ways),
and what the body pays on its cheapest path from start to goal at no more than full speed. Their sum is below J of every
plan, whatever the multipliers; the best ones are found by ascent on the soft least, which is concave and smooth. A
gripper in a swing is in the box around both contacts, and around the tall obstacles there.

What is lost: limbs may be on several ways at once, in shares. So balance holds in the mean only, and a limb that ought
to stand may be half in the air.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from crux_planner.certificates.bound.carrying import Carriers
from crux_planner.certificates.bound.centre_of_mass import FOLLOW, CentreOfMass
from crux_planner.certificates.bound.excursion import range_at
from crux_planner.certificates.bound.limb_ways import LimbWays
from crux_planner.certificates.bound.multipliers import Accelerations
from crux_planner.certificates.bound.places import Orientations, body_boxes, shoulder_to_wrist, shoulders
from crux_planner.certificates.bound.swings import distinct, earned, swing_ranges
from crux_planner.model.arrays import Array
from crux_planner.model.problem import Problem
from crux_planner.solvers.qp import Qp

_NONE = 1e9  # of multipliers that numbers do not go as far as
FORCE, MOMENT, REACH = 0.01, 0.03, 0.3  # units of the multipliers in which the ascent is about as steep along all


class _Limb:
    """Where a limb's gripper may be, by contacts and by swings."""

    def __init__(self, problem: Problem, about: Orientations, limb: int, windows: Array) -> None:
        self.contacts = distinct(problem, limb)
        shift = about.shift_m[-1]
        low, high = (each[limb, self.contacts] for each in body_boxes(problem, about))
        low, high = low.min(axis=1)[:, :2] - shift, high.max(axis=1)[:, :2] + shift
        allowed = ((low <= windows[:, None, 1, :2]) & (windows[:, None, 0, :2] <= high)).all(axis=2)
        allowed[0, 0] = True
        self.ways = LimbWays(problem, limb, self.contacts, allowed)
        self.place = np.stack([problem.contacts[c].centre_h_m for c in self.contacts])
        self.low, self.high = swing_ranges(problem, self.contacts, self.ways.begins, self.ways.lands)
        self.shoulder, off = shoulders(problem, about, limb)  # (Y, 2), (Y,)
        self.length = shoulder_to_wrist(problem.limb_masses[limb].limb)[1] + off
        self.about: float | None = None  # what its ways cost, by multipliers asked about last


class LimbByLimb:
    """Of one problem; multipliers x (14 N,) are pi (N, 6), about points on the line from start to goal, and
    nu (N, 4, 2), in units of FORCE, MOMENT and REACH.
    """

    def __init__(self, problem: Problem, about: Orientations, box: tuple[Array, Array]) -> None:
        self.problem, self.about, self.knots = problem, about, problem.steps
        self.windows = np.array([range_at(problem, k, box) for k in range(self.knots + 1)])  # (N + 1, 2, 3)
        self.carriers, self._limbs = Carriers.of(problem), [_Limb(problem, about, i, self.windows) for i in range(4)]
        self._rest = CentreOfMass(problem, about).anywhere
        self._still = Accelerations.of(problem, about)
        self._line = np.linspace(problem.start.position_m, problem.goal.body.position_m, self.knots)
        self._earned = earned(problem)

    @property
    def work(self) -> int:
        """Costs of limbs' knots, about what an evaluation takes."""
        return self.knots * sum(len(each.contacts) + len(each.ways.knots) for each in self._limbs)

    def scaled(self, multipliers: Array) -> Array:
        """x for multipliers (6,) or (N, 6) about the origin, reach for nothing."""
        pi = np.broadcast_to(multipliers, (self.knots, 6))
        force = pi[:, :3] + np.cross(pi[:, 3:], self._line)
        return np.concatenate([force.ravel() / FORCE, pi[:, 3:].ravel() / MOMENT, np.zeros(8 * self.knots)])

    def _of(self, x: Array) -> tuple[Array, Array]:
        many = 3 * self.knots
        force, moment = FORCE * x[:many].reshape(-1, 3), MOMENT * x[many : 2 * many].reshape(-1, 3)
        return np.hstack([force - np.cross(moment, self._line), moment]), REACH * x[2 * many :].reshape(-1, 4, 2)

    def bound(self, x: Array) -> float:
        """What no plan costs less than, by multipliers x."""
        pi, nu = self._of(x)
        limbs = [self._costs(limb, pi, nu[:, i]) for i, limb in enumerate(self._limbs)]
        least = sum(limb.ways.least(ground, air) for limb, (ground, air, _) in zip(self._limbs, limbs, strict=True))
        return float(least + self._body(pi, nu)[0])

    def soft(self, x: Array, heat: float) -> tuple[float, Array] | None:
        """The soft least and its slopes in x; None where numbers end."""
        pi, nu = self._of(x)
        total, by_pi, by_nu, by_slope = self._body(pi, nu)
        for i, limb in enumerate(self._limbs):
            ground, air, wrench = self._costs(limb, pi, nu[:, i])
            if limb.about is None:
                limb.about = limb.ways.least(ground, air)
            found = limb.ways.soft(ground, air, heat, limb.about)
            if found is None:
                return None
            limb.about, on, up = found
            total += limb.about
            by_pi += np.einsum("kc,kci->ki", on, wrench)
            slope = np.cross(self.problem.weight_N, pi[:, 3:])
            place, along = on @ limb.place, FOLLOW * slope
            along[:, :2] += nu[:, i]
            for axis in range(3):
                low = up @ limb.low[:, axis], up @ limb.high[:, axis]
                place[:, axis] += np.where(along[:, axis] > 0.0, *low)
            by_slope += FOLLOW * place
            by_nu[:, i] += place[:, :2]
        by_pi[:, 3:] += np.cross(by_slope, self.problem.weight_N)
        by_moment = by_pi[:, 3:] - np.cross(self._line, by_pi[:, :3])
        parts = FORCE * by_pi[:, :3].ravel(), MOMENT * by_moment.ravel(), REACH * by_nu.ravel()
        return float(total), np.concatenate(parts)

    def _costs(self, limb: _Limb, pi: Array, nu: Array) -> tuple[Array, Array, Array]:
        """Costs (N, C) and (N, P) of contacts and swings, and the wrench (N, C, 6) on each contact."""
        along = FOLLOW * np.cross(self.problem.weight_N, pi[:, 3:])
        along[:, :2] += nu
        least, wrench = self.carriers.wrenches(pi, limb.contacts)
        up, down = np.maximum(along, 0.0), np.minimum(along, 0.0)
        return least + along @ limb.place.T, up @ limb.low.T + down @ limb.high.T + self._earned, wrench

    def _body(self, pi: Array, nu: Array) -> tuple[float, Array, Array, Array]:
        """The body's share, and its slopes in pi but for the slope of c, in nu, and in that."""
        problem, about, every = self.problem, self.about, np.arange(self.knots)
        weight = problem.weight_N
        slope = np.cross(weight, pi[:, 3:])  # of  pi_M . (c x M g)  in c
        by_pi, by_nu = np.zeros_like(pi), np.zeros_like(nu)
        by_pi[:, :3] = weight
        size = np.linalg.norm(nu, axis=2)
        yaws = np.tile(about.yaw_cost, (self.knots, 1))
        for i, limb in enumerate(self._limbs):
            yaws -= nu[:, i] @ limb.shoulder.T + size[:, i, None] * limb.length
        yaw = yaws.argmin(axis=1)
        way = nu / np.maximum(size, 1e-12)[..., None]
        for i, limb in enumerate(self._limbs):
            by_nu[:, i] -= limb.shoulder[yaw] + limb.length[yaw, None] * way[:, i]
        rests = np.minimum(slope[:, None] * self._rest[:, 0], slope[:, None] * self._rest[:, 1]).sum(axis=2)
        rests += about.tilt_cost.min(axis=1)
        tilt = rests.argmin(axis=1)
        by_slope = np.where(slope > 0.0, self._rest[tilt, 0], self._rest[tilt, 1])
        ends = self.windows[:-1, 0], self.windows[:-1, 1]
        helped = self._still.most(pi, *ends)
        by_pi -= self._still.slopes(pi, *ends)
        total = float(yaws[every, yaw].sum() + rests[every, tilt].sum() + (pi[:, :3] @ weight).sum() - helped.sum())
        follow = 1.0 - 4 * FOLLOW
        by_place = np.append(follow * slope, np.zeros((1, 3)), axis=0)
        by_place[:-1, :2] -= nu.sum(axis=1)
        for axis in range(3):
            cost, path = self._path(axis, by_place[:, axis])
            total += cost
            by_slope[:, axis] += follow * path[:-1]
            if axis < 2:
                by_nu[:, :, axis] -= path[:-1, None]
        return total, by_pi, by_nu, by_slope

    def _path(self, axis: int, slope: Array) -> tuple[float, Array]:
        """Least of Q (r - g)^2 + slope r over paths no faster than (7) allows, by weak duality; and about where."""
        problem, low, high = self.problem, self.windows[:, 0, axis], self.windows[:, 1, axis]
        weight, goal = problem.weights.position, problem.goal.body.position_m[axis]
        step, many, slope = problem.body.max_speed_m_s * problem.dt_s, self.knots, slope - 2 * weight * goal
        if axis < 2:
            moved = sp.diags([-np.ones(many), np.ones(many)], [0, 1], shape=(many, many + 1), format="csc")
            square = sp.diags(np.full(many + 1, 2 * weight + 1e-9), format="csc")
            rows = moved, np.full(many, -step), np.full(many, step)
            multipliers = np.nan_to_num(Qp(square, slope, None, rows, low, high).solve().of_rows)
            slope = slope + moved.T @ multipliers
            step = step * float(np.abs(multipliers).sum())
        else:
            step = 0.0
        place = np.where(slope > 0.0, low, high) if weight <= 0.0 else np.clip(-slope / (2 * weight), low, high)
        return float((weight * (place**2 + goal**2) + slope * place).sum() - step), place


def size(problem: Problem) -> int:
    """At most how many costs of limbs' knots there are."""
    many = [len(distinct(problem, limb)) for limb in range(4)]
    return problem.steps * sum(n * (n + 1) for n in many)


def ascended(dual: LimbByLimb, x: Array, heat: float, steps: int) -> Array:
    """Better multipliers than x, by so many evaluations of the soft least at most."""
    from scipy.optimize import minimize  # slow to import, and small walls do without

    def cost(x: Array) -> tuple[float, Array]:
        found = dual.soft(x, heat)
        return (_NONE, np.zeros_like(x)) if found is None else (-found[0], -found[1])

    options = {"maxfun": steps, "maxiter": steps, "maxcor": 15}
    return np.asarray(minimize(cost, x, jac=True, method="L-BFGS-B", options=options).x)
