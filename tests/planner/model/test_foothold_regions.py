"""Walks beside and around obstacles."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from crux_contracts.robot import load_robot
from crux_contracts.scenario import Obstacle, parse_scenario
from crux_planner import InfeasibleError
from crux_planner.model.foothold_regions import CLEARANCE_M, foothold_ranges
from crux_planner.model.slots import Strides
from crux_planner.model.walk_problem import build_walk
from shared_plans import unproven

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
    text = FLAT.replace("steps: 40", "steps: 44").replace("[0.1, 0.0, 0.185]", "[0.15, 0.0, 0.185]")
    result = unproven(parse_scenario(text + f"obstacles: [{listed}]\n"), ROBOT)
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
    for low, high in (ranges.first, ranges.along, ranges.passing, ranges.last):
        places = random.uniform(np.maximum(low[0], -1.0), np.minimum(high[0], 1.0), (200, 2))
        assert (np.abs(places - [0.28, 0.36]) - half).max(axis=1).min() >= -1e-9
    for places in (FEET[1:], FEET[1:] + AHEAD):  # the others go where they would
        assert ((ranges.first[0][1:] <= places) & (places <= ranges.first[1][1:])).all()


def test_far_obstacles_change_nothing_and_walls_have_no_way_past() -> None:
    far = foothold_ranges([Obstacle("box", (2.0, 2.0), (0.1, 0.1, 0.1))], ROBOT, 0.3, 0.1, FEET, FEET + AHEAD, ROOM)
    assert (far.fewest == 1).all()
    assert (far.last[0] < FEET).all()
    assert (far.last[1] > FEET + AHEAD).all()
    wall = Obstacle("wall", (0.28, 0.0), (0.04, 2.0, 0.1))
    with pytest.raises(InfeasibleError, match="no foothold for LF beside obstacle 'wall'"):
        foothold_ranges([wall], ROBOT, 0.0, 0.0, FEET, FEET + AHEAD, np.array([0.02, 0.05]))


@pytest.mark.parametrize("steps", [3, 5])
def test_a_foot_whose_goal_is_behind_an_obstacle_comes_back(steps: int) -> None:
    """Straight steps between any footholds in the ranges keep off it, and the last may end where the goal has it."""
    box = Obstacle("box", (0.36, 0.36), (0.04, 0.04, 0.1))
    behind = FEET + np.array([0.44, 0.0])
    ranges = foothold_ranges([box], ROBOT, 0.0, 0.0, FEET, behind, np.array([0.13, 0.075]))
    assert ranges.fewest.tolist() == [3, 1, 1, 1]
    found = ranges.of_steps(0, steps)
    assert ranges.of_steps(0, 2) is None
    assert found is not None
    low, high = found
    assert ((low[-1] <= behind[0]) & (behind[0] <= high[-1])).all()
    half, random = 0.02 + PALM + CLEARANCE_M, np.random.default_rng(5)
    for _ in range(100):
        way = np.vstack([FEET[0], random.uniform(np.maximum(low, 0.0), np.minimum(high, 0.8))])
        for start, end in pairwise(way):
            places = start + np.linspace(0.0, 1.0, 50)[:, None] * (end - start)
            assert (np.abs(places - [0.36, 0.36]) - half).max(axis=1).min() >= -1e-9


def test_a_foot_takes_the_steps_that_its_detour_needs() -> None:
    """Two steps would do for 0.4 m of way; round the box it takes three, and the one past it is long."""
    text = FLAT.replace("steps: 40", "steps: 120").replace("[0.1, 0.0, 0.185]", "[0.4, 0.0, 0.185]")
    box = "obstacles: [{name: box, position_m: [0.36, 0.36], size_m: [0.04, 0.04, 0.05]}]\n"
    plain, around = (Strides(build_walk(parse_scenario(each), ROBOT)) for each in (text, text + box))
    assert (plain.fewest_rounds(), around.fewest_rounds()) == (2, 3)
    in_the_air = [[land - lift for lift, land in strides.starts(3)[0].of_limb[0]] for strides in (plain, around)]
    assert min(in_the_air[1]) > max(in_the_air[0])
