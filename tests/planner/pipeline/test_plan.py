"""Whole plans: they pass the independent check, keep clear between the knots, and do not depend on the frame."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from crux_contracts import LIMB_NAMES
from crux_contracts.interpolation import PlanReference
from crux_contracts.plan_file import plan_id
from crux_contracts.robot import Robot
from crux_planner.pipeline.message import PlanResult
from shared_plans import SharedPlans, unproven
from walls import hold, one_move, scenario, three_rows, two_rows


@pytest.fixture(scope="module")
def climb(robot: Robot, planned: SharedPlans) -> PlanResult:
    return planned(scenario(two_rows()), robot)


def test_a_climb_passes_the_independent_check(climb: PlanResult) -> None:
    assert climb.ok
    assert climb.check.ok
    assert climb.check.violations == []
    assert sorted(climb.gait) == sorted(LIMB_NAMES)
    assert climb.position_residual_m < 1e-6
    assert climb.force_residual_N < 1e-3


def test_the_message_is_complete(climb: PlanResult, robot: Robot) -> None:
    plan, wall = climb.plan, scenario(two_rows())
    assert plan.plan_id == plan_id(plan)
    assert (plan.scenario_name, plan.scenario_sha256, plan.scenario_yaml) == (wall.name, wall.sha256, wall.yaml_text)
    assert (plan.robot_name, plan.robot_sha256) == (robot.name, robot.hash)
    assert plan.n_knots == len(plan.knots) == climb.steps + 1 < 41
    assert plan.n_holds == len(plan.holds) == 8
    assert [h.graspable for h in plan.holds] == [1] * 8
    assert plan.cost == climb.cost


def test_the_same_scenario_gives_the_same_plan(robot: Robot, planned: SharedPlans) -> None:
    """Whatever is proven of its cost beside it."""
    plans = [planned(scenario(one_move()), robot, proven=proven).plan for proven in (False, True)]
    assert plans[0].plan_id == plans[1].plan_id


def test_forces_carry_the_weight_at_every_knot(climb: PlanResult, robot: Robot) -> None:
    plan = climb.plan
    weight = robot.total_mass_kg * np.array(plan.gravity_w_m_s2)
    for here, after in zip(plan.knots, plan.knots[1:], strict=False):
        total = sum(np.reshape(limb.finger_force_w_n, (2, 3)).sum(axis=0) for limb in here.limbs)
        change = np.subtract(after.body_velocity_w_m_s, here.body_velocity_w_m_s) / plan.dt_s
        np.testing.assert_allclose(total + weight, robot.total_mass_kg * change, atol=1e-3)


def distance(point: np.ndarray, cuboid: Any) -> float:
    """From a point to a cuboid, by turning the point into its frame."""
    c, s = math.cos(cuboid.yaw_rad), math.sin(cuboid.yaw_rad)
    x, y = point[0] - cuboid.position_w_m[0], point[1] - cuboid.position_w_m[1]
    local = np.array([c * x + s * y, -s * x + c * y, point[2] - cuboid.size_m[2] / 2])
    half = np.array(cuboid.size_m) / 2
    return float(np.linalg.norm(local - np.clip(local, -half, half)))


def least_clearance(plan: Any, robot: Robot) -> float:
    """Least distance [m] of the middle of a swinging finger to any hold but the one it is on."""
    reference, least = PlanReference(plan), math.inf
    for limb in range(4):
        for k in range(reference.intervals):
            if not reference.air[k, limb]:
                continue
            leaving, landing = reference.lets_go(k, limb), reference.takes_hold(k + 1, limb)
            own = {plan.knots[k - 1].limbs[limb].hold} if leaving else set()
            own |= {plan.knots[k + 1].limbs[limb].hold} if landing else set()
            for u in np.linspace(0, 1, 41):
                at = reference.limb(limb, k, u)
                axis = np.array([np.cos(at.yaw_w_rad), np.sin(at.yaw_w_rad), 0.0])
                for side in (-1, 1):
                    finger = at.position_w_m + side * (at.opening_m + robot.gripper.pad_radius_m) * axis
                    others = [c for i, c in enumerate(plan.holds) if i not in own]
                    least = min(least, *[distance(finger, cuboid) for cuboid in others])
    return least


def test_fingers_keep_their_clearance_between_the_knots(climb: PlanResult, robot: Robot) -> None:
    assert least_clearance(climb.plan, robot) >= robot.grasp.swing_clearance_m - 1e-9


def test_a_body_that_starts_turned_plans_the_same_climb(robot: Robot) -> None:
    """On the flat nothing depends on the heading: the wall turned by 40 degrees gives the plan turned by 40 degrees."""
    straight = unproven(scenario(one_move(slope_deg=0.0)), robot)
    wall, turn = one_move(slope_deg=0.0), math.radians(40)
    c, s = math.cos(turn), math.sin(turn)
    for part in wall["holds"]:
        x, y = part["position_m"]
        part["position_m"] = [c * x - s * y, s * x + c * y]
        part["yaw_deg"] = part.get("yaw_deg", 0) + 40
    for body in (wall["start"]["body"], wall["goal"]["body"]):
        x, y, z = body["position_m"]
        body.update(position_m=[c * x - s * y, s * x + c * y, z], rpy_deg=[0, 0, 40])
    turned = unproven(scenario(wall), robot)
    assert turned.cost == pytest.approx(straight.cost, rel=1e-3)
    assert turned.gait == straight.gait
    assert turned.steps == straight.steps
    k = straight.steps // 2
    np.testing.assert_allclose(
        turned.plan.knots[k].body_rpy_rad[2] - turn, straight.plan.knots[k].body_rpy_rad[2], atol=0.01
    )


@pytest.mark.sweep  # test_scenes.py has the ceiling
@pytest.mark.parametrize("slope_deg", [0.0, 90.0])
def test_other_slopes(robot: Robot, slope_deg: float) -> None:
    result = unproven(scenario(two_rows(slope_deg=slope_deg)), robot)
    assert result.ok
    assert all(joint.peak_torque_Nm <= joint.effort_limit_Nm for joint in result.check.joints)


@pytest.mark.sweep  # as the shipped scenes show in test_scenes.py
def test_slippery_faces_are_not_gripped(robot: Robot) -> None:
    """Turned holds whose x faces are polished: every gripper takes the y faces."""
    wall = two_rows(0.16)
    for i, part in enumerate(wall["holds"]):
        part["yaw_deg"] = (-15, 10, 20, -8)[i % 4]
        part["friction"] = {"+x": 0.0, "-x": 0.0, "+y": 2.2, "-y": 2.2, "top": 2.2}
        part["spines"] = {"+x": False, "-x": False}
    for grasp in (*wall["start"]["grasps"].values(), *wall["goal"]["grasps"].values()):
        grasp["faces"] = "y"
    wall["goal"].pop("grasps")
    wall["goal"]["body"]["position_m"][0] = 0.28
    result = unproven(scenario(wall), robot)
    assert result.gait
    for knot in result.plan.knots:
        assert all(limb.finger1_face in (-1, 2, 3) for limb in knot.limbs)


def test_an_obstacle_on_the_way_is_passed_with_clearance(robot: Robot) -> None:
    wall = three_rows()
    wall["obstacles"] = [{"name": "pillar", "position_m": [0.28, 0.365], "size_m": [0.05, 0.05, 0.3]}]
    result = unproven(scenario(wall), robot)
    assert result.ok
    assert least_clearance(result.plan, robot) >= robot.grasp.swing_clearance_m - 1e-9


@pytest.mark.parametrize("made", [one_move, pytest.param(two_rows, marks=pytest.mark.sweep)])
def test_spines_carry_the_robot_where_faces_have_little_friction(
    robot: Robot, made: Callable[[], dict[str, Any]]
) -> None:
    wall = made()
    for part in wall["holds"]:
        part["friction"] = 0.05
    wall["contact"].update(spine_shear_N=40, spine_twist_Nm=0.5)
    result = unproven(scenario(wall), robot)
    assert result.ok
    for knot in result.plan.knots:
        for limb in knot.limbs:
            shear = np.reshape(limb.finger_force_w_n, (2, 3))[:, 2]
            assert np.abs(shear).max() <= 40.0 + 1e-6


@pytest.mark.sweep  # as the shipped scenes show in test_scenes.py
def test_a_finger_that_may_not_press_hangs_by_its_spines(robot: Robot) -> None:
    """On a vertical wall, each gripper on one pressing finger: 30 N of shear by spines, none of it by friction."""
    wall = two_rows(slope_deg=90.0)
    hanging = {"LF": 2, "RF": 2, "LR": 2, "RR": 2}
    wall["contact"].update(spine_shear_N=30, spines_only=hanging)
    result = unproven(scenario(wall), robot)
    assert sorted(result.gait) == sorted(LIMB_NAMES)
    shears = []
    for knot in result.plan.knots:
        for limb in knot.limbs:
            axis = np.array([np.cos(limb.gripper_yaw_w_rad), np.sin(limb.gripper_yaw_w_rad), 0.0])
            force = np.reshape(limb.finger_force_w_n, (2, 3))
            assert force[1] @ axis == pytest.approx(0.0, abs=1e-6)
            shears.append(np.abs(force - np.outer(force @ axis, axis)).max())
    assert 5.0 < max(shears) <= 30.0


def test_grasps_named_by_the_goal_are_honoured(robot: Robot) -> None:
    wall = two_rows(all_limbs=False)
    wall["holds"].append(hold("aside", 0.32, -0.30, yaw_deg=85))
    wall["goal"]["grasps"] = {"RF": {"hold": "aside", "faces": "y"}}
    wall["holds"] = [part for part in wall["holds"] if part["name"] != "RF-high"]
    result = unproven(scenario(wall), robot)
    last = result.plan.knots[-1].limbs[1]
    assert result.plan.holds[last.hold].name == "aside"
    assert last.finger1_face in (2, 3)
