"""What happened, as lanes of a time line: the state, what the plan's clock waits for, every limb's gait; and events."""

from __future__ import annotations

from typing import Any

import numpy as np
from crux_contracts import LIMB_NAMES
from crux_contracts.channels import SUPERVISOR_STATES

from crux_tools.log.seen import NS, WARN
from crux_tools.telemetry.summary import CLIMBING, PHASE_NAMES, WAIT_NAMES, name_of, runs
from crux_tools.view.recording import Recording

Lane = dict[str, Any]
NOTHING = "nothing"


def _lane(name: str, kind: str, time_s: np.ndarray, values: np.ndarray, words: tuple[str, ...]) -> Lane:
    """Spans [begin, end, word] of equal values; `kind` tells the page which colours are meant."""
    ends = np.append(time_s[1:], time_s[-1])
    spans = [
        (round(float(time_s[first]), 4), round(float(ends[end - 1]), 4), name_of(words, int(values[first])))
        for first, end in runs(values.astype(int))
    ]
    return {"name": name, "kind": kind, "spans": [span for span in spans if span[2] != NOTHING]}


def lanes(recording: Recording) -> list[Lane]:
    """From top to bottom; a plan has neither states nor waits."""
    log = recording.log
    state, time_s = log.state, log.time_s
    gait = [
        _lane(limb, "gait", time_s, log.references["phase"][:, i], PHASE_NAMES) for i, limb in enumerate(LIMB_NAMES)
    ]
    if recording.what == "plan":
        return gait
    waits = [NOTHING] + [f"{limb} {reason}" for reason in WAIT_NAMES[1:] for limb in ("all", *LIMB_NAMES)]
    waiting = np.where(
        state["waiting_for"] > 0,
        1 + (state["waiting_for"].astype(int) - 1) * (len(LIMB_NAMES) + 1) + state["waiting_limb"] + 1,
        0,
    )
    return [
        _lane("state", "state", time_s, state["supervisor_state"], SUPERVISOR_STATES),
        _lane("waits", "wait", time_s, waiting, tuple(waits)),
        *gait,
    ]


def start_s(recording: Recording) -> float:
    """When the climb began; the recording's begin where it never did."""
    climbing = np.flatnonzero(recording.log.state["supervisor_state"] == CLIMBING)
    return float(recording.log.time_s[climbing[0] if len(climbing) else 0])


def story_of(recording: Recording, shift_s: float) -> Lane:
    """For the page; the page adds `shift_s` to this recording's times."""
    log = recording.log
    return {
        "name": log.path.name,
        "what": recording.what,
        "begin_s": float(log.time_s[0]),
        "end_s": float(log.time_s[-1]),
        "shift_s": shift_s,
        "step_s": float(log.inputs["dt_s"][0]),
        "lanes": lanes(recording),
        "events": [
            {"time_s": event.log_ns / NS, "serious": event.level >= WARN, "text": event.text}
            for event in recording.events
        ],
        "notes": log.notes,
    }
