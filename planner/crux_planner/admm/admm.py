"""The ADMM loops: (17) in general, (19) with two blocks, P3 with a block for every limb.

In scaled form, with eta = [x; u] of the contact blocks, its copy delta and the scaled dual epsilon:

    eta     <- argmin J + rho / 2 |eta - delta + epsilon|^2    contacts: (7), (8a), (9) linear, (10), (13), (14)
    delta   <- argmin     rho / 2 |eta - delta + epsilon|^2    motion: (7), (8), (9)
    epsilon <- epsilon + eta - delta

Two blocks: one MIP for all limbs. Multi-block: the first line falls into one MIP a limb, solved in parallel; the
body's terms of J and (8a) go to the motion NLP, whose own variables are the shared copy: it is the projection.
Both stop when the largest residual of any body or finger position and of any force component (maximum norm) is within
the paper's thresholds, unless they are to run `to_the_end`.
The loops know nothing of holds or feet: blocks of climbing and of walking (`walk_*`) are beside them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from typing import Any, Generic, Protocol, TypeVar

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


@dataclass(frozen=True, kw_only=True)
class Settings:
    """What a method is given beside its problem; rho and iterations None: the method's own."""

    deadline: float  # of clock.now
    rho: float | None = None
    iterations: int | None = None
    moments: bool = True  # (8b) in the contact block; without it the trot of the paper's figure 6 appears
    to_the_end: bool = False  # all iterations, thresholds or not
    report: Report = lambda _line: None


@dataclass(frozen=True, kw_only=True)
class Outcome:
    """How a method came to what it decided."""

    converged: bool
    iterations: int
    residuals: list[dict[str, float]] = field(default_factory=list)
    gaits: list[list[str]] = field(default_factory=list)


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

    @property
    def outcome(self) -> dict[str, Any]:
        """What an `Outcome` has."""
        residuals = [asdict(each) for each in self.residuals]
        return {"converged": self.converged, "iterations": len(residuals), "residuals": residuals, "gaits": self.gaits}


def two_block(contacts: Contacts[P], motion: Motion, given: Settings, rho: float, iterations: int) -> Run[P]:
    """Equation (19). Stops at the thresholds, after `iterations`, or when the time is up."""
    rho = given.rho or rho

    def decide(target: Eta | None) -> P:
        return contacts.minimise(rho, target, given.deadline)

    return _run(decide, motion, None, lambda plan, _delta: plan, True, given, rho, iterations)


def multi_block(limbs: Limbs[P], motion: Motion, given: Settings, rho: float, iterations: int) -> Run[P]:
    """P3. Stops at the thresholds, after `iterations`, or when the time is up."""
    rho = given.rho or rho
    first = limbs.first_guess(motion, rho)

    def decide(target: Eta | None) -> P:
        return limbs.minimise(rho, target or first)

    return _run(decide, motion, first, limbs.with_body, False, given, rho, iterations)


def _run(
    decide: Callable[[Eta | None], P],
    motion: Motion,
    target: Eta | None,
    joined: Callable[[P, Eta], P],
    body: bool,
    given: Settings,
    rho: float,
    iterations: int,
) -> Run[P]:
    """The loop (17), from a first `target` if there is one; `body`: the contacts decide on the body too."""
    epsilon: Eta | None = None
    run: Run[P] | None = None
    for iteration in range(1, (given.iterations or iterations) + 1):
        plan = decide(target)
        eta = plan.eta
        epsilon = epsilon or eta.times(0.0)
        delta = motion.project(eta + epsilon, rho)
        epsilon = epsilon + eta - delta
        target = delta - epsilon
        run = run or Run(plan)
        run.plan = joined(plan, delta)
        run.residuals.append(Residuals.of(eta - delta, body=body))
        run.gaits.append(plan.gait)
        given.report(_line(run, iteration))
        if (run.converged and not given.to_the_end) or clock.now() > given.deadline:
            break
    assert run is not None
    return run


def _line(run: Run[P], iteration: int) -> str:
    """One line for people."""
    text = f"{run.residuals[-1].line(iteration)}; gait {' '.join(run.gaits[-1])}"
    return f"{text}; within the thresholds in the maximum norm" if run.converged else text
