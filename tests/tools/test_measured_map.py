"""The map as a robot has measured it, of scenarios of both versions: holds that have moved keep shape and turn."""

from __future__ import annotations

import math
import re
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from crux_contracts.robot import load_robot
from crux_contracts.scenario import Hold, Scenario, ScenarioError, parse_scenario
from crux_tools.guide.measured import Found, found_holds, scenario_with
from crux_tools.guide.plan_command import of_log
from crux_tools.guide.situation import Situation, yaw_of
from crux_tools.paths import ROOT
from crux_tools.telemetry.reader import read_log
from scipy.spatial.transform import Rotation

LOGS = ROOT / "tests" / "tools" / "logs"
RF, GRIP_LOST, AIR = 1, 9, 3
UPRIGHT = [1.0, 0.0, 0.0, 0.0]
SHIFT_M, TURNED_DEG = np.array([0.012, -0.007]), 5.0

of_each_kind = pytest.mark.parametrize("kind", ["12-fingers", "13-leaning", "14-turned"])


def climb(kind: str) -> tuple[Any, Any]:
    """A plan, and a robot in physics at its start, as a log has it; nothing has moved."""
    status = of_log(LOGS / f"{kind}.mcap")
    status.fault = SimpleNamespace(code=GRIP_LOST, limb=RF)
    for reference, telemetry in zip(status.reference, status.telemetry, strict=True):
        reference.load, telemetry.force_reference_w_n = 1.0, [1.0, 0.0, 0.0]
    return read_log(LOGS / f"{kind}.mcap").plan, status


def rotation_of(hold: Hold) -> Rotation:
    return Rotation.from_euler("ZYX", [hold.yaw_deg, *hold.tilt_deg[::-1]], degrees=True)


def with_a_moved_hold(kind: str) -> tuple[Any, Any, Hold]:
    """The hold under RF is shifted and turned about W's z, and its gripper with it."""
    plan, status = climb(kind)
    scenario, telemetry, grip = parse_scenario(plan.scenario_yaml), status.telemetry[RF], plan.knots[0].limbs[RF]
    hold = scenario.holds[scenario.hold_index(plan.holds[grip.hold].name)]
    foot, turn = np.array([*hold.position_m, hold.foot_z_m]), Rotation.from_euler("z", TURNED_DEG, degrees=True)
    moved = foot + np.array([*SHIFT_M, 0.0]) + turn.apply(np.array(grip.gripper_position_w_m) - foot)
    planned = Rotation.from_rotvec([*grip.gripper_tilt_w_rad, 0.0]) * Rotation.from_euler("z", grip.gripper_yaw_w_rad)
    telemetry.gripper_position_w_m = moved
    telemetry.gripper_quaternion_w = (turn * planned).as_quat()[[3, 0, 1, 2]]
    return plan, status, hold


def assert_moved(made: Scenario, before: Hold, width_m: float = 0.0) -> None:
    after = made.holds[made.hold_index(before.name)]
    np.testing.assert_allclose(np.subtract(after.position_m, before.position_m), SHIFT_M, atol=1e-6)
    between = rotation_of(after) * rotation_of(before).inv()
    np.testing.assert_allclose(between.as_rotvec(degrees=True), [0.0, 0.0, TURNED_DEG], atol=1e-6)
    x, y, z = before.size_m
    np.testing.assert_allclose(after.size_m, [x + width_m, y, z])
    assert (after.lean_deg, after.foot_z_m) == (before.lean_deg, before.foot_z_m)


@of_each_kind
def test_a_robot_on_holds_that_are_as_on_the_map_finds_nothing(kind: str) -> None:
    plan, status = climb(kind)
    assert found_holds(plan, status) == []
    before = parse_scenario(plan.scenario_yaml)
    assert Situation(plan, status, load_robot("scaler")).scenario().holds == before.holds


@of_each_kind
def test_a_moved_hold_keeps_its_shape_and_turn_while_the_robot_climbs_on(kind: str) -> None:
    plan, status, hold = with_a_moved_hold(kind)
    (found,) = found_holds(plan, status)
    assert found.shift_m == pytest.approx(SHIFT_M, abs=1e-6)
    assert math.degrees(found.turned_rad) == pytest.approx(TURNED_DEG, abs=1e-6)
    assert_moved(scenario_with(plan, [found]), hold)
    slippery = scenario_with(plan, [Found("RF", hold.name, (0.0, 0.0), 0.0, 0.3)])
    assert max(slippery.holds[slippery.hold_index(hold.name)].friction) == 0.3


@of_each_kind
def test_a_moved_hold_keeps_its_shape_and_turn_for_the_guide(kind: str) -> None:
    plan, status, hold = with_a_moved_hold(kind)
    status.reference[RF].finger_opening_m += 0.004
    wider_m = 2 * status.reference[RF].finger_opening_m - plan.knots[0].limbs[RF].finger_separation_m
    assert plan.knots[0].limbs[RF].finger1_face in (0, 1)
    assert_moved(Situation(plan, status, load_robot("scaler")).scenario(), hold, wider_m)


@of_each_kind
def test_a_hold_that_is_none_becomes_the_box_around_it(kind: str, monkeypatch: pytest.MonkeyPatch) -> None:
    plan, status, hold = with_a_moved_hold(kind)
    x, y = hold.position_m
    status.telemetry[RF].gripper_position_w_m, status.telemetry[RF].gripper_quaternion_w = [x + 0.1, y, 0.2], UPRIGHT
    status.reference[RF].phase = AIR
    monkeypatch.setattr(Situation, "useless", lambda _: {hold.name: RF})
    goal = {"body": {"position_m": [0.02, 0.0, 0.185]}}
    made = Situation(plan, status, load_robot("scaler")).scenario(goal)
    left = made.obstacles[-1]
    assert hold.name not in [each.name for each in made.holds]
    assert (left.name, left.position_m, left.size_m) == (hold.name, hold.position_m, hold.size_m)
    assert (left.yaw_deg, left.tilt_deg, left.foot_z_m) == (hold.yaw_deg, hold.tilt_deg, hold.foot_z_m)


def test_a_tilted_gripper_in_the_air_is_refused_in_words() -> None:
    plan, status, _ = with_a_moved_hold("14-turned")
    status.reference[RF].phase = AIR
    with pytest.raises(ScenarioError, match=r"start.air.RF: tilted by 20 degrees: .*upright on the wall"):
        Situation(plan, status, load_robot("scaler")).scenario()


@pytest.mark.parametrize("yaw_rad", [0.0, -0.7])
def test_the_yaw_of_a_tilted_gripper_is_that_of_plans(yaw_rad: float) -> None:
    """exp(tilt) Rz(yaw), not the direction of the opening axis in the wall's plane."""
    turn = Rotation.from_rotvec([0.5, 0.5, 0.0]) * Rotation.from_euler("z", yaw_rad)
    felt: Any = SimpleNamespace(gripper_quaternion_w=turn.as_quat()[[3, 0, 1, 2]])
    assert yaw_of(felt, 0.1) == pytest.approx(yaw_rad)


def test_numbers_of_the_plans_scenario_are_read_as_scenarios_are() -> None:
    """1e-2 is a number in YAML 1.2 alone."""
    plan, status = climb("12-fingers")
    plan.scenario_yaml, changed = re.subn("tolerance_m: .*", "tolerance_m: 1e-2", plan.scenario_yaml)
    assert changed == 1
    assert Situation(plan, status, load_robot("scaler")).scenario().goal.tolerance_m == 0.01
