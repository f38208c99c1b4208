"""A link's mesh is a picture: with a simple <collision> beside it every program reads the same robot."""

from __future__ import annotations

import shutil
import subprocess
from pathlib import Path

import numpy as np
import pytest
from crux_contracts.plan_file import read_plan
from crux_contracts.robot import ROBOTS, Robot, load_robot
from crux_planner.checker.limb_model import load_model
from crux_planner.model.shapes import limb_radii_m, palm_shape
from crux_tools.paths import built
from crux_tools.robot3d.robot_model import build_model

PICTURE = '<visual><geometry><mesh filename="package://scaler/missing.stl" scale="1 1 1"/></geometry></visual>'


@pytest.fixture
def with_meshes(tmp_path: Path) -> Robot:
    """scaler with every shape as <collision>, and a mesh of a file that is not there as its picture."""
    folder = tmp_path / "scaler"
    shutil.copytree(ROBOTS / "scaler", folder)
    urdf = folder / "scaler.urdf"
    text = urdf.read_text().replace("visual>", "collision>")
    urdf.write_text(text.replace("</collision>", f"</collision>{PICTURE}"))
    return load_robot(folder)


def test_planner_checker_and_simulation_see_the_same_shapes(with_meshes: Robot, plan_path: Path) -> None:
    plain = load_robot("scaler")
    assert limb_radii_m(with_meshes) == limb_radii_m(plain)
    assert palm_shape(with_meshes) == palm_shape(plain)
    for with_mesh, without in zip(load_model(with_meshes).limbs, load_model(plain).limbs, strict=True):
        for mine, theirs in zip(with_mesh.links, without.links, strict=True):
            assert [shape.radius_m for shape in mine.capsules] == [shape.radius_m for shape in theirs.capsules]
            assert len(mine.boxes) == len(theirs.boxes)
    plan = read_plan(plan_path)
    mine, theirs = (build_model(robot, plan).model for robot in (with_meshes, plain))
    for table in ("geom_size", "geom_type", "geom_contype", "geom_pos", "geom_bodyid", "body_mass"):
        np.testing.assert_array_equal(getattr(mine, table), getattr(theirs, table))


def test_the_runtime_reads_it(with_meshes: Robot) -> None:
    words = [str(built("runtime/app/crux-runtime")), "--insecure", "--robot", str(with_meshes.folder)]
    for limb in ("LF", "RF", "LR", "RR"):
        words += ["--bus", f"{limb}=nothing:0"]  # opened after the robot was read
    done = subprocess.run(words, capture_output=True, text=True, timeout=600, check=False)
    assert done.returncode == 2
    assert "nothing:0" in done.stderr
