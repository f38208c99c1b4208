"""The ADMM loops: (17) in general, (19) with two blocks, P3 with a block for every limb.

Scaled form: with eta = [x; u] of the contact block, its copy delta, and the scaled dual epsilon,

    eta     <- argmin J + rho / 2 |eta - delta + epsilon|^2    contacts: (7), (8a), (9) linear, (10), (13), (14)
    delta   <- argmin     rho / 2 |eta - delta + epsilon|^2    motion: (7), (8), (9)
    epsilon <- epsilon + eta - delta
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field

from crux_planner.admm.consensus import Eta, Residuals
from crux_planner.admm.contact_block import ContactBlock, ContactPlan
from crux_planner.admm.motion_block import MotionBlock

RHO = 10.0  # the paper's, for climbing
ITERATIONS = 10

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
