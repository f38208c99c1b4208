"""What was planned again on the way of a climb: why, what that took, and whether the robot climbed it."""

from __future__ import annotations

import json
import statistics
from typing import Any

from crux_contracts.terminal import in_a_line

from crux_tools.report.page import Section
from crux_tools.telemetry import Telemetry
from crux_tools.telemetry.channels import REPLANNED, REPLANS

_TEXT = (
    "After a new grasp the moves ahead were planned again where holds are not as on the map; what comes too late, or "
    "is no plan, leaves the climb as it was."
)


def replan_sections(log: Telemetry) -> list[Section]:
    """One section, where anything was planned again. The log of a simulated climb has all of it, that of a robot what
    was kept.
    """
    told = log.metadata.get(REPLANS)
    each: list[dict[str, Any]] = json.loads(told) if told else []
    if each:
        rows = [(f"{made['time_s']:.1f} s, {made['seconds']:.2f} s of planning", _says(made)) for made in each]
        median_s = statistics.median(made["seconds"] for made in each)
        kept = sum(bool(made["kept"]) for made in each)
        said = f"{_TEXT} {kept} of {len(each)} kept; {median_s:.2f} s in the median, the check included."
        return [Section("replans", "Planned again on the way", said, rows=rows)]
    rows = [
        (f"{time_s:.1f} s", f"{in_a_line(plan.method.removeprefix(REPLANNED))}: kept")
        for time_s, plan in log.plans
        if plan.method.startswith(REPLANNED)
    ]
    return [Section("replans", "Planned again on the way", _TEXT, rows=rows)] if rows else []


def _says(made: dict[str, Any]) -> str:
    return in_a_line(f"{made['why']}: {made['outcome']}")
