"""The limbs of P3 on a wall of holds: their blocks' answers joined, and what each is told of the others."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from crux_planner.admm.consensus import Eta, Scales
from crux_planner.admm.contact_block import ContactPlan
from crux_planner.admm.knot_qp import KnotSolution, plan_cost
from crux_planner.admm.limb_block import LimbPlan, ParallelLimbs
from crux_planner.admm.stages import Stages
from crux_planner.arrays import Array

if TYPE_CHECKING:
    from crux_planner.admm.admm import Motion

_RIGHT_OF_WAY = 300.0  # cost of a stage in the air beside a limb that comes before in the order


class ClimbLimbs:
    """The four limb blocks of a climb as one."""

    def __init__(self, stages: Stages, blocks: ParallelLimbs, scales: Scales) -> None:
        self._stages, self._blocks, self._scales = stages, blocks, scales
        self._others = self._contacts([])

    def first_guess(self, motion: Motion, rho: float) -> Eta:
        """A first copy: forces that carry the body at the start, and poses of limbs that choose one after another."""
        stages, problem, scales = self._stages, self._stages.problem, self._scales
        pose = np.concatenate([problem.start.position_m, problem.start.rpy_rad, np.zeros(6)])
        body = np.tile(pose, (problem.steps + 1, 1))
        nothing: list[dict[int, Array]] = [{} for _ in range(problem.steps)]
        standing = motion.project(Eta.of_contacts(problem, stages.schedule([]), body, nothing), rho)
        forces_alone = Scales(0.0, scales.orientation, scales.rate, scales.force, scales.moment)
        plans: list[LimbPlan] = []
        for limb in range(4):
            others = self._contacts(plans)
            plans.append(self._blocks.minimise_one(limb, rho, standing, _yielding(others)[limb], others, forces_alone))
        chosen = self._joined(plans, standing.body).eta
        self._others = self._contacts(plans)
        return Eta(chosen.body, chosen.fingers, chosen.yaws, standing.forces, standing.moments)

    def minimise(self, rho: float, target: Eta) -> ContactPlan:
        """Every limb's argmin against `target`, in parallel, joined."""
        plans = self._blocks.minimise(rho, target, _yielding(self._others), self._others, self._scales)
        self._others = self._contacts(plans)
        return self._joined(plans, target.body)

    def with_body(self, plan: ContactPlan, delta: Eta) -> ContactPlan:
        """The limbs' plan with the body of the copy, and J of both."""
        wrenches = plan.knots.wrenches
        cost = plan_cost(self._stages.problem, plan.schedule, delta.body, wrenches)
        return ContactPlan(plan.eta, plan.schedule, KnotSolution(delta.body, wrenches, cost))

    def _contacts(self, plans: list[LimbPlan]) -> Array:
        """(4, S): the contacts of the limbs planned so far, -1 in the air; of the others the start's."""
        swings = [swing for plan in plans for swing in plan.swings]
        held = [self._stages.held(limb, swings) for limb in range(4)]
        return np.array([[-1 if c is None else c for c in limb] for limb in held])

    def _joined(self, plans: list[LimbPlan], body: Array) -> ContactPlan:
        """The limbs' answers as one eta, with the body given."""
        schedule = self._stages.schedule([swing for plan in plans for swing in plan.swings])
        wrenches = [
            {limb: plan.wrenches[k] for limb, plan in enumerate(plans) if k in plan.wrenches}
            for k in range(self._stages.problem.steps)
        ]
        eta = Eta.of_contacts(self._stages.problem, schedule, body, wrenches)
        return ContactPlan(eta, schedule, KnotSolution(body, wrenches, np.inf))


def _yielding(contacts: Array) -> Array:
    """(4, S): what it costs a limb to be in the air where one before it in the order last was.

    Limbs alike would else let go together and, each knowing nothing of the others, stay together.
    """
    flying = contacts < 0
    before = np.cumsum(flying, axis=0) > flying
    return np.where(before, _RIGHT_OF_WAY, 0.0)
