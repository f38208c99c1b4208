"""Every number of a recording by its name, and its course as the least and largest of each interval of a plot."""

from __future__ import annotations

import re
from dataclasses import dataclass
from typing import Any

import numpy as np
from crux_contracts import LIMB_NAMES

from crux_tools.telemetry.columns import columns
from crux_tools.telemetry.summary import body_error_m, body_error_rad
from crux_tools.view.recording import Recording

PER_CYCLE = {"robot_state": "state", "control_input": "inputs", "control_output": "outputs"}
PER_LIMB = {"limb_telemetry": "limbs", "limb_reference": "references"}
UNITS = {
    "rad_s": "rad/s", "m_s": "m/s", "m_n": "m/N", "nm": "Nm", "mm": "mm", "ns": "ns", "deg": "°", "rad": "rad",
    "n": "N", "m": "m", "s": "s",
}  # fmt: skip
UNIT = re.compile(rf"_({'|'.join(UNITS)})(?:_(?:{'|'.join(LIMB_NAMES)}))?(?:_(?:joint\d+|[wxyz]|\d+))?(?:\.\w+)?$")
OF_PLAN = re.compile(  # of the others a plan has nothing
    r"margin_n|surface_used|robot_state\.(plan_time_s|body_position|body_quaternion)"
    r"|control_input\.(joint_position|finger_opening)|.*\.limb_reference\.(phase|gripper_yaw)"
    r"|.*\.limb_telemetry\.(gripper_position|force_w|moment_w|grasp_force_n)"
)


@dataclass(frozen=True)
class Signal:
    """(n,) times of the recording and values."""

    time_s: np.ndarray
    value: np.ndarray


def signals_of(recording: Recording) -> dict[str, Signal]:
    """All of them. Nothing is copied: values are views of the recording's tables but for a few that are computed."""
    log = recording.log
    found = {f"margin_n.{limb}": recording.grip.margin_n[:, i] for i, limb in enumerate(LIMB_NAMES)}
    found |= {f"surface_used.{limb}": recording.grip.used[:, i] for i, limb in enumerate(LIMB_NAMES)}
    found["body_error_mm"] = body_error_m(log) * 1e3
    found["body_error_deg"] = np.degrees(body_error_rad(log))
    for i, limb in enumerate(LIMB_NAMES):
        difference = log.limbs["force_w_n"][:, i] - log.limbs["force_reference_w_n"][:, i]
        found[f"force_error_n.{limb}"] = np.linalg.norm(difference, axis=1)
    for name, table in PER_CYCLE.items():
        found |= {f"{name}.{column}": values for column, values in columns(getattr(log, table))}
    for name, table in PER_LIMB.items():
        for i, limb in enumerate(LIMB_NAMES):
            records = getattr(log, table)[:, i]
            found |= {f"{limb}.{name}.{column}": values for column, values in columns(records)}
    signals = {name: Signal(log.time_s, values) for name, values in found.items()}
    if len(log.timing):
        time_s = log.timing["cycle"] * float(log.inputs["dt_s"][0])
        signals |= {f"cycle_timing.{name}": Signal(time_s, values) for name, values in columns(log.timing)}
    return {name: signal for name, signal in signals.items() if recording.what != "plan" or OF_PLAN.match(name)}


def unit_of(name: str) -> str:
    """Of a signal, as the end of its field's name says it; empty for one without."""
    found = UNIT.search(name)
    return "" if found is None else UNITS[found[1]]


def difference(a: Signal, b: Signal, shift_s: float) -> Signal:
    """a less b at the times of a; `shift_s` is added to those of b. NaN where b has nothing."""
    rows = np.searchsorted(b.time_s + shift_s, a.time_s + 1e-9, side="right") - 1
    outside = (rows < 0) | (a.time_s > b.time_s[-1] + shift_s + 1e-9)
    value = a.value.astype(float) - b.value[np.clip(rows, 0, None)].astype(float)
    return Signal(a.time_s, np.where(outside, np.nan, value))


def reduced(signal: Signal, from_s: float, to_s: float, points: int) -> dict[str, Any]:
    """Times [s], least and largest of at most `points` intervals between two times; None where all is NaN."""
    first, end = np.searchsorted(signal.time_s, [from_s, to_s])
    first, end = max(int(first) - 1, 0), min(int(end) + 1, len(signal.time_s))
    time_s, value = signal.time_s[first:end], signal.value[first:end].astype(float)
    if len(time_s) > points:
        begins = np.unique(np.linspace(0, len(time_s), points, endpoint=False).astype(int))
        low, high = np.fmin.reduceat(value, begins), np.fmax.reduceat(value, begins)
        time_s = time_s[begins]
    else:
        low = high = value
    return {"time_s": _rounded(time_s), "low": _rounded(low), "high": _rounded(high)}


def _rounded(values: np.ndarray) -> list[float | None]:
    """Seven digits, which is more than a screen shows; JSON has neither NaN nor infinities."""
    return [float(f"{value:.7g}") if np.isfinite(value) else None for value in values.tolist()]
