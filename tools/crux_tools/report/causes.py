"""Why a climb stopped: every fault with the second before it, its probable reason and what to do."""

from __future__ import annotations

import shlex

from crux_msgs.tables import FAULT_HELP

from crux_tools.operator_status import role_of
from crux_tools.report.evidence import BEFORE_S, evidence, moment_of, stories
from crux_tools.report.flight_recorder import flight_recorder
from crux_tools.report.page import Section
from crux_tools.telemetry import Telemetry
from crux_tools.telemetry.summary import FaultNote, Summary
from crux_tools.telemetry.wording import fault_line

MOST = 5  # stories on a page; what comes behind is seldom the cause
_EXPLANATION = (
    "What the log shows is read from its numbers, whatever the runtime said; what usually is behind it and what to do "
    "are those of every such fault."
)
_RECORDER = f" The plot: {BEFORE_S:g} s before the fault (red line) and what came at once behind it."


def _where(fault: FaultNote) -> str:
    return f"{fault.limb} {role_of(fault.node) if fault.node else ''}".strip() if fault.limb else ""


def _section(log: Telemetry, number: int, story: list[FaultNote]) -> Section:
    first, *others = story
    at = moment_of(log, first)
    usual, remedy = FAULT_HELP.get(first.code, ("not known to this version", "use the crux of the runtime's version"))
    seen = evidence(at) or ["Nothing unusual but the fault itself."]
    rows = [("fault", fault_line(first)), ("what the log shows", seen[0]), *(("and", more) for more in seen[1:])]
    rows += [("what usually is behind it", usual), ("what to do", remedy)]
    rows += [("then", fault_line(other)) for other in others[:MOST]]
    rows += [("look at it", f"crux view {shlex.quote(log.path.name)} --at {max(first.time_s - BEFORE_S, 0):.3f}")]
    where = _where(first)
    title = f"Cause: {first.name}{f' of {where}' if where else ''}, {first.time_s:.2f} s"
    return Section(f"cause-{number}", title, _EXPLANATION + _RECORDER, rows=rows, plots=[flight_recorder(at)])


def cause_sections(log: Telemetry, summary: Summary) -> list[Section]:
    """A section a story, none where there was no fault."""
    told = stories(summary.faults)
    sections = [_section(log, number, story) for number, story in enumerate(told[:MOST], 1)]
    if len(told) > MOST:
        sections[-1].notes.append(f"{len(told) - MOST} more came behind these; they are in the summary.")
    return sections
