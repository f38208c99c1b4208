"""What several of the planner's tests share."""

from __future__ import annotations

import re
import shutil
from collections.abc import Callable
from pathlib import Path

import pytest
from crux_contracts.robot import ROBOTS, Robot, load_robot

WeakRobot = Callable[[Callable[[str, float], float]], Robot]
"""Gives the robot whose joints give as much [N m] as a function of their names and their torque says."""


@pytest.fixture(scope="session")
def robot() -> Robot:
    """The simulated robot."""
    return load_robot("scaler")


@pytest.fixture
def weak_robot(tmp_path: Path) -> WeakRobot:
    """Robots with other motors, in folders of their own."""

    def made(effort_Nm: Callable[[str, float], float]) -> Robot:
        folder = tmp_path / f"robot-{len(list(tmp_path.iterdir()))}"
        shutil.copytree(ROBOTS / "scaler", folder)
        (urdf,) = folder.glob("*.urdf")
        joint = re.compile(r'(<joint name="(\w+)" type="revolute">.*?effort=")([\d.]+)(")', re.DOTALL)
        text = joint.sub(lambda m: f"{m[1]}{effort_Nm(m[2], float(m[3])):.9g}{m[4]}", urdf.read_text())
        urdf.write_text(text)
        return load_robot(folder)

    return made
