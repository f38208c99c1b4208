"""Far climbs that only the parts of a route lead to, as one plan."""

from __future__ import annotations

import numpy as np
import pytest
from crux_contracts.plan_file import plan_id
from crux_contracts.robot import Robot
from crux_contracts.scenario import Scenario
from crux_planner.checker import check_plan
from crux_planner.errors import InfeasibleError
from crux_planner.model.build import build_problem
from crux_planner.pipeline import climb
from crux_planner.pipeline.restart import with_objective
from crux_planner.pipeline.route import is_long
from shared_plans import unproven
from walls import ladder, scattered, scenario, two_rows

FAR = scattered(8, rise_m=1.5, count=44)
LADDER = ladder(10, steps=240)  # 1.2 m


def check_parts(wall: Scenario, robot: Robot) -> None:
    """Its own inertia and speeds hold all along, though every part has those of its own first pose."""
    result = unproven(with_objective(wall, "balanced"), robot)
    assert "parts" in result.timing
    assert result.plan.plan_id == plan_id(result.plan)
    report = check_plan(result.plan, robot)
    assert report.ok
    assert result.cost == result.plan.cost == report.cost
    body, stance = result.arrays.body_position_m, result.arrays.stance
    assert np.linalg.norm(body[-1] - wall.goal.body.position_m) <= wall.goal.tolerance_m
    standing = stance[1:-1].all(axis=1) & (np.abs(np.diff(body, axis=0)).max(axis=1)[1:] < 1e-9)
    assert standing.any()  # at rest where a part ends
    assert len(result.arrays.time_s) - 1 == result.steps <= build_problem(wall, robot).steps


def test_a_far_climb_is_one_plan_of_parts_where_no_way_is_found_at_once(
    robot: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(climb, "plan_by_map", lambda *_, **__: None)
    monkeypatch.setattr(climb, "_level_or_none", lambda _climb: InfeasibleError("contacts", "not looked for"))
    check_parts(scenario(LADDER), robot)


@pytest.mark.sweep
def test_a_far_climb_over_scattered_holds_is_one_plan_of_parts(robot: Robot) -> None:
    check_parts(scenario(FAR), robot)


def test_a_climb_of_one_part_is_no_route() -> None:
    assert is_long(scenario(FAR))
    assert not is_long(scenario(two_rows()))
