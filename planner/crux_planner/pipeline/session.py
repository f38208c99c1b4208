"""What planning one scenario carries along: its numbers, oracles and time, and what it reports."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import TYPE_CHECKING, Any

from crux_contracts.robot import Robot
from crux_contracts.scenario import METHODS, Scenario

from crux_planner.errors import HorizonError, wrong
from crux_planner.solvers import clock

if TYPE_CHECKING:
    from crux_planner.certificates.bound.bound_worker import ClimbBoundWorker

TIME_LIMIT_S = 60.0
CHECK_S, CHECK_SHARE = 1.0, 0.2  # of the time limit, the less of both is left to the check

Progress = Callable[[str, float], None]
"""Called with what begins now and the share of the work behind, 0..1."""


@dataclass
class Work:
    """Says what is being done and keeps the time of each part."""

    report: Progress
    log: Callable[[str], None]
    began: float = field(default_factory=time.monotonic)
    seconds: dict[str, float] = field(default_factory=dict)
    bound: ClimbBoundWorker | None = None
    cut_short: bool = False  # some search ended because of its time
    too_short: list[HorizonError] = field(default_factory=list)  # ways found that take more than the horizon

    @contextmanager
    def part(self, name: str, share: float) -> Iterator[None]:
        self.report(name, share)
        since = time.monotonic()
        try:
            yield
        finally:
            self.seconds[name] = round(self.seconds.get(name, 0.0) + time.monotonic() - since, 3)


@dataclass(frozen=True)
class Session:
    """One scenario being planned; `deadline` is of clock.now, `limit_s` how far off it was at first."""

    scenario: Scenario
    robot: Robot
    work: Work
    deadline: float
    limit_s: float
    method: str

    @property
    def late(self) -> bool:
        """Whether the time is over."""
        return clock.now() > self.deadline

    def share_of_time(self, share: float) -> float:
        """When (of clock.now) a share of the time left is over."""
        now = clock.now()
        return now + share * (self.deadline - now)


def method_settings(session: Session) -> dict[str, Any]:
    """What one of the paper's methods is given beside its problem (crux_planner.admm.admm.Settings)."""
    options = session.scenario.planner
    given = {"rho": options.rho, "iterations": options.iterations}
    return {**given, "deadline": session.deadline, "report": session.work.log}


def begin(
    scenario: Scenario,
    robot: Robot,
    method: str,
    time_limit_s: float | None,
    progress: Progress | None,
    log: Callable[[str], None] | None,
) -> Session:
    """A session with the time by which all but the check is to be done, of computing. Raises ScenarioError."""
    if method not in METHODS:
        raise wrong(scenario, "planner.method", method, f"expected {', '.join(METHODS)}: the methods this planner has")
    limit_s = time_limit_s or scenario.planner.time_limit_s or TIME_LIMIT_S
    work = Work(progress or (lambda _what, _share: None), log or (lambda _line: None))
    return Session(scenario, robot, work, clock.now() + limit_s - min(CHECK_S, CHECK_SHARE * limit_s), limit_s, method)
