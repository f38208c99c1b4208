"""The plan of a climb of one step, short enough for a kernel with one processor."""

from __future__ import annotations

import subprocess
from pathlib import Path

from crux_tools.paths import ROOT
from with_can import CRUX


def plan_short_climb(folder: Path) -> Path:
    """Plans it with the real planner."""
    plan = folder / "plan.mcap"
    scenario = ROOT / "msgs" / "scenarios" / "climb-one-step.yaml"
    subprocess.run([*CRUX, "plan", str(scenario), "-o", str(plan)], check=True)
    return plan
