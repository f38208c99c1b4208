"""The feet of P3 on a walk: a MIP for each, solved in parallel; then their forces and footholds at the knots by QPs.

A foot's block is P2a's rows of that foot (walk_mip.WalkMip). The body is in none of them: (8) and (9a) are the NLP's.
"""

from __future__ import annotations

import numpy as np
from crux_contracts import LIMB_NAMES

from crux_planner.admm.admm import ContactPlan
from crux_planner.admm.walk_mip import WalkMip
from crux_planner.errors import InfeasibleError
from crux_planner.model.arrays import Array
from crux_planner.model.gait import Gait, nominal_footholds
from crux_planner.model.slots import Slot, Slots
from crux_planner.model.walk_problem import WalkProblem
from crux_planner.physics.bounds import foothold_bounds, least_load_N, step_polygon
from crux_planner.physics.cost import FORCE_SHARE
from crux_planner.solvers.qp import SparseQp
from crux_planner.solvers.worker import Team
from crux_planner.trajectory.consensus import Eta, Scales
from crux_planner.trajectory.walk_qp import WalkKnots

_TIME_S = 6.0  # of a foot's MIP
_SIDES = 8  # of the polygon inside the cone


class FootMips:
    """The MIPs of a process: rows of every foot by itself, of which one is asked for."""

    def __init__(self, problem: WalkProblem, scales: Scales) -> None:
        self._mip, self._scales = WalkMip(problem, alone=True), scales

    def __call__(self, limb: int, rho: float, target: Eta) -> tuple[Slot, ...]:
        """The foot's steps in the argmin of its share. Raises InfeasibleError."""
        values, _ = self._mip.solve(rho, target, self._scales, time_limit_s=_TIME_S, limb=limb)
        if values is None:
            raise InfeasibleError("contacts", f"{LIMB_NAMES[limb]} finds no steps to the goal in its block")
        return self._mip.slots(values, limb)


class WalkLimbs:
    """The four feet's blocks as one."""

    def __init__(self, problem: WalkProblem, mips: Team[tuple[Slot, ...]], scales: Scales) -> None:
        self._problem, self._mips, self._scales = problem, mips, scales

    def standing(self) -> Eta:
        """Nothing but the start, and no forces."""
        n, start = self._problem.steps, self._problem.start
        body = np.tile(np.concatenate([start.position_m, start.rpy_rad, np.zeros(6)]), (n + 1, 1))
        feet = np.tile(np.pad(self._problem.start_feet_w_m, ((0, 0), (0, 1))), (n + 1, 1, 1))
        return Eta.of_points(body, feet, np.zeros((n, len(LIMB_NAMES), 3)))

    def minimise(self, rho: float, target: Eta) -> ContactPlan[WalkKnots]:
        """Every foot's argmin against `target`."""
        problem = self._problem
        slots = self._mips.answers([(limb, rho, target) for limb in range(len(LIMB_NAMES))])
        gait = Slots(tuple(slots)).gait(problem.steps + 1)
        footholds, forces = self._footholds(gait, target), self._forces(gait, rho, target)
        knots = WalkKnots(gait, target.body, forces, footholds, problem, np.inf)
        return ContactPlan(Eta.of_points(target.body, knots.feet(problem.step_height_m), forces), knots)

    def _footholds(self, gait: Gait, target: Eta) -> Array:
        """Those (4 + S, 2) with which the feet are nearest to the target."""
        problem, qp, blend, last = self._problem, SparseQp(), gait.blend, list(range(len(LIMB_NAMES)))
        spots, nominal = foothold_bounds(problem, gait), nominal_footholds(problem, gait)
        if spots is None:
            raise InfeasibleError("contacts", "the feet's blocks leave no footholds")
        start = [qp.variables(at, at) for at in problem.start_feet_w_m]
        places = np.array([*start, *(qp.variables(low, high) for low, high in zip(*spots, strict=True))])
        for j, step in enumerate(gait.steps):
            both = last[step.limb], len(LIMB_NAMES) + j
            normals, most = step_polygon(problem, step, *nominal[list(both)])
            qp.below(np.hstack([-normals, normals]), places[list(both)].ravel(), most)
            until = next((s.lift for s in gait.steps[j + 1 :] if s.limb == step.limb), problem.steps + 1)
            for k in range(step.lift, until):
                shares = np.tile(blend[k, step.limb, list(both)], (2, 1))
                if shares.any():
                    qp.squares(places[list(both)].T, shares, target.fingers[k, step.limb, :2], 1.0)
            last[step.limb] = both[1]
        found = qp.solve()
        if found is None:
            raise InfeasibleError("contacts", "the feet's blocks leave no footholds")
        footholds: Array = found[places]
        return footholds

    def _forces(self, gait: Gait, rho: float, target: Eta) -> Array:
        """Those (N, 4, 3) in the cone that are cheapest by J and the consensus term."""
        problem, qp, on = self._problem, SparseQp(), gait.stance[:-1]
        effort, near = FORCE_SHARE * problem.weights.wrench, rho / 2 * self._scales.force**2
        angles = 2 * np.pi * np.arange(_SIDES) / _SIDES
        cone = np.column_stack([np.cos(angles), np.sin(angles), np.full(_SIDES, -problem.friction * np.cos(np.pi / 8))])
        most, forces = problem.max_normal_N, np.zeros(target.forces.shape)
        places = np.argwhere(on)
        columns = [qp.variables(np.array([-most, -most, least_load_N(problem)]), np.full(3, most)) for _ in places]
        for q, (k, limb) in zip(columns, places, strict=True):
            qp.below(cone, q, np.zeros(_SIDES))
            wanted = near / (near + effort) * target.forces[k, limb]
            qp.squares(q[:, None], np.ones((3, 1)), wanted, near + effort)
        found = qp.solve()
        if found is None:
            raise InfeasibleError("contacts", "a foot's forces leave the cone")
        forces[on] = found[np.array(columns)]
        return forces
