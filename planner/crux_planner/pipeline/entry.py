"""Where planning begins."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from pathlib import Path
from typing import TYPE_CHECKING

from crux_contracts.robot import Robot
from crux_contracts.scenario import Scenario

from crux_planner.pipeline.at_once import plan_at_once
from crux_planner.pipeline.message import PlanResult
from crux_planner.pipeline.session import Progress

if TYPE_CHECKING:
    from crux_planner.pipeline.solve_and_check import Climb


def plan(
    scenario: Scenario | Mapping[str, object],
    robot: Robot | str | Path,
    *,
    method: str = "auto",
    time_limit_s: float | None = None,
    progress: Progress | None = None,
    log: Callable[[str], None] | None = None,
    prove_s: float | None = None,
) -> PlanResult:
    """Plan a climb or a walk and check it.

    `scenario` may be a dict with the keys of the YAML, NumPy's numbers and arrays in it; `robot` the name of one that
    ships with crux, or a robot's folder. `method` is one of crux_contracts.scenario.METHODS; `time_limit_s` counts
    seconds of CPU of this process and its workers; `progress` is called with what begins now and the share of the work
    behind, 0..1; `log` receives line by line what is reported on the way.

    The gap is what a bound worked out beside the planning proves of plans of as many steps with a fixed amount of work;
    of climbs with `prove_s`, what is proven in up to so long.

    Raises ScenarioError where the scenario must be corrected, RobotError where the robot's description must be,
    InfeasibleError where no plan exists or none was found.
    """
    return plan_at_once(
        scenario,
        robot,
        method=method,
        time_limit_s=time_limit_s,
        progress=progress,
        log=log,
        prove_s=prove_s,
        in_parts=_in_parts,
    )


def _in_parts(climb: Climb) -> PlanResult | None:
    from crux_planner.pipeline.by_parts import plan_by_parts  # with all that plans them

    return plan_by_parts(climb)
