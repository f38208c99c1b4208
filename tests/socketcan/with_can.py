"""Runs commands under a kernel with SocketCAN, as a user would: `crux can run`."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

CRUX = (sys.executable, "-m", "crux_tools.cli")
BUSES = "can0,can1,can2,can3"


def can_run(
    *words: str, cwd: Path | None = None, env: dict[str, str] | None = None
) -> subprocess.CompletedProcess[bytes]:
    """`crux can run WORDS`."""
    return subprocess.run([*CRUX, "can", "run", *words], capture_output=True, check=False, cwd=cwd, env=env)
