"""Two climbs on one page: both verdicts, what differs in their figures, and their errors and margins in one plot."""

from __future__ import annotations

from pathlib import Path
from typing import NamedTuple

import numpy as np

from crux_tools.errors import UsageError
from crux_tools.report import figures
from crux_tools.report.page import Section
from crux_tools.report.verdict import facts, sentence
from crux_tools.telemetry import Telemetry, read_log
from crux_tools.telemetry.description import robot_of
from crux_tools.telemetry.summary import CLIMBING, Summary, body_error_m, summarise
from crux_tools.telemetry.wording import rows

COLOURS = ("#2465b0", "#d9822b")


class Climb(NamedTuple):
    """A log with what is said of it; (n,) the least margin of all limbs in a cycle, NaN without one in full stance."""

    log: Telemetry
    summary: Summary
    margin_n: np.ndarray

    @property
    def since_start_s(self) -> np.ndarray:
        """(n,) from the begin of the climb, of a log that never climbs from its own begin."""
        climbing = np.flatnonzero(self.log.state["supervisor_state"] == CLIMBING)
        return np.asarray(self.log.time_s - self.log.time_s[climbing[0] if len(climbing) else 0])

    def verdict(self) -> str:
        least_n = float(np.nanmin(self.margin_n)) if np.isfinite(self.margin_n).any() else float("nan")
        return sentence(self.log, self.summary, least_n, self.log.verdict)


def _climb(path: Path) -> Climb:
    from crux_tools.log.seen import grip_of_limbs

    log = read_log(path)
    if log.plan is None:
        raise UsageError(f"{path}: no plan was accepted in this log, so there is no climb to compare")
    with robot_of(log.plan.robot_name, log.robot_files) as robot:
        margin_n = grip_of_limbs(log, robot).margin_n
    return Climb(log, summarise(log), np.fmin.reduce(margin_n, axis=1))


def comparison_sections(paths: tuple[Path, Path]) -> list[Section]:
    """Raises LogError, and UsageError for a log without a climb."""
    both = [_climb(path) for path in paths]
    said = [dict(facts(climb.log) + rows(climb.summary)) for climb in both]
    names = [path.name if paths[0].name != paths[1].name else str(path) for path in paths]
    what = list(said[0] | said[1])
    differing = [(key, *(each.get(key, "–") for each in said)) for key in what if said[0].get(key) != said[1].get(key)]
    alike = [(key, said[0][key]) for key in what if said[0].get(key) == said[1].get(key)]
    verdicts = [(name, climb.verdict()) for name, climb in zip(names, both, strict=True)]
    notes = [f"{name}: {note}" for name, climb in zip(names, both, strict=True) for note in climb.log.notes]
    return [
        Section("verdict", "Verdicts", notes=notes, rows=verdicts),
        Section("differences", "What differs", table=[("", *names), *differing]),
        Section(
            "course",
            "Body and margins",
            "From the begin of each climb. The margin is the least of all limbs in full stance, as squeezed.",
            plots=[_course(names, both)],
        ),
        Section("alike", "What is the same", rows=alike),
    ]


def _course(names: list[str], both: list[Climb]) -> bytes:
    figure, axes = figures.rows_of(2, 4.6)
    for name, climb, colour in zip(names, both, COLOURS, strict=True):
        time_s = climb.since_start_s
        for axis, values in zip(axes, (1e3 * body_error_m(climb.log), climb.margin_n), strict=True):
            axis.plot(*figures.envelope(time_s, values), color=colour, linewidth=1.0, label=name)
    axes[0].set_ylabel("body off [mm]")
    axes[1].set_ylabel("least margin [N]")
    axes[1].axhline(0, color="#c0392b", linewidth=1.0)
    axes[1].set_xlabel("time from the begin of the climb [s]")
    figure.legend(*axes[0].get_legend_handles_labels(), ncols=2, fontsize=8, frameon=False, loc="outside upper right")
    return figures.png(figure)
