"""A local search over gaits on J as planar_qp has it, from the best of the orders of the feet.

A foot off the ground has a value in the QP, the pull of the dynamics' duals on a force it does not exert; a foot on
the ground has its share of the effort. Neighbours are tried in the order of what these values promise.
"""

from collections import Counter
from collections.abc import Container, Iterable, Sequence

from crux_planner.errors import PLANNED_REACH, InfeasibleError
from crux_planner.model.arrays import Array
from crux_planner.model.gait import Gait
from crux_planner.model.slots import Change, Slots, Strides
from crux_planner.model.walk_problem import WalkProblem
from crux_planner.search.planar_qp import FlatQp, FlatWalk
from crux_planner.solvers import clock
from crux_planner.solvers.worker import Team, Worker

_MORE_ROUNDS = 1  # of steps than the fewest, in those tried last
_BETTER = 1e-3  # of J, what is worth a change


class FlatSearch:
    """Gaits of one problem, each solved once; the next one beside it where a worker is free for it."""

    def __init__(self, problem: WalkProblem, workers: Sequence[Worker] = ()) -> None:
        self.problem, self.strides = problem, Strides(problem)
        self._team = Team(workers, FlatQp, problem)
        self._solved: dict[Slots, FlatWalk | None] = {}
        self._ahead: dict[Slots, FlatWalk | None] = {}  # solved before they were asked for

    @property
    def asked(self) -> int:
        """Gaits solved so far."""
        return len(self._solved)

    def best_first(self) -> list[FlatWalk]:
        """All walks found so far."""
        return sorted((walk for walk in self._solved.values() if walk is not None), key=lambda walk: walk.cost)

    def solve(self, slots: Slots, then: Slots | None = None) -> FlatWalk | None:
        """J of a gait, nearly; None where it has no solution. `then`: what will be asked for next."""
        if slots in self._solved:
            return self._solved[slots]
        if slots in self._ahead:
            walk = self._ahead.pop(slots)
        else:
            unknown = then is not None and then not in self._solved and then not in self._ahead
            beside = next(iter(self._team.free()), None) if unknown else None
            knots = self.problem.steps + 1
            ahead = None if beside is None or then is None else self._team.later(beside, then.gait(knots))
            walk = self._team.call(slots.gait(knots))
            if ahead is not None and then is not None:
                self._ahead[then] = ahead()
        self._solved[slots] = walk
        return walk

    def begin(self, deadline: float) -> FlatWalk:
        """The best order of the feet, with as few steps as do. Raises InfeasibleError."""
        fewest, failure = self.strides.fewest_rounds(), None
        for rounds in range(fewest, fewest + (_MORE_ROUNDS if fewest else 0) + 1):
            try:
                starts = self.strides.starts(rounds)
            except InfeasibleError as too_short:
                failure = too_short if rounds == fewest else failure
                break
            walk = self.best_of(starts, deadline)
            if walk is not None:
                return walk
        raise failure or InfeasibleError(
            "contacts", f"no gait found that keeps the feet within {PLANNED_REACH} and the body in balance"
        )

    def best_of(self, gaits: Iterable[Slots], deadline: float) -> FlatWalk | None:
        """The cheapest of some gaits; None where none has a solution."""
        best, gaits = None, list(gaits)
        for slots, then in zip(gaits, _following(gaits), strict=True):
            walk = self.solve(slots, then)
            if walk is not None and (best is None or walk.cost < best.cost):
                best = walk
            if clock.now() > deadline:
                break
        return best

    def improve(self, best: FlatWalk, many: int, deadline: float) -> FlatWalk:
        """The first better neighbour, again and again, until none is or `many` have been solved."""
        last = self.asked + many
        doubts: Counter[Change] = Counter()
        improving = True
        while improving:
            improving = False
            promising = self.promising(best.gait, best.worth, self._solved, doubts)
            for (change, slots), then in zip(promising, _following([each for _, each in promising]), strict=True):
                if self.asked >= last or clock.now() > deadline:
                    return best
                walk = self.solve(slots, then)
                if walk is not None and walk.cost < best.cost - _BETTER:
                    best, improving = walk, True
                    doubts[change] = 0
                    break
                doubts[change] += 1
        return best

    def promising(
        self, gait: Gait, worth: Array, seen: Container[Slots], doubts: Counter[Change]
    ) -> list[tuple[Change, Slots]]:
        """Neighbours not seen, those first of which the values (N, 4) promise most; changes that failed, later."""
        problem, here = self.problem, Slots.of(gait)
        alpha = here.alpha(problem.steps)
        ranked = {}
        for change, slots in here.neighbours():
            if slots in seen or slots in ranked:
                continue
            if slots.possible(problem) and self.strides.long_enough(slots):
                then = slots.alpha(problem.steps)
                gain = float(worth[then & ~alpha].sum() - worth[alpha & ~then].sum())
                ranked[slots] = (doubts[change], -gain, change)
        return [(ranked[slots][2], slots) for slots in sorted(ranked, key=lambda each: ranked[each])]


def _following(gaits: list[Slots]) -> list[Slots | None]:
    """What comes after each."""
    return [*gaits[1:], None][: len(gaits)]
