"""Walls that need all that the limbs reach, and what is said of walls that need more."""

from __future__ import annotations

import itertools
import json
import subprocess
import sys
from pathlib import Path

import crux_planner
import numpy as np
import pytest
import yaml
from crux_contracts.plan_file import write_plan
from crux_contracts.robot import Robot
from crux_contracts.scenario import parse_scenario
from crux_planner.checker.inverse_kinematics import solve
from crux_planner.checker.limb_model import load_model
from crux_planner.errors import PLANNED_REACH, InfeasibleError
from crux_planner.model.build import build_problem
from crux_planner.model.kinematics import rotation_z
from crux_planner.pipeline import climb
from crux_planner.pipeline.explanation import level_stance_at_goal
from crux_planner.pipeline.message import PlanResult
from crux_simulation.benchmarks.random_fields import random_field
from crux_simulation.benchmarks.random_walls import random_wall
from shared_plans import unproven
from walls import one_move, scenario, two_rows

SCENES = Path(__file__).resolve().parents[3] / "msgs" / "scenarios"
LIMBS = {"LF": (1, 1), "RF": (1, -1), "LR": (0, 1), "RR": (0, -1)}


def ladder(gap_m: float, slope_deg: float, *, staggered_m: float = 0.0, without: tuple[str, ...] = ()) -> str:
    """Three rungs of two holds each; the climb is one rung, the right side is `staggered_m` higher."""
    holds = [
        {
            "name": f"{'LR'[side < 0]}{rung}",
            "position_m": [round((rung - 0.5) * gap_m + staggered_m * (side < 0), 4), 0.345 * side],
            "size_m": [0.06, 0.06, 0.06],
            "friction": 2.2,
        }
        for rung in range(3)
        for side in (1, -1)
    ]
    on = {limb: {"hold": f"{limb[0]}{rung}", "faces": "x"} for limb, (rung, _) in LIMBS.items()}
    body = {"position_m": [round(staggered_m / 2, 4), 0.0, 0.185]}
    goal = {"position_m": [round(gap_m + staggered_m / 2, 4), 0.0, 0.185], "tolerance_m": 0.01, "tolerance_deg": 3.0}
    contact = {"model": "patch", "patch_radius_m": 0.02, "max_normal_N": 60, "spine_shear_N": 5, "spine_twist_Nm": 0.05}
    document = {
        "version": 1,
        "name": "ladder",
        "robot": "scaler",
        "wall": {"slope_deg": slope_deg, "friction": 0.6},
        "contact": contact,
        "holds": [hold for hold in holds if hold["name"] not in without],
        "horizon": {"steps": 80, "dt_s": 2.0},
        "start": {"body": body, "grasps": on},
        "goal": {"body": goal},
    }
    return yaml.safe_dump(document, sort_keys=False)


@pytest.mark.parametrize("position_m", [[0.44, 0.26], [-0.02, 0.2], [0.02, 0.47]])
def test_a_climb_starts_wherever_joint_limits_let_its_limbs_hold(position_m: list[float], robot: Robot) -> None:
    """Far ahead, near the body and far aside: outside every inner box and polytope of reach."""
    wall = one_move()
    wall["holds"][0]["position_m"] = position_m
    read = scenario(wall)
    problem = build_problem(read, robot)
    place = problem.contacts[problem.start_contacts[0]].centre_h_m - problem.start.position_m
    assert all((reach.beyond(0, place) > 0.0).any() for reach in (problem.boxes, problem.limb_reach.inner))
    assert unproven(read, robot).check.ok


@pytest.mark.sweep
@pytest.mark.parametrize(
    ("gap_m", "slope_deg", "staggered_m"),
    [(0.35, 45.0, 0.0), (0.38, 30.0, 0.04)],
)
def test_rungs_farther_apart_than_a_box_is_long_are_climbed(
    robot: Robot, gap_m: float, slope_deg: float, staggered_m: float
) -> None:
    result = unproven(parse_scenario(ladder(gap_m, slope_deg, staggered_m=staggered_m)), robot)
    assert result.check.ok
    body = np.array([knot.body_position_w_m for knot in result.plan.knots])
    assert body[-1, 0] - body[0, 0] > gap_m - 0.01


def near_and_chosen(text: str, robot: Robot, monkeypatch: pytest.MonkeyPatch) -> tuple[PlanResult, PlanResult]:
    """The plan that limbs in their boxes give, and the one that is given."""
    chosen = crux_planner.plan(parse_scenario(text), robot)
    with monkeypatch.context() as patch:
        patch.setattr("crux_planner.pipeline.climb.plan_by_map", lambda *_, **__: None)
        near = unproven(parse_scenario(text), robot)
    assert near.check.ok
    assert chosen.check.ok
    return near, chosen


