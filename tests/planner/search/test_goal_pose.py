"""Where plans end: in the middle of the goal's tolerance where they can, else wherever it lets them."""

from __future__ import annotations

from typing import Any

import numpy as np
from crux_contracts.robot import Robot
from crux_planner.model.build import build_problem
from crux_planner.physics.reachable_set import ReachableSet
from shared_plans import unproven
from walls import scenario, two_rows


def end_error_m(content: dict[str, Any], robot: Robot) -> np.ndarray:
    result = unproven(scenario(content), robot)
    assert result.check.ok
    error: np.ndarray = np.array(result.plan.knots[-1].body_position_w_m) - content["goal"]["body"]["position_m"]
    return error


def test_a_plan_leaves_most_of_the_goals_tolerance_to_the_robot(robot: Robot) -> None:
    content = two_rows()
    content["goal"]["body"]["tolerance_m"] = 0.01
    assert np.linalg.norm(end_error_m(content, robot)) < 0.0035


def test_a_goal_whose_middle_is_out_of_reach_is_reached_at_its_edge(robot: Robot) -> None:
    content = two_rows()
    problem = build_problem(scenario(content), robot)
    wanted = [next(i for i, c in enumerate(problem.contacts) if (c.hold, c.pair) == g) for g in goal_grasps(problem)]
    bounds = ReachableSet(problem).of((wanted[0], wanted[1], wanted[2], wanted[3]))
    assert bounds is not None
    beyond = float(bounds[1][0]) + 0.007  # the level body's reach ends here; tilted it gets some millimetres further
    content["goal"]["body"].update(position_m=[beyond, 0.0, 0.185], tolerance_m=0.015)
    assert 0.0035 < np.linalg.norm(end_error_m(content, robot)) < 0.015


def goal_grasps(problem: Any) -> list[tuple[int, int]]:
    return [problem.goal.grasps[limb] for limb in range(4)]
