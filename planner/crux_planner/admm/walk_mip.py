"""P2a of a walk on windows, equation (19a), as a MIP: a binary for each step that a foot may take, in hull form.

A step is a foot in the air through whole windows, by the smooth way that plans have; how far it leads is free within
the foot's speed. A foot stands where it takes no step, and pushes there by (8a) within the cone; of the moments (8b)
nothing is known here, they are the NLP's. (9a) is at level, at the ends of windows. Obstacles are not in it. HiGHS
takes no quadratic MIP: squares enter as tangents, in perspective form where they hang on a binary, more of them where
answers have been.
"""

from __future__ import annotations

from functools import cached_property
from itertools import pairwise

import numpy as np

from crux_planner.model.arrays import Array, Indices
from crux_planner.model.gait import LEAST_AIR, Gait, Step, WalkMotion, longest_step
from crux_planner.model.slots import FIRST_LIFT, LAST_LAND, Slot, Slots
from crux_planner.model.walk_problem import FINAL_FOOT_M, WalkProblem
from crux_planner.physics.bounds import FEET_APART_M, least_load_N, rate_steps, walk_bounds
from crux_planner.physics.cost import FORCE_SHARE
from crux_planner.physics.reach import turned
from crux_planner.solvers.milp import Milp
from crux_planner.trajectory.consensus import Eta, Scales

WINDOW_KNOTS = LEAST_AIR
MOST_WINDOWS = 2  # that a step takes
_FEET = 4
GAP = 0.02
_SIDES = 8  # of the polygon inside the cone, and of the one inside a step's longest way
_TANGENTS_N = (np.array([-10.0, 10.0]), np.array([-10.0, 10.0]), np.array([15.0, 30.0, 45.0]))
_OFF_M = (-0.05, 0.0, 0.05)  # of start and goal, where the first tangents of places are


