"""`crux climb` for tests: as a process of its own or in this one, and what its log holds."""

from __future__ import annotations

import contextlib
import io
import json
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from crux_contracts.plan_file import write_plan
from crux_contracts.robot import Robot
from crux_msgs import plan_t
from crux_planner.pipeline.message import PlanResult
from crux_simulation.sim.climb import ClimbOptions, climb
from crux_tools.cli import main
from mcap.reader import make_reader

WALL_TIME = ("/cycle_timing", "/can_frames")
TIMEOUT_S = 600


def start_climb(plan: Path, log: Path, *options: str, before: Sequence[str] = ()) -> subprocess.Popen[str]:
    words = [*before, sys.executable, "-m", "crux_tools.cli", "climb", str(plan), "-o", str(log), "--json", *options]
    return subprocess.Popen(words, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)


def finish_climb(process: subprocess.Popen[str]) -> tuple[int, dict[str, Any]]:
    output, errors = process.communicate(timeout=TIMEOUT_S)
    assert "Traceback" not in errors
    return process.returncode, json.loads(output)


def climb_here(plan: Path, log: Path, *options: str) -> tuple[int, dict[str, Any]]:
    """Exit status and result of the same command in this process: a second less of imports."""
    told = io.StringIO()
    with contextlib.redirect_stdout(told):
        status = main(["climb", str(plan), "-o", str(log), "--json", *options])
    return status, json.loads(told.getvalue())


def climbs_and_replays(found: PlanResult, robot: Robot, log: Path) -> None:
    """The plan is right, takes the robot to its goal without a slip, and its log is computed again bit for bit."""
    assert found.check.violations == []
    result = climb(found.plan, robot, log, ClimbOptions())
    assert result.ok, result.reason
    assert result.verdict.slips == 0
    assert result.verdict.goal_error_m < 0.02
    assert main(["replay", str(log), "--check", "--no-view"]) == 0


def saved(folder: Path, plan: plan_t) -> Path:
    path = folder / "plan.mcap"
    write_plan(path, plan)
    return path


def messages(log: Path) -> dict[str, list[tuple[int, bytes]]]:
    """Everything in a log but what carries wall time; and the CAN frames."""
    found: dict[str, list[tuple[int, bytes]]] = {}
    with log.open("rb") as stream:
        for _, channel, message in make_reader(stream).iter_messages(log_time_order=False):
            if channel.topic not in WALL_TIME:
                found.setdefault(channel.topic, []).append((message.log_time, message.data))
    return found
