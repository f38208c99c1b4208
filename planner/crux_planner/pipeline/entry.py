"""Where planning begins: climbs and walks load only what they need."""

import time
from collections.abc import Callable

from crux_contracts.robot import Robot
from crux_contracts.scenario import Scenario

from crux_planner.pipeline.message import PlanResult
from crux_planner.pipeline.session import Progress, begin
from crux_planner.solvers.worker import Worker


def plan(
    scenario: Scenario,
    robot: Robot,
    *,
    method: str = "auto",
    time_limit_s: float | None = None,
    progress: Progress | None = None,
    log: Callable[[str], None] | None = None,
    prove_s: float | None = None,
) -> PlanResult:
    """Plan a climb or a walk and check it; `log` receives line by line what is reported on the way.

    The gap is what a bound worked out beside the planning proves of plans of as many steps with a fixed amount of work;
    of climbs with `prove_s`, what is proven in up to so long.

    Raises ScenarioError where the scenario must be corrected, InfeasibleError where no plan exists or none was found.
    """
    session = begin(scenario, robot, method, time_limit_s, progress, log)
    walks = scenario.contact.model == "point"
    modules = ["certificates.bound.walk", "pipeline.walk_contacts"] if walks else ["certificates.bound.climb"]
    with Worker(*(f"crux_planner.{each}" for each in modules), log=session.work.log) as worker:  # begins meanwhile
        if walks:
            from crux_planner.pipeline import walk

            result = walk.plan(session, worker)
        else:
            from crux_planner.pipeline import climb

            result = climb.plan(session, worker, prove_s)
        result.method, result.seconds = method, time.monotonic() - session.work.began
    return result