def test_the_body_alone_moves_where_all_of_the_reach_lets_it(robot: Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    near, chosen = near_and_chosen(random_wall(9001), robot, monkeypatch)
    assert near.gait
    assert chosen.gait == []
    assert chosen.steps < near.steps
    assert chosen.cost < 0.5 * near.cost
    assert chosen.gap is not None
    assert chosen.gap < 0.18  # 0.22 where the centre of mass at start and goal is as anywhere, 0.28 where the body is


@pytest.mark.sweep
@pytest.mark.parametrize("scene", ["climb-field", "climb-obstacles", "climb-spines-only", "climb-turned"])
def test_a_plan_by_map_costs_no_more_than_one_in_boxes(
    robot: Robot, monkeypatch: pytest.MonkeyPatch, scene: str
) -> None:
    """Of moves in all of the reach that cost no more than in the boxes."""
    near, chosen = near_and_chosen((SCENES / f"{scene}.yaml").read_text(), robot, monkeypatch)
    assert chosen.cost <= (1.0 + 1e-6) * near.cost
    assert chosen.steps <= near.steps


@pytest.mark.parametrize(
    ("start_deg", "goal_deg"),
    [
        pytest.param((5, -6), (0, 0), marks=pytest.mark.sweep),
        ((0, 10), (0, -8)),
        pytest.param((0, 0), (-7, 7), marks=pytest.mark.sweep),
    ],
)
def test_starts_and_goals_may_be_tilted(
    robot: Robot, start_deg: tuple[float, float], goal_deg: tuple[float, float]
) -> None:
    wall = two_rows()
    wall["start"]["body"]["rpy_deg"], wall["goal"]["body"]["rpy_deg"] = [*start_deg, 0], [*goal_deg, 0]
    result = unproven(scenario(wall), robot)
    assert result.check.ok
    first, last = (np.degrees(result.plan.knots[k].body_rpy_rad[:2]) for k in (0, -1))
    np.testing.assert_allclose(first, start_deg, atol=1e-6)
    assert np.abs(last - goal_deg).max() < 3.1


@pytest.mark.sweep
@pytest.mark.parametrize(("start_deg", "goal_deg"), [((5, -6), (0, 0)), ((0, 10), (0, -8))])
def test_the_robot_climbs_from_and_to_a_tilt(
    robot: Robot, tmp_path: Path, start_deg: tuple[float, float], goal_deg: tuple[float, float]
) -> None:
    """In physics, with the runtime's own code."""
    wall = two_rows()
    wall["start"]["body"]["rpy_deg"], wall["goal"]["body"]["rpy_deg"] = [*start_deg, 0], [*goal_deg, 0]
    plan, log = tmp_path / "plan.mcap", tmp_path / "log.mcap"
    write_plan(plan, unproven(scenario(wall), robot).plan)
    climb = [sys.executable, "-m", "crux_tools.cli", "climb", str(plan), "-o", str(log), "--json"]
    done = subprocess.run(climb, stdout=subprocess.PIPE, check=False)
    said = json.loads(done.stdout)
    assert done.returncode == 0, said
    assert (said["reached_goal"], said["fell"], said["slips"]) == (True, False, 0)


@pytest.mark.parametrize("seed", [402, *(pytest.param(seed, marks=pytest.mark.sweep) for seed in (403, 408))])
def test_a_level_stance_at_the_goal_is_what_the_checkers_kinematics_finds(robot: Robot, seed: int) -> None:
    """Limb by limb, by numeric inverse kinematics within the joint limits, for the body in the middle of the goal."""
    problem = build_problem(parse_scenario(random_field(seed)), robot)
    stance, goal = level_stance_at_goal(problem, robot), problem.goal.body
    places = (np.array([c.centre_h_m for c in problem.contacts]) - goal.position_m) @ rotation_z(goal.rpy_rad[2])
    yaws = np.array([c.yaw_rad for c in problem.contacts]) - goal.rpy_rad[2]
    ends = []
    for index, limb in enumerate(load_model(robot).limbs):
        contacts = problem.limb_contacts[index]
        (found,) = solve([limb], [places[contacts]], [rotation_z(yaws[contacts])])
        inside = ((found.q_rad > limb.lower_rad) & (found.q_rad < limb.upper_rad)).all(axis=1)
        grips = [(problem.contacts[c].hold, problem.contacts[c].pair) for c in contacts]
        wanted = problem.goal.grasps.get(index)
        reached = inside & (found.position_error_m < 1e-6)
        ends.append({grip[0] for grip, ok in zip(grips, reached, strict=True) if ok and wanted in (None, grip)})
    stands = any(len(set(holds)) == 4 for holds in itertools.product(*ends))
    assert (stance is not None) or not stands
    assert (stance is None) == (seed == 408)


def test_no_wall_is_refused_for_reach_where_a_level_body_could_stand(
    robot: Robot, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(climb, "plan_by_map", lambda *_, **__: None)
    with pytest.raises(InfeasibleError, match="no sequence of contacts found") as refused:
        unproven(parse_scenario(random_field(407)), robot)
    assert (refused.value.constraint, refused.value.proven) == ("contacts", False)
    assert PLANNED_REACH in str(refused.value)
    assert "workspace" not in str(refused.value)
