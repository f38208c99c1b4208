"""Robots with limbs of four or seven joints: a first wall is fitted to them, planned and climbed."""

from __future__ import annotations

import json
from pathlib import Path
from subprocess import run
from typing import Any

import crux_planner
import mujoco
import numpy as np
import pytest
from climbs import climb_here, saved
from crux_contracts.robot import Robot, load_robot
from crux_contracts.scenario import load_scenario
from crux_planner.checker.inverse_kinematics import solve
from crux_planner.checker.limb_model import load_model
from crux_planner.method_report import first_walls
from crux_tools import cli
from crux_tools.paths import built
from crux_tools.robot3d.robot_model import build_model, slot_names
from crux_tools.robot3d.start_pose import take_start_pose
from crux_tools.telemetry import read_log
from crux_tools.telemetry.slots import for_robot, slots_of
from crux_tools.view.recording import blank
from hand_plan import standing_plan
from other_counts import with_joints


def planned(robot: Path, wall: Path, capsys: pytest.CaptureFixture[str]) -> Any:
    """The plan on the wall that `crux robot check` fits."""
    cli.main(["robot", "check", str(robot), "--wall", str(wall), "--json"])
    checks = {check["topic"]: check for check in json.loads(capsys.readouterr().out)["checks"]}
    assert checks["reach"]["verdict"] == checks["first wall"]["verdict"] == "good"
    scenario = load_scenario(wall)
    assert scenario.wall.slope_deg >= 30
    result = crux_planner.plan(scenario, robot)
    assert result.check.ok
    return result.plan


def checked_by_the_runtime(robot: Path) -> Any:
    words = [str(built("runtime/app/crux-runtime")), "--robot", str(robot), "--check"]
    return run(words, check=False, capture_output=True, text=True, timeout=60)


@pytest.mark.sweep
def test_four_joints_climb_holds_that_they_grip_squarely(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Some 60 s: the reach of its limbs is mapped, and the wall is planned twice."""
    robot, wall, log = with_joints(4, tmp_path), tmp_path / "wall.yaml", tmp_path / "climb.mcap"
    monkeypatch.setenv("CRUX_ROBOTS", str(tmp_path))
    plan = planned(robot, wall, capsys)
    status, said = climb_here(saved(tmp_path, plan), log)
    assert (status, said["ok"], said["slips"]) == (0, True, 0)
    told = read_log(log).outputs["joint_position_rad"].reshape(-1, 4, 6)
    assert (told[..., 4:] == 0.0).all()  # nobody is told to make a turn that no joint makes
    assert abs(told[..., 1:4]).max() > 0.5


@pytest.mark.sweep
def test_seven_joints_climb_four_holds(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Some 100 s: the reach of its limbs is mapped. The runtime has the checker's angles, of all that a gripper's pose
    leaves open."""
    monkeypatch.setenv("CRUX_ROBOTS", str(tmp_path))
    robot, log = load_robot(with_joints(7, tmp_path)), tmp_path / "climb.mcap"
    wall = next(first_walls(robot))
    result = crux_planner.plan(wall.document(45, 2.2), robot, time_limit_s=100.0)
    assert result.check.ok
    status, said = climb_here(saved(tmp_path, result.plan), log)
    assert (status, said["ok"], said["slips"]) == (0, True, 0)
    told = read_log(log)
    rows = np.arange(1500, len(told.time_s), 250)  # control has taken over
    commands = told.outputs["joint_position_rad"][rows].reshape(-1, 4, 7)
    assert np.ptp(commands[..., 2], axis=0).min() > 0.1  # the twist, which a gripper's pose leaves open
    apart = [np.abs(angles - commands[:, i]).max() for i, angles in enumerate(checked_angles(robot, commands))]
    assert max(apart) < 2e-3
    capsys.readouterr()
    assert cli.main(["replay", "--check", str(log), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["largest"] == 0.0


def checked_angles(robot: Robot, commands: np.ndarray) -> list[np.ndarray]:
    """(n, 7) of each limb: what the checker has where commands (n, 4, 7) place the gripper."""
    limbs = load_model(robot).limbs
    placed = [limb.forward(commands[:, i]) for i, limb in enumerate(limbs)]
    poses = [
        (state.link_position_m[limb.gripper], state.link_rotation[limb.gripper])
        for limb, state in zip(limbs, placed, strict=True)
    ]
    return [found.q_rad for found in solve(limbs, *zip(*poses, strict=True))]


@pytest.mark.parametrize("count", [4, 5, 7])
def test_the_runtime_takes_them(count: int, tmp_path: Path) -> None:
    done = checked_by_the_runtime(with_joints(count, tmp_path))
    assert (done.returncode, done.stderr) == (0, "")


def test_physics_has_idle_slots_for_fewer_joints_than_six(tmp_path: Path) -> None:
    idle = [name for name in slot_names(load_robot(with_joints(4, tmp_path / "4"))) if "slot" in name]
    assert idle[:2] == ["LF/slot5", "LF/slot6"]
    assert not any("slot" in name for name in slot_names(load_robot(with_joints(7, tmp_path / "7"))))


def test_physics_begins_with_the_angles_that_the_checker_has(tmp_path: Path) -> None:
    robot, plan = load_robot(with_joints(7, tmp_path)), standing_plan()
    model = build_model(robot, plan)
    data = mujoco.MjData(model.model)
    take_start_pose(model, data, plan)
    angles = data.qpos[model.joint_qpos].reshape(1, 4, 7)
    for i, found in enumerate(checked_angles(robot, angles)):
        np.testing.assert_allclose(found, angles[:, i], atol=1e-5)


def test_logs_have_the_slots_that_the_robot_needs() -> None:
    wide = blank("/control_input", 3, 7)
    assert wide["joint_position_rad"].shape == (3, 28)
    wide["joint_position_rad"] = np.arange(28)
    assert for_robot(wide, 7) is wide
    narrow = for_robot(wide, 6)
    assert narrow["joint_position_rad"][1].tolist() == [7 * limb + joint for limb in range(4) for joint in range(6)]
    assert narrow["ft_force_g_n"].shape == (3, 12)
    assert for_robot(narrow, 6) is narrow  # of a log of an earlier format
    assert slots_of({"robot.yaml": b"limb: {joints: [a, b, c, d, e, f, g]}"}) == 7
    assert [slots_of({"robot.yaml": text}) for text in (b"", b"limb: 7", b"limb: {joints: [a]}", b"{")] == [6] * 4
