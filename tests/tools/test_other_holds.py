"""Climbs where grippers are slower, gears stickier and holds others than planned."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from crux_contracts.robot import load_robot
from crux_simulation.sim.climb import ClimbOptions, climb
from crux_simulation.sim.climb_result import ClimbResult
from crux_simulation.sim.plant import Plant
from crux_simulation.sim.world_file import parse_world
from crux_tools.robot3d.robot_model import build_model
from crux_tools.telemetry.channels import Channels, read_channels
from hand_plan import HALF_HOLD_M, climbing_plan, standing_plan
from holding_controller import HoldingController

pytestmark = pytest.mark.usefixtures("briefly_watched")
NEW = "h4"  # LF climbs to it
HOLD_MISSING, ENCODER_FROZEN = 29, 18
SWEPT = pytest.mark.sweep


def climbed(text: str, folder: Path) -> tuple[ClimbResult, Channels]:
    plan = climbing_plan(limbs_to_move=(0,))
    world = parse_world(f"version: 1\nname: test\n{text}".encode()).draw(0, plan)
    result = climb(plan, load_robot("scaler"), folder / "log.mcap", ClimbOptions(world=world))
    return result, read_channels(folder / "log.mcap")


def slow(speed_m_s: float) -> str:
    return f"robot: {{grippers: {{all: {{speed_limit_m_s: {speed_m_s}}}}}}}\n"


@pytest.mark.sweep
@pytest.mark.parametrize("speed_m_s", [0.005, 0.010])
def test_grippers_slower_than_described_climb(speed_m_s: float, tmp_path: Path) -> None:
    result, log = climbed(slow(speed_m_s), tmp_path)
    assert result.ok, result.reason
    fastest = np.abs(log.tables["/control_input"]["finger_speed_m_s"]).max()
    assert fastest < 1.2 * speed_m_s


@pytest.mark.parametrize(
    ("change", "half_m"),
    [
        ("size_change_m: [-0.020, -0.020, 0]", HALF_HOLD_M - 0.010),
        pytest.param("size_change_m: [0.030, 0.030, 0]", HALF_HOLD_M + 0.015, marks=SWEPT),
        pytest.param("yaw_deg: 20", None, marks=SWEPT),
        pytest.param("corner_cut_m: [0.02, 0.02]", HALF_HOLD_M, marks=SWEPT),
        pytest.param("corner_cut_m: [-0.02, 0.02]", HALF_HOLD_M, marks=SWEPT),
    ],
)
def test_a_hold_that_is_not_as_planned_is_gripped_as_it_is(change: str, half_m: float | None, tmp_path: Path) -> None:
    result, log = climbed(f"holds: {{{NEW}: {{{change}}}}}\n", tmp_path)
    assert result.ok, result.reason
    reference = log.tables["/limb_reference"]
    told_m = reference["finger_opening_m"][reference["limb"] == 0][-1]
    assert told_m == pytest.approx(log.tables["/control_input"]["finger_opening_m"][-1, 0], abs=5e-4)
    if half_m is not None:
        assert told_m == pytest.approx(half_m, abs=1e-3)


def test_a_hold_that_is_not_there_is_told_when_the_fingers_have_closed(tmp_path: Path) -> None:
    result, log = climbed(f"holds: {{{NEW}: {{present: false}}}}\n", tmp_path)
    (fault,) = log.tables["/fault"]
    assert (fault["code"], fault["limb"]) == (HOLD_MISSING, 0), result.reason
    closed_m, _ = load_robot("scaler").gripper.opening_m
    assert fault["value"] == pytest.approx(closed_m, abs=1.5e-3)
    assert not result.verdict.fell


def test_a_joint_that_sticks_has_no_frozen_encoder(tmp_path: Path) -> None:
    result, log = climbed("robot: {joints: {all: {friction_Nm: 0.5, stiction_Nm: 1.0}}}\n", tmp_path)
    assert ENCODER_FROZEN not in set(log.tables["/fault"]["code"]), result.reason
    assert log.tables["/robot_state"]["plan_time_s"][-1] > 2.5
    assert not result.verdict.fell


def test_an_encoder_hovers_by_whole_counts_about_a_standing_joint() -> None:
    """As a magnetic encoder of the motor does, seen behind the gear."""
    robot = load_robot("scaler")
    plant = Plant(build_model(robot, standing_plan()), standing_plan(), seed=1)
    control = HoldingController(plant)
    control.run(2.0)
    read, true = [], []
    for _ in range(1000):
        control.run(plant.dt_s)
        read.append(plant.joint_position_rad.copy())
        true.append(plant.data.qpos[plant.robot.joint_qpos].copy())
    count_rad = 2 * np.pi / robot.drive.encoder_counts / robot.motor.gear_ratio
    counts = np.array(read) / count_rad
    np.testing.assert_allclose(counts, np.round(counts), atol=1e-6)
    np.testing.assert_allclose(
        np.std(np.array(read) - true, axis=0), np.radians(0.068) / robot.motor.gear_ratio, rtol=0.2
    )
    assert (np.diff(counts, axis=0) == 0).mean() < 0.15
