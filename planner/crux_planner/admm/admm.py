"""The ADMM loops: (17) in general, (19) with two blocks, P3 with a block for every limb.

In scaled form, with eta = [x; u] of the contact blocks, its copy delta and the scaled dual epsilon:

    eta     <- argmin J + rho / 2 |eta - delta + epsilon|^2    contacts: (7), (8a), (9) linear, (10), (13), (14)
    delta   <- argmin     rho / 2 |eta - delta + epsilon|^2    motion: (7), (8), (9)
    epsilon <- epsilon + eta - delta

Two blocks: one MIP for all limbs. Multi-block: the first line falls into one MIP a limb, solved in parallel; the
body's terms of J and (8a) go to the motion NLP, whose own variables are the shared copy: it is the projection.
Both stop when the largest residual of any body or finger position and of any force component (maximum norm) is within
the paper's thresholds, unless they are to run `to_the_end`.
The loops know nothing of holds or feet: blocks of climbing are in this package, of walking in crux_planner.walk.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Generic, Protocol, TypeVar

from crux_planner.solvers import clock
from crux_planner.trajectory.consensus import Eta, Residuals

Report = Callable[[str], None]


class Planned(Protocol):
    """Contacts decided, with the x and u that go with them."""

    @property
    def eta(self) -> Eta: ...
    @property
    def gait(self) -> list[str]: ...


P = TypeVar("P", bound=Planned)
Decision_co = TypeVar("Decision_co", bound=Planned, covariant=True)


class Contacts(Protocol[Decision_co]):
    """The MIP of all limbs."""

    def minimise(self, rho: float, target: Eta | None, deadline: float) -> Decision_co:
        """argmin J + rho / 2 |eta - target|^2; without a target, J alone. Raises InfeasibleError."""
        ...


class Limbs(Protocol[P]):
    """One MIP a limb."""

    def first_guess(self, motion: Motion, rho: float) -> Eta:
        """The copy that the limbs meet in the first iteration."""
        ...

    def minimise(self, rho: float, target: Eta) -> P:
        """Every limb's argmin of its share, joined; the body, in no limb's block, is the target's."""
        ...

    def with_body(self, plan: P, delta: Eta) -> P:
        """The limbs' plan with the body of the copy."""
        ...


class Motion(Protocol):
    """The NLP, P2b."""

    def project(self, target: Eta, rho: float) -> Eta:
        """argmin rho / 2 |delta - target|^2."""
        ...


@dataclass
class Run(Generic[P]):
    """What an ADMM reached by itself: residuals of every iteration, and whether they meet the paper's thresholds."""

    plan: P
    residuals: list[Residuals] = field(default_factory=list)
    gaits: list[list[str]] = field(default_factory=list)

    @property
    def converged(self) -> bool:
        """Thresholds in the maximum norm."""
        return bool(self.residuals) and self.residuals[-1].converged


def two_block(
    contacts: Contacts[P],
    motion: Motion,
    *,
    rho: float,
    iterations: int,
    deadline: float,
    report: Report,
    to_the_end: bool = False,
) -> Run[P]:
    """Equation (19). Stops at the thresholds, after `iterations`, or when the time is up."""
    epsilon: Eta | None = None
    target: Eta | None = None
    run: Run[P] | None = None
    for iteration in range(1, iterations + 1):
        plan = contacts.minimise(rho, target, deadline)
        eta = plan.eta
        epsilon = epsilon or eta.times(0.0)
        delta = motion.project(eta + epsilon, rho)
        epsilon = epsilon + eta - delta
        target = delta - epsilon
        run = run or Run(plan)
        run.plan = plan
        run.residuals.append(Residuals.of(eta - delta))
        run.gaits.append(plan.gait)
        report(_line(run, iteration))
        if (run.converged and not to_the_end) or clock.now() > deadline:
            break
    assert run is not None
    return run


def multi_block(
    limbs: Limbs[P],
    motion: Motion,
    *,
    rho: float,
    iterations: int,
    deadline: float,
    report: Report,
    to_the_end: bool = False,
) -> Run[P]:
    """P3. Stops at the thresholds, after `iterations`, or when the time is up."""
    delta = limbs.first_guess(motion, rho)
    epsilon = delta.times(0.0)
    run: Run[P] | None = None
    for iteration in range(1, iterations + 1):
        plan = limbs.minimise(rho, delta - epsilon)
        eta = plan.eta
        delta = motion.project(eta + epsilon, rho)
        epsilon = epsilon + eta - delta
        run = run or Run(plan)
        run.plan = limbs.with_body(plan, delta)
        run.residuals.append(Residuals.of(eta - delta, body=False))
        run.gaits.append(plan.gait)
        report(_line(run, iteration))
        if (run.converged and not to_the_end) or clock.now() > deadline:
            break
    assert run is not None
    return run


def _line(run: Run[P], iteration: int) -> str:
    """One line for people."""
    text = f"{run.residuals[-1].line(iteration)}; gait {' '.join(run.gaits[-1])}"
    return f"{text}; within the thresholds in the maximum norm" if run.converged else text
