"""Runs commands under a kernel with SocketCAN, as a user would: `crux can run`."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

CRUX = (sys.executable, "-m", "crux_tools.cli")
BUSES = "can0,can1,can2,can3"


def can_run(
    *words: str, cwd: Path | None = None, env: dict[str, str] | None = None
) -> subprocess.CompletedProcess[bytes]:
    """`crux can run WORDS`."""
    return subprocess.run([*CRUX, "can", "run", *words], capture_output=True, check=False, cwd=cwd, env=env)


REALTIME = ("--bus", "socketcan", "--pace", "realtime")


def climb_in_guest(folder: Path, *climbs: tuple[str, Sequence[str | Path], Sequence[str]]) -> None:
    """`crux climb` in one guest, by guest_climbs.py: names, words, and buses whose frames are recorded."""
    (folder / "climbs.json").write_text(
        json.dumps([(name, list(map(str, words)), dump) for name, words, dump in climbs])
    )
    script, path = Path(__file__).with_name("guest_climbs.py"), os.pathsep.join(filter(None, sys.path))
    words = ["--virtual-time", "-i", BUSES, "--", sys.executable, str(script), str(folder)]
    done = can_run(*words, env={**os.environ, "PYTHONPATH": path})
    assert done.returncode == 0, done.stderr.decode()
