"""`crux robot show`: the command, the surface of a region, and robots of any number of joints."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
from crux_contracts.robot import ROBOTS
from crux_tools import cli
from crux_tools.robot.described import described
from crux_tools.view.robot.figure import Figure
from crux_tools.view.robot.surface import surface
from other_counts import with_joints
from PIL import Image


def test_the_surface_of_a_ball_encloses_it() -> None:
    """Its volume by the divergence theorem, so that triangles are turned outwards and leave no gap."""
    step, radius = 0.03, 0.2
    axis = np.arange(-9, 10) * step
    x, y, z = np.meshgrid(axis, axis, axis, indexing="ij")
    corners, triangles = surface(x**2 + y**2 + z**2 < radius**2, np.full(3, axis[0]), step)
    a, b, c = (corners[triangles[:, i]] for i in range(3))
    assert (a * np.cross(b, c)).sum() / 6 == pytest.approx(4 / 3 * np.pi * radius**3, rel=0.06)
    assert np.linalg.norm(corners, axis=1) == pytest.approx(radius, abs=0.6 * step)
    assert np.cross(b - a, c - a).sum(axis=0) == pytest.approx(np.zeros(3), abs=1e-9)


@pytest.mark.parametrize("joints", [4, 7])
def test_limbs_of_any_number_of_joints_are_shown(joints: int, tmp_path: Path) -> None:
    figure = Figure(described(str(with_joints(joints, tmp_path))), 2.2)
    told = figure.told()
    assert [len(limb["joints"]) for limb in told["limbs"]] == [joints] * 4
    start = [[joint["start"] for joint in limb["joints"]] for limb in told["limbs"]]
    found = figure.at(start, 0.03, 60.0, None)
    assert found["meets"] == []
    assert 0 < found["loads"]["share"] < 1
    for gripper in found["grippers"]:
        assert gripper["tiltDeg"] == pytest.approx(0.0, abs=0.1)
    corners = np.array(figure.reach(0)["corners"]).reshape(-1, 3)
    place = np.array(found["grippers"][0]["positionM"])
    assert (corners.min(axis=0) < place).all()
    assert (place < corners.max(axis=0)).all()


def test_what_is_no_posture_is_refused() -> None:
    figure = Figure(described("scaler"), 2.2)
    start = [[0.0] * 6] * 4
    for q, slope, lifted in ((start[1:], 0.0, None), (start, np.nan, None), (start, 0.0, 4), ([["x"] * 6] * 4, 0, 0)):
        with pytest.raises(ValueError, match=r"expected|could not convert"):
            figure.at(q, 0.03, slope, lifted)  # type: ignore[arg-type]


def test_a_robot_that_the_planner_does_not_take_is_shown_without_its_map(tmp_path: Path) -> None:
    shutil.copytree(ROBOTS / "scaler", tmp_path / "robot")
    path = tmp_path / "robot" / "scaler.urdf"
    path.write_text(path.read_text().replace('upper="0.066"', 'upper="0.065"'))
    figure = Figure(described(str(tmp_path / "robot")), 2.2)
    told = figure.told()
    assert told["planned"] is False
    with pytest.raises(ValueError, match="planner"):
        figure.reach(0)


def test_a_robot_without_chains_is_refused_in_words(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    shutil.copytree(ROBOTS / "scaler", tmp_path / "robot")
    path = tmp_path / "robot" / "scaler.urdf"
    path.write_text(path.read_text().replace('<joint name="LF_joint2"', '<joint name="LF_hip"'))
    assert cli.main(["robot", "show", str(tmp_path / "robot"), "-o", str(tmp_path / "a.png")]) == 2
    said = capsys.readouterr().err
    assert "LF_hip" in said
    assert "crux robot check" in said
    with pytest.raises(SystemExit):
        cli.main(["robot", "show", "scaler", "--slope", "181"])
    assert "0 to 180 degrees" in capsys.readouterr().err
    assert cli.main(["robot", "show", "no-such-robot"]) == 2
    assert "no-such-robot" in capsys.readouterr().err


def test_a_picture_is_written(tmp_path: Path) -> None:
    path = tmp_path / "out" / "robot.png"
    assert cli.main(["robot", "show", "scaler", "--slope", "90", "-o", str(path)]) == 0
    with Image.open(path) as picture:
        colours = picture.convert("RGB").getcolors(1 << 24)
    assert colours is not None
    assert len(colours) > 1000
