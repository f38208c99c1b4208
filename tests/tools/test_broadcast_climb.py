"""A climb at 1 kHz in which one frame a bus commands all nodes. Needs the build."""

from __future__ import annotations

import shutil
from pathlib import Path

from crux_contracts.robot import load_robot
from crux_contracts.scenario import parse_scenario
from crux_simulation.sim.climb import ClimbOptions, climb
from crux_tools.paths import ROOT
from shared_plans import unproven
from short_climb import scenario_text

RATE_HZ = 1000


def test_climbs_one_step_at_a_kilohertz(tmp_path: Path) -> None:
    folder = tmp_path / "scaler"
    shutil.copytree(ROOT / "msgs/robots/scaler", folder)
    description = folder / "robot.yaml"
    text = description.read_text(encoding="utf-8")
    description.write_text(text.replace("rate_Hz: 500", f"rate_Hz: {RATE_HZ}"), encoding="utf-8")
    robot = load_robot(folder)
    assert robot.can.rate_Hz == RATE_HZ
    found = unproven(parse_scenario(scenario_text()), robot)
    result = climb(found.plan, robot, tmp_path / "log.mcap", ClimbOptions(commands="broadcast"))
    assert result.ok, result.reason
    assert result.missed_cycles == 0
    assert result.verdict.slips == 0
    assert result.verdict.goal_error_m < 0.01
    assert result.outcome.cycles > RATE_HZ * found.plan.knots[-1].time_s, "slower than planned, never faster"
