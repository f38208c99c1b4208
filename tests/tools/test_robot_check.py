"""`crux robot check`: of the shipped robot, of one that cannot climb, and of one that the planner does not take."""

from __future__ import annotations

import json
import re
import shutil
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from crux_contracts.robot import ROBOTS, load_robot
from crux_planner.checker.limb_model import load_model
from crux_tools import cli
from crux_tools.robot.described import described
from crux_tools.robot.loads import least_load
from crux_tools.robot.singular import singular_within
from crux_tools.robot.stance import Stance, limb_reach, stance


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    shutil.copytree(ROBOTS / "scaler", tmp_path / "robot")
    return tmp_path / "robot"


def spoil(folder: Path, right: str, wrong: str) -> None:
    path = folder / "scaler.urdf"
    assert right in path.read_text()
    path.write_text(path.read_text().replace(right, wrong))


def checked(folder: Path | str, capsys: pytest.CaptureFixture[str]) -> tuple[int, dict[str, Any], dict[str, Any]]:
    status = cli.main(["robot", "check", str(folder), "--json"])
    said = json.loads(capsys.readouterr().out)
    return status, said, {check["topic"]: check for check in said["checks"]}


def test_the_shipped_robot_is_good_but_for_its_heat(capsys: pytest.CaptureFixture[str]) -> None:
    status, said, by_topic = checked("scaler", capsys)
    assert (status, said["ok"], said["problems"]) == (0, True, [])
    assert [topic for topic, check in by_topic.items() if check["verdict"] != "good"] == ["continuous torques"]
    assert "9.60 kg" in by_topic["masses"]["found"]


def test_a_wrist_that_is_singular_within_the_reach_is_told() -> None:
    """It rolls, pitches and rolls; with its joint 5 at 0 the two that roll are in one line."""
    limb = load_model(load_robot("scaler")).limbs[0]
    axes = dict(zip((joint.name for joint in limb.joints[3:]), np.eye(3)[[0, 1, 0]], strict=True))
    limb = replace(limb, chain=tuple(replace(each, axis=axes.get(each.name, each.axis)) for each in limb.chain))
    limb = replace(limb, joints=tuple(each for each in limb.chain if each.kind == "revolute"))
    q_rad = np.tile([0.2, 0.5, 1.0, -0.4, 0.0, 0.3], (41, 1))
    q_rad[:, 4] = np.linspace(-0.4, 0.4, 41)
    said = "LF is singular at a LF_joint5 of 0 rad, where LF_joint4 and LF_joint6 turn fast"
    assert singular_within(limb, q_rad) == f"{said}: limits on one side of it keep plans off"
    one_side = np.tile([[-np.inf], [np.inf]], 6)
    one_side[0, 4] = 0.05
    assert singular_within(limb, q_rad[21:]) == singular_within(limb, q_rad, one_side) == ""


def test_weak_fingers_are_named_where_a_robot_slips(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    yaml = folder / "robot.yaml"
    yaml.write_text(yaml.read_text().replace("max_finger_force_N: 60", "max_finger_force_N: 9"))
    check = checked(folder, capsys)[2]["peak torques"]
    assert check["found"].startswith("share that hanging takes, with grippers in the middle of their reach")
    assert "0 degrees 0.12 (LF_joint2), on three limbs slips; 45 degrees slips, on three limbs slips" in check["found"]
    assert check["remedy"] == (
        "does not hold on four limbs at 45, 90, 135 degrees, on three limbs at 0, 45, 90, 135, 180 degrees; "
        "where it slips, fingers need more than 9 N (gripper.max_finger_force_N)"
    )


def test_a_robot_that_the_planner_does_not_take_is_checked_nevertheless(
    folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    spoil(folder, '<origin xyz="0.2 0 0" rpy="0 0 0"/>', '<origin xyz="0.2 0.01 0" rpy="0.1 0 0"/>')
    spoil(folder, 'effort="6"', 'effort="0.5"')
    spoil(folder, 'upper="0.066"', 'upper="0.065"')
    status, said, by_topic = checked(folder, capsys)
    assert status == 1
    assert len(said["problems"]) == 8  # every finger's travel
    assert all("_finger" in problem for problem in said["problems"])
    assert by_topic["reach"]["verdict"] == "good"
    assert "does not hold" in by_topic["peak torques"]["remedy"]


def test_limbs_that_reach_no_hold_are_told(folder: Path, capsys: pytest.CaptureFixture[str]) -> None:
    spoil(folder, '<limit lower="-2.2" upper="2.2"', '<limit lower="-0.2" upper="0.2"')
    status, _, by_topic = checked(folder, capsys)
    assert status == 1
    assert "LF, RF, LR, RR: no grip" in by_topic["reach"]["remedy"]
    assert "peak torques" not in by_topic


@cache
def standing() -> Stance:
    """How the shipped robot stands on holds in the middle of its limbs' reach; that takes two seconds to find."""
    robot = described(str(ROBOTS / "scaler"))
    assert robot.model is not None
    return stance(robot.model, [limb_reach(robot.model.body, limb, robot.sections) for limb in robot.model.limbs], 0.03)


def test_loads_grow_with_the_weight_and_with_a_limb_in_the_air(folder: Path) -> None:
    def loads(where: Stance) -> tuple[float, float, float]:
        peaks = [np.array([joint.effort for joint in limb.joints]) for limb in where.model.limbs]
        found = [least_load(where, *args) for args in ((0.0, peaks, 2.2, 1e3), (np.pi, peaks, 2.2, 1e3))]
        found.append(least_load(where, 0.0, peaks, 2.2, 1e3, 0))
        flat, overhead, lifted = (load.share if load is not None else np.inf for load in found)
        return flat, overhead, lifted

    flat, overhead, lifted = loads(standing())
    assert overhead == pytest.approx(flat, rel=1e-6)  # all forces turn around
    assert lifted > 1.2 * flat
    path = folder / "scaler.urdf"
    doubled = re.sub(r'<mass value="([^"]+)"', lambda mass: f'<mass value="{2 * float(mass[1])}"', path.read_text())
    path.write_text(doubled)
    heavy = described(str(folder)).model
    assert heavy is not None
    assert loads(replace(standing(), model=heavy)) == pytest.approx((2 * flat, 2 * overhead, 2 * lifted), rel=1e-6)


def test_holds_without_friction_hold_nothing() -> None:
    where = standing()
    peaks = [np.full(6, 1e3)] * 4
    assert least_load(where, np.pi / 2, peaks, 2.2, 60.0) is not None
    assert least_load(where, np.pi / 2, peaks, 0.05, 60.0) is None


@pytest.mark.parametrize(
    ("right", "wrong"),
    [
        ('mass value="2.8"', 'mass value="nan"'),
        ('xyz="0.15 0 0"', 'xyz="1e300 0 0"'),
        ('xyz="0.15 0 0"', 'xyz="0.15 0"'),
        ('<axis xyz="0 -1 0"/>', '<axis xyz="0 0 0"/>'),
        ('<box size="0.30 0.22 0.06"/>', '<box size="0.3 0.2"/>'),
        ('<parent link="base"/>', '<parent link="LF_gripper"/>'),
        ('<joint name="LF_joint2"', '<joint name="LF_hip"'),
    ],
)
def test_what_cannot_be_reckoned_with_is_told(
    right: str, wrong: str, folder: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    spoil(folder, right, wrong)
    status, said, by_topic = checked(folder, capsys)
    assert status == 1
    assert said["problems"]
    assert list(by_topic) == ["description", "kinematics"]
