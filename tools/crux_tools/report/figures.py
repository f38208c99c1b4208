"""The plots of a report as PNG files held in memory."""

from __future__ import annotations

import io
from collections.abc import Iterable
from typing import Any

import matplotlib

matplotlib.use("Agg")
import numpy as np
from crux_contracts import LIMB_NAMES
from crux_contracts.plan_series import PlanSeries
from matplotlib import pyplot as plt
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from crux_tools.report.joints import joint_torques_Nm
from crux_tools.telemetry import Telemetry
from crux_tools.telemetry.margins import measured_margin_n, planned_margin_n
from crux_tools.telemetry.summary import PHASE_NAMES, body_error_m, body_error_rad, is_realtime, runs

MAX_POINTS = 2500  # a curve needs no more on a page
DPI = 110
WIDTH_IN = 10.0
AXIS_COLOURS = ("#c0392b", "#27864a", "#2465b0")  # x, y, z
FINGER_COLOURS = ("#2465b0", "#c77700")
STANCE_COLOUR, AIR_COLOUR = "#35506b", "#f0c36d"
PHASE_COLOURS = (STANCE_COLOUR, "#7d95ad", "#f7e2ae", "#f0c36d", "#e8a33d", "#f0c36d", "#f7e2ae", "#7d95ad")
NS_PER_US = 1e3


def png(figure: Figure) -> bytes:
    buffer = io.BytesIO()
    figure.savefig(buffer, format="png", dpi=DPI)
    plt.close(figure)
    return buffer.getvalue()


def rows_of(count: int, height_in: float, sharex: bool = True) -> tuple[Figure, list[Axes]]:
    figure, axes = plt.subplots(
        count, 1, sharex=sharex, figsize=(WIDTH_IN, height_in), layout="constrained", squeeze=False
    )
    for axis in axes[:, 0]:
        axis.grid(color="#e4e4e4", linewidth=0.6)
        axis.set_axisbelow(True)
    return figure, list(axes[:, 0])


