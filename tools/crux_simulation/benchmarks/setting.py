"""What the figures of the paper's methods were measured with: machine, solvers, limits."""

from __future__ import annotations

import os
import platform
from importlib.metadata import version
from pathlib import Path
from textwrap import wrap
from typing import Any

from crux_planner.method_report import limits
from crux_tools.output import note

SOLVERS = {"MIP": ("HiGHS", "highspy"), "NLP": ("ipopt of casadi", "casadi"), "QP": ("PIQP", "piqp")}
_WIDTH = 120


def setting() -> dict[str, Any]:
    """For a bench's JSON object."""
    return {
        "machine": {"cpu": _cpu(), "cores": len(os.sched_getaffinity(0)), "load": round(os.getloadavg()[0], 1)},
        "solvers": {kind: f"{name} {version(package)}" for kind, (name, package) in SOLVERS.items()},
        "limits": limits(),
    }


def setting_text(said: dict[str, Any]) -> str:
    """The same in lines that fit a picture."""
    machine = said["machine"]
    lines = [f"machine: {machine['cpu']}, {machine['cores']} cores, load {machine['load']} when it began"]
    lines.append("solvers: " + ", ".join(said["solvers"].values()))
    lines.append("limits: " + ", ".join(f"{name} {value:g}" for name, value in said["limits"].items()))
    return "\n".join(part for line in lines for part in wrap(line, _WIDTH))


def print_setting(said: dict[str, Any]) -> None:
    """For people."""
    for line in setting_text(said).splitlines():
        note(line)


def _cpu() -> str:
    try:
        told = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
    except OSError:
        told = []
    names = [line.partition(":")[2].strip() for line in told if line.startswith("model name")]
    return names[0] if names else platform.machine()
