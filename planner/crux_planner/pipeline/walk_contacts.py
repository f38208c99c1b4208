"""Gaits of a walk: a local search over the contact binaries.

It is on J in the plane (search.gait_search). Its best gaits go to the QP oracle, P1 linear with its binaries fixed
(trajectory.walk_qp): (7), (8), (9a), (10), footholds free.
"""

from collections.abc import Callable, Iterator, Sequence

import numpy as np

from crux_planner.errors import PLANNED_REACH, InfeasibleError
from crux_planner.model.gait import Gait, WalkMotion
from crux_planner.model.slots import Slots
from crux_planner.model.walk_problem import WalkProblem
from crux_planner.search.gait_search import FlatSearch
from crux_planner.search.planar_qp import FlatWalk
from crux_planner.solvers.worker import Team, Worker
from crux_planner.trajectory.walk_qp import ContactQp, WalkKnots

FLAT_GAITS = 60  # solved by the first search beyond its first ones
_LINEARISATIONS = 3  # of (8b) and (9a) about the answer
_NEAR = 90  # gaits looked at near one that has no solution
_SETTLED, _COMPARED = 12, 6  # walks in the plane given to the oracle, and how many at once for the best of them


def oracle(problem: WalkProblem) -> Callable[[WalkMotion], WalkKnots | None]:
    """Its answers for walks, None where it has none."""
    return ContactQp(problem, None).solve


class WalkContacts:
    """Of one walk; `many` bounds the search."""

    def __init__(self, problem: WalkProblem, *, many: int = FLAT_GAITS, workers: Sequence[Worker] = ()) -> None:
        self.problem, self._many = problem, many
        self._flat = FlatSearch(problem, workers)
        self._lifted = Team(workers, oracle, problem)

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
            found += len(lifted)
            yield from sorted(lifted, key=lambda knots: knots.cost)
        if not found:
            raise InfeasibleError(
                "contacts", f"no gait found that keeps the feet within {PLANNED_REACH} and the body in balance"
            )

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
            again = self._lifted.call(knots or walk)
            if again is None:
                return None
            settled = knots is not None and _alike(knots, again)
            knots = again
            if settled:
                break
        return knots


def _alike(one: WalkKnots, other: WalkKnots) -> bool:
    return bool(np.abs(one.body - other.body).max() < 1e-4 and np.abs(one.forces - other.forces).max() < 0.02)
