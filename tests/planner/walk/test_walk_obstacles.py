"""Walks beside and around obstacles."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from crux_contracts.robot import load_robot
from crux_contracts.scenario import Obstacle, parse_scenario
from crux_planner import InfeasibleError, plan
from crux_planner.walk.obstacles import CLEARANCE_M, foothold_ranges

FLAT = (Path(__file__).resolve().parents[3] / "msgs" / "scenarios" / "walk-flat.yaml").read_text()
ROBOT = load_robot("scaler")
FEET = np.array([[0.14, 0.36], [0.14, -0.36], [-0.14, 0.36], [-0.14, -0.36]])
AHEAD = np.array([0.15, 0.0])
ROOM = np.array([0.1, 0.1])
PALM = np.array([0.07, 0.012])  # half edges in the robot's URDF


def test_a_foot_walks_around_an_obstacle_and_another_beside_one() -> None:
    """LF's way is blocked: it goes round. The checker measures how near everything comes."""
    boxes = [("mid", 0.25, 0.36), ("side", 0.13, -0.48)]
    listed = ", ".join(f"{{name: {n}, position_m: [{x}, {y}], size_m: [0.05, 0.05, 0.06]}}" for n, x, y in boxes)
    text = FLAT.replace("steps: 40", "steps: 60").replace("[0.1, 0.0, 0.185]", "[0.15, 0.0, 0.185]")
    result = plan(parse_scenario(text + f"obstacles: [{listed}]\n"), ROBOT)
    assert result.ok
    assert result.gait.count("LF") >= 2
    places = np.array([knot.limbs[0].gripper_position_w_m[:2] for knot in result.plan.knots])
    off = np.abs(places - [0.25, 0.36]) - PALM - 0.025
    assert off.max(axis=1).min() >= 0.9 * CLEARANCE_M
    assert places[-1, 0] > 0.24


@pytest.mark.parametrize("yaw_deg", [0.0, 30.0, 90.0])
def test_every_foothold_of_a_range_is_clear_of_the_obstacle(yaw_deg: float) -> None:
    obstacle = Obstacle("box", (0.28, 0.36), (0.04, 0.04, 0.1), yaw_deg)
    ranges = foothold_ranges([obstacle], ROBOT, 0.0, 0.0, FEET, FEET + AHEAD, ROOM)
    corners = 0.5 * np.array([[a * 0.04, b * 0.04] for a in (-1, 1) for b in (-1, 1)])
    c, s = np.cos(np.radians(yaw_deg)), np.sin(np.radians(yaw_deg))
    half = np.abs(corners @ np.array([[c, s], [-s, c]])).max(axis=0) + PALM + CLEARANCE_M
    random = np.random.default_rng(3)
    for low, high in (ranges.first, ranges.later):
        places = random.uniform(np.maximum(low[0], -1.0), np.minimum(high[0], 1.0), (200, 2))
        assert (np.abs(places - [0.28, 0.36]) - half).max(axis=1).min() >= -1e-9
    for places in (FEET[1:], FEET[1:] + AHEAD):  # the others go where they would
        assert ((ranges.first[0][1:] <= places) & (places <= ranges.first[1][1:])).all()


def test_far_obstacles_change_nothing_and_walls_have_no_way_past() -> None:
    far = foothold_ranges([Obstacle("box", (2.0, 2.0), (0.1, 0.1, 0.1))], ROBOT, 0.3, 0.1, FEET, FEET + AHEAD, ROOM)
    assert not far.detour.any()
    assert (far.later[0] < FEET).all()
    assert (far.later[1] > FEET + AHEAD).all()
    wall = Obstacle("wall", (0.28, 0.0), (0.04, 2.0, 0.1))
    with pytest.raises(InfeasibleError, match="no foothold for LF beside obstacle 'wall'"):
        foothold_ranges([wall], ROBOT, 0.0, 0.0, FEET, FEET + AHEAD, np.array([0.02, 0.05]))
