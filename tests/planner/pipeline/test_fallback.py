"""Goals that need another heading, or a grasp off the middle of its hold."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import crux_planner
import pytest
from crux_contracts.robot import Robot
from crux_planner.errors import HorizonError, InfeasibleError
from shared_plans import unproven
from walls import hold, one_move, scenario, two_rows


def turned_goal(degrees: float) -> dict[str, Any]:
    """Holds for a body that turns on the spot."""
    wall = two_rows(0.0, steps=60, all_limbs=False)
    c, s = math.cos(math.radians(degrees)), math.sin(math.radians(degrees))
    for part in wall["holds"][4:]:
        x, y = part["position_m"]
        part["position_m"] = [round(c * x - s * y, 3), round(s * x + c * y, 3)]
    wall["goal"] = {
        "body": {"position_m": [0.0, 0.0, 0.185], "rpy_deg": [0.0, 0.0, degrees]},
        "grasps": {limb: {"hold": f"{limb}-high", "faces": "x"} for limb in ("LF", "RR")},
    }
    return wall


def turned_goal_in(steps: int) -> dict[str, Any]:
    """The same with a horizon."""
    return {**turned_goal(20.0), "horizon": {"steps": steps, "dt_s": 2.0}}


@pytest.mark.parametrize("proven", [False, pytest.param(True, marks=pytest.mark.sweep)])
def test_the_body_turns_to_the_goals_heading(robot: Robot, proven: bool) -> None:
    result = (crux_planner.plan if proven else unproven)(scenario(turned_goal(20.0)), robot)
    assert result.check.ok
    assert abs(math.degrees(result.plan.knots[-1].body_rpy_rad[2]) - 20.0) < 3.0
    assert {"LF", "RR"} <= set(result.gait)
    if proven:
        assert result.gap is not None
        assert 0.0 < result.gap < 0.6


def hold_beyond_reach(steps: int) -> dict[str, Any]:
    """LF's goal hold is in reach near its end only."""
    wall = two_rows(steps=steps)
    wall["goal"]["body"].update(tolerance_m=0.004, tolerance_deg=0.5)
    wall["holds"][4] = hold("LF-high", 0.29, 0.447, size_m=[0.06, 0.1, 0.06])
    return wall


@pytest.mark.sweep
@pytest.mark.parametrize(
    ("wall", "short"), [pytest.param(hold_beyond_reach, 20, id="aside"), pytest.param(turned_goal_in, 18, id="turned")]
)
def test_a_horizon_too_short_for_what_only_the_wider_search_finds_is_named(
    robot: Robot, wall: Callable[[int], dict[str, Any]], short: int
) -> None:
    """Not the reach of a level body, which is what the search before that lacks; and as many steps as named do."""
    with pytest.raises(InfeasibleError, match=rf"horizon\.steps: .* {short} steps of 2 s, but one in \d+") as error:
        unproven(scenario(wall(short)), robot)
    assert error.value.constraint == "horizon"
    assert isinstance(error.value, HorizonError)
    assert unproven(scenario(wall(error.value.needed)), robot).check.ok


@pytest.mark.sweep
def test_a_hold_beyond_reach_is_gripped_near_its_end(robot: Robot) -> None:
    result = unproven(scenario(hold_beyond_reach(40)), robot)
    assert result.check.ok
    aside = 0.447 - result.plan.knots[-1].limbs[0].gripper_position_w_m[1]
    assert 0.02 < aside <= 0.03


def test_grippers_in_each_others_way_start_off_the_middle_of_their_holds(robot: Robot) -> None:
    wall = one_move()
    for i, x in ((0, 0.065), (2, -0.065)):  # palms of 140 mm, end to end
        wall["holds"][i] = hold(wall["holds"][i]["name"], x, 0.36, size_m=[0.06, 0.1, 0.06])
    result = unproven(scenario(wall), robot)
    assert result.check.ok
    first = result.plan.knots[0].limbs
    assert abs(first[0].gripper_position_w_m[1] - first[2].gripper_position_w_m[1]) > 0.024