def envelope(time: np.ndarray, values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """A curve of at most MAX_POINTS: least and largest of every interval drawn, in turn, so that a spike of one cycle
    is seen. NaN counts only where an interval holds nothing else. Shapes (n,) and (n, ...) -> (m,) and (m, ...)."""
    if len(time) <= MAX_POINTS:
        return time, values
    first = np.linspace(0, len(time), MAX_POINTS // 2, endpoint=False).astype(int)
    ends = [extreme.reduceat(values, first, axis=0) for extreme in (np.fmin, np.fmax)]
    return np.repeat(time[first], 2), np.stack(ends, axis=1).reshape(-1, *values.shape[1:])


def _lane(axis: Axes, lane: int, start: float, width: float, colour: str, text: str = "") -> None:
    axis.broken_barh([(start, width)], (lane - 0.36, 0.72), facecolors=colour, edgecolor="white", linewidth=0.8)
    if text:
        light = colour == STANCE_COLOUR
        axis.text(
            start + width / 2, lane, text, ha="center", va="center", fontsize=8, clip_on=True,
            color="white" if light else "#333333",
        )  # fmt: skip


def _limb_lanes(axis: Axes) -> None:
    axis.set_yticks(range(len(LIMB_NAMES)), LIMB_NAMES)
    axis.invert_yaxis()
    axis.grid(visible=False, axis="y")


def gait(series: PlanSeries) -> bytes:
    """Limbs over plan time: stance with the hold's name, and air."""
    figure, (axis,) = rows_of(1, 2.4)
    end = 2 * series.time_s[-1] - series.time_s[-2]
    for limb in range(len(LIMB_NAMES)):
        for first, last in runs(series.hold[:, limb]):
            start = series.time_s[first]
            stop = series.time_s[last] if last < len(series.time_s) else end
            stance = bool(series.stance[first, limb])
            name = series.hold_name(int(series.hold[first, limb])) if stance else ""
            _lane(axis, limb, start, stop - start, STANCE_COLOUR if stance else AIR_COLOUR, name)
    _limb_lanes(axis)
    axis.set_xlim(series.time_s[0], end)
    axis.set_xlabel("plan time [s]")
    return png(figure)


def executed_gait(log: Telemetry) -> bytes:
    """Limbs over real time as they really moved, with the instants the plan's clock stood still."""
    figure, (axis,) = rows_of(1, 2.8)
    for limb in range(len(LIMB_NAMES)):
        phase = log.references["phase"][:, limb]
        for first, end in runs(phase):
            stop = log.time_s[min(end, len(log.time_s) - 1)]
            _lane(axis, limb, log.time_s[first], stop - log.time_s[first], PHASE_COLOURS[int(phase[first]) % 8])
    waiting = log.state["waiting_for"]
    for first, end in runs(waiting):
        if waiting[first]:
            limb = int(log.state["waiting_limb"][first])
            lanes = [limb] if limb >= 0 else range(len(LIMB_NAMES))
            for lane in lanes:
                axis.plot([log.time_s[first], log.time_s[end - 1]], [lane + 0.43] * 2, color="#c0392b", linewidth=2.5)
    _limb_lanes(axis)
    handles: list[Artist] = [Patch(color=PHASE_COLOURS[i], label=PHASE_NAMES[i]) for i in range(5)]
    handles.append(Line2D([], [], color="#c0392b", linewidth=2.5, label="waits"))
    figure.legend(handles=handles, ncols=6, fontsize=8, frameon=False, loc="outside upper right")
    axis.set_xlim(log.time_s[0], log.time_s[-1])
    axis.set_xlabel("time [s]")
    return png(figure)


def _components(axis: Axes, time: np.ndarray, values: np.ndarray, style: dict[str, Any], labels: Iterable[str]) -> None:
    for component, (colour, label) in enumerate(zip(AXIS_COLOURS, labels, strict=True)):
        axis.plot(time, values[:, component], color=colour, label=label, **style)


def _wrench_figure(quantity: str, unit: str, curves: list[tuple[np.ndarray, np.ndarray, dict[str, Any], str]]) -> bytes:
    figure, axes = rows_of(len(LIMB_NAMES), 7.5)
    for limb, axis in enumerate(axes):
        for time, values, style, what in curves:
            _components(axis, time, values[:, limb], style, [f"{quantity}{letter} {what}" for letter in "xyz"])
        axis.set_ylabel(f"{LIMB_NAMES[limb]} [{unit}]")
    axes[-1].set_xlabel("time [s]" if len(curves) > 1 else "plan time [s]")
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, ncols=6, fontsize=8, frameon=False, loc="outside upper right")
    return png(figure)


def planned_wrenches(series: PlanSeries) -> tuple[bytes, bytes]:
    """Forces and moments of the plan, constant from knot to knot."""
    style = {"drawstyle": "steps-post", "linewidth": 1.3}
    return (
        _wrench_figure("F", "N", [(series.time_s, series.force_n, style, "")]),
        _wrench_figure("M", "Nm", [(series.time_s, series.moment_nm, style, "")]),
    )


def measured_wrenches(log: Telemetry) -> tuple[bytes, bytes]:
    """Forces and moments of every gripper: planned (thin, dashed) and measured."""
    planned = {"linestyle": "--", "linewidth": 0.9}
    measured = {"linewidth": 1.1, "alpha": 0.85}

    def figure(quantity: str, unit: str, wanted: str, actual: str) -> bytes:
        curves = [
            (*envelope(log.time_s, log.limbs[name]), style, what)
            for name, style, what in ((wanted, planned, "planned"), (actual, measured, "measured"))
        ]
        return _wrench_figure(quantity, unit, curves)

    return (
        figure("F", "N", "force_reference_w_n", "force_w_n"),
        figure("M", "Nm", "moment_reference_w_nm", "moment_w_nm"),
    )


def _margin_figure(time: np.ndarray, margin: np.ndarray, drawstyle: str, label: str) -> bytes:
    figure, axes = rows_of(len(LIMB_NAMES), 7.0)
    for limb, axis in enumerate(axes):
        for finger in range(2):
            axis.plot(
                time, margin[:, limb, finger], color=FINGER_COLOURS[finger], drawstyle=drawstyle, linewidth=1.2,
                label=f"finger {finger + 1}",
            )  # fmt: skip
        axis.axhline(0, color="#c0392b", linewidth=1.0)
        axis.set_ylim(bottom=float(np.min(margin, where=np.isfinite(margin), initial=0.0)) - 2)
        axis.set_ylabel(f"{LIMB_NAMES[limb]} [N]")
    axes[-1].set_xlabel(label)
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, ncols=2, fontsize=8, frameon=False, loc="outside upper right")
    return png(figure)


