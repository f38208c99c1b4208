"""The limbs of P3 on a wall of holds: a MIP for each, solved in parallel; then their wrenches at the knots by a QP.

A limb's block is P2a's rows of that limb (hull.HullMilp): its contacts, swings and limit surface. The body is in none
of them: (8) and (9a) are the NLP's.
"""

from __future__ import annotations

import numpy as np
from crux_contracts import LIMB_NAMES

from crux_planner.admm.admm import ContactPlan
from crux_planner.admm.hull import HullMilp
from crux_planner.admm.window_cost import window_cost
from crux_planner.admm.windows import Swinging, Windows
from crux_planner.errors import InfeasibleError
from crux_planner.model.arrays import Array, Indices
from crux_planner.model.schedule import Schedule
from crux_planner.physics.bounds import wrench_bounds
from crux_planner.physics.cost import wrench_weights
from crux_planner.physics.limit_surface import finger_inputs
from crux_planner.physics.static_balance import StaticBalance
from crux_planner.solvers.qp import SparseQp
from crux_planner.solvers.worker import Team
from crux_planner.trajectory.consensus import Eta, Scales
from crux_planner.trajectory.knot_qp import KnotSolution

_GAP, _TIME_S = 0.01, 6.0  # of a limb's MIP
_FREE_N = 300.0


class LimbMips:
    """The MIPs of a process, each built when it is asked for."""

    def __init__(self, windows: Windows, scales: Scales) -> None:
        self._windows, self._scales = windows, scales
        self._balance = StaticBalance(windows.problem, windows.problem.friction_share)
        self._known: dict[int, HullMilp] = {}

    def __call__(self, limb: int, rho: float, target: Eta) -> list[Swinging]:
        """The limb's swings in the argmin of its share. Raises InfeasibleError."""
        if limb not in self._known:
            self._known[limb] = HullMilp(self._windows, self._balance, (limb,))
        milp, cost = self._known[limb], window_cost(self._windows, rho, target, self._scales)
        found = milp.solve(cost, gap=_GAP, time_limit_s=_TIME_S)
        if found.values is None:
            text = f"{LIMB_NAMES[limb]} finds no chain of holds on the windows of its block"
            raise InfeasibleError("contacts", text)
        return milp.decision(found).swings


class ClimbLimbs:
    """The four limb blocks of a climb as one."""

    def __init__(self, windows: Windows, mips: Team[list[Swinging]], scales: Scales) -> None:
        self._windows, self._mips, self._scales = windows, mips, scales
        self._balance = StaticBalance(windows.problem, windows.problem.friction_share)

    def standing(self) -> Eta:
        """Nothing but the start, and no forces."""
        problem = self._windows.problem
        pose = np.concatenate([problem.start.position_m, problem.start.rpy_rad, np.zeros(6)])
        body, nothing = np.tile(pose, (problem.steps + 1, 1)), [dict[int, Array]() for _ in range(problem.steps)]
        return Eta.of_contacts(problem, self._windows.schedule([]), body, nothing)

    def minimise(self, rho: float, target: Eta) -> ContactPlan[KnotSolution]:
        """Every limb's argmin against `target`."""
        problem = self._windows.problem
        answers = self._mips.answers([(limb, rho, target) for limb in range(len(LIMB_NAMES))])
        schedule = self._windows.schedule([swing for swings in answers for swing in swings])
        wrenches = self._wrenches(schedule, rho, target)
        eta = Eta.of_contacts(problem, schedule, target.body, wrenches)
        return ContactPlan(eta, KnotSolution(problem, schedule, target.body, wrenches, np.inf))

    def _wrenches(self, schedule: Schedule, rho: float, target: Eta) -> list[dict[int, Array]]:
        """The argmin of J and the consensus term on the limit surface, for contacts that are given."""
        problem, balance, scales = self._windows.problem, self._balance, self._scales
        effort = problem.weights.wrench * wrench_weights(problem)
        near = rho / 2 * np.array([2 * scales.force**2] * 2 + [2 * scales.moment**2] + [scales.force**2] * 2)
        qp, where = SparseQp(), list[tuple[int, int, Indices]]()
        for k, knot in enumerate(schedule.contacts[: problem.steps]):
            for limb, c in enumerate(knot):
                if c is None:
                    continue
                fingers, contact = slice(2 * limb, 2 * limb + 2), problem.contacts[c]
                forces, moments = target.forces[k, fingers], target.moments[k, fingers]
                wanted = finger_inputs(forces, moments, np.array(contact.yaw_rad))
                wanted[:3] = (
                    wanted[:3] + finger_inputs(forces[::-1], moments[::-1], np.array(contact.yaw_rad))[:3]
                ) / 2
                free = np.array([_FREE_N] * 3 + [balance.max_normal_N] * 2)
                q = qp.variables(*(np.clip(bound, -free, free) for bound in wrench_bounds(problem, contact)))
                root = np.sqrt(effort + near)
                qp.squares(q[:, None], root[:, None], near * wanted / root, 1.0)
                for finger in (0, 1):
                    rows = np.column_stack([balance.directions, np.zeros((len(balance.directions), 2))])
                    rows[:, 3 + finger] = -balance.load[c, finger]
                    qp.below(rows, q, balance.spine[c, finger])
                where.append((k, limb, q))
        found = qp.solve()
        if found is None:
            raise InfeasibleError("contacts", "a limb's wrenches leave the limit surface")
        wrenches: list[dict[int, Array]] = [{} for _ in range(problem.steps)]
        for k, limb, index in where:
            wrenches[k][limb] = found[index]
        return wrenches
