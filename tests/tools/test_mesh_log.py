"""A log carries its robot's meshes: it is drawn by them where nobody has the robot's folder."""

from __future__ import annotations

import shutil
from pathlib import Path
from typing import Any

import pytest
import trimesh
from crux_contracts.robot import ROBOTS, load_robot
from crux_simulation.sim.climb import ClimbOptions, climb
from crux_simulation.sim.world_file import parse_world
from crux_tools import cli
from crux_tools.telemetry import read_log
from crux_tools.telemetry.description import inside, robot_of
from crux_tools.view.recording import recording_of
from crux_tools.view.scene import Scene
from hand_plan import standing_plan

MESHES = {"LF_link2": "package://scaler/meshes/link.stl", "LF_link3": "../scaler/meshes/other.stl"}
LOST = "package://scaler/meshes/lost.stl"
PICTURE = '<visual><geometry><mesh filename="{}" scale="0.001 0.001 0.001"/></geometry></visual>'
WORLD = "version: 1\nname: greasy\nholds: {h3: {friction_factor: 0.5}}\n"


@pytest.fixture
def with_meshes(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Path:
    """The folder of the robots of this machine; scaler has two meshes, one that is not there, and three that are
    not in its folder.
    """
    robots = tmp_path / "robots"
    shutil.copytree(ROBOTS, robots)
    monkeypatch.setattr("crux_contracts.robot.ROBOTS", robots)
    (robots / "scaler" / "meshes").mkdir()
    for size, name in enumerate(MESHES.values()):
        trimesh.creation.box([10 * (size + 1)] * 3).export(robots / "scaler" / "meshes" / Path(name).name)
    urdf = robots / "scaler" / "scaler.urdf"
    text = urdf.read_text().replace("visual>", "collision>")
    secret = tmp_path / "secret.stl"  # of this machine, not of the robot
    trimesh.creation.box([5] * 3).export(secret)
    (robots / "scaler" / "meshes" / "way-out.stl").symlink_to(secret)
    out = {"LR_link2": f"file://{secret}", "RR_link2": "meshes/way-out.stl", "LR_link3": "../../secret.stl"}
    for link, name in {**MESHES, **out, "RF_link2": LOST}.items():
        assert f'<link name="{link}">' in text
        text = text.replace(f'<link name="{link}">', f'<link name="{link}">{PICTURE.format(name)}')
    urdf.write_text(text)
    return robots


def drawn(log: Path) -> list[dict[str, Any]]:
    recording = recording_of(log)
    assert recording is not None
    return [shape for shape in Scene(recording).description["shapes"] if shape["kind"] == "mesh"]


@pytest.mark.usefixtures("undrawn", "small_pictures")
def test_a_log_is_drawn_by_its_meshes_where_the_robots_folder_is_not(with_meshes: Path, tmp_path: Path) -> None:
    log, part, page, plan = tmp_path / "log.mcap", tmp_path / "part.mcap", tmp_path / "page.html", standing_plan()
    world = parse_world(WORLD.encode()).draw(0, plan)
    climb(plan, load_robot("scaler"), log, ClimbOptions(world=world))
    before = drawn(log)
    assert len(before) == len(MESHES)
    shutil.rmtree(with_meshes / "scaler")
    assert drawn(log) == before
    assert cli.main(["log", "cut", str(log), "-o", str(part), "--from", "0", "--to", "2.5"]) == 0
    assert drawn(part) == before
    assert cli.main(["report", str(log), "-o", str(page)]) == 0
    assert "friction_factor: 0.5" in page.read_text(encoding="utf-8")  # and the world
    assert cli.main(["replay", str(log), "--check"]) == 0
    attached = read_log(log).robot_files
    assert sorted(attached) == ["meshes/link.stl", "robot.yaml", "scaler.urdf", "scaler/meshes/other.stl"]


def test_no_name_in_a_log_leads_out_of_a_folder() -> None:
    assert inside("/../a/./b//../c.stl") == "a/b/c.stl"
    with robot_of("scaler", {"../../outside": b"x", "a\0b": b"", "a": b"", "a/b": b""}) as robot:
        assert robot.name == "scaler"
    assert not list(robot.folder.parent.parent.glob("outside"))
