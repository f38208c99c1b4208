"""Robots made up at random: those that `crux robot check` calls able climb the wall that it fits to them."""

from __future__ import annotations

from pathlib import Path

import crux_planner
import numpy as np
import pytest
from climbs import climb_here, saved
from crux_contracts.robot import load_robot
from crux_contracts.scenario import load_scenario
from crux_tools import cli
from random_robots import robot_folder

ABLE, MUST_CLIMB, MOST_DRAWN = 20, 18, 60  # robots


def test_limbs_are_not_alike_and_the_robot_is_taken(tmp_path: Path) -> None:
    """Some 5 s: so long it takes to find postures from which four limbs step."""
    robot = load_robot(robot_folder(1, tmp_path))
    assert not robot.closed_form
    lengths = [limb.longest_m for limb in robot.limbs]
    assert len(set(np.round(lengths, 3))) == len(lengths)


@pytest.mark.sweep
def test_those_that_are_called_able_climb(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    """Half an hour: the reach of each robot's limbs is mapped, and its wall is planned up to four times."""
    monkeypatch.setenv("CRUX_ROBOTS", str(tmp_path))
    climbed: dict[int, bool] = {}  # by seed, of those that are called able
    for seed in range(1, MOST_DRAWN + 1):
        robot, wall = robot_folder(seed, tmp_path), tmp_path / f"wall-{seed}.yaml"
        able = cli.main(["robot", "check", str(robot), "--wall", str(wall), "--json"]) == 0
        capsys.readouterr()
        if able:
            climbed[seed] = _climbs(robot, wall, tmp_path)
        if len(climbed) == ABLE:
            break
    assert len(climbed) == ABLE, climbed
    assert sum(climbed.values()) >= MUST_CLIMB, climbed


def _climbs(robot: Path, wall: Path, folder: Path) -> bool:
    try:
        result = crux_planner.plan(load_scenario(wall), load_robot(robot))
    except crux_planner.InfeasibleError:
        return False
    status, climb = climb_here(saved(folder, result.plan), folder / f"{wall.stem}.mcap")
    return bool(result.check.ok and status == 0 and climb["slips"] == 0)
