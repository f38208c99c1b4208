"""Robots whose limbs have no closed-form kinematics: they are planned for, pass the check, and climb in physics."""

from __future__ import annotations

from pathlib import Path

import pytest
from crux_contracts.robot import load_robot
from crux_contracts.scenario import parse_scenario
from crux_simulation.sim.climb import ClimbOptions, climb
from crux_tools.paths import ROOT
from other_limbs import CHANGES, other_limbs
from shared_plans import unproven
from short_climb import scenario_text


def climbs(change: str, scenario: str, folder: Path) -> None:
    """Fails where the robot with this change does not climb."""
    robot = load_robot(other_limbs(change, folder))
    assert not robot.closed_form
    found = unproven(parse_scenario(scenario), robot)
    assert found.check.ok
    assert found.gait
    result = climb(found.plan, robot, folder / "log.mcap", ClimbOptions())
    assert result.ok, result.reason
    assert result.verdict.slips == 0
    assert result.verdict.goal_error_m < 0.02


def test_a_robot_with_offsets_and_unlike_limits_climbs_one_step(tmp_path: Path) -> None:
    climbs("all of them", scenario_text(), tmp_path)


@pytest.mark.sweep
@pytest.mark.parametrize("scene", ["climb-one-step", "climb-four-holds"])
@pytest.mark.parametrize("change", CHANGES)
def test_robots_with_other_limbs_climb(change: str, scene: str, tmp_path: Path) -> None:
    text = (ROOT / "msgs/scenarios" / f"{scene}.yaml").read_text(encoding="utf-8")
    climbs(change, text, tmp_path)