class WalkMip:
    """The rows of P2a; `alone`, of every foot by itself, without what ties it to the others and the body."""

    def __init__(self, problem: WalkProblem, *, alone: bool = False) -> None:
        self.problem, n = problem, problem.steps
        self.ends = ends = window_ends(n)
        self.count = count = len(ends) - 1
        self.knots = np.diff(ends)  # of each window
        spans = [(i, i + long) for long in range(1, MOST_WINDOWS + 1) for i in range(1, count - long)]
        self.steps = [Step(0, int(ends[i]), int(ends[j])) for i, j in spans]
        self.airborne = np.array([[i <= t < j for i, j in spans] for t in range(count)])
        self._shares = [step.shares() for step in self.steps]
        self.milp = milp = Milp()
        low, high = (bound[ends][:, [0, 1, 2, 6, 7, 8]] for bound in walk_bounds(problem, None))
        far = 1.0 + np.abs(problem.goal.body.position_m).max()
        low, high = np.maximum(low, -far), np.minimum(high, far)
        self.body, self.body_squares = _grid(milp, low, high), _grid(milp, np.zeros(low.shape), np.inf)
        self.taken = _grid(milp, np.zeros((_FEET, len(spans))), 1.0, integer=True)
        self.moved = _grid(milp, np.full((2, _FEET, len(spans)), -far), far)
        self.feet = _grid(milp, np.full((count + 1, _FEET, 2), -far), far)
        self.feet_squares = _grid(milp, np.zeros((count + 1, _FEET, 2)), np.inf)
        most = np.array([problem.friction, problem.friction, 1.0]) * problem.max_normal_N
        self.forces = _grid(milp, np.tile([-most[0], -most[1], 0.0], (count, _FEET, 1)), most)
        self.squares = _grid(milp, np.zeros((count, _FEET, 3)), np.inf)
        self.stands = _grid(milp, np.zeros((count, _FEET)), 1.0)
        self._steps()
        self._forces()
        if not alone:
            self._body_motion()
            self._together()

    def solve(
        self,
        rho: float,
        target: Eta | None,
        scales: Scales,
        *,
        time_limit_s: float,
        start: Array | None = None,
        limb: int | None = None,
    ) -> tuple[Array | None, bool]:
        """Values of all variables, None where none were found; and whether there are none. Of one `limb` if asked."""
        cost, constant = self._cost(rho, target, scales)
        if limb is not None:
            own = np.zeros(cost.shape, dtype=bool)
            for index in (
                self.taken[limb],
                *(x[:, limb] for x in (self.feet, self.feet_squares, self.forces, self.squares)),
            ):
                own[index] = True
            cost[~own] = 0.0
        hint = None
        if start is not None:
            hint = np.full(self.milp.size, np.nan)
            hint[self.taken] = np.round(start[self.taken])
        found = self.milp.solve(cost, constant=constant, gap=GAP, time_limit_s=time_limit_s, start=hint)
        return found.values, found.infeasible

    def slots(self, values: Array, limb: int) -> tuple[Slot, ...]:
        """When a foot of an answer is in the air."""
        chosen = np.flatnonzero(values[self.taken[limb]] > 0.5)
        return tuple(sorted((self.steps[a].lift, self.steps[a].land) for a in chosen))

    def motion(self, values: Array) -> WalkMotion:
        """The gait of an answer at the knots, with its body, forces and footholds."""
        problem, knots = self.problem, np.arange(self.problem.steps + 1)
        gait: Gait = Slots(tuple(self.slots(values, limb) for limb in range(_FEET))).gait(len(knots))
        places = values[self.feet]
        footholds = [places[np.searchsorted(self.ends, step.land), step.limb] for step in gait.steps]
        body = np.zeros((len(knots), 12))
        for axis, column in enumerate((0, 1, 2, 6, 7, 8)):
            body[:, column] = np.interp(knots, self.ends, values[self.body[:, axis]])
        body[:, 3:6] = np.linspace(problem.start.rpy_rad, problem.goal.body.rpy_rad, len(knots))
        forces = np.repeat(values[self.forces], self.knots, axis=0) * gait.stance[:-1, :, None]
        return WalkMotion(gait, body, forces, np.vstack([problem.start_feet_h_m, *footholds]))

    def touch(self, motion: WalkMotion) -> None:
        """Tangents at a motion's forces, body and feet."""
        places, on = (motion.gait.blend @ motion.footholds)[self.ends], motion.gait.stance[self.ends[:-1]]
        forces = np.add.reduceat(motion.forces, self.ends[:-1]) / self.knots[:, None, None]
        self._tangents(self.squares[on], self.forces[on], forces[on], self.stands[on][:, None])
        self._tangents(self.body_squares, self.body, motion.body[self.ends][:, [0, 1, 2, 6, 7, 8]])
        self._tangents(self.feet_squares, self.feet, places)

    def forbid(self, values: Array) -> None:
        """Never these steps again."""
        on = values[self.taken] > 0.5
        self.milp.row(self.taken.ravel(), np.where(on, 1.0, -1.0).ravel(), -np.inf, int(on.sum()) - 1)

    def _tangents(self, squares: Indices, index: Indices, at: Array, held: Indices | None = None) -> None:
        """squares >= x^2 by the tangent at `at`: 2 at x - at^2, times `held` where the square hangs on a binary."""
        if held is None:
            self.milp.add([(squares, 1.0), (index, -2.0 * at)], -(at**2), np.inf)
        else:
            self.milp.add([(squares, 1.0), (index, -2.0 * at), (held, at**2)], 0.0, np.inf)

    def _body_motion(self) -> None:
        """The body's position and velocity from window to window, and squares of what J and the consensus have."""
        problem, milp, r, v = self.problem, self.milp, self.body[:, :3], self.body[:, 3:]
        long = problem.dt_s * self.knots[:, None]
        milp.add([(r[1:], 1.0), (r[:-1], -1.0), (v[:-1], -long / 2), (v[1:], -long / 2)], 0.0, 0.0)
        quick = self.knots[:, None] * rate_steps(problem)[:3]
        milp.add([(v[1:], 1.0), (v[:-1], -1.0)], -quick, quick)
        start, goal = problem.start.position_m, problem.goal.body.position_m
        for at in (start, (start + goal) / 2, goal):
            for off in _OFF_M:
                self._tangents(self.body_squares[:, :3], r, np.broadcast_to(at + off, r.shape))

    def _steps(self) -> None:
        """One step at a time and foot, ways within the foot's speed, and where the feet are."""
        problem, milp = self.problem, self.milp
        for t in range(1, self.count):
            over = self.airborne[t] | self.airborne[t - 1]  # a foot stands between its steps
            milp.add([(column, 1.0) for column in self.taken[:, over].T], 0.0, 1.0)
        for t in range(self.count):
            on = [(column, 1.0) for column in self.taken[:, self.airborne[t]].T]
            milp.add([(self.stands[t], 1.0), *on], 1.0, 1.0)
        longest = np.array([[longest_step(problem, Step(i, s.lift, s.land)) for s in self.steps] for i in range(_FEET)])
        for normal in _polygon():
            ways = [(self.moved[0], normal[0]), (self.moved[1], normal[1])]
            milp.add([*ways, (self.taken, -np.cos(np.pi / _SIDES) * longest)], -np.inf, 0.0)
        milp.add([(self.feet[0], 1.0)], problem.start_feet_h_m, problem.start_feet_h_m)
        for t, (first, end) in enumerate(pairwise(self.ends)):
            share = [self._way(a, end) - self._way(a, first) for a in range(len(self.steps))]
            ahead = [(self.moved[:, :, a].T, -part) for a, part in enumerate(share) if part]
            milp.add([(self.feet[t + 1], 1.0), (self.feet[t], -1.0), *ahead], 0.0, 0.0)
        milp.add([(self.feet[-1], 1.0)], problem.goal_feet_h_m - FINAL_FOOT_M, problem.goal_feet_h_m + FINAL_FOOT_M)
        for at in (problem.start_feet_h_m, problem.goal_feet_h_m):
            for off in _OFF_M:
                self._tangents(self.feet_squares, self.feet, np.broadcast_to(at + off, self.feet.shape))

    def _way(self, a: int, k: int) -> float:
        """Share of a step's way that is behind at a knot."""
        step, ways = self.steps[a], self._shares[a][0]
        return float(ways[np.clip(k - step.lift, 0, step.land - step.lift)])

    @cached_property
    def heights(self) -> Array:
        """(A, N + 1) of a foot above the surface on a step [m]."""
        z = np.zeros((len(self.steps), self.problem.steps + 1))
        for row, step, (_, share) in zip(z, self.steps, self._shares, strict=True):
            row[step.lift : step.land + 1] = self.problem.step_height_m * share
        return z

    def _together(self) -> None:
        """(8a); (9a) with R level, inside what it is for every heading on the way; feet of a side apart."""
        problem, milp, v = self.problem, self.milp, self.body[:, 3:]
        inertia, weight = problem.mass_kg / (problem.dt_s * self.knots[:, None]), problem.mass_kg * problem.gravity_h
        feet = [(self.forces[:, i], -1.0) for i in range(_FEET)]
        milp.add([(v[1:], inertia), (v[:-1], -inertia), *feet], weight, weight)
        boxes = turned(problem.boxes, abs(float(problem.goal.body.rpy_rad[2])))
        low, high = (boxes.middle_m[:, :2] + sign * boxes.extent_m[..., :2] for sign in (-1.0, 1.0))
        milp.add([(self.feet[1:], 1.0), (self.body[1:, None, :2], -1.0)], low, high)
        for front, rear in ((0, 2), (1, 3)):
            milp.add([(self.feet[:, front, 0], 1.0), (self.feet[:, rear, 0], -1.0)], FEET_APART_M, np.inf)

    def _forces(self) -> None:
        """(10b), the polygon inside the cone, and squares."""
        problem, milp, f, on = self.problem, self.milp, self.forces, self.stands
        milp.add([(f[..., 2], 1.0), (on, -problem.max_normal_N)], -np.inf, 0.0)
        milp.add([(f[..., 2], 1.0), (on, -least_load_N(problem))], 0.0, np.inf)
        cone = problem.friction * np.cos(np.pi / _SIDES)
        for normal in _polygon():
            milp.add([(f[..., 0], normal[0]), (f[..., 1], normal[1]), (f[..., 2], -cone)], -np.inf, 0.0)
        for axis, tangents in enumerate(_TANGENTS_N):
            for at in tangents:
                self._tangents(self.squares[..., axis], f[..., axis], np.full(on.shape, at), on)

    def _cost(self, rho: float, target: Eta | None, scales: Scales) -> tuple[Array, float]:
        """J and, where there is a target, the consensus term, with its constant; ends of windows stand for knots."""
        problem, weights = self.problem, self.problem.weights
        vector, knots = np.zeros(self.milp.size), self.knots[:, None, None]
        each = np.append(self.knots, 1)[:, None]  # knots that an end of a window stands for
        vector[self.taken] = weights.lift * self.heights.sum(axis=1) + 2 * weights.switching
        vector[self.squares] = knots * FORCE_SHARE * weights.wrench
        vector[self.body_squares] = each * np.repeat([weights.position, weights.velocity], 3)
        vector[self.body[:, :3]] = -2 * each * weights.position * problem.goal.body.position_m
        constant = float(each.sum()) * weights.position * float((problem.goal.body.position_m**2).sum())
        if target is None:
            return vector, constant
        near = rho / 2 * np.repeat([scales.position**2, scales.rate**2], 3)
        vector[self.body_squares] += each * near
        vector[self.body] -= 2 * each * near * target.body[self.ends][:, [0, 1, 2, 6, 7, 8]]
        near_foot, near_force = rho / 2 * scales.position**2, rho / 2 * scales.force**2
        vector[self.feet_squares] = near_foot * each[..., None]
        vector[self.feet] = -2 * near_foot * each[..., None] * target.fingers[self.ends, :, :2]
        lifted = (self.heights**2).sum(axis=1) - 2 * target.fingers[..., 2].T @ self.heights.T
        vector[self.taken] += near_foot * lifted
        if len(target.away):
            vector[self.taken] += rho / 2 * scales.flag**2 * ((1.0 - 2.0 * target.away).T @ self.airborne)
        vector[self.squares] += near_force * knots
        vector[self.forces] = -2 * near_force * np.add.reduceat(target.forces, self.ends[:-1])
        feet = (each[..., None] * target.fingers[self.ends, :, :2] ** 2).sum() + (target.fingers[..., 2] ** 2).sum()
        constant += float((each * near * target.body[self.ends][:, [0, 1, 2, 6, 7, 8]] ** 2).sum() + near_foot * feet)
        return vector, constant + near_force * float((target.forces**2).sum())


def window_ends(steps: int) -> Indices:
    """Knots at which windows begin, and the last one."""
    return np.unique([0, *range(FIRST_LIFT, steps - LAST_LAND + 1, WINDOW_KNOTS), steps])


def _polygon() -> list[tuple[float, float]]:
    angles = 2 * np.pi * np.arange(_SIDES) / _SIDES
    return [(float(np.cos(a)), float(np.sin(a))) for a in angles]


def _grid(milp: Milp, low: Array, high: Array | float, *, integer: bool = False) -> Indices:
    """Variables in the shape of their bounds."""
    high = np.broadcast_to(high, low.shape)
    return milp.variables(low.size, low.ravel(), high.ravel(), integer=integer).reshape(low.shape)
