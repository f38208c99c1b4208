"""A plan does not wait without need, and J and the gap are those of the steps it takes."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from crux_contracts.robot import Robot
from crux_contracts.scenario import Scenario, parse_scenario
from crux_planner.certificates.bound.climb import EFFORT, lower_bound
from crux_planner.checker import check_plan
from crux_planner.model.build import build_problem
from crux_planner.model.problem import BodyBounds
from crux_planner.pipeline.message import PlanResult
from crux_planner.trajectory.waiting import PACES, moving_knots
from shared_plans import SharedPlans, unproven
from walls import one_move, scenario, two_rows

ROOT = Path(__file__).resolve().parents[3]
README = (ROOT / "README.md").read_text(encoding="utf-8")
FLAT = (ROOT / "msgs" / "scenarios" / "walk-flat.yaml").read_text(encoding="utf-8")
LIMITS = BodyBounds((0.165, 0.21), 0.3, 0.02, 0.1, 0.165)


def longest_wait(plan: Any, moved_m: float) -> int:
    """Most intervals in a row in which all limbs stay where they are and the body moves less than `moved_m` in all."""
    knots, longest = plan.knots, 0
    for first in range(len(knots)):
        for k in range(first + 1, len(knots)):
            grippers = [
                np.subtract(a.gripper_position_w_m, b.gripper_position_w_m)
                for a, b in zip(knots[first].limbs, knots[k].limbs, strict=True)
            ]
            way = np.subtract(knots[k].body_position_w_m, knots[first].body_position_w_m)
            in_air = any(limb.phase == limb.AIR for limb in knots[k].limbs)
            if in_air or np.abs(grippers).max() > 1e-6 or np.abs(way).max() > moved_m:
                break
            longest = max(longest, k - first)
    return longest


def readme_wall() -> Scenario:
    begin = README.index("version: 1\nname: my-wall")
    return parse_scenario(README[begin : README.index("```", begin)], "my-wall.yaml")


@pytest.fixture(scope="module")
def wall(robot: Robot, planned: SharedPlans) -> PlanResult:
    return planned(readme_wall(), robot, proven=True)


def test_the_wall_of_the_readme_does_not_stand_still(wall: PlanResult) -> None:
    assert wall.check.ok
    assert longest_wait(wall.plan, 0.004) <= 2
    assert wall.steps == len(wall.plan.knots) - 1 < 40
    assert wall.plan.knots[-1].time_s == wall.steps * 2.0


def test_the_gap_is_about_plans_of_as_many_steps(wall: PlanResult, robot: Robot) -> None:
    assert wall.gap is not None
    assert wall.gap < 0.4  # 0.56 where what faces are gripped does not count
    problem = replace(build_problem(readme_wall(), robot), steps=wall.steps)
    bound = lower_bound(problem, 0.95 * wall.cost, 300.0, effort=EFFORT)
    assert bound is not None
    assert wall.gap == pytest.approx(1.0 - bound / wall.cost, abs=0.02)
    assert wall.to_json()["steps"] == wall.steps


@pytest.mark.sweep
def test_more_time_makes_no_longer_plan(robot: Robot, planned: SharedPlans) -> None:
    some, more = planned(scenario(two_rows()), robot), unproven(scenario(two_rows(steps=80)), robot)
    assert some.check.ok
    assert more.check.ok
    assert more.steps <= some.steps + 2 < 40


def test_a_scenario_may_keep_the_waits(robot: Robot, planned: SharedPlans) -> None:
    kept = unproven(scenario({**one_move(), "planner": {"idle": "keep"}}), robot)
    short = planned(scenario(one_move()), robot)
    assert kept.steps == 40 > short.steps
    assert kept.gait == short.gait
    assert kept.cost > short.cost


@pytest.mark.parametrize(
    ("goal", "steps"),
    [
        ("[0.1, 0.0, 0.185]", 40),
        pytest.param("[0.1, 0.0, 0.185]", 60, marks=pytest.mark.sweep),
        *(pytest.param("[0.05, 0.0, 0.185]", steps, marks=pytest.mark.sweep) for steps in (40, 60)),
    ],
)
def test_a_walk_does_not_wait(goal: str, steps: int, robot: Robot, planned: SharedPlans) -> None:
    text = FLAT.replace("[0.1, 0.0, 0.185]", goal).replace("steps: 40", f"steps: {steps}")
    found = planned(parse_scenario(text), robot)
    assert found.steps < steps
    assert longest_wait(found.plan, 0.001) <= 3


def test_a_walk_may_keep_its_waits(robot: Robot) -> None:
    assert unproven(parse_scenario(FLAT + "planner: {idle: keep}\n"), robot).steps == 40


def test_the_check_allows_fewer_steps_than_the_horizon_but_not_where_they_are_kept(
    robot: Robot, planned: SharedPlans
) -> None:
    short = planned(scenario(two_rows()), robot).plan
    assert check_plan(short, robot).ok
    text = short.scenario_yaml
    for other in (text + "planner: {idle: keep}\n", text.replace("steps: 40", f"steps: {short.n_knots - 2}")):
        short.scenario_yaml = other
        worst = [v for v in check_plan(short, robot).violations if "number of knots" in v.detail]
        assert [v.constraint for v in worst] == ["scenario_match"]


@pytest.mark.parametrize("pace", PACES)
def test_knots_are_left_out_only_where_nothing_moves(pace: float) -> None:
    """All limbs on at 0..9 and 13..20; the body rests at 4..8 and drifts slowly from 15 on; 0.02 m/s, 1 s a knot."""
    standing = np.ones(21, dtype=bool)
    standing[10:13] = False
    body = np.zeros((21, 6))
    body[:, 0] = [0, 0, 0.02, 0.04, *[0.05] * 11, *0.05 + 0.001 * np.arange(1, 7)]
    kept = moving_knots(standing, body, LIMITS, 1.0, pace)
    assert kept.tolist()[:4] == [0, 1, 2, 3]
    assert {9, 10, 11, 12, 13, 19, 20} <= set(kept.tolist())
    swings = np.abs(np.diff(body[kept, 0]))
    assert len(kept) < 17
    assert all(way <= pace * 0.02 + 1e-12 or b == a + 1 for way, a, b in zip(swings, kept, kept[1:], strict=False))
