"""What planning one scenario carries along: its numbers, oracles and time, and what it reports."""

import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from typing import Any

from crux_contracts.robot import Robot
from crux_contracts.scenario import Scenario

from crux_planner.certificates.bound.bound_worker import ClimbBoundWorker
from crux_planner.errors import InfeasibleError
from crux_planner.solvers import clock

TIME_LIMIT_S = 60.0
LONGER_S = {"multi_block": 180.0}  # of methods that compute for longer: a program a limb in every round
CHECK_S, CHECK_SHARE = 1.0, 0.2  # of the time limit, the less of both is left to the check

Progress = Callable[[str, float], None]
"""Called with what begins now and the share of the work behind, 0..1."""


@dataclass(frozen=True)
class RefusedWay:
    """A way to the goal that gave no plan; `again` is what it gives in so many steps, by a deadline (of clock.now): a
    PlanResult, or why there is none.
    """

    reason: InfeasibleError
    again: Callable[[int, float], object]


@dataclass
class Work:
    """Says what is being done and keeps the time of each part."""

    report: Progress
    log: Callable[[str], None]
    began: float = field(default_factory=time.monotonic)
    computing_since: float = field(default_factory=clock.now)
    seconds: dict[str, float] = field(default_factory=dict)
    bound: ClimbBoundWorker | None = None
    cut_short: bool = False  # some search ended because of its time
    refused: list[RefusedWay] = field(default_factory=list)

    @contextmanager
    def part(self, name: str, share: float) -> Iterator[None]:
        self.report(name, share)
        since = time.monotonic()
        try:
            yield
        finally:
            self.seconds[name] = round(self.seconds.get(name, 0.0) + time.monotonic() - since, 3)

    def took_s(self) -> tuple[float, float]:
        """Up to now, by the wall's clock and in seconds of computing."""
        return time.monotonic() - self.began, clock.now() - self.computing_since


@dataclass(frozen=True)
class Session:
    """One scenario being planned; `deadline` is of clock.now, by which all but the check is to be done, `limit_s` how
    far off the end was at first.
    """

    scenario: Scenario
    robot: Robot
    work: Work
    deadline: float
    limit_s: float
    method: str

    @property
    def wants_gap(self) -> bool:
        """Whether the plan is to say how near it is to the least J: another pace than the paper's costs more J."""
        return self.scenario.planner.objective == "paper"

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