def planned_margins(plan: Any, series: PlanSeries) -> tuple[bytes, float]:
    """Margin of the limit surface a finger at the knots, and the smallest of all [N]."""
    margin = planned_margin_n(plan)
    return _margin_figure(series.time_s, margin, "steps-post", "plan time [s]"), float(np.nanmin(margin))


def measured_margins(log: Telemetry, filter_s: float) -> tuple[bytes, float]:
    """Margin of the limit surface a finger from the measured wrenches, and the smallest of all cycles [N]."""
    margin = measured_margin_n(log, filter_s)
    smallest = float(np.nanmin(margin)) if np.isfinite(margin).any() else float("nan")
    return _margin_figure(*envelope(log.time_s, margin), "default", "time [s]"), smallest


def body_tracking(log: Telemetry) -> bytes:
    """Position and orientation error of the body against its reference."""
    figure, axes = rows_of(2, 3.6)
    axes[0].plot(*envelope(log.time_s, 1e3 * body_error_m(log)), color=AXIS_COLOURS[2], linewidth=1.1)
    axes[0].set_ylabel("position [mm]")
    axes[1].plot(*envelope(log.time_s, np.degrees(body_error_rad(log))), color=AXIS_COLOURS[0], linewidth=1.1)
    axes[1].set_ylabel("orientation [deg]")
    axes[1].set_xlabel("time [s]")
    for axis in axes:
        axis.set_ylim(bottom=0)
    return png(figure)


def grasp_forces(log: Telemetry) -> bytes:
    """Squeeze of a finger, wanted and measured."""
    figure, axes = rows_of(len(LIMB_NAMES), 6.0)
    time, measured = envelope(log.time_s, log.inputs["finger_force_n"])
    _, wanted = envelope(log.time_s, log.limbs["grasp_force_reference_n"])
    for limb, axis in enumerate(axes):
        axis.plot(time, measured[:, limb], color=FINGER_COLOURS[0], linewidth=1.1, label="measured")
        axis.plot(time, wanted[:, limb], color="#333333", linestyle="--", linewidth=0.9, label="wanted")
        axis.set_ylabel(f"{LIMB_NAMES[limb]} [N]")
    axes[-1].set_xlabel("time [s]")
    handles, labels = axes[0].get_legend_handles_labels()
    figure.legend(handles, labels, ncols=2, fontsize=8, frameon=False, loc="outside upper right")
    return png(figure)


def joint_torques(log: Telemetry) -> bytes:
    """Torque of every joint."""
    figure, axes = rows_of(len(LIMB_NAMES), 7.0)
    time, torque = envelope(log.time_s, joint_torques_Nm(log))
    for limb, axis in enumerate(axes):
        for joint in range(torque.shape[2]):
            axis.plot(time, torque[:, limb, joint], linewidth=1.0, label=f"joint{joint + 1}")
        axis.set_ylabel(f"{LIMB_NAMES[limb]} [Nm]")
    axes[-1].set_xlabel("time [s]")
    figure.legend(*axes[0].get_legend_handles_labels(), ncols=6, fontsize=8, frameon=False, loc="outside upper right")
    return png(figure)


def cycle_timing(log: Telemetry) -> bytes | None:
    """Histograms of computing time and, in real time, of period and lateness; None for a log without timing."""
    timing = log.timing
    if len(timing) < 2:
        return None
    columns = [("computing [µs]", timing["compute_ns"][1:] / NS_PER_US)]
    if is_realtime(log):
        period = np.diff(timing["wall_ns"]) / np.diff(timing["cycle"]) / NS_PER_US
        columns += [("period [µs]", period), ("late [µs]", timing["late_ns"][1:] / NS_PER_US)]
    figure, axes = plt.subplots(1, len(columns), figsize=(WIDTH_IN, 2.6), layout="constrained", squeeze=False)
    for axis, (label, values) in zip(axes[0], columns, strict=True):
        axis.hist(values, bins=80, color=STANCE_COLOUR)
        axis.set_yscale("log")
        axis.set_xlabel(label)
        axis.grid(color="#e4e4e4", linewidth=0.6)
        axis.set_axisbelow(True)
    axes[0][0].set_ylabel("cycles")
    return png(figure)
