"""What a campaign leaves in its folder: DIR/rows/KEY.json for each job, DIR/failures/KEY/ about a job that failed."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from crux_tools.errors import UsageError

CLIMBED, PLANNED, HELD = "climbed", "planned", "held"
FAILED, WRONG, INFEASIBLE, UNDECIDED, REFUSED, ERROR = "failed", "wrong", "infeasible", "undecided", "refused", "error"
SUCCESSES = (CLIMBED, PLANNED, HELD)
ROWS, FAILURES = "rows", "failures"
LOG_FILE = "log.mcap"
ORDER = ("walls", "wall_seed", "world", "seed", "method", "key")
Row = dict[str, Any]
Kinds = dict[str, type | tuple[type, ...]]
NEEDED: Kinds = {
    "key": str,
    "walls": str,
    "wall_seed": int,
    "world": str,
    "seed": int,
    "method": str,
    "verdict": str,
    "reason": str,
}
OPTIONAL: Kinds = {"check": dict, "cpu_s": (int, float), "worker": str, "wall": str}
WORDS = {str: "a text", int: "a whole number", float: "a number", dict: "an object"}
LONGEST_SHOWN = 60


def read_rows(folder: Path) -> list[Row]:
    """Every result in a campaign's folder, once, in the order of the table. Raises UsageError, OSError."""
    rows = [_row(file) for file in (folder / ROWS).glob("[!.]*.json")]
    return sorted(rows, key=lambda row: tuple(row[name] for name in ORDER))


def _row(file: Path) -> Row:
    try:
        row: Row = json.loads(file.read_bytes())
    except (ValueError, RecursionError) as error:
        raise UsageError(f"{file}: no whole JSON file: {error}") from None
    if not isinstance(row, dict):
        raise UsageError(f"{file}: expected the result of a job, an object")
    for key, kind in (NEEDED | {key: kind for key, kind in OPTIONAL.items() if key in row}).items():
        if not isinstance(row.get(key), kind):
            found = repr(row[key])[:LONGEST_SHOWN] if key in row else "missing"
            words = " or ".join(WORDS[each] for each in (kind if isinstance(kind, tuple) else (kind,)))
            raise UsageError(f"{file}: {key}: {found}: expected {words}; a campaign writes it again once it is gone")
    return row
