"""A moment in words and figures: what the climb does, and a row of a table for every limb."""

from __future__ import annotations

from typing import Any

import numpy as np
from crux_contracts import LIMB_NAMES
from crux_contracts.channels import SUPERVISOR_STATES
from crux_contracts.plan_series import PlanSeries

from crux_tools.telemetry.summary import PHASE_NAMES, WAIT_NAMES, name_of
from crux_tools.view.recording import Recording


def caption(recording: Recording, row: int, series: PlanSeries) -> dict[str, Any]:
    """`lines` of text, and `limbs`: name, hold, phase, margin [N], share of the limit surface used, squeeze [N]."""
    log = recording.log
    knot = int(series.knot_at(log.state["plan_time_s"][row : row + 1])[0])
    return {
        "lines": _plan_lines(recording, row, knot, series) if recording.what == "plan" else _lines(recording, row),
        "limbs": [
            {
                "name": name,
                "hold": series.hold_name(int(series.hold[knot, i])) if series.hold[knot, i] >= 0 else "",
                "phase": name_of(PHASE_NAMES, int(log.references["phase"][row, i])),
                "margin_n": _known(recording.grip.margin_n[row, i]),
                "used": _known(recording.grip.used[row, i]),
                "squeeze_n": _known(log.limbs["grasp_force_n"][row, i]),
            }
            for i, name in enumerate(LIMB_NAMES)
        ],
    }


def _plan_lines(recording: Recording, row: int, knot: int, series: PlanSeries) -> list[str]:
    """A plan is not run: it has neither states nor cycles nor errors."""
    time_s, end_s = recording.log.time_s[row], recording.log.time_s[-1]
    return [f"plan, knot {knot} of {len(series.time_s) - 1}, {time_s:.2f} of {end_s:.2f} s"]


def _lines(recording: Recording, row: int) -> list[str]:
    state = recording.log.state[row]
    error_mm = 1e3 * np.linalg.norm(state["body_position_w_m"] - state["body_reference_position_w_m"])
    waiting, limb = int(state["waiting_for"]), int(state["waiting_limb"])
    wait = f"waits for {name_of(LIMB_NAMES, limb) if limb >= 0 else 'all limbs'} to {name_of(WAIT_NAMES, waiting)}"
    return [
        f"{name_of(SUPERVISOR_STATES, int(state['supervisor_state']))}, cycle {state['cycle']}, plan time "
        f"{state['plan_time_s']:.2f} s" + (f", {wait}" if waiting else ""),
        f"body {error_mm:.1f} mm off its reference",
    ]


def _known(value: float) -> float | None:
    """JSON has neither NaN nor infinities."""
    return round(float(value), 3) if np.isfinite(value) else None
