"""The plan of a climb of one step, short enough for a kernel with one processor and for emulated boards."""

from __future__ import annotations

import re
from functools import cache
from pathlib import Path

from crux_contracts.plan_file import to_bytes
from crux_contracts.robot import load_robot
from crux_contracts.scenario import parse_scenario
from crux_tools.paths import ROOT
from shared_plans import unproven

SCENARIO = ROOT / "msgs" / "scenarios" / "climb-one-step.yaml"
HORIZON = "{steps: 13, dt_s: 0.6}"  # the quickest that the robot's speeds permit


@cache
def _planned() -> bytes:
    """The plan's file, by the real planner."""
    text = re.sub(r"(?m)^horizon: .*$", f"horizon: {HORIZON}", SCENARIO.read_text(encoding="utf-8"))
    scenario = parse_scenario(text)
    return to_bytes(unproven(scenario, load_robot(scenario.robot)).plan)


def plan_short_climb(folder: Path) -> Path:
    """Plans it, once a process."""
    plan = folder / "plan.mcap"
    plan.write_bytes(_planned())
    return plan
