"""What a report says about a plan and about a climb."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

import numpy as np
from crux_contracts import LIMB_NAMES

from crux_tools.bench.start_pose import RobotPose
from crux_tools.report import figures
from crux_tools.report.page import Section
from crux_tools.report.pictures import Picture, Stage, open_stage
from crux_tools.report.plan_series import PlanSeries, Swing, plan_series
from crux_tools.report.renderer import NoGraphicsError
from crux_tools.telemetry import Telemetry
from crux_tools.telemetry.summary import CLIMBING, SWING, Summary, runs
from crux_tools.telemetry.wording import rows as summary_rows

PICTURE_PX = (640, 460)
_MARGIN = (
    "Newtons of tangential force a finger could still take: μ·f_z less what shear and twist demand of the limit "
    "surface, after the micro-spines' share. Below zero it slips."
)


def _title(swing: Swing) -> str:
    return f"{LIMB_NAMES[swing.limb]} from {swing.from_hold or '?'} to {swing.to_hold or '?'}"


def _pictures(plan: Any, take: Callable[[Stage], list[Picture]]) -> Section:
    section = Section("pictures", "Pictures")
    try:
        with open_stage(plan, PICTURE_PX) as stage:
            section.pictures = take(stage)
    except NoGraphicsError as error:
        section.notes.append(f"No pictures: this machine has no OpenGL to render them with ({error}).")
    return section


def _plan_pictures(plan: Any, series: PlanSeries) -> Section:
    def take(stage: Stage) -> list[Picture]:
        wanted = [(0, "start")]
        wanted += [
            ((s.first + s.last + 1) // 2, f"{_title(s)}, {series.time_s[s.first]:.0f} s") for s in series.swings()
        ]
        wanted.append((len(series.time_s) - 1, "goal"))
        shots = []
        for knot, caption in wanted:
            stage.show_pose(RobotPose.of_knot(plan.knots[knot], stage.robot))
            shots.append(stage.picture(caption))
        return shots

    return _pictures(plan, take)


def _swing_rows(log: Telemetry, series: PlanSeries) -> list[tuple[int, str]]:
    """The middle of every swing that was really made, with its caption."""
    found = []
    for limb in range(len(LIMB_NAMES)):
        planned = [swing for swing in series.swings() if swing.limb == limb]
        phase = log.references["phase"][:, limb]
        made = [(first, end) for first, end in runs(phase) if phase[first] == SWING]
        for (first, end), swing in zip(made, planned, strict=False):
            row = (first + end) // 2
            found.append((row, f"{_title(swing)}, {log.time_s[row]:.1f} s"))
    return sorted(found)


def _log_pictures(log: Telemetry, series: PlanSeries) -> Section:
    def take(stage: Stage) -> list[Picture]:
        climbing = np.flatnonzero(log.state["supervisor_state"] == CLIMBING)
        start = int(climbing[0]) if len(climbing) else 0
        last = len(log.time_s) - 1
        wanted = [(start, "start"), *_swing_rows(log, series), (last, f"end, {log.time_s[last]:.1f} s")]
        shots = []
        for row, caption in wanted:
            stage.show_cycle(log, row)
            shots.append(stage.picture(caption))
        return shots

    return _pictures(log.plan, take)


def _scenario(plan: Any) -> Section:
    return Section("scenario", "Scenario", text=re.sub(r"\n{3,}", "\n\n", plan.scenario_yaml))


def plan_sections(plan: Any) -> list[Section]:
    """Everything about a plan (plan_t)."""
    series = plan_series(plan)
    margins, smallest = figures.planned_margins(plan, series)
    forces, moments = figures.planned_wrenches(series)
    swings = series.swings()
    advance = series.body_position_m[-1] - series.body_position_m[0]
    table = [
        ("scenario", plan.scenario_name),
        ("robot", plan.robot_name),
        ("plan", plan.plan_id),
        ("method", plan.method),
        ("cost", f"{plan.cost:.6g}"),
        ("knots", f"{len(series.time_s)}, every {series.dt_s:g} s, {series.time_s[-1]:g} s in all"),
        ("body moves", f"{1e3 * np.linalg.norm(advance):.0f} mm"),
        ("swings", ", ".join(map(_title, swings)) or "none"),
        ("smallest margin of a finger", f"{smallest:.2f} N"),
    ]
    return [
        Section("summary", "Summary", rows=table),
        _plan_pictures(plan, series),
        Section("gait", "Gait", "Dark: stance, with the hold's name. Light: in the air.", plots=[figures.gait(series)]),
        Section(
            "wrenches",
            "Planned wrenches",
            "On the robot at the gripper's centre, world frame.",
            plots=[forces, moments],
        ),
        Section("margins", "Limit-surface margins", _MARGIN, plots=[margins]),
        _scenario(plan),
    ]


def log_sections(log: Telemetry, summary: Summary) -> list[Section]:
    """Everything about a climb."""
    sections = [Section("summary", "Summary", notes=list(summary.notes), rows=summary_rows(summary))]
    if log.plan is not None:
        series = plan_series(log.plan)
        sections.append(_log_pictures(log, series))
        sections.append(
            Section(
                "gait",
                "Gait",
                "Above as planned, over plan time; below as climbed, over real time. Red: the plan's clock stood "
                "still, waiting for this limb.",
                plots=[figures.gait(series), figures.executed_gait(log)],
            )
        )
    else:
        sections.append(Section("gait", "Gait", notes=["No plan was accepted in this log."]))
    sections.append(
        Section(
            "wrenches",
            "Planned and measured wrenches",
            "On the robot at the gripper's centre, world frame; measured with the hand's weight and tare taken off.",
            plots=figures.measured_wrenches(log),
        )
    )
    if log.plan is not None:
        plot, smallest = figures.measured_margins(log)
        rows = [("smallest margin drawn", f"{smallest:.2f} N")]
        text = _MARGIN + " From the measured wrench and grasp force, in full stance."
        sections.append(Section("margins", "Limit-surface margins", text, rows=rows, plots=[plot]))
    sections += [
        Section("body", "Body off its reference", "As the runtime estimates it.", plots=[figures.body_tracking(log)]),
        Section("grasp", "Grasp forces", "Squeeze of a finger.", plots=[figures.grasp_forces(log)]),
    ]
    timing = figures.cycle_timing(log)
    if timing:
        text = (
            "" if summary.timing and summary.timing.realtime else "In lockstep only the computing time means something."
        )
        sections.append(Section("timing", "Control cycle", text, plots=[timing]))
    if log.plan is not None:
        sections.append(_scenario(log.plan))
    return sections
