"""A log is drawn with the robot description it carries, and says so where the one on this machine is another."""

from __future__ import annotations

import json
import shutil
from pathlib import Path
from typing import Any

import pytest
from crux_contracts.plan_file import write_plan
from crux_contracts.robot import ROBOTS, Robot, load_robot
from crux_tools import cli
from crux_tools.robot3d.robot_model import RobotModel, build_model
from crux_tools.telemetry import read_log
from crux_tools.telemetry.description import robot_of
from crux_tools.view.recording import recording_of
from crux_tools.view.server import Viewer, still
from made_up_climb import made_up_plan, write_log

ELBOW = '<origin xyz="0.15 0 0"'  # of each limb
LENGTH_M = 0.15
CHANGED = "the description of scaler has changed since"


@pytest.fixture
def robots(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The robots of this machine, for a test to change."""
    shutil.copytree(ROBOTS, tmp_path / "robots")
    monkeypatch.setattr("crux_contracts.robot.ROBOTS", tmp_path / "robots")
    return tmp_path / "robots"


def change(robots: Path, file: str, right: str, other: str) -> None:
    path = robots / "scaler" / file
    text = path.read_text()
    assert right in text
    path.write_text(text.replace(right, other, 1))


def lengthen(robots: Path) -> None:
    for _ in range(4):
        change(robots, "scaler.urdf", ELBOW, ELBOW.replace("0.15", "0.25"))


def report(source: Path, page: Path) -> str:
    assert cli.main(["report", str(source), "-o", str(page)]) == 0
    return page.read_text(encoding="utf-8")


@pytest.mark.usefixtures("undrawn", "small_pictures")
def test_a_changed_length_is_said_and_the_logs_own_drawn(
    log_path: Path, robots: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = report(log_path, tmp_path / "before.html")
    assert CHANGED not in before
    lengthen(robots)
    after = report(log_path, tmp_path / "after.html")
    assert CHANGED in after
    assert [line for line in after.splitlines() if "data:image/jpeg" in line] == [
        line for line in before.splitlines() if "data:image/jpeg" in line
    ]
    capsys.readouterr()
    assert cli.main(["replay", str(log_path), "--no-view", "--json"]) == 0
    printed, errors = capsys.readouterr()
    assert errors.count(CHANGED) == 1
    assert any(CHANGED in remark for remark in json.loads(printed)["notes"])


def test_the_view_is_of_the_logs_own_robot(log_path: Path, robots: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    lengthen(robots)
    lengths = []

    def build(robot: Robot, plan: Any) -> RobotModel:
        lengths.append(robot.limbs[0].upper_link_m)
        return build_model(robot, plan)

    monkeypatch.setattr("crux_tools.view.scene.build_model", build)
    recording = recording_of(log_path)
    assert recording is not None
    Viewer([still(recording)], "127.0.0.1", 0).close()
    assert lengths == [LENGTH_M]


def test_a_comment_or_another_layout_is_no_change(log_path: Path, robots: Path) -> None:
    change(robots, "robot.yaml", "can:\n  rate_Hz: 500\n", "can: # of the nodes\n\n  rate_Hz: 500.0\n")
    change(robots, "scaler.urdf", "<robot", "<!-- the same -->\n<robot")
    assert read_log(log_path).notes == []
    plan = made_up_plan()
    assert plan.robot_sha256 == load_robot("scaler").hash


def test_a_robot_this_machine_does_not_know_is_known_from_the_log(log_path: Path, robots: Path) -> None:
    log = read_log(log_path)
    shutil.move(robots / "scaler", robots / "other")
    with robot_of("scaler", log.robot_files) as robot:
        assert robot.hash == log.metadata["robot_sha256"]
    assert read_log(log_path).notes == []


def test_a_description_of_another_form_gives_way_to_the_one_here(log_path: Path, robots: Path) -> None:
    log = read_log(log_path)
    files = log.robot_files | {"robot.yaml": b"version: 2\n"}
    with robot_of("scaler", files) as robot:
        assert robot.folder == robots / "scaler"


@pytest.mark.usefixtures("undrawn", "no_graphics")
def test_a_plan_for_another_description_says_so(robots: Path, tmp_path: Path) -> None:
    path = tmp_path / "plan.mcap"
    write_plan(path, made_up_plan())
    assert "another description" not in report(path, tmp_path / "plan.html")
    lengthen(robots)
    assert "made with another description of scaler" in report(path, tmp_path / "plan.html")


def test_an_older_log_without_a_description_says_so(robots: Path, tmp_path: Path) -> None:
    path = tmp_path / "old.mcap"
    write_log(path, attached=False)
    assert read_log(path).notes == []
    lengthen(robots)
    assert any("made with another description of scaler" in remark for remark in read_log(path).notes)


def test_an_older_log_on_a_machine_without_its_robot_is_refused(
    robots: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "old.mcap"
    write_log(path, attached=False)
    shutil.rmtree(robots / "scaler")
    assert cli.main(["report", str(path), "-o", str(tmp_path / "page.html")]) == 2
    error = capsys.readouterr().err
    assert "scaler" in error
    assert error.count("\n") == 1


@pytest.mark.usefixtures("undrawn", "small_pictures")
def test_a_log_opens_whole_where_its_robot_is_not_known(log_path: Path, robots: Path, tmp_path: Path) -> None:
    before = report(log_path, tmp_path / "before.html")
    shutil.rmtree(robots / "scaler")
    assert report(log_path, tmp_path / "after.html") == before
    recording = recording_of(log_path)
    assert recording is not None
    viewer = Viewer([still(recording)], "127.0.0.1", 0)
    try:
        (shown,) = viewer.at(1.0)
        assert shown["time_s"] == pytest.approx(1.0)
    finally:
        viewer.close()
