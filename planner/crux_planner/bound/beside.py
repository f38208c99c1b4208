"""The bound worked out in a process of its own, while the exact NLP and the check keep this one busy."""

from __future__ import annotations

import multiprocessing
from multiprocessing.connection import Connection

import numpy as np

from crux_planner import clock
from crux_planner.bound.climb import EFFORT, lower_bound
from crux_planner.bound.gap import gap
from crux_planner.problem import Problem

AIM = 0.05  # no bound is looked for above this share below the cost expected: it is what makes the search small
TIME_LIMIT_S = 60.0  # of a process that nobody listens to any more
PATIENCE_S = 10.0  # of computing, for what is left when the plan is there
_LOOK_S = 0.2  # how often a process that says nothing is asked how long it has computed


class Beside:
    """Bounds of one problem, the best so far at hand at any time."""

    def __init__(self, problem: Problem, time_limit_s: float | None = None) -> None:
        """With a `time_limit_s` of its own the bound takes as long as it needs, up to that; else so much work."""
        self._problem = problem
        self._limit_s = TIME_LIMIT_S if time_limit_s is None else time_limit_s
        self._wait_s = PATIENCE_S if time_limit_s is None else time_limit_s
        self._waited_for = time_limit_s is not None
        self._process: multiprocessing.process.BaseProcess | None = None
        self._inbox: Connection | None = None
        self._best: float | None = None

    @property
    def idle(self) -> bool:
        """Not begun."""
        return self._process is None

    @property
    def hurried(self) -> bool:
        """Idle, and not waited for: better begun early, on a rough guess of the cost."""
        return self.idle and not self._waited_for

    def start(self, expected: float) -> None:
        """Begin, for plans that cost about `expected`; once begun, nothing more."""
        if not self.idle:
            return
        context = multiprocessing.get_context("fork")  # the parent's modules are there at once
        self._inbox, outbox = context.Pipe(duplex=False)
        effort = np.inf if self._waited_for else EFFORT
        work = (self._problem, (1.0 - AIM) * expected, self._limit_s, effort, outbox)
        self._process = context.Process(target=_work, args=work, daemon=True)
        self._process.start()
        outbox.close()

    def gap(self, cost: float) -> float | None:
        """The gap of a plan that costs `cost` by what is proven; ends the process."""
        pid = self._process and self._process.pid
        until = clock.computed_s(pid) + self._wait_s
        try:
            while self._inbox is not None and clock.computed_s(pid) < until:
                if self._inbox.poll(_LOOK_S):
                    self._best = self._inbox.recv()
        except EOFError:  # it has said all
            pass
        self.stop()
        return gap(cost, self._best)

    def stop(self) -> None:
        """End the process, whatever it is doing."""
        if self._process is not None and self._inbox is not None:
            self._process.terminate()
            self._process.join()
            self._inbox.close()
            self._inbox = None


def _work(problem: Problem, cost: float, time_limit_s: float, effort: float, outbox: Connection) -> None:
    lower_bound(problem, cost, time_limit_s, outbox.send, effort)
    outbox.close()
