"""P2a of walking, equation (19a): a local search over the contact binaries, guided by the duals of a QP oracle.

The oracle is P2a with its binaries fixed (contact_qp): (7), (8) with (8b) linear, (9a), (10), footholds free, the
consensus term in its objective. A foot off the ground has a price in that QP, the pull of the dynamics' duals on a
force it does not exert; a foot on the ground has its share of the effort. Neighbours are tried in the order of what
these prices promise, and the best binaries of one ADMM iteration start the next.
"""

from __future__ import annotations

import time
from dataclasses import dataclass

import numpy as np

from crux_planner.admm.consensus import Eta, Scales
from crux_planner.arrays import Array
from crux_planner.errors import InfeasibleError
from crux_planner.walk.contact_qp import ContactQp, Reference, WalkKnots
from crux_planner.walk.cost import FORCE_SHARE
from crux_planner.walk.gait import Candidate, Gait, candidates
from crux_planner.walk.problem import WalkProblem
from crux_planner.walk.slots import Slots

_STARTS = 4  # gaits of the pattern search from which the local search chooses its first
_FIRST_TIME_S, _NEXT_TIME_S = 2.0, 0.4  # of the local search in the first ADMM iteration, and in those after
_LINEARISATIONS = 3  # of (8b) and (9a) about the answer
_BETTER = 1e-4


@dataclass(frozen=True)
class WalkPlan:
    """eta of the contact blocks with the contacts behind it."""

    eta: Eta
    knots: WalkKnots

    @property
    def gait(self) -> list[str]:
        """Limbs in the order in which they lift off."""
        return self.knots.gait.names


class WalkContacts:
    """P2a of one walk; `moments` False leaves (8b) out."""

    def __init__(self, problem: WalkProblem, scales: Scales, *, moments: bool = True) -> None:
        self.problem, self.oracles = problem, 0
        self._qp = ContactQp(problem, scales, moments=moments)
        self._known: WalkKnots | None = None
        self._at_once = 1

    def minimise(self, rho: float, target: Eta | None, deadline: float) -> WalkPlan:
        """Minimise J + rho / 2 |eta - target|^2. Raises InfeasibleError."""
        until = min(deadline, time.monotonic() + (_FIRST_TIME_S if self._known is None else _NEXT_TIME_S))
        best = self._first(rho, target) if self._known is None else self._again(self._known, rho, target)
        best = self._improved(best, rho, target, until)
        self._known = best
        return WalkPlan(eta_of(self.problem, best), best)

    def _first(self, rho: float, target: Eta | None) -> WalkKnots:
        """The best of a few regular gaits; two feet in the air at a time only where one at a time does not do."""
        for at_once in (1, 2):
            self._at_once = at_once
            tried = [self._solved(c.gait, None, rho, target) for c in candidates(self.problem, at_once)[:_STARTS]]
            known = [knots for knots in tried if knots is not None]
            if known:
                return min(known, key=lambda knots: knots.value)
        raise InfeasibleError(
            "contacts", "the contact block finds no gait that keeps the feet within reach and the body in balance"
        )

    def _again(self, known: WalkKnots, rho: float, target: Eta | None) -> WalkKnots:
        """The last answer's binaries with another consensus term."""
        again = self._qp.solve(known.gait, Reference(known.body, known.forces, known.footholds), rho, target)
        return known if again is None else again

    def _solved(self, gait: Gait, body: Array | None, rho: float, target: Eta | None) -> WalkKnots | None:
        self.oracles += 1
        problem = self.problem
        about = Reference.straight(problem, gait) if body is None else Reference.of(problem, gait, body)
        return self._qp.solve(gait, about, rho, target)

    def _improved(self, best: WalkKnots, rho: float, target: Eta | None, until: float) -> WalkKnots:
        seen = {Slots.of(best.gait)}
        improving = True
        while improving and time.monotonic() < until:
            improving = False
            for slots in self._promising(best, rho, seen):
                if time.monotonic() > until:
                    break
                seen.add(slots)
                knots = self._solved(slots.gait(self.problem.steps + 1), best.body, rho, target)
                if knots is not None and knots.value < best.value - _BETTER:
                    best, improving = knots, True
                    break
        for _ in range(_LINEARISATIONS):
            again = self._again(best, rho, target)
            settled = np.abs(again.body - best.body).max() < 1e-4 and np.abs(again.forces - best.forces).max() < 0.02
            best = again
            if settled:
                break
        return best

    def _promising(self, best: WalkKnots, rho: float, seen: set[Slots]) -> list[Slots]:
        """Neighbours not seen, those first of which the duals promise most."""
        problem, here = self.problem, Slots.of(best.gait)
        alpha = here.alpha(problem.steps)
        effort = FORCE_SHARE * problem.weights.wrench + rho / 2 * self._qp.scales.force**2
        price = (best.pull**2).sum(axis=2) / (4 * effort)
        price[best.pull[..., 2] > 0] = 0.0  # the ground does not pull
        price = np.where(alpha, effort * (best.forces**2).sum(axis=2), price)
        ranked = []
        for slots in set(here.neighbours()) - seen:
            if slots.possible(problem, self._at_once):
                then = slots.alpha(problem.steps)
                gain = price[then & ~alpha].sum() - price[alpha & ~then].sum()
                ranked.append((-float(gain), slots.of_limb, slots))
        return [slots for _, _, slots in sorted(ranked, key=lambda entry: entry[:2])]


def eta_of(problem: WalkProblem, knots: WalkKnots) -> Eta:
    """x and u of the consensus: point feet have neither yaws nor moments in it."""
    n = problem.steps
    return Eta(knots.body, knots.feet(problem.step_height_m), np.zeros((n + 1, 0)), knots.forces, np.zeros((n, 0, 3)))


def as_candidate(knots: WalkKnots) -> Candidate:
    """What the exact NLP starts from."""
    return Candidate(knots.gait, knots.footholds, knots.body[:, :2], knots.forces[..., 2], knots.cost)
