"""P2a of walking, equation (19a): a local search over the contact binaries.

The first search is on J in the plane (search.gait_search). Its best gaits go to the QP oracle, P2a with its binaries
fixed (trajectory.walk_qp): (7), (8) with (8b) linear, (9a), (10), footholds free, the consensus term in its objective.
The best binaries of one ADMM iteration start the next; their neighbours are tried in the order of what the duals
promise.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Iterator, Sequence
from typing import TYPE_CHECKING

import numpy as np

from crux_planner.errors import InfeasibleError
from crux_planner.model.arrays import Array
from crux_planner.model.gait import Gait, straight_motion
from crux_planner.model.slots import Change, Slots
from crux_planner.model.walk_problem import WalkProblem
from crux_planner.physics.cost import FORCE_SHARE
from crux_planner.search.gait_search import FlatSearch
from crux_planner.search.planar_qp import FlatWalk
from crux_planner.solvers import clock
from crux_planner.solvers.worker import Team, Worker
from crux_planner.trajectory.walk_qp import ContactQp, WalkKnots

if TYPE_CHECKING:
    from crux_planner.admm.admm import ContactPlan
    from crux_planner.trajectory.consensus import Eta, Scales

FLAT_GAITS = 60  # solved by the first search beyond its first ones
_NEXT_ORACLES = 30  # asked in the ADMM iterations after the first
_LINEARISATIONS = 3  # of (8b) and (9a) about the answer
_NEAR = 90  # gaits looked at near one that has no solution
_SETTLED, _COMPARED = 12, 6  # walks in the plane given to the oracle, and how many at once for the best of them
_BETTER = 2e-3  # of J, what is worth a change


class Lifted:
    """The oracle's answers for walks in the plane."""

    def __init__(self, problem: WalkProblem, scales: Scales | None, moments: bool) -> None:
        self._qp = ContactQp(problem, scales, moments=moments)

    def __call__(self, walk: FlatWalk) -> WalkKnots | None:
        """None where it has none."""
        return self._qp.solve(walk)


