"""Commands of crux in processes of their own, cold, as a user runs them."""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from crux_contracts.output_file import look_at_folder
from crux_contracts.plan_file import read_plan
from crux_tools.errors import WorkFailed
from crux_tools.paths import SCENARIOS

BUSES = "can0,can1,can2,can3"
TIMEOUT_S = "900"
GUEST = ("can", "run", "--virtual-time", "-i", BUSES, "--timeout", TIMEOUT_S, "--")
"""Words of crux before a command that is to run in a kernel with SocketCAN and virtual time."""
CRUX = (sys.executable, "-m", "crux_tools.cli")
_POLL_S = 0.02
HANGING = 10.0  # times its limit of computing: a process that takes so long by the wall clock is ended


def crux_json(*words: str) -> tuple[dict[str, Any], float]:
    """The object that `crux WORDS --json` prints, and its wall time [s].

    A run without an object comes back as {"ok": False, "error": why}.
    """
    began = time.monotonic()
    command = [*CRUX, *words, "--json"]
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    seconds = time.monotonic() - began
    return _object(words[0], done.stdout, done.stderr, done.returncode), seconds


def planned_scene(scene: str, folder: Path) -> tuple[Any, float]:
    """The plan of a scene that ships, planned into `folder`, and how long that took [s]. Raises WorkFailed."""
    look_at_folder("--output", folder)
    path = folder / "plan.mcap"
    planned, _ = crux_json("plan", str(SCENARIOS / f"{scene}.yaml"), "-o", str(path))
    if not planned.get("ok"):
        raise WorkFailed(f"{scene}: {planned.get('error')}")
    return read_plan(path), planned["seconds"]


@dataclass(frozen=True)
class Measured:
    """What a process printed, its wall time, and of it and its own processes the CPU time and the largest memory."""

    result: dict[str, Any]
    seconds: float
    cpu_s: float
    peak_MB: float


def measured(module: str, *words: str, limit_s: float) -> Measured:
    """`python -m MODULE WORDS --json`, ended with all it has started after `limit_s`."""
    began = time.monotonic()
    with tempfile.TemporaryFile("w+") as out, tempfile.TemporaryFile("w+") as err:
        command = [sys.executable, "-m", module, *words, "--json"]
        process = subprocess.Popen(command, stdout=out, stderr=err, start_new_session=True)
        ended = 0
        while ended == 0:
            ended, status, usage = os.wait4(process.pid, os.WNOHANG)
            if ended == 0 and time.monotonic() - began > limit_s:
                os.killpg(process.pid, signal.SIGKILL)
                ended, status, usage = os.wait4(process.pid, 0)
            elif ended == 0:
                time.sleep(_POLL_S)
        seconds = time.monotonic() - began
        process.returncode = code = os.waitstatus_to_exitcode(status)
        out.seek(0)
        err.seek(0)
        result = _object(words[0], out.read(), err.read(), code)
    if code == -signal.SIGKILL:
        result = {"ok": False, "error": f"ended after {limit_s:g} s"}
    return Measured(result, seconds, usage.ru_utime + usage.ru_stime, usage.ru_maxrss / 1024)


def _object(name: str, stdout: str, stderr: str, status: int) -> dict[str, Any]:
    lines = stdout.strip().splitlines()
    try:
        result = json.loads(lines[-1])
    except (IndexError, ValueError):
        result = {"ok": False, "error": f"{name} ended with status {status}: {stderr.strip()[-300:]}"}
    return result if isinstance(result, dict) else {"ok": False, "error": f"{name} printed no object"}
