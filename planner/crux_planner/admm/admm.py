"""The ADMM loops: (17) in general, (19) with two blocks, P3 with a block for every limb.

In scaled form, with eta = [x; u] of the contact blocks, its copy delta and the scaled dual epsilon:

    eta     <- argmin J + rho / 2 |eta - delta + epsilon|^2    contacts: (7), (8a), (9) linear, (10), (13), (14)
    delta   <- argmin     rho / 2 |eta - delta + epsilon|^2    motion: (7), (8), (9)
    epsilon <- epsilon + eta - delta

Two blocks: one MIP for all limbs. Multi-block: one MIP a limb, solved in parallel, and the motion NLP with the body's
terms of J and (8a), all against a shared copy: the mean of what the limbs and the NLP have with their duals, which is
the projection. Limbs know of one another by this copy alone, of which who is in the air is a part (turns.py). Where the
forces come nearer too slowly, limbs are in the air at other times than where they still differ; the duals stay.
rho begins as the paper's for climbs. What matters beside it is the units of the consensus (methods.py). The NLP is not
convex: where the duals grow, the nearest motion to a copy may be another than before, and the blocks part. Where they
part from one iteration to the next and to the one after that, rho doubles, which halves the scaled duals.

Both stop when the largest residual of any body or finger position and of any force component (maximum norm) is within
the paper's thresholds, unless they are to run `to_the_end`. z is binary: no theorem says that they come so far, and
what does not is said not to have converged. The loops know nothing of holds or feet.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import asdict, dataclass, field, replace
from typing import Any, Generic, Protocol, Self, TypeVar

import numpy as np

from crux_planner.model.arrays import Array
from crux_planner.solvers import clock
from crux_planner.trajectory.consensus import FORCE_THRESHOLD_N, Eta, Residuals

Report = Callable[[str], None]
_PAST, _AHEAD = 6, 30  # iterations whose rate is looked at, and in which at that rate the forces are to be there
_FIRMER = 2.0  # of rho where the blocks part


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

    def minimise(self, rho: float, target: Eta) -> ContactPlan[K]:
        """Every limb's argmin of its share; the body, in no limb's block, is the target's. Raises InfeasibleError."""
        ...

    def in_turn(self, copy: Eta, away: Array, before: Array) -> Eta:
        """The nearest copy in which the swings of `away` take turns; as `before` where others are as near."""
        ...

    def disputed(self, apart: Eta) -> Array:
        """(T, 1): 1 for windows in which limbs and motion are `apart` by more than the threshold on forces."""
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
    """Equation (19), from no copy at all. Stops at the thresholds, after `iterations`, or when the time is up."""
    rho, target, run = given.rho or rho, None, Iterations[K](given)
    epsilon: Eta | None = None
    for _ in range(given.iterations or iterations):
        plan = contacts.minimise(rho, target, given.deadline)
        epsilon = epsilon or plan.eta.times(0.0)
        delta = motion.project(plan.eta + epsilon, rho)
        epsilon = epsilon + plan.eta - delta
        if run.ends(plan.knots, Residuals.of(plan.eta - delta)):
            break
        if run.parts():
            rho, epsilon = _FIRMER * rho, epsilon.times(1.0 / _FIRMER)
        target = delta - epsilon
    return run.decided()


def multi_block(
    limbs: Limbs[K], motion: Motion, first: Eta, given: Settings, rho: float, iterations: int
) -> Decided[K]:
    """P3, from a `first` copy. Stops at the thresholds, after `iterations`, or when the time is up."""
    rho, run = given.rho or rho, Iterations[K](given)
    copy = replace(motion.project(first, rho), away=first.away)
    of_limbs = of_motion = first.times(0.0)
    given_up = np.zeros(first.away.shape)
    for _ in range(given.iterations or iterations):
        plan = limbs.minimise(rho, copy - of_limbs)
        delta = replace(motion.project(copy - of_motion, rho), away=plan.eta.away)
        eta = replace(plan.eta, body=delta.body)
        residuals = replace(Residuals.of(eta - delta, body=False), out_of_turn=int(np.abs(eta.away - copy.away).sum()))
        if run.ends(plan.knots.with_body(delta.body), residuals):
            break
        if run.is_slow():
            given_up += 2.0 * copy.away * limbs.disputed(eta - delta)
        copy = limbs.in_turn((eta + of_limbs + delta + of_motion).times(0.5), eta.away, copy.away - given_up)
        of_limbs, of_motion = of_limbs + eta - copy, of_motion + delta - copy
        if run.parts():
            rho = _FIRMER * rho
            of_limbs, of_motion = of_limbs.times(1.0 / _FIRMER), of_motion.times(1.0 / _FIRMER)
    return run.decided()


class Iterations(Generic[K]):
    """What a loop has come to."""

    def __init__(self, given: Settings) -> None:
        self._given = given
        self._decided: Decided[K] | None = None
        self._since = 0

    def decided(self) -> Decided[K]:
        """After the last iteration; says so where it has not come within the thresholds."""
        run = self._decided
        assert run is not None
        if not run.converged:
            self._given.report(f"not converged after {run.iterations} iterations")
        return run

    def is_slow(self) -> bool:
        """Whether the forces, as they have come nearer lately, will not be there; if so, iterations count from here."""
        forces = self._forces()
        if len(forces) <= _PAST:
            return False
        rate = (forces[-1] / forces[-1 - _PAST]) ** (1.0 / _PAST)
        slow = self._residuals[-1].force_N * rate**_AHEAD > FORCE_THRESHOLD_N
        return self._count_anew(slow, "the forces come nearer too slowly: other turns where they differ")

    def parts(self) -> bool:
        """Whether the forces are further apart for the second time; if so, iterations count from here."""
        forces = self._forces()
        parts = len(forces) > 2 and forces[-3] < forces[-2] < forces[-1]
        return self._count_anew(parts, f"the blocks part: rho times {_FIRMER:g}")

    @property
    def _residuals(self) -> list[Residuals]:
        return [] if self._decided is None else self._decided.residuals

    def _forces(self) -> list[float]:
        """Root mean squares of the iterations that count; none where the blocks agree."""
        counting = self._residuals[self._since :]
        return [] if counting and counting[-1].converged else [each.force_rms_N for each in counting]

    def _count_anew(self, needed: bool, why: str) -> bool:
        if needed:
            self._since = len(self._residuals)
            self._given.report(why)
        return needed

    def ends(self, knots: K, residuals: Residuals) -> bool:
        """Note an iteration and report it; whether it is the last."""
        run = self._decided = self._decided or Decided(knots=knots)
        run.knots = knots
        run.residuals.append(residuals)
        run.gaits.append(knots.order)
        self._given.report(_line(run, len(run.residuals)))
        return (run.converged and not self._given.to_the_end) or clock.now() > self._given.deadline


def _line(run: Decided[K], iteration: int) -> str:
    """One line for people."""
    text = f"{run.residuals[-1].line(iteration)}; gait {' '.join(run.gaits[-1])}"
    if run.residuals[-1].out_of_turn:
        text += f"; windows out of turn {run.residuals[-1].out_of_turn}"
    return f"{text}; within the thresholds in the maximum norm" if run.converged else text
