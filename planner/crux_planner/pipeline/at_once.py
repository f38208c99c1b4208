"""One plan of a scenario: climbs and walks load only what they need."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from crux_contracts.robot import Robot, robot_of
from crux_contracts.scenario import METHODS, Scenario, parse_scenario

from crux_planner.errors import wrong
from crux_planner.pipeline.message import PlanResult
from crux_planner.pipeline.session import CHECK_S, CHECK_SHARE, LONGER_S, TIME_LIMIT_S, Progress, Session, Work
from crux_planner.solvers import clock
from crux_planner.solvers.worker import Worker

if TYPE_CHECKING:
    from crux_planner.pipeline.climb import InParts


def plan_at_once(
    scenario: Scenario | Mapping[str, object],
    robot: Robot | str | Path,
    *,
    method: str = "auto",
    time_limit_s: float | None = None,
    progress: Progress | None = None,
    log: Callable[[str], None] | None = None,
    prove_s: float | None = None,
    in_parts: InParts | None = None,
) -> PlanResult:
    """As `entry.plan`; `in_parts` gives a far climb where no way leads to its goal at once, or None."""
    robot = robot_of(robot)
    if not isinstance(scenario, Scenario):
        scenario = parse_scenario(scenario)
    if method not in METHODS:
        raise wrong(scenario, "planner.method", method, f"expected {', '.join(METHODS)}: the methods this planner has")
    limit_s = time_limit_s or scenario.planner.time_limit_s or LONGER_S.get(method, TIME_LIMIT_S)
    work = Work(progress or (lambda _what, _share: None), log or (lambda _line: None))
    deadline = clock.now() + limit_s - min(CHECK_S, CHECK_SHARE * limit_s)
    session = Session(scenario, robot, work, deadline, limit_s, method)
    walks = scenario.contact.model == "point"
    modules = ["certificates.bound.walk", "pipeline.walk_contacts"] if walks else ["certificates.bound.climb"]
    names = [f"crux_planner.{each}" for each in modules]
    with Worker(*names, log=session.work.log, at_once=walks) as worker:  # a climb's begins where the map finds no way
        if walks:
            from crux_planner.pipeline import walk

            result = walk.plan(session, worker)
        else:
            from crux_planner.pipeline import climb

            result = climb.plan(session, worker, prove_s, in_parts)
            from crux_planner.pipeline.pace import paced

            result = paced(result, scenario, robot, work)
        result.method = method
        result.seconds, result.computed_s = session.work.took_s()
    return result
