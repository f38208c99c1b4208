"""What a report says about a plan and about a climb."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

import numpy as np
from crux_contracts import LIMB_NAMES
from crux_contracts.interpolation import is_walk
from crux_contracts.plan_series import PlanSeries, Swing, plan_series
from crux_contracts.robot import Robot

from crux_tools.report import figures
from crux_tools.report.causes import cause_sections
from crux_tools.report.joints import hot_nodes, joint_loads
from crux_tools.report.page import Section
from crux_tools.report.pictures import Picture, Stage, open_stage
from crux_tools.report.renderer import NoGraphicsError
from crux_tools.report.replans import replan_sections
from crux_tools.report.verdict import APPLIED, PLANNED, facts, sentence
from crux_tools.robot3d.start_pose import RobotPose
from crux_tools.telemetry import Telemetry
from crux_tools.telemetry.channels import WORLD
from crux_tools.telemetry.description import difference, robot_of
from crux_tools.telemetry.summary import CLIMBING, SWING, Summary, runs
from crux_tools.telemetry.wording import rows as summary_rows

if TYPE_CHECKING:
    from crux_msgs import truth_verdict_t

PICTURE_PX = (640, 460)
_MARGIN = (
    "Newtons of tangential force a finger could still take: μ·f_z less what shear and twist demand of the limit "
    "surface, after the micro-spines' share. Below zero it slips."
)
_PLANNED = (
    f" Here {PLANNED}, which J counts too; the controller squeezes at least this hard, and the page of a climb "
    "has the margins with that squeeze."
)
_APPLIED = (
    f" Here {APPLIED}: from the measured wrench and squeeze of every cycle in full stance, drawn as the least and "
    "largest of each interval. The plan's own margins, with the plan's squeeze, are on the page of the plan."
)


def _smallest(walks: bool, squeeze: str) -> str:
    """Feet do not squeeze."""
    return "smallest margin of a foot" if walks else f"smallest margin of a finger {squeeze}"


def _title(swing: Swing) -> str:
    return f"{LIMB_NAMES[swing.limb]} from {swing.from_hold or '?'} to {swing.to_hold or '?'}"


def _pictures(plan: Any, robot_files: dict[str, bytes], take: Callable[[Stage], list[Picture]]) -> Section:
    section = Section("pictures", "Pictures")
    try:
        with open_stage(plan, PICTURE_PX, robot_files) as stage:
            section.pictures = take(stage)
    except NoGraphicsError as error:
        section.notes.append(f"No pictures: {error}.")
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

    return _pictures(plan, {}, take)


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

    return _pictures(log.plan, log.robot_files, take)


def _scenario(plan: Any) -> Section:
    return Section("scenario", "Scenario", text=re.sub(r"\n{3,}", "\n\n", plan.scenario_yaml))


def plan_sections(plan: Any) -> list[Section]:
    """Everything about a plan (plan_t)."""
    series = plan_series(plan)
    margins, smallest = figures.planned_margins(plan, series)
    forces, moments = figures.planned_wrenches(series)
    other_robot = difference({"robot": plan.robot_name, "robot_sha256": plan.robot_sha256}, {})
    swings, walks = series.swings(), is_walk(plan)
    every = f", every {series.dt_s:g} s" if plan.format < plan.FORMAT_OWN_TIMES else ""
    advance = series.body_position_m[-1] - series.body_position_m[0]
    table = [
        ("scenario", plan.scenario_name),
        ("robot", plan.robot_name),
        ("plan", plan.plan_id),
        ("method", plan.method),
        ("cost J", f"{plan.cost:.6g}{'' if walks else f'; its force terms are {PLANNED}'}"),
        ("knots", f"{len(series.time_s)}{every}, {series.time_s[-1]:g} s in all"),
        ("body moves", f"{1e3 * np.linalg.norm(advance):.0f} mm"),
        ("swings", ", ".join(map(_title, swings)) or "none"),
        (_smallest(walks, PLANNED), f"{smallest:.2f} N"),
    ]
    return [
        Section("summary", "Summary", notes=[other_robot] if other_robot else [], rows=table),
        _plan_pictures(plan, series),
        Section("gait", "Gait", "Dark: stance, with the hold's name. Light: in the air.", plots=[figures.gait(series)]),
        Section(
            "wrenches",
            "Planned wrenches",
            "On the robot at the gripper's centre, world frame.",
            plots=[forces, moments],
        ),
        Section("margins", "Limit-surface margins", _MARGIN + ("" if walks else _PLANNED), plots=[margins]),
        _scenario(plan),
    ]


def _joints(log: Telemetry, robot: Robot) -> Section:
    loads = joint_loads(log, robot)
    hot = ", ".join(hot_nodes(log))
    limit = f"{robot.servo.temperature_limit_degC:g} °C"
    text = (
        "Peak against the joint's effort and RMS while climbing against what the motor's winding bears for good, both "
        "of the robot description; heat is the share that the drive's count would reach from a cold "
        f"start. A log has no temperatures, only which nodes report {limit} or more."
    )
    rows = [("reported hot", hot or "none"), *loads.rows()]
    return Section("joints", "Joint torques and heat", text, "", loads.notes(), rows, [figures.joint_torques(log)])


def _gait(log: Telemetry) -> Section:
    if log.plan is None:
        return Section("gait", "Gait", notes=["No plan was accepted in this log."])
    return Section(
        "gait",
        "Gait",
        "Above as planned, over plan time; below as climbed, over real time. Red: the plan's clock stood still, "
        "waiting for this limb.",
        plots=[figures.gait(plan_series(log.plan)), figures.executed_gait(log)],
    )


def log_sections(log: Telemetry, summary: Summary, verdict: truth_verdict_t | None) -> list[Section]:
    """Everything about a climb; `verdict` is the judge's, where there is one."""
    smallest = float("nan")
    margins, joints = [], []
    if log.plan is not None:
        with robot_of(log.plan.robot_name, log.robot_files) as robot:
            joints = [_joints(log, robot)]
            plot, smallest = figures.measured_margins(log, robot.control.force_filter_s)
        walks = is_walk(log.plan)
        text = _MARGIN + ("" if walks else _APPLIED)
        rows = [(_smallest(walks, APPLIED), f"{smallest:.2f} N")]
        margins = [Section("margins", "Limit-surface margins", text, rows=rows, plots=[plot])]
    sections = [
        Section("verdict", "Verdict", verdict=sentence(log, summary, smallest, verdict), rows=facts(log)),
        *cause_sections(log, summary),
        Section("summary", "Summary", notes=list(summary.notes), rows=summary_rows(summary)),
    ]
    if log.plan is not None:
        sections.append(_log_pictures(log, plan_series(log.plan)))
    sections += [
        _gait(log),
        *replan_sections(log),
        Section(
            "wrenches",
            "Planned and measured wrenches",
            "On the robot at the gripper's centre, world frame; measured with the hand's weight and tare taken off.",
            plots=figures.measured_wrenches(log),
        ),
        *margins,
        Section("body", "Body off its reference", "As the runtime estimates it.", plots=[figures.body_tracking(log)]),
        Section("grasp", "Grasp forces", "Squeeze of a finger.", plots=[figures.grasp_forces(log)]),
        *joints,
    ]
    timing = figures.cycle_timing(log)
    if timing:
        text = (
            "" if summary.timing and summary.timing.realtime else "In lockstep only the computing time means something."
        )
        sections.append(Section("timing", "Control cycle", text, plots=[timing]))
    if log.plan is not None:
        sections.append(_scenario(log.plan))
    if world := log.metadata.get(WORLD):
        sections.append(Section("world", "World of the simulation", text=world))
    return sections
