"""P2a of walking, equation (19a): a local search over the contact binaries, guided by the duals of a QP oracle.

The oracle is P2a with its binaries fixed (contact_qp): (7), (8) with (8b) linear, (9a), (10), footholds free, the
consensus term in its objective. A foot off the ground has a price in that QP, the pull of the dynamics' duals on a
force it does not exert; a foot on the ground has its share of the effort. Neighbours are tried in the order of what
these prices promise, and the best binaries of one ADMM iteration start the next.
"""

from __future__ import annotations

import itertools
import time
from collections import Counter
from dataclasses import dataclass

import numpy as np

from crux_planner.admm.consensus import Eta, Scales
from crux_planner.arrays import Array
from crux_planner.errors import InfeasibleError
from crux_planner.walk.contact_qp import ContactQp, Reference, WalkKnots
from crux_planner.walk.cost import FORCE_SHARE
from crux_planner.walk.gait import Candidate, Gait, fewest_rounds, regular_gaits
from crux_planner.walk.problem import WalkProblem
from crux_planner.walk.slots import Change, Slots

_LONGEST_STRIDE = 0.9  # of the workspace, in the gaits that are tried first
_MORE_ROUNDS = 1  # of steps than the fewest, in those tried last
FIRST_ORACLES, _NEXT_ORACLES = 100, 30  # asked by the local search in the first ADMM iteration, and in those after
_LINEARISATIONS = 3  # of (8b) and (9a) about the answer
_CHANGES, _MOST_NEAR, _SETTLED = 1, 80, 8  # how far and wide to look for a gait near one that has no solution
_BETTER = 2e-3  # of J, what is worth a change


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
    """P2a of one walk; `moments` False leaves (8b) out, `oracles` bounds the first search."""

    def __init__(
        self, problem: WalkProblem, scales: Scales, *, moments: bool = True, oracles: int = FIRST_ORACLES
    ) -> None:
        self.problem, self.oracles, self._first_oracles = problem, 0, oracles
        self._qp = ContactQp(problem, scales, moments=moments)
        self._known: WalkKnots | None = None
        self._at_once = 1

    def minimise(self, rho: float, target: Eta | None, deadline: float) -> WalkPlan:
        """Minimise J + rho / 2 |eta - target|^2. Raises InfeasibleError."""
        oracles = self._first_oracles if self._known is None else _NEXT_ORACLES
        best = self._first(rho, target) if self._known is None else self._again(self._known, rho, target)
        best = self._improved(best, rho, target, oracles, deadline)
        self._known = best
        return WalkPlan(eta_of(self.problem, best), best)

    def near(self, gait: Gait, deadline: float) -> WalkKnots | None:
        """J's minimum for a gait; where it has none, of the best gait that a change or two lead to."""
        seen: set[Slots] = set()
        layer = [Slots.of(gait)]
        for _ in range(_CHANGES + 1):
            solved = []
            for slots in layer:
                if len(seen) > _MOST_NEAR or time.monotonic() > deadline:
                    break
                seen.add(slots)
                knots = self._solved(slots.gait(self.problem.steps + 1), None, 0.0, None)
                solved += [] if knots is None else [knots]
            for knots in sorted(solved, key=lambda knots: knots.value)[:_SETTLED]:
                settled = self._settled(knots)
                if settled is not None:
                    return settled
            beyond = [then for slots in layer for _, then in slots.neighbours()]
            layer = [s for s in dict.fromkeys(beyond) if s not in seen and s.possible(self.problem, self._at_once)]
        return None

    def _settled(self, knots: WalkKnots) -> WalkKnots | None:
        """The answer linearised about itself, as often as it takes; None where nothing is left of it."""
        for _ in range(_LINEARISATIONS):
            again = self._qp.solve(knots.gait, Reference(knots.body, knots.forces, knots.footholds), 0.0, None)
            if again is None:
                return None
            knots = again
        return knots

    def _first(self, rho: float, target: Eta | None) -> WalkKnots:
        """The best of the regular gaits with the fewest steps; two feet in the air only where one does not do."""
        problem, failure = self.problem, None
        fewest = fewest_rounds(problem, _LONGEST_STRIDE)
        for at_once, rounds in itertools.product((1, 2), range(fewest, fewest + _MORE_ROUNDS + 1)):
            try:
                gaits = regular_gaits(problem, at_once, rounds)
            except InfeasibleError as too_short:
                failure = failure or too_short
                continue
            tried = [self._solved(gait, None, rho, target) for gait in gaits]
            known = [knots for knots in tried if knots is not None]
            if known:
                self._at_once = at_once
                return min(known, key=lambda knots: knots.value)
        raise failure or InfeasibleError(
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

    def _improved(self, best: WalkKnots, rho: float, target: Eta | None, oracles: int, deadline: float) -> WalkKnots:
        seen, last = {Slots.of(best.gait)}, self.oracles + oracles
        doubts: Counter[Change] = Counter()
        improving = True
        while improving:
            improving = False
            for change, slots in self._promising(best, rho, seen, doubts):
                if self.oracles >= last or time.monotonic() > deadline:
                    break
                seen.add(slots)
                knots = self._solved(slots.gait(self.problem.steps + 1), best.body, rho, target)
                if knots is not None and knots.value < best.value - _BETTER:
                    best, improving = knots, True
                    doubts[change] = 0
                    break
                doubts[change] += 1
        for _ in range(_LINEARISATIONS):
            again = self._again(best, rho, target)
            settled = np.abs(again.body - best.body).max() < 1e-4 and np.abs(again.forces - best.forces).max() < 0.02
            best = again
            if settled:
                break
        return best

    def _promising(
        self, best: WalkKnots, rho: float, seen: set[Slots], doubts: Counter[Change]
    ) -> list[tuple[Change, Slots]]:
        """Neighbours not seen, those first of which the duals promise most; changes that failed before, later."""
        problem, here = self.problem, Slots.of(best.gait)
        alpha = here.alpha(problem.steps)
        effort = FORCE_SHARE * problem.weights.wrench + rho / 2 * self._qp.scales.force**2
        price = (best.pull**2).sum(axis=2) / (4 * effort)
        price[best.pull[..., 2] > 0] = 0.0  # the ground does not pull
        price = np.where(alpha, effort * (best.forces**2).sum(axis=2), price)
        ranked = {}
        for change, slots in here.neighbours():
            if slots not in seen and slots not in ranked and slots.possible(problem, self._at_once):
                then = slots.alpha(problem.steps)
                gain = float(price[then & ~alpha].sum() - price[alpha & ~then].sum())
                ranked[slots] = (doubts[change], -gain, change)
        return [(ranked[slots][2], slots) for slots in sorted(ranked, key=lambda each: ranked[each])]


def eta_of(problem: WalkProblem, knots: WalkKnots) -> Eta:
    """x and u of the consensus: point feet have neither yaws nor moments in it."""
    n = problem.steps
    return Eta(knots.body, knots.feet(problem.step_height_m), np.zeros((n + 1, 0)), knots.forces, np.zeros((n, 0, 3)))


def as_candidate(knots: WalkKnots) -> Candidate:
    """What the exact NLP starts from."""
    return Candidate(knots.gait, knots.footholds, knots.body[:, :2], knots.forces[..., 2], knots.cost)
