"""The bound worked out by a worker, while the exact NLP and the check keep this process busy; where nothing is begun
when the plan is there, of a climb by this process: starting another one would take a third as long.
"""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from crux_planner.model.problem import Problem
from crux_planner.solvers import clock
from crux_planner.solvers.worker import Worker, WorkerLostError, say

AIM = 0.05  # no bound is looked for above this share below the cost expected: it is what makes the search small
TIME_LIMIT_S = 60.0  # of what nobody listens to any more
PATIENCE_S = 10.0  # of computing, for what is left when the plan is there
_LOOK_S = 0.2  # how often a worker that says nothing is asked how long it has computed


class BoundWorker:
    """Bounds of one scenario, the best so far at hand at any time, waited for up to `patience_s`."""

    def __init__(self, worker: Worker, patience_s: float) -> None:
        self._worker, self._patience_s = worker, patience_s
        self._about: object = None  # what is being bounded
        self._best: float | None = None

    def start(self, about: object, bound: Callable[..., Any], *arguments: Any) -> None:
        """Begin with `bound(*arguments)`, which says or returns bounds; goes on with what is begun about the same."""
        if self._about == about:
            return
        self.stop()
        self._about = about
        self._worker.begin(bound, *arguments)

    def gap(self, cost: float) -> float | None:
        """The gap of a plan that costs `cost` by what is proven; ends the work."""
        until = clock.computed_s(self._worker.pid) + self._patience_s
        try:
            while self._worker.waiting and clock.computed_s(self._worker.pid) < until:
                if self._worker.ready(_LOOK_S):
                    self._best = self._worker.receive()
        except WorkerLostError:  # what it has said until then is true
            pass
        best = self._best
        self.stop()
        return gap(cost, best)

    def stop(self) -> None:
        """End the work, whatever is being done."""
        if self._worker.waiting:
            self._worker.stop()
        self._about = self._best = None


class ClimbBoundWorker(BoundWorker):
    """Bounds of a climb. With `prove_s` they take as long as they need, up to that; else so much work."""

    def __init__(self, worker: Worker, problem: Problem, prove_s: float | None = None) -> None:
        super().__init__(worker, PATIENCE_S if prove_s is None else prove_s)
        self._problem, self._prove_s = problem, prove_s

    def get_ready(self) -> None:
        """Start the worker's process, which imports what it needs meanwhile."""
        self._worker.start()

    def start_with(self, steps: int, expected: float) -> None:
        """Begin, for plans of so many steps that cost about `expected`."""
        from crux_planner.certificates.bound.climb import lower_bound  # which walks do without

        limit_s, effort = self._limits(TIME_LIMIT_S)
        problem = replace(self._problem, steps=steps)
        self.start(steps, lower_bound, problem, (1.0 - AIM) * expected, limit_s, say, effort)

    def gap_of(self, steps: int, cost: float) -> float | None:
        """The gap of a plan of so many steps; ends the work."""
        if self._worker.pid is None:
            return self.gap_here(replace(self._problem, steps=steps), cost)
        self.start_with(steps, cost)  # unless it is about so many already
        return self.gap(cost)

    def gap_here(self, problem: Problem, cost: float) -> float | None:
        """The gap of a plan of a problem, worked out by this process."""
        from crux_planner.certificates.bound.climb import lower_bound

        self.stop()
        limit_s, effort = self._limits(PATIENCE_S)
        return gap(cost, lower_bound(problem, (1.0 - AIM) * cost, limit_s, effort=effort))

    def _limits(self, usual_s: float) -> tuple[float, float]:
        """Time [s] and effort."""
        from crux_planner.certificates.bound.climb import EFFORT

        return (usual_s, EFFORT) if self._prove_s is None else (self._prove_s, np.inf)


def gap(cost: float, bound: float | None) -> float | None:
    """How far above the bound a cost may be, as a share of it: (cost - bound) / cost; None without a bound."""
    if bound is None or not np.isfinite(bound) or cost <= 0.0:
        return None
    return max((cost - bound) / cost, 0.0)
