"""A plan for the least J at the pace of the least time, for the planner's tests."""

from __future__ import annotations

from dataclasses import replace

from crux_contracts.plan_file import plan_id
from crux_contracts.robot import Robot
from crux_contracts.scenario import parse_scenario
from crux_msgs import plan_t
from crux_planner.pipeline.message import PlanResult
from crux_planner.pipeline.pace import paced
from crux_planner.pipeline.restart import with_objective
from crux_planner.pipeline.session import Work


def is_quick(found: PlanResult, robot: Robot) -> bool:
    """Whether it takes less than 0.4 of the time at the pace of the least time, and passes the check there."""
    scenario = with_objective(parse_scenario(found.plan.scenario_yaml), "time")
    plan = plan_t.decode(found.plan.encode())
    plan.scenario_yaml, plan.scenario_sha256 = scenario.yaml_text, scenario.sha256
    plan.plan_id = plan_id(plan)
    silent = Work(lambda _what, _share: None, lambda _line: None)
    quick = paced(replace(found, plan=plan), scenario, robot, silent)
    assert quick.check.ok
    assert quick.plan.format >= plan_t.FORMAT_OWN_TIMES
    return bool(quick.plan.knots[-1].time_s < 0.4 * found.plan.knots[-1].time_s)
