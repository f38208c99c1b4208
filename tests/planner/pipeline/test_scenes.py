"""The climbing scenes that ship: planned and checked. Those not here are planned by other tests of this folder."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from crux_contracts import LIMB_NAMES
from crux_contracts.robot import Robot, load_robot
from crux_contracts.scenario import Scenario, load_scenario, parse_scenario
from crux_planner import Planner
from crux_planner.pipeline.message import PlanResult
from crux_simulation.benchmarks.random_walls import random_ladder
from shared_plans import unproven

SCENES = Path(__file__).resolve().parents[3] / "msgs" / "scenarios"


def of_scene(name: str, robot: Robot) -> tuple[Scenario, PlanResult]:
    scenario = load_scenario(SCENES / f"{name}.yaml")
    return scenario, planned_well(scenario, robot)


def planned_well(scenario: Scenario, robot: Robot) -> PlanResult:
    result = unproven(scenario, robot)
    assert result.ok
    assert result.check.violations == []
    return result


def no_dearer_than_quick(scenario: Scenario, robot: Robot) -> None:
    """The plan costs no more than what the quick mode finds."""
    quick = Planner(scenario, robot).plan(time_limit_s=60.0)  # enough on a slow machine, too
    assert quick.ok
    assert planned_well(scenario, robot).cost <= quick.cost + 1e-6


CLIMBS = sorted(path.stem for path in SCENES.glob("climb-*.yaml"))


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=[pytest.mark.sweep] * (name != "climb-one-step")) for name in CLIMBS]
)
def test_a_scene_costs_no_more_than_the_quick_plan(name: str) -> None:
    scenario = load_scenario(SCENES / f"{name}.yaml")
    no_dearer_than_quick(scenario, load_robot(scenario.robot))


@pytest.mark.parametrize("seed", [pytest.param(seed, marks=pytest.mark.sweep) for seed in range(1, 51)])
def test_a_random_wall_costs_no_more_than_the_quick_plan(seed: int, robot: Robot) -> None:
    """With two rungs to climb or three, as the seed is even or odd, on slopes from 45 to 90 degrees."""
    text = random_ladder(seed, rungs=5 + seed % 2, slope_deg=(45.0, 60.0, 75.0, 90.0)[seed // 2 % 4])
    no_dearer_than_quick(parse_scenario(text), robot)


@pytest.mark.parametrize(
    "name",
    [
        *("climb-diagonal", "climb-ceiling"),
        *(
            pytest.param(name, marks=pytest.mark.sweep)
            for name in ("climb-four-holds", "climb-vertical", "climb-overhang")
        ),
    ],
)
def test_a_wall_of_eight_holds(name: str, robot: Robot) -> None:
    scenario, result = of_scene(name, robot)
    for limb, grasp in scenario.goal.grasps.items():
        assert result.plan.knots[-1].limbs[LIMB_NAMES.index(limb)].hold == scenario.hold_index(grasp.hold)


@pytest.mark.sweep
def test_a_field_of_holds_of_any_yaw_and_size(robot: Robot) -> None:
    scenario, result = of_scene("climb-field", robot)
    assert len(scenario.holds) > 20
    assert result.gait


def test_slippery_faces_are_left_alone_and_grippers_turn(robot: Robot) -> None:
    scenario, result = of_scene("climb-slippery", robot)
    yaws = []
    for knot in result.plan.knots:
        for limb in knot.limbs:
            if limb.hold >= 0:
                friction = scenario.holds[limb.hold].friction
                assert friction[limb.finger1_face] == friction[limb.finger1_face ^ 1] == 2.2
                yaws.append(limb.gripper_yaw_w_rad)
    assert np.degrees(max(yaws) - min(yaws)) > 50.0
    assert sorted(result.gait) == sorted(LIMB_NAMES)


def test_a_finger_hangs_on_by_its_spines_alone(robot: Robot) -> None:
    """Fig. 8: no normal force, and shear of up to 4 N; by (4) its partner has the same shear."""
    scenario, result = of_scene("climb-spines-only", robot)
    ((name, finger),) = scenario.contact.spines_only.items()
    shears = []
    for knot in result.plan.knots:
        limb = knot.limbs[LIMB_NAMES.index(name)]
        forces = np.reshape(limb.finger_force_w_n, (2, 3))
        axis = np.array([np.cos(limb.gripper_yaw_w_rad), np.sin(limb.gripper_yaw_w_rad), 0.0])
        assert abs(forces[finger - 1] @ axis) < 1e-6
        across = forces - np.outer(forces @ axis, axis)
        np.testing.assert_allclose(across[0], across[1], atol=1e-6)
        shears.append(np.abs(across).max())
    assert 1.0 < max(shears) <= 4.0
    assert name in result.gait


@pytest.mark.sweep
def test_obstacles_are_stepped_over_and_gone_around(robot: Robot) -> None:
    """The sill is passed above, the post beside."""
    scenario, result = of_scene("climb-obstacles", robot)
    boxes = {obstacle.name: obstacle for obstacle in scenario.obstacles}
    sill, post = boxes["sill"], boxes["post"]
    paths = [np.array([knot.limbs[limb].gripper_position_w_m for knot in result.plan.knots]) for limb in range(4)]
    for path in paths[0::2]:  # left limbs
        passing = np.interp(sill.position_m[0], path[:, 0], path[:, 2])
        if path[-1, 0] > sill.position_m[0]:
            assert passing > sill.size_m[2]
    for path in paths[1::2]:
        if path[-1, 0] > post.position_m[0]:
            beside = np.interp(post.position_m[0], path[:, 0], path[:, 1])
            assert beside > post.position_m[1] + post.size_m[1] / 2
