"""The ADMM loops: (17) in general, (19) with two blocks, P3 with a block for every limb.

In scaled form, with eta = [x; u] of the contact blocks, its copy delta and the scaled dual epsilon:

    eta     <- argmin J + rho / 2 |eta - delta + epsilon|^2    contacts: (7), (8a), (9) linear, (10), (13), (14)
    delta   <- argmin     rho / 2 |eta - delta + epsilon|^2    motion: (7), (8), (9)
    epsilon <- epsilon + eta - delta

Two blocks: one MIP for all limbs. Multi-block: the first line falls into one MIP a limb, solved in parallel; the
body's terms of J and (8a) go to the motion NLP, whose own variables are the shared copy: it is the projection.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field

import numpy as np

from crux_planner.admm.consensus import Eta, Residuals, Scales
from crux_planner.admm.contact_block import ContactBlock, ContactPlan
from crux_planner.admm.knot_qp import KnotSolution, plan_cost
from crux_planner.admm.limb_block import LimbPlan, ParallelLimbs
from crux_planner.admm.motion_block import MotionBlock
from crux_planner.admm.stages import Stages
from crux_planner.arrays import Array

RHO, MULTI_RHO = 10.0, 40.0
ITERATIONS, MULTI_ITERATIONS = 10, 40
_RIGHT_OF_WAY = 300.0  # cost of a stage in the air beside a limb that comes before in the order

Report = Callable[[str], None]


@dataclass
class Run:
    """What an ADMM reached by itself: residuals of every iteration, and whether they meet the paper's thresholds."""

    plan: ContactPlan
    residuals: list[Residuals] = field(default_factory=list)
    gaits: list[list[str]] = field(default_factory=list)

    @property
    def converged(self) -> bool:
        """Thresholds in the maximum norm."""
        return bool(self.residuals) and self.residuals[-1].converged


def two_block(
    contacts: ContactBlock, motion: MotionBlock, *, rho: float, iterations: int, deadline: float, report: Report
) -> Run:
    """Equation (19). Stops at the thresholds, after `iterations`, or when the time is up."""
    epsilon = Eta.zeros(motion.problem.steps)
    target: Eta | None = None
    run: Run | None = None
    for iteration in range(1, iterations + 1):
        plan = contacts.minimise(rho, target, deadline)
        eta = plan.eta
        delta = motion.project(eta + epsilon, rho)
        epsilon = epsilon + eta - delta
        target = delta - epsilon
        run = run or Run(plan)
        run.plan = plan
        run.residuals.append(Residuals.of(eta - delta))
        run.gaits.append(plan.schedule.gait)
        report(run.residuals[-1].line(iteration))
        if run.converged or time.monotonic() > deadline:
            break
    assert run is not None
    return run


def multi_block(
    stages: Stages,
    limbs: ParallelLimbs,
    motion: MotionBlock,
    scales: Scales,
    *,
    rho: float,
    iterations: int,
    deadline: float,
    report: Report,
) -> Run:
    """P3. Stops at the thresholds, after `iterations`, or when the time is up."""
    problem = motion.problem
    epsilon = Eta.zeros(problem.steps)
    delta, others = _first_guess(stages, limbs, motion, rho, scales)
    run: Run | None = None
    for iteration in range(1, iterations + 1):
        plans = limbs.minimise(rho, delta - epsilon, _yielding(others), others, scales)
        others = _contacts(stages, plans)
        eta = _joined(stages, plans, delta.body - epsilon.body)
        delta = motion.project(eta.eta + epsilon, rho)
        epsilon = epsilon + eta.eta - delta
        wrenches = eta.knots.wrenches
        cost = plan_cost(problem, eta.schedule, delta.body, wrenches)
        run = run or Run(eta)
        run.plan = ContactPlan(eta.eta, eta.schedule, KnotSolution(delta.body, wrenches, cost))
        run.residuals.append(Residuals.of(eta.eta - delta, body=False))
        run.gaits.append(eta.schedule.gait)
        report(run.residuals[-1].line(iteration))
        if run.converged or time.monotonic() > deadline:
            break
    assert run is not None
    return run


def _first_guess(
    stages: Stages, limbs: ParallelLimbs, motion: MotionBlock, rho: float, scales: Scales
) -> tuple[Eta, Array]:
    """A first copy: forces that carry the body at the start, and poses of limbs that choose one after the other."""
    problem = motion.problem
    pose = np.concatenate([problem.start.position_m, problem.start.rpy_rad, np.zeros(6)])
    body = np.tile(pose, (problem.steps + 1, 1))
    nothing: list[dict[int, Array]] = [{} for _ in range(problem.steps)]
    standing = motion.project(Eta.of_contacts(problem, stages.schedule([]), body, nothing), rho)
    forces_alone = Scales(0.0, scales.orientation, scales.rate, scales.force, scales.moment)
    plans: list[LimbPlan] = []
    for limb in range(4):
        others = _contacts(stages, plans)
        plans.append(limbs.minimise_one(limb, rho, standing, _yielding(others)[limb], others, forces_alone))
    chosen = _joined(stages, plans, standing.body).eta
    delta = Eta(chosen.body, chosen.fingers, chosen.yaws, standing.forces, standing.moments)
    return delta, _contacts(stages, plans)


def _yielding(contacts: Array) -> Array:
    """(4, S): what it costs a limb to be in the air where one before it in the order last was.

    Limbs alike would else let go together and, each knowing nothing of the others, stay together.
    """
    flying = contacts < 0
    before = np.cumsum(flying, axis=0) > flying
    return np.where(before, _RIGHT_OF_WAY, 0.0)


def _contacts(stages: Stages, plans: list[LimbPlan]) -> Array:
    """(4, S): the contacts of the limbs planned so far, -1 in the air; of the others the start's."""
    swings = [swing for plan in plans for swing in plan.swings]
    held = [stages.held(limb, swings) for limb in range(4)]
    return np.array([[-1 if c is None else c for c in limb] for limb in held])


def _joined(stages: Stages, plans: list[LimbPlan], body: Array) -> ContactPlan:
    """The limbs' answers as one eta; `body`, which is in no limb's block, keeps what the motion block wants."""
    schedule = stages.schedule([swing for plan in plans for swing in plan.swings])
    wrenches = [
        {limb: plan.wrenches[k] for limb, plan in enumerate(plans) if k in plan.wrenches}
        for k in range(stages.problem.steps)
    ]
    eta = Eta.of_contacts(stages.problem, schedule, body, wrenches)
    return ContactPlan(eta, schedule, KnotSolution(body, wrenches, np.inf))
