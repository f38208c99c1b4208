"""Commands of crux in processes of their own, cold, as a user runs them."""

from __future__ import annotations

import json
import subprocess
import sys
import time
from typing import Any


def crux_json(*words: str, limit_s: float | None = None) -> tuple[dict[str, Any], float]:
    """The object that `crux WORDS --json` prints, and its wall time [s].

    A run beyond `limit_s` is ended; it, and one without an object, comes back as {"ok": False, "error": why}.
    """
    began = time.monotonic()
    try:
        done = subprocess.run(
            [sys.executable, "-m", "crux_tools.cli", *words, "--json"],
            capture_output=True,
            text=True,
            check=False,
            timeout=limit_s,
        )
    except subprocess.TimeoutExpired:
        return {"ok": False, "error": f"{words[0]} ended after {limit_s:g} s"}, time.monotonic() - began
    seconds = time.monotonic() - began
    lines = done.stdout.strip().splitlines()
    try:
        result = json.loads(lines[-1])
    except (IndexError, ValueError):
        result = {"ok": False, "error": f"{words[0]} ended with status {done.returncode}: {done.stderr.strip()[-300:]}"}
    return (result if isinstance(result, dict) else {"ok": False, "error": f"{words[0]} printed no object"}), seconds
