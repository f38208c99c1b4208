"""The limbs of P3 on a wall of holds: their blocks solved in parallel, then one contact sequence for all."""

from __future__ import annotations

import numpy as np
from crux_contracts import LIMB_NAMES

from crux_planner.admm.admm import ContactPlan, Motion
from crux_planner.admm.agreement import Agreement
from crux_planner.admm.limb_block import LimbAnswer
from crux_planner.admm.windows import Swinging, Windows
from crux_planner.model.arrays import Array
from crux_planner.search.equilibrium import StaticEquilibrium
from crux_planner.solvers.worker import Team
from crux_planner.trajectory.consensus import Eta, Scales
from crux_planner.trajectory.knot_qp import KnotSolution, solve_knots


class ClimbLimbs:
    """The four limb blocks of a climb as one."""

    def __init__(
        self,
        windows: Windows,
        equilibrium: StaticEquilibrium,
        blocks: Team[LimbAnswer],
        scales: Scales,
        deadline: float,
    ) -> None:
        self._windows, self._balance, self._blocks, self._scales = windows, equilibrium, blocks, scales
        self._agreement, self._deadline = Agreement(windows, equilibrium), deadline

    def first_guess(self, motion: Motion, rho: float) -> Eta:
        """A first copy: forces that carry the body at the start, and the poses of limbs that agreed on a way."""
        problem, scales = self._windows.problem, self._scales
        pose = np.concatenate([problem.start.position_m, problem.start.rpy_rad, np.zeros(6)])
        body = np.tile(pose, (problem.steps + 1, 1))
        nothing: list[dict[int, Array]] = [{} for _ in range(problem.steps)]
        standing = motion.project(Eta.of_contacts(problem, self._windows.schedule([]), body, nothing), rho)
        forces_alone = Scales(0.0, scales.orientation, scales.rate, scales.force, scales.moment)
        chosen = self._agreed(self._answers(rho, standing, forces_alone), standing.body).eta
        return Eta(chosen.body, chosen.fingers, chosen.yaws, standing.forces, standing.moments)

    def minimise(self, rho: float, target: Eta) -> ContactPlan[KnotSolution]:
        """Every limb's argmin against `target`, in parallel, then the cheapest sequence on which they agree."""
        return self._agreed(self._answers(rho, target, self._scales), target.body)

    def _answers(self, rho: float, target: Eta, scales: Scales) -> list[LimbAnswer]:
        return self._blocks.answers([(limb, rho, target, scales) for limb in range(len(LIMB_NAMES))])

    def _agreed(self, answers: list[LimbAnswer], body: Array) -> ContactPlan[KnotSolution]:
        windows, problem = self._windows, self._windows.problem

        def sound(swings: list[Swinging]) -> bool:
            line, schedule = body[:, :3], windows.schedule(swings)
            return solve_knots(problem, self._balance, schedule, 0.0, None, self._scales, line, True) is not None

        paths = self._agreement.cheapest([answer.costs for answer in answers], sound, self._deadline)
        schedule = windows.schedule(self._agreement.swings(paths))
        wrenches = [
            {limb: answers[limb].wrenches[k, c] for limb, c in enumerate(knot) if c is not None}
            for k, knot in enumerate(schedule.contacts[: problem.steps])
        ]
        eta = Eta.of_contacts(problem, schedule, body, wrenches)
        return ContactPlan(eta, KnotSolution(problem, schedule, body, wrenches, np.inf))
