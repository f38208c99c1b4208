"""One limb's MIP of P3 on a walk: when its foot is in the air, its footholds and its forces against its shared copy.

Without the other limbs its forces are one small problem a knot, solved in closed form: the cone's point nearest to the
target shortened by the effort. Footholds enter as squares, so that for given knots in the air they are closed form
too. So the MIP is solved to proven optimality by looking at all knots in the air of one step, or of two.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from crux_contracts import LIMB_NAMES

from crux_planner.errors import InfeasibleError
from crux_planner.model.arrays import Array
from crux_planner.model.gait import LEAST_AIR, Step, longest_step
from crux_planner.model.slots import FIRST_LIFT, LAST_LAND, LEAST_GAP, Slot
from crux_planner.model.walk_problem import FINAL_FOOT_M, WalkProblem
from crux_planner.physics.bounds import least_load_N
from crux_planner.physics.cost import FORCE_SHARE
from crux_planner.trajectory.consensus import Scales

_LONGEST_AIR = 12  # knots


@dataclass(frozen=True)
class FootPlan:
    """A foot's slots, its footholds (S, 2) and its forces (N, 3), 0 in the air."""

    slots: tuple[Slot, ...]
    footholds: Array
    forces: Array


class FootBlock:
    """The MIP of limb `limb`."""

    def __init__(self, problem: WalkProblem, limb: int) -> None:
        self.problem, self.limb = problem, limb
        n = problem.steps
        self.options = [
            (lift, lift + air)
            for air in range(LEAST_AIR, _LONGEST_AIR + 1)
            for lift in range(FIRST_LIFT, n - LAST_LAND - air + 1)
        ]
        self._way = np.zeros((len(self.options), n + 1))
        self._height = np.zeros((len(self.options), n + 1))
        self._air = np.zeros((len(self.options), n))
        for i, (lift, land) in enumerate(self.options):
            way, height = Step(limb, lift, land).shares()
            self._way[i, lift : land + 1], self._way[i, land:] = way, 1.0
            self._height[i, lift : land + 1] = problem.step_height_m * height
            self._air[i, lift:land] = 1.0
        self._longest = np.array([longest_step(problem, Step(limb, *slot)) for slot in self.options])
        self._gram = self._way @ self._way.T
        lifts, lands = np.array(self.options).T
        self._in_order = lands[:, None] + LEAST_GAP <= lifts[None, :]

    def minimise(self, rho: float, feet: Array, forces: Array, air_cost: Array, scales: Scales) -> FootPlan:
        """Minimise the limb's part of J and rho / 2 |eta - target|^2, the target its feet (N + 1, 3) and forces (N, 3).

        `air_cost` (N,) is added in the air. Raises InfeasibleError where neither one step nor two are enough.
        """
        problem = self.problem
        near, pull = rho / 2 * scales.position**2, rho / 2 * scales.force**2
        effort = FORCE_SHARE * problem.weights.wrench
        held = self._in_cone(forces * (pull / (effort + pull)))
        on = effort * (held**2).sum(axis=1) + pull * ((held - forces) ** 2).sum(axis=1)
        off = pull * (forces**2).sum(axis=1) + air_cost
        fixed = self._air @ (off - on) + near * ((self._height**2).sum(axis=1) - 2 * self._height @ feet[:, 2])
        fixed += problem.weights.lift * self._height.sum(axis=1) + 2 * problem.weights.switching
        begin = problem.start_feet_w_m[self.limb]
        ahead = feet[:, :2] - begin
        wanted = self._way @ ahead  # (M, 2)
        slack = problem.goal_feet_w_m[self.limb] - begin
        low, high = slack - FINAL_FOOT_M, slack + FINAL_FOOT_M
        if (low <= 0.0).all() and (high >= 0.0).all() and np.abs(slack).max() < 1e-9:
            return FootPlan((), np.zeros((0, 2)), held)
        one_cost, one = self._one_step(near, wanted, fixed, low, high)
        best = int(np.argmin(one_cost))
        if np.isfinite(one_cost[best]):
            slots: tuple[Slot, ...] = (self.options[best],)
            footholds = begin + one[best][None, :]
            air = self._air[best]
        else:
            i, j, steps = self._two_steps(near, wanted, fixed, low, high)
            slots = (self.options[i], self.options[j])
            footholds = begin + np.cumsum(steps, axis=0)
            air = self._air[i] + self._air[j]
        return FootPlan(slots, footholds, np.where(air[:, None] > 0, 0.0, held))

    def _one_step(self, near: float, wanted: Array, fixed: Array, low: Array, high: Array) -> tuple[Array, Array]:
        """Costs (M,) and steps (M, 2)."""
        own = np.diag(self._gram)[:, None]
        step = np.clip(wanted / own, low, high)
        step *= np.minimum(1.0, self._longest / np.maximum(np.linalg.norm(step, axis=1), 1e-9))[:, None]
        outside = (step < low - 1e-9).any(axis=1) | (step > high + 1e-9).any(axis=1)
        cost = fixed + near * (own * step**2 - 2 * wanted * step).sum(axis=1)
        return np.where(outside, np.inf, cost), step

    def _two_steps(self, near: float, wanted: Array, fixed: Array, low: Array, high: Array) -> tuple[int, int, Array]:
        """The best two options and their steps (2, 2)."""
        own = np.diag(self._gram)
        a, c, b = own[:, None], own[None, :], self._gram
        cost = fixed[:, None] + fixed[None, :]
        steps = np.zeros((2, len(own), len(own), 2))
        for axis in range(2):
            w, v = wanted[:, None, axis], wanted[None, :, axis]
            solvable = np.maximum(a * c - b * b, 1e-9)
            whole = np.clip((w * c - v * b + v * a - w * b) / solvable, low[axis], high[axis])
            first = (w - v - whole * (b - c)) / np.maximum(a + c - 2 * b, 1e-9)  # with the second step what remains
            second = whole - first
            steps[0, ..., axis], steps[1, ..., axis] = first, second
            cost = cost + near * (
                a * first**2 + 2 * b * first * second + c * second**2 - 2 * w * first - 2 * v * second
            )
        lengths = np.linalg.norm(steps, axis=3)
        possible = self._in_order & (lengths[0] <= self._longest[:, None]) & (lengths[1] <= self._longest[None, :])
        cost = np.where(possible, cost, np.inf)
        i, j = np.unravel_index(int(np.argmin(cost)), cost.shape)
        if not np.isfinite(cost[i, j]):
            raise InfeasibleError("contacts", f"{LIMB_NAMES[self.limb]} does not reach its goal with two steps in time")
        return int(i), int(j), steps[:, i, j]

    def _in_cone(self, forces: Array) -> Array:
        """The nearest forces (N, 3) that the cone and the bounds of a foot in stance allow."""
        mu = self.problem.friction
        lateral = np.linalg.norm(forces[:, :2], axis=1)
        normal = np.where(lateral <= mu * forces[:, 2], forces[:, 2], (mu * lateral + forces[:, 2]) / (1 + mu * mu))
        normal = np.clip(normal, least_load_N(self.problem), self.problem.max_normal_N)
        share = np.minimum(1.0, mu * normal / np.maximum(lateral, 1e-9))
        return np.column_stack([forces[:, :2] * share[:, None], normal])
