"""The plan of a climb of one step, short enough for a kernel with one processor and for emulated boards."""

from __future__ import annotations

import re
import subprocess
import tempfile
from functools import cache
from pathlib import Path

from crux_tools.paths import ROOT
from with_can import CRUX

SCENARIO = ROOT / "msgs" / "scenarios" / "climb-one-step.yaml"
HORIZON = "{steps: 13, dt_s: 0.6}"  # the quickest that the robot's speeds permit


@cache
def _planned() -> bytes:
    """The plan's file, by the real planner."""
    with tempfile.TemporaryDirectory() as name:
        plan, scenario = Path(name) / "plan.mcap", Path(name) / "short.yaml"
        text = SCENARIO.read_text(encoding="utf-8")
        scenario.write_text(re.sub(r"(?m)^horizon: .*$", f"horizon: {HORIZON}", text), encoding="utf-8")
        subprocess.run([*CRUX, "plan", str(scenario), "-o", str(plan)], check=True)
        return plan.read_bytes()


def plan_short_climb(folder: Path) -> Path:
    """Plans it, once a process."""
    plan = folder / "plan.mcap"
    plan.write_bytes(_planned())
    return plan
