"""One limb's MIP of P3: contacts, gripper poses and wrenches of a limb against its shared copy; exact on the windows.

Without the other limbs a limb's contacts are a path through windows, and given a contact its wrenches are one small
convex problem a knot: min R |u|^2 + rho / 2 |lambda - target|^2 on the limit surface. So the MIP is a shortest path,
solved to proven optimality without branching. Blocks of different limbs are solved in parallel (`worker.Team`).
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from crux_planner.admm.agreement import ContactCosts
from crux_planner.admm.limb_paths import LimbPaths, Path
from crux_planner.admm.window_cost import arc_costs, held_costs
from crux_planner.admm.windows import REST_KNOTS, Windows
from crux_planner.model.arrays import Array
from crux_planner.physics.bounds import wrench_bounds
from crux_planner.physics.limit_surface import finger_forces
from crux_planner.search.equilibrium import WRENCH, StaticEquilibrium
from crux_planner.solvers.qp import Qp
from crux_planner.trajectory.consensus import Eta, Scales


@dataclass(frozen=True)
class LimbAnswer:
    """A limb's MIP solved: its cheapest path, the costs behind it, the best wrenches (N, C, 5) on every contact."""

    path: Path
    costs: ContactCosts
    wrenches: Array


@dataclass(frozen=True)
class LimbBlock:
    """The MIP of limb `limb`."""

    windows: Windows
    equilibrium: StaticEquilibrium
    limb: int

    def minimise(self, rho: float, target: Eta, scales: Scales) -> LimbAnswer:
        """Minimise the limb's part of J and of rho / 2 |eta - target|^2."""
        windows, limb = self.windows, self.limb
        wrenches, effort = self._wrenches(rho, target, scales)
        held = held_costs(windows, limb, target, rho, scales)
        for t in range(windows.count):
            first, end = windows.span(t)
            held[t] += effort[first:end].sum(axis=0)
        arcs = arc_costs(windows, limb, target, rho, scales)
        for i, arc in enumerate(windows.arcs[limb]):
            rest = windows.span(arc.first)[0]
            arcs[i] += effort[rest : rest + REST_KNOTS, arc.start].sum()
        return LimbAnswer(LimbPaths(windows, limb).shortest(held, arcs), ContactCosts(held, arcs), wrenches)

    def _wrenches(self, rho: float, target: Eta, scales: Scales) -> tuple[Array, Array]:
        """Best q (N, C, 5) for each knot and contact, and its cost (N, C) above that of the limb in the air."""
        problem, equilibrium = self.windows.problem, self.equilibrium
        near, turn = rho * scales.force**2, rho * scales.moment**2
        effort = problem.weights.wrench * np.array([2.0, 2.0, 2.0 / problem.patch.k_m**2, 1.0, 1.0])
        hessian = np.diag(2 * effort + near * np.array([2.0, 2.0, 0.0, 1.0, 1.0]) + turn * np.array([0, 0, 2.0, 0, 0]))
        fingers = slice(2 * self.limb, 2 * self.limb + 2)
        forces, moments = target.forces[:, fingers].reshape(-1, 6), target.moments[:, fingers].reshape(-1, 6)
        answers = np.zeros((problem.steps, len(problem.contacts), WRENCH))
        costs = np.zeros((problem.steps, len(problem.contacts)))
        for c in self.windows.contacts[self.limb]:
            contact = problem.contacts[c]
            low, high = wrench_bounds(problem, contact)
            low, high = np.maximum(low, -1e3), np.minimum(high, 1e3)
            units = [finger_forces(unit, contact.axis, contact.tangent) for unit in np.eye(5)]
            to_force, to_moment = (np.stack([unit[i].ravel() for unit in units], axis=1) for i in (0, 1))
            loads = [-np.outer(load, unit) for load, unit in zip(equilibrium.load[c], np.eye(2), strict=True)]
            rows = np.vstack([np.hstack([equilibrium.directions, load]) for load in loads])
            right = equilibrium.spine[c].ravel()
            linear = -near * forces @ to_force - turn * moments @ to_moment
            qp = Qp(hessian, linear[0], None, (rows, None, right), low, high)
            for k in range(problem.steps):
                q = qp.solve(linear[k]).x
                answers[k, c] = q
                costs[k, c] = 0.5 * q @ hessian @ q + linear[k] @ q
        return answers, costs
