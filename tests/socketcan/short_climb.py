"""A climb of one step, short enough for a kernel with one processor: the four-hold wall, LF alone goes one hold up."""

from __future__ import annotations

import subprocess
from pathlib import Path

import yaml
from crux_tools.paths import ROOT
from with_can import CRUX

SCENARIO = ROOT / "msgs" / "scenarios" / "climb-four-holds.yaml"
STEPS, STEP_S = 14, 1.0
GOAL_M = [0.02, 0.0, 0.185]


def plan_short_climb(folder: Path) -> Path:
    """Plans it with the real planner."""
    scenario = yaml.safe_load(SCENARIO.read_text())
    scenario["name"] = "one-step"
    kept = {limb: dict(grasp) for limb, grasp in scenario["start"]["grasps"].items() if limb != "LF"}
    scenario["goal"]["grasps"].update(kept)
    scenario["goal"]["body"]["position_m"] = GOAL_M
    scenario["horizon"] = {"steps": STEPS, "dt_s": STEP_S}
    path = folder / "one-step.yaml"
    path.write_text(yaml.safe_dump(scenario))
    plan = folder / "plan.mcap"
    subprocess.run([*CRUX, "plan", str(path), "-o", str(plan)], check=True)
    return plan
