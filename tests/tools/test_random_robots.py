"""Robots made up at random: those that `crux robot check` calls able climb the wall that it fits to them."""

from __future__ import annotations

import json
from pathlib import Path

import crux_planner
import numpy as np
import pytest
from climbs import climb_here, saved
from crux_contracts.robot import load_robot
from crux_contracts.scenario import load_scenario
from crux_tools import cli
from random_robots import robot_folder


def test_limbs_are_not_alike_and_the_robot_is_taken(tmp_path: Path) -> None:
    """Some 5 s: so long it takes to find postures from which four limbs step."""
    robot = load_robot(robot_folder(1, tmp_path))
    assert not robot.closed_form
    lengths = [limb.longest_m for limb in robot.limbs]
    assert len(set(np.round(lengths, 3))) == len(lengths)


@pytest.mark.sweep
@pytest.mark.parametrize("seed", range(1, 21))
def test_those_that_are_called_able_climb(
    seed: int, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Some minutes: the limbs' reach is mapped, and the wall is planned up to four times."""
    robot, wall = robot_folder(seed, tmp_path), tmp_path / "wall.yaml"
    monkeypatch.setenv("CRUX_ROBOTS", str(tmp_path))
    status = cli.main(["robot", "check", str(robot), "--wall", str(wall), "--json"])
    said = json.loads(capsys.readouterr().out)
    if status:
        pytest.skip(str([check["remedy"] for check in said["checks"] if check["verdict"] == "bad"]))
    result = crux_planner.plan(load_scenario(wall), robot)
    assert result.check.ok
    status, climbed = climb_here(saved(tmp_path, result.plan), tmp_path / "climb.mcap")
    assert (status, climbed["ok"], climbed["slips"]) == (0, True, 0)
