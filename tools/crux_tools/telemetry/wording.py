"""The figures of a climb as rows of a table, the same on the terminal and on a page."""

from __future__ import annotations

import math
from types import SimpleNamespace
from typing import Any

from crux_contracts.terminal import in_a_line

from crux_tools.telemetry.summary import FaultNote, Summary, Wait

TOUCH_N = 1.0  # of links on wall or holds, from which on it is told


def _figure(value: float | None, unit: str, scale: float = 1.0, digits: int = 2) -> str:
    return "–" if value is None else f"{value * scale:.{digits}f} {unit}"


def fault_line(fault: FaultNote) -> str:
    """One fault in words: when, what, where, how much."""
    where = "".join([f", limb {fault.limb}" if fault.limb else "", f", node {fault.node}" if fault.node else ""])
    return f"{fault.time_s:.3f} s: {fault.code} {fault.name}{where}: {fault.text}"


def wait_line(wait: Wait) -> str:
    """How long the plan's clock stood still for one reason."""
    return (
        f"{wait.limb or 'all'} to {wait.reason}: {wait.count} times, {wait.total_s:.2f} s in all, "
        f"longest {wait.longest_s:.2f} s"
    )


def touching(verdict: Any) -> list[str]:
    """That something else than a pad pressed on wall or holds, where it did."""
    force_N = verdict.link_contact_force_n
    return [f"links press on wall or holds with up to {force_N:.0f} N"] if force_N >= TOUCH_N else []


def judged(verdict: Any) -> list[str]:
    """Slips, fall, touching links and log of a verdict with the fields of truth_verdict_t."""
    return [
        f"{verdict.slips or 'no'} slip{'' if verdict.slips == 1 else 's'} "
        f"(largest {verdict.largest_slip_m * 1e3:.2f} mm)",
        f"a fall ({in_a_line(verdict.fall_reason)})" if verdict.fell else "no fall",
        *touching(verdict),
        *([] if verdict.log_complete else ["log incomplete"]),
    ]


def _verdict(verdict: Any) -> str:
    head = "climbed" if verdict.ok else f"failed: {in_a_line(verdict.reason)}"
    off = f"{verdict.goal_error_m * 1e3:.1f} mm and {math.degrees(verdict.goal_error_rad):.1f} deg off the goal"
    return f"{head}\n{off}, {', '.join(judged(verdict))}"


def rows(summary: Summary) -> list[tuple[str, str]]:
    """(what, value) lines of a summary; the value of one thing may have several lines."""
    tracking = summary.tracking
    table = [("verdict", _verdict(SimpleNamespace(**summary.verdict)))] if summary.verdict else []
    table += [
        ("plan", in_a_line(f"{summary.scenario or 'none'} ({(summary.plan_id or '–')[:12]})")),
        ("outcome", _outcome(summary)),
        ("duration", f"{summary.duration_s:.2f} s, {summary.cycles} control cycles"),
        ("states", "\n".join(f"{s.state} {s.from_s:.2f} … {s.to_s:.2f} s" for s in summary.states)),
        ("faults", "\n".join(map(fault_line, summary.faults)) or "none"),
        ("waits of the plan's clock", "\n".join(map(wait_line, summary.waits)) or "none"),
        (
            "body off its reference",
            f"largest {_figure(tracking.body_max_m, 'mm', 1e3)}, RMS {_figure(tracking.body_rms_m, 'mm', 1e3)}, "
            f"largest turn {_figure(tracking.body_max_deg, 'deg')}",
        ),
        (
            "wrench error in stance, RMS",
            f"{_figure(summary.force_rms_N, 'N')}, {_figure(summary.moment_rms_Nm, 'Nm', digits=3)} ("
            + ", ".join(f"{limb.limb} {_figure(limb.force_rms_N, 'N')}" for limb in summary.wrench)
            + ")",
        ),
        ("missed cycles", str(summary.missed_cycles)),
    ]
    if summary.timing:
        timing = summary.timing
        table.append(("computing a cycle", _percentiles(timing.compute_us)))
        if timing.realtime:
            table += [("period", _percentiles(timing.period_us)), ("late", _percentiles(timing.late_us))]
        else:
            table.append(("pace", "lockstep with the simulation: the time between cycles means nothing"))
    if summary.refusals:
        table.append(("refused requests", "\n".join(summary.refusals)))
    return table


def _outcome(summary: Summary) -> str:
    if summary.plan_complete:
        return f"plan completed, {summary.final_state}"
    return f"{summary.final_state} at plan time {summary.plan_time_s:.2f} of {summary.plan_end_s:.2f} s"


def _percentiles(values_us: list[float]) -> str:
    names = ("median", "99 %", "99.9 %", "largest")
    return ", ".join(f"{name} {value:.0f} µs" for name, value in zip(names, values_us, strict=True))
