"""Where planning begins: climbs and walks load only what they need."""

from __future__ import annotations

from typing import Any

from crux_contracts.robot import Robot
from crux_contracts.scenario import Scenario

from crux_planner.result import PlanResult


def plan(scenario: Scenario, robot: Robot, **options: Any) -> PlanResult:
    """Plan a climb or a walk and check it; `options` are those of planning.plan, without `prove_s` for walks.

    Raises ScenarioError where the scenario must be corrected, InfeasibleError where no plan exists or none was found.
    """
    if scenario.contact.model == "point":
        from crux_planner.walk.planning import plan as plan_walk

        options.pop("prove_s", None)
        return plan_walk(scenario, robot, **options)
    from crux_planner.planning import plan as plan_climb

    return plan_climb(scenario, robot, **options)
