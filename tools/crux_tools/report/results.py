"""What a campaign leaves in its folder: DIR/rows/KEY.json for each job, DIR/failures/KEY/ about a job that failed."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

CLIMBED, PLANNED, HELD = "climbed", "planned", "held"
FAILED, WRONG, INFEASIBLE, UNDECIDED, REFUSED, ERROR = "failed", "wrong", "infeasible", "undecided", "refused", "error"
SUCCESSES = (CLIMBED, PLANNED, HELD)
ROWS, FAILURES = "rows", "failures"
LOG_FILE = "log.mcap"
ORDER = ("walls", "wall_seed", "world", "seed", "method", "key")
Row = dict[str, Any]


def read_rows(folder: Path) -> list[Row]:
    """Every result in a campaign's folder, once, in the order of the table."""
    rows: list[Row] = [json.loads(file.read_bytes()) for file in (folder / ROWS).glob("[!.]*.json")]
    return sorted(rows, key=lambda row: tuple(row[name] for name in ORDER))
