"""Where planning begins: climbs and walks load only what they need."""

from __future__ import annotations

from typing import Any

from crux_contracts.robot import Robot
from crux_contracts.scenario import Scenario

from crux_planner.pipeline.message import PlanResult
from crux_planner.solvers.worker import Worker


def plan(scenario: Scenario, robot: Robot, **options: Any) -> PlanResult:
    """Plan a climb or a walk and check it; `options` are those of planning.plan, without `prove_s` for walks.

    Raises ScenarioError where the scenario must be corrected, InfeasibleError where no plan exists or none was found.
    """
    log = {"log": options["log"]} if options.get("log") else {}
    if scenario.contact.model == "point":
        options.pop("prove_s", None)
        with Worker("crux_planner.certificates.bound.walk", "crux_planner.admm.walk_contact_block", **log) as worker:
            from crux_planner.pipeline.walk import plan as plan_walk

            return plan_walk(scenario, robot, worker=worker, **options)
    with Worker("crux_planner.certificates.bound.climb", **log) as worker:  # it begins while this process imports
        from crux_planner.pipeline.climb import plan as plan_climb

        return plan_climb(scenario, robot, worker=worker, **options)
