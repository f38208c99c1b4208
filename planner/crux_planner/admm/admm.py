"""The ADMM loops: (17) in general, (19) with two blocks, P3 with a block for every limb.

In scaled form, with eta = [x; u] of the contact blocks, its copy delta and the scaled dual epsilon:

    eta     <- argmin J + rho / 2 |eta - delta + epsilon|^2    contacts: (7), (8a), (9) linear, (10), (13), (14)
    delta   <- argmin     rho / 2 |eta - delta + epsilon|^2    motion: (7), (8), (9)
    epsilon <- epsilon + eta - delta

Two blocks: one MIP for all limbs. Multi-block: the first line falls into one MIP a limb, solved in parallel; the
body's terms of J and (8a) go to the motion NLP, whose own variables are the shared copy: it is the projection.
Both stop when the largest residual of any body or finger position and of any force component (maximum norm) is within
the paper's thresholds, unless they are to run `to_the_end`.
The loops know nothing of holds or feet.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from typing import Any, Generic, Protocol, Self, TypeVar

from crux_contracts import LIMB_NAMES

from crux_planner.model.arrays import Array
from crux_planner.solvers import clock
from crux_planner.trajectory.consensus import Eta, Residuals

Report = Callable[[str], None]


class Knots(Protocol):
    """Contacts decided, with the x and u at the knots that go with them."""

    @property
    def cost(self) -> float: ...
    @property
    def order(self) -> list[str]: ...
    def with_body(self, body: Array) -> Self: ...


K = TypeVar("K", bound=Knots)


@dataclass(frozen=True)
class ContactPlan(Generic[K]):
    """eta of the contact blocks with the contacts behind it."""

    eta: Eta
    knots: K


class Contacts(Protocol[K]):
    """The MIP of all limbs."""

    def minimise(self, rho: float, target: Eta | None, deadline: float) -> ContactPlan[K]:
        """argmin J + rho / 2 |eta - target|^2; without a target, J alone. Raises InfeasibleError."""
        ...


class Limbs(Protocol[K]):
    """One MIP a limb."""

    def first_guess(self, motion: Motion, rho: float) -> Eta:
        """The copy that the limbs meet in the first iteration."""
        ...

    def minimise(self, rho: float, target: Eta) -> ContactPlan[K]:
        """Every limb's argmin of its share, joined; the body, in no limb's block, is the target's."""
        ...


class LimbBlocks:
    """The MIPs of all limbs, `make(*arguments, limb)` each."""

    def __init__(self, make: Callable[..., Any], *arguments: Any) -> None:
        self._blocks = [make(*arguments, limb) for limb in range(len(LIMB_NAMES))]

    def __call__(self, limb: int, *question: Any) -> Any:
        """The argmin of one limb."""
        return self._blocks[limb].minimise(*question)


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


@dataclass(kw_only=True)
class Decided(Generic[K]):
    """What a method reached by itself: residuals of every iteration, and whether they meet the paper's thresholds."""

    knots: K
    residuals: list[Residuals] = field(default_factory=list)
    gaits: list[list[str]] = field(default_factory=list)
    relaxations: dict[float, int] = field(default_factory=dict)  # the benchmark's, and ipopt's iterations for each

    @property
    def converged(self) -> bool:
        """Thresholds in the maximum norm; the benchmark is only handed out where it ends."""
        return bool(self.relaxations) or (bool(self.residuals) and self.residuals[-1].converged)

    @property
    def iterations(self) -> int:
        """Of the ADMM, or of ipopt."""
        return len(self.residuals) or sum(self.relaxations.values())

    @property
    def history(self) -> list[dict[str, float]]:
        """The residuals as `crux plan --json` shows them."""
        return [asdict(each) for each in self.residuals]

    def to_json(self) -> dict[str, Any]:
        """What `crux plan --json` says of the method before the exact program."""
        said = {"cost": self.knots.cost, "converged": self.converged, "gait": self.knots.order}
        return {**said, "relaxations": self.relaxations} if self.relaxations else said


def two_block(contacts: Contacts[K], motion: Motion, given: Settings, rho: float, iterations: int) -> Decided[K]:
    """Equation (19). Stops at the thresholds, after `iterations`, or when the time is up."""
    rho = given.rho or rho

    def decide(target: Eta | None) -> ContactPlan[K]:
        return contacts.minimise(rho, target, given.deadline)

    return _run(decide, motion, None, given, rho, iterations)


def multi_block(limbs: Limbs[K], motion: Motion, given: Settings, rho: float, iterations: int) -> Decided[K]:
    """P3. Stops at the thresholds, after `iterations`, or when the time is up."""
    rho = given.rho or rho
    first = limbs.first_guess(motion, rho)

    def decide(target: Eta | None) -> ContactPlan[K]:
        return limbs.minimise(rho, target or first)

    return _run(decide, motion, first, given, rho, iterations)


def _run(
    decide: Callable[[Eta | None], ContactPlan[K]],
    motion: Motion,
    first: Eta | None,
    given: Settings,
    rho: float,
    iterations: int,
) -> Decided[K]:
    """The loop (17); where it begins from a `first` copy, the contacts do not decide on the body, the copy does."""
    epsilon: Eta | None = None
    run: Decided[K] | None = None
    target = first
    for iteration in range(1, (given.iterations or iterations) + 1):
        plan = decide(target)
        eta = plan.eta
        epsilon = epsilon or eta.times(0.0)
        delta = motion.project(eta + epsilon, rho)
        epsilon = epsilon + eta - delta
        target = delta - epsilon
        run = run or Decided(knots=plan.knots)
        run.knots = plan.knots if first is None else plan.knots.with_body(delta.body)
        run.residuals.append(Residuals.of(eta - delta, body=first is None))
        run.gaits.append(plan.knots.order)
        given.report(_line(run, iteration))
        if (run.converged and not given.to_the_end) or clock.now() > given.deadline:
            break
    assert run is not None
    return run


def _line(run: Decided[K], iteration: int) -> str:
    """One line for people."""
    text = f"{run.residuals[-1].line(iteration)}; gait {' '.join(run.gaits[-1])}"
    return f"{text}; within the thresholds in the maximum norm" if run.converged else text
