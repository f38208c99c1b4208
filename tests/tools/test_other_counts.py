"""Robots with limbs of four or seven joints: a first wall is fitted to them, planned, and climbed by the former."""

from __future__ import annotations

import json
from pathlib import Path
from subprocess import run
from typing import Any

import crux_planner
import pytest
from climbs import climb_here, saved
from crux_contracts.robot import load_robot
from crux_contracts.scenario import load_scenario
from crux_planner.method_report import first_walls
from crux_tools import cli
from crux_tools.errors import UsageError
from crux_tools.paths import built
from crux_tools.robot3d.robot_model import build_model, slot_names
from crux_tools.telemetry import read_log
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
def test_seven_joints_are_planned_for(tmp_path: Path) -> None:
    """Some 60 s: the reach of its limbs is mapped."""
    robot = load_robot(with_joints(7, tmp_path))
    wall = next(first_walls(robot))
    result = crux_planner.plan(wall.document(45, 2.2), robot, time_limit_s=100.0)
    assert result.check.ok
    assert len(result.plan.knots) > 10


@pytest.mark.parametrize(("count", "words"), [(4, ""), (5, ""), (7, "limb.joints: a list of 7: expected at most 6")])
def test_the_runtime_takes_those_that_it_drives(count: int, words: str, tmp_path: Path) -> None:
    done = checked_by_the_runtime(with_joints(count, tmp_path))
    assert (done.returncode == 0) == (not words)
    assert words in done.stderr


def test_physics_refuses_seven_joints_and_has_idle_slots_for_fewer(tmp_path: Path) -> None:
    with pytest.raises(UsageError, match="limbs of 7 joints are planned for and checked, not driven"):
        build_model(load_robot(with_joints(7, tmp_path / "7")), None)
    assert [name for name in slot_names(load_robot(with_joints(4, tmp_path / "4"))) if "slot" in name][:2] == [
        "LF/slot5",
        "LF/slot6",
    ]
