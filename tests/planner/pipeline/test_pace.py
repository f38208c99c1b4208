"""A climb in the least time, planned and planned again; the fingers' and body's bounds are in checker/test_pace.py."""

from __future__ import annotations

from pathlib import Path

import yaml
from crux_contracts.interpolation import knot_times_s
from crux_contracts.robot import Robot
from crux_contracts.scenario import parse_scenario
from crux_msgs import plan_t
from crux_planner.checker import check_plan
from crux_planner.pipeline.entry import plan
from crux_planner.pipeline.replan import Planner

ONE_STEP = Path(__file__).parents[3] / "msgs" / "scenarios" / "climb-one-step.yaml"


def test_a_climb_is_planned_and_planned_again_in_the_least_time(robot: Robot) -> None:
    content = yaml.safe_load(ONE_STEP.read_text())
    content["planner"] = {**content.get("planner", {}), "objective": "time"}
    scenario = parse_scenario(yaml.safe_dump(content))
    result = plan(scenario, robot)
    even_s = scenario.horizon.dt_s * result.steps
    assert result.plan.format == plan_t.FORMAT_OWN_TIMES
    assert knot_times_s(result.plan)[-1] < 0.4 * even_s
    assert result.gap is None
    again = Planner(scenario, robot).replan(result.plan, 0.01)
    assert again.plan.format == plan_t.FORMAT_OWN_TIMES
    assert check_plan(again.plan, robot).ok
    assert again.plan.knots[-1].time_s < result.plan.knots[-1].time_s + 1.0