class WalkContacts:
    """P2a of one walk; `moments` False leaves (8b) out of the oracle, `many` bounds the first search."""

    def __init__(
        self,
        problem: WalkProblem,
        scales: Scales | None = None,
        *,
        moments: bool = True,
        many: int = FLAT_GAITS,
        workers: Sequence[Worker] = (),
    ) -> None:
        self.problem, self.oracles, self._many = problem, 0, many
        self._scales = scales
        self._flat = FlatSearch(problem, workers)
        self._qp = ContactQp(problem, scales, moments=moments)
        self._lifted = Team(workers, Lifted, problem, scales, moments)
        self._known: WalkKnots | None = None

    def begin(self, deadline: float) -> None:
        """Raises InfeasibleError where there is no walk."""
        self._flat.begin(deadline)

    def search(self, deadline: float) -> Iterator[WalkKnots]:
        """Walks, the best first, each once by the oracle. Raises InfeasibleError where there is none."""
        begun = self._flat.begin(deadline)
        self._flat.improve(begun, self._many, deadline)
        yield from self._answers()

    def _answers(self) -> Iterator[WalkKnots]:
        """The oracle's answers for the best walks in the plane. Raises InfeasibleError where it has none."""
        found = 0
        walks = self._flat.best_first()[:_SETTLED]
        while walks:
            some, walks = walks[:_COMPARED], walks[_COMPARED:]
            answers = self._lifted.answers([(walk,) for walk in some])
            lifted = [knots for knots in answers if knots is not None]
            self.oracles += len(some)
            found += len(lifted)
            yield from sorted(lifted, key=lambda knots: knots.cost)
        if not found:
            raise InfeasibleError("contacts", "no gait keeps the feet within reach and the body in balance")

    def minimise(self, rho: float, target: Eta | None, deadline: float) -> ContactPlan[WalkKnots]:
        """Minimise J + rho / 2 |eta - target|^2. Raises InfeasibleError."""
        if self._known is None:
            first = next(self.search(deadline))
            self._known = self._settled(first) or first
        best = self._known
        if target is not None:
            best = self._improved(self._again(best, rho, target), rho, target, deadline)
        self._known = best
        from crux_planner.admm.admm import ContactPlan
        from crux_planner.trajectory.consensus import Eta  # with casadi, which auto does without

        return ContactPlan(Eta.of_points(best.body, best.feet(self.problem.step_height_m), best.forces), best)

    def near(self, gait: Gait, deadline: float) -> Iterator[WalkKnots]:
        """Walks by a gait, by its neighbours and its order of the feet at other times, by any order where it has none.

        Raises InfeasibleError where there is none at all.
        """
        flat, here = self._flat, Slots.of(gait)
        walk = flat.solve(here)
        if walk is not None:
            knots = self._settled(walk)
            if knots is not None:
                yield knots
        order = [step.limb for step in gait.steps]
        beyond = [slots for _, slots in here.neighbours() if slots.possible(self.problem)]
        beyond = [slots for slots in dict.fromkeys(beyond) if flat.strides.long_enough(slots)][:_NEAR]
        best = flat.best_of(beyond + flat.strides.in_order(order), deadline)
        if best is None:
            best = flat.begin(deadline)
        flat.improve(best, self._many, deadline)
        yield from self._answers()

    def _settled(self, walk: FlatWalk | WalkKnots) -> WalkKnots | None:
        """The oracle's answer for a walk, linearised about itself; None where nothing is left of it."""
        knots = None
        for _ in range(_LINEARISATIONS):
            self.oracles += 1
            again = self._qp.solve(knots or walk)
            if again is None:
                return None
            settled = knots is not None and _alike(knots, again)
            knots = again
            if settled:
                break
        return knots

    def _again(self, known: WalkKnots, rho: float, target: Eta | None) -> WalkKnots:
        """The last answer's binaries with another consensus term."""
        again = self._qp.solve(known, rho, target)
        return known if again is None else again

    def _improved(self, best: WalkKnots, rho: float, target: Eta, deadline: float) -> WalkKnots:
        seen, last = {Slots.of(best.gait)}, self.oracles + _NEXT_ORACLES
        doubts: Counter[Change] = Counter()
        improving = True
        while improving:
            improving = False
            for change, slots in self._flat.promising(best.gait, self._worth(best, rho), seen, doubts):
                if self.oracles >= last or clock.now() > deadline:
                    break
                seen.add(slots)
                self.oracles += 1
                gait = slots.gait(self.problem.steps + 1)
                knots = self._qp.solve(straight_motion(self.problem, gait, best.body), rho, target)
                if knots is not None and knots.value < best.value - _BETTER:
                    best, improving = knots, True
                    doubts[change] = 0
                    break
                doubts[change] += 1
        for _ in range(_LINEARISATIONS):
            again = self._again(best, rho, target)
            settled = _alike(best, again)
            best = again
            if settled:
                break
        return best

    def _worth(self, best: WalkKnots, rho: float) -> Array:
        """(N, 4): what a foot on the ground costs, and what one in the air would save were it there."""
        effort = FORCE_SHARE * self.problem.weights.wrench
        if self._scales is not None:
            effort += rho / 2 * self._scales.force**2
        worth: Array = (best.pull**2).sum(axis=2) / (4 * effort)
        worth[best.pull[..., 2] > 0] = 0.0  # the ground does not pull
        on = best.gait.stance[: self.problem.steps]
        worth[on] = effort * (best.forces[on] ** 2).sum(axis=1)
        return worth


def _alike(one: WalkKnots, other: WalkKnots) -> bool:
    return bool(np.abs(one.body - other.body).max() < 1e-4 and np.abs(one.forces - other.forces).max() < 0.02)
