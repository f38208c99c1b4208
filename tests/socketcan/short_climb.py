"""A climb of one step, short enough for a kernel with one processor and for emulated boards."""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path

from crux_contracts.plan_file import to_bytes
from crux_contracts.robot import load_robot
from crux_contracts.scenario import Scenario, parse_scenario
from crux_tools.paths import ROOT
from shared_plans import unproven

SCENARIO = ROOT / "msgs" / "scenarios" / "climb-one-step.yaml"
HORIZON = "{steps: 13, dt_s: 0.6}"  # the quickest that the robot's speeds permit
SPARE = "  - {name: right-rear-high, position_m: [0.01, -0.36], size_m: [0.06, 0.06, 0.06], friction: 2.2}\n"


def scenario_text() -> str:
    """The scenario it is planned for."""
    return re.sub(r"(?m)^horizon: .*$", f"horizon: {HORIZON}", SCENARIO.read_text(encoding="utf-8"))


def with_a_spare_hold() -> Scenario:
    """The same climb, and a hold for RR beside its own; the goal asks for LF's alone."""
    before, goal = scenario_text().replace("steps: 13", "steps: 30").split("goal:\n")
    asked = re.sub(r"(?m)^    (RF|LR|RR): .*\n", "", goal)
    return parse_scenario(f"{before.replace('start:', f'{SPARE}start:')}goal:\n{asked}")


@cache
def _planned() -> bytes:
    """The plan's file, by the real planner."""
    scenario = parse_scenario(scenario_text())
    return to_bytes(unproven(scenario, load_robot(scenario.robot)).plan)


def plan_short_climb(folder: Path) -> Path:
    """Plans it, once a process."""
    plan = folder / "plan.mcap"
    plan.write_bytes(_planned())
    return plan
