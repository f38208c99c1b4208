"""`crux robot check --wall`: the wall fitted to a robot can be planned and climbed, and is as steep as motors bear."""

from __future__ import annotations

import itertools
import json
import re
import shutil
from dataclasses import replace
from pathlib import Path
from typing import Any

import crux_planner
import numpy as np
import pytest
from climbs import climb_here, saved
from crux_contracts.robot import ROBOTS, Robot, load_robot
from crux_contracts.scenario import load_scenario
from crux_planner.checker.limb_model import load_model
from crux_planner.method_report import first_walls
from crux_tools import cli
from crux_tools.paths import ROOT
from crux_tools.robot import first_wall

FRICTION = 1.0


def fitted(robot: str, wall: Path, capsys: pytest.CaptureFixture[str]) -> dict[str, Any]:
    """The finding of the command."""
    cli.main(["robot", "check", robot, "--wall", str(wall), "--json"])
    checks = json.loads(capsys.readouterr().out)["checks"]
    return next(check for check in checks if check["topic"] == "first wall")


def test_the_shipped_robot_climbs_a_vertical_one(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    wall = tmp_path / "wall.yaml"
    found = fitted("scaler", wall, capsys)
    assert found["verdict"] == "good"
    assert re.search(r"0\.\d\d of the peak torques to hang on three of its first holds; ", found["found"])
    said = r"joints turn up to (\d+) rad for a metre of a gripper .* as stiff as (\d+) N/mm and stay (0.\d+) rad"
    turning = re.search(said, found["found"])
    assert turning is not None, found
    assert [int(turning[1]), int(turning[2]), float(turning[3])] == [
        pytest.approx(9, abs=1),
        pytest.approx(10, abs=3),
        pytest.approx(0.5, abs=0.3),
    ]
    scenario = load_scenario(wall)
    assert scenario.wall.slope_deg == 90
    assert {grasp.hold for grasp in scenario.goal.grasps.values()} == {"LF-high", "RF-high", "LR-high", "RR-high"}
    assert crux_planner.plan(scenario, "scaler").check.ok


def weaker(folder: Path, share: float) -> str:
    """The shipped robot with this share of its torques."""
    shutil.copytree(ROBOTS / "scaler", folder / "scaler")
    path = folder / "scaler" / "scaler.urdf"
    path.write_text(re.sub(r'effort="(6|12)"', lambda found: f'effort="{share * float(found[1]):g}"', path.read_text()))
    return str(folder / "scaler")


@pytest.mark.parametrize(("share", "verdict"), [pytest.param(0.45, "doubtful", marks=pytest.mark.sweep), (0.2, "bad")])
def test_weak_motors_get_a_gentle_one_or_none(
    share: float, verdict: str, tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    wall, robot = tmp_path / "wall.yaml", weaker(tmp_path, share)
    found = fitted(robot, wall, capsys)
    assert found["verdict"] == verdict
    if verdict == "bad":
        assert "motors bear no slope" in found["found"]
        short = re.search(r"at best, on \d+ degrees, (\d\.\d\d) of that of \w+_joint\d$", found["remedy"])
        assert short is not None, found
        assert float(short[1]) > first_wall.MOST_SHARE
        assert not wall.exists()
        return
    assert 0 < load_scenario(wall).wall.slope_deg < 90
    assert "CRUX_ROBOTS" in found["remedy"]  # the name is another robot's
    monkeypatch.setenv("CRUX_ROBOTS", str(tmp_path))
    assert fitted(robot, wall, capsys)["verdict"] == "good"


def imported(folder: Path, capsys: pytest.CaptureFixture[str]) -> str:
    maker = ROOT / "examples" / "makers-scaler"
    words = ["robot", "import", str(maker / "scaler.urdf"), "--mapping", str(maker / "mapping.yaml")]
    words += ["-o", str(folder / "robots" / "makers")]
    assert cli.main(words) == 0
    capsys.readouterr()
    return str(folder / "robots" / "makers")


def test_a_wall_that_is_not_planned_is_none(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    tried: list[float] = []
    robot = load_robot("scaler")
    model, fitting = load_model(robot), list(first_walls(robot))
    monkeypatch.setattr(first_wall, "first_walls", lambda _robot: iter(fitting))

    def steep(document: dict[str, Any], _: Robot, **limits: float) -> None:
        assert limits == {"time_limit_s": first_wall.FIT_S}
        tried.append(document["wall"]["slope_deg"])
        if len(tried) < failures + 1:
            raise crux_planner.InfeasibleError("torque", "too steep", undecided=tried == [ended])

    monkeypatch.setattr(first_wall, "plan", steep)
    ended = 0
    for failures, slopes, verdict in ((1, [90, 75], "good"), (5, [90, 75, 60], "bad")):
        tried.clear()
        wall = tmp_path / f"{failures}.yaml"
        found = first_wall.fitted(robot, model, FRICTION, wall)
        assert (tried, found.verdict, wall.exists()) == (slopes, verdict, verdict == "good")
    assert "no plan for those that fit, as on 60 degrees: too steep" in found.found
    assert found.remedy == "other limits or stronger motors"
    tried.clear()
    ended, wall = 90, tmp_path / "ended.yaml"
    found = first_wall.fitted(robot, model, FRICTION, wall)
    assert found.remedy == f"{wall} is one that time ended: crux plan {wall} -o plan.mcap --time-limit 300 goes on"
    assert load_scenario(wall).wall.slope_deg == ended


def test_a_limb_near_a_singular_posture_is_told_of_and_nothing_is_planned(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    turning = np.array([9.0, 51.0, 12.0, 9.0])
    walls = [replace(wall, turns_rad_m=turning) for wall in itertools.islice(first_walls(load_robot("scaler")), 2)]
    monkeypatch.setattr(first_wall, "first_walls", lambda _robot: iter(walls))
    monkeypatch.setattr(first_wall, "plan", lambda *_: pytest.fail("planned"))
    robot = load_robot("scaler")
    found = first_wall.fitted(robot, load_model(robot), FRICTION, tmp_path / "wall.yaml")
    assert found.verdict == "bad"
    assert "none fits: joints turn up to 51 rad for a metre of a gripper (RF" in found.found
    assert "expected at most 40 rad" in found.found
    assert "RF is near a singular posture" in found.remedy
    assert not (tmp_path / "wall.yaml").exists()


@pytest.mark.sweep
def test_an_imported_robot_climbs_its_first_wall(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    robot, wall = imported(tmp_path, capsys), tmp_path / "wall.yaml"
    monkeypatch.setenv("CRUX_ROBOTS", str(tmp_path / "robots"))
    assert fitted(robot, wall, capsys)["verdict"] == "good"
    assert load_scenario(wall).wall.slope_deg >= 30
    result = crux_planner.plan(load_scenario(wall), robot)
    assert result.check.ok
    status, said = climb_here(saved(tmp_path, result.plan), tmp_path / "climb.mcap")
    assert (status, said["ok"], said["slips"]) == (0, True, 0)
