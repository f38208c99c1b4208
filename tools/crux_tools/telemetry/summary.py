"""The figures a logged climb is judged by, from the log alone (the runtime's own view, not physics' truth)."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from itertools import pairwise
from typing import Any

import numpy as np
from crux_contracts import LIMB_NAMES
from crux_contracts.channels import FAULT_BY_CODE, SUPERVISOR_STATES
from crux_msgs import robot_state_t
from crux_msgs.tables import MEMBERS

from crux_tools.telemetry.reader import Telemetry

CLIMBING = robot_state_t.CLIMBING
MOTION_NAMES = ("forward", "single step", "in reverse")  # robot_state.motion
PHASE_NAMES = ("stance", "unload", "open", "lift", "swing", "descend", "close", "load")  # limb_reference.phase
STANCE, SWING = PHASE_NAMES.index("stance"), PHASE_NAMES.index("swing")
WAIT_NAMES = ("nothing", "unload", "open", "arrive", "grip", "settle", "slip", "stand up", "drift")
STANDS_UP = WAIT_NAMES.index("stand up")
FULL_LOAD = 0.98  # of limb_reference.load: from here on the limb carries its planned wrench
PERCENTILES = (50, 99, 99.9, 100)
NS_PER_US = 1e3


@dataclass(frozen=True)
class StateSpan:
    """One stay of the supervisor in a state."""

    state: str
    from_s: float
    to_s: float


@dataclass(frozen=True)
class FaultNote:
    """One fault with its text from msgs/faults.yaml."""

    time_s: float
    code: int
    name: str
    limb: str | None
    node: int
    value: float
    limit: float
    text: str


@dataclass(frozen=True)
class Wait:
    """How often and how long the plan's clock stood still for one limb and reason."""

    limb: str | None
    reason: str
    count: int
    total_s: float
    longest_s: float


@dataclass(frozen=True)
class WrenchError:
    """Measured minus planned wrench of a limb in full stance, root mean square of the vector's length."""

    limb: str
    force_rms_N: float | None
    moment_rms_Nm: float | None


@dataclass(frozen=True)
class Tracking:
    """Body against its reference while climbing, as the runtime estimates it; None where it never climbed."""

    body_max_m: float | None
    body_rms_m: float | None
    body_max_deg: float | None


@dataclass(frozen=True)
class Timing:
    """Percentiles 50, 99, 99.9 and 100 over the control cycles, in microseconds of wall time."""

    realtime: bool
    compute_us: list[float]
    period_us: list[float]
    late_us: list[float]


@dataclass(frozen=True)
class Summary:
    """A climb in figures; `to_json` gives the object that --json prints."""

    cycles: int
    duration_s: float
    plan_id: str | None
    scenario: str | None
    robot: str | None
    plan_complete: bool
    final_state: str
    plan_time_s: float
    plan_end_s: float
    states: list[StateSpan]
    faults: list[FaultNote]
    waits: list[Wait]
    tracking: Tracking
    wrench: list[WrenchError]
    force_rms_N: float | None
    moment_rms_Nm: float | None
    missed_cycles: int
    timing: Timing | None
    refusals: list[str]
    notes: list[str]
    verdict: dict[str, Any] | None
    """the fields of truth_verdict_t; None in the log of a robot"""

    def to_json(self) -> dict[str, Any]:
        """Plain dicts, lists and numbers."""
        return asdict(self)


def runs(values: np.ndarray) -> list[tuple[int, int]]:
    """Maximal runs of equal values as half-open index ranges (first, end)."""
    if len(values) == 0:
        return []
    edges = np.flatnonzero(values[1:] != values[:-1]) + 1
    return list(pairwise([0, *edges.tolist(), len(values)]))


def name_of(names: tuple[str, ...], index: int) -> str:
    """names[index], or the number itself where a newer runtime knows more."""
    return names[index] if 0 <= index < len(names) else f"#{index}"


def body_error_m(log: Telemetry) -> np.ndarray:
    """Distance of the estimated body from its reference, (n,)."""
    error = log.state["body_position_w_m"] - log.state["body_reference_position_w_m"]
    return np.asarray(np.linalg.norm(error, axis=1))


def body_error_rad(log: Telemetry) -> np.ndarray:
    """Angle between estimated and reference orientation of the body, (n,)."""
    dot = np.einsum("ij,ij->i", log.state["body_quaternion_w"], log.state["body_reference_quaternion_w"])
    return np.asarray(2 * np.arccos(np.clip(np.abs(dot), 0, 1)))


def in_full_stance(log: Telemetry) -> np.ndarray:
    """(n, 4): climbing, the limb in stance and under its whole planned wrench."""
    loaded = (log.references["phase"] == STANCE) & (log.references["load"] > FULL_LOAD)
    return np.asarray(loaded & (log.state["supervisor_state"] == CLIMBING)[:, None])


def wrench_error(log: Telemetry) -> tuple[np.ndarray, np.ndarray]:
    """Length of measured minus reference force and moment of every limb, (n, 4) each."""
    force = np.linalg.norm(log.limbs["force_w_n"] - log.limbs["force_reference_w_n"], axis=2)
    moment = np.linalg.norm(log.limbs["moment_w_nm"] - log.limbs["moment_reference_w_nm"], axis=2)
    return force, moment


def _rms(values: np.ndarray) -> float | None:
    return float(np.sqrt(np.mean(values**2))) if values.size else None


def _limb(index: int) -> str | None:
    return None if index < 0 else name_of(LIMB_NAMES, index)


def _states(log: Telemetry) -> list[StateSpan]:
    state, time = log.state["supervisor_state"], log.time_s
    motion = np.zeros_like(state)
    if "motion" in (log.state.dtype.names or ()):  # not in logs of earlier runtimes
        motion = np.where(state == CLIMBING, log.state["motion"], 0)
    step = float(np.median(np.diff(time))) if len(time) > 1 else 0.0

    def name(row: int) -> str:
        way = f", {name_of(MOTION_NAMES, int(motion[row]))}" if motion[row] else ""
        return name_of(SUPERVISOR_STATES, int(state[row])) + way

    return [
        StateSpan(name(first), float(time[first]), float(time[end - 1]) + step)
        for first, end in runs(state.astype(int) + len(SUPERVISOR_STATES) * motion)
    ]


def _faults(log: Telemetry) -> list[FaultNote]:
    first_cycle, first_time = int(log.state["cycle"][0]), float(log.time_s[0])
    dt_s = float(log.inputs["dt_s"][0])
    notes = []
    for row in log.faults:
        fault = FAULT_BY_CODE.get(int(row["code"]))
        notes.append(
            FaultNote(
                time_s=first_time + (int(row["cycle"]) - first_cycle) * dt_s,
                code=int(row["code"]),
                name=fault.name if fault else "unknown",
                limb=_limb(int(row["limb"])),
                node=int(row["node"]),
                value=float(row["value"]),
                limit=float(row["limit"]),
                text=fault.describe(row["value"], row["limit"]) if fault else "a fault this version does not know",
            )
        )
    return notes


def _waits(log: Telemetry) -> list[Wait]:
    limb, reason = log.state["waiting_limb"].astype(int), log.state["waiting_for"].astype(int)
    dt_s = float(log.inputs["dt_s"][0])
    spans: dict[tuple[int, int], list[float]] = {}
    for first, end in runs((limb + 1) * len(WAIT_NAMES) + reason):
        if reason[first] > 0:
            spans.setdefault((int(limb[first]), int(reason[first])), []).append((end - first) * dt_s)
    return [
        Wait(_limb(limb_index), name_of(WAIT_NAMES, why), len(times), float(sum(times)), max(times))
        for (limb_index, why), times in sorted(spans.items())
    ]


def _tracking(log: Telemetry) -> Tracking:
    climbing = log.state["supervisor_state"] == CLIMBING
    if not climbing.any():
        return Tracking(None, None, None)
    error = body_error_m(log)[climbing]
    return Tracking(float(error.max()), _rms(error), float(np.degrees(body_error_rad(log)[climbing].max())))


def _timing(log: Telemetry) -> Timing | None:
    timing = log.timing
    if len(timing) < 2:
        return None
    after_first = timing[1:]
    period = np.diff(timing["wall_ns"]) / np.diff(timing["cycle"])

    def percentiles(values_ns: np.ndarray) -> list[float]:
        return [float(value) for value in np.percentile(values_ns, PERCENTILES) / NS_PER_US]

    return Timing(
        realtime=is_realtime(log),
        compute_us=percentiles(after_first["compute_ns"]),
        period_us=percentiles(period),
        late_us=percentiles(after_first["late_ns"]),
    )


def _verdict(log: Telemetry) -> dict[str, Any] | None:
    if log.verdict is None:
        return None
    fields = {name: (kind, getattr(log.verdict, name)) for name, kind, _ in MEMBERS["truth_verdict_t"]}
    return {name: bool(value) if kind == "int8_t" else value for name, (kind, value) in fields.items()}


def is_realtime(log: Telemetry) -> bool:
    """Whether the clock paced the runtime, and not the answers of the nodes."""
    return log.metadata.get("pace") == "clock"


def summarise(log: Telemetry) -> Summary:
    """All figures of a log."""
    stance = in_full_stance(log)
    force, moment = wrench_error(log)
    last = log.state[-1]
    return Summary(
        cycles=len(log.time_s),
        duration_s=float(len(log.time_s) * log.inputs["dt_s"][0]),
        plan_id=log.plan.plan_id if log.plan else None,
        scenario=log.plan.scenario_name if log.plan else None,
        robot=log.plan.robot_name if log.plan else None,
        plan_complete=bool(last["plan_complete"]),
        final_state=name_of(SUPERVISOR_STATES, int(last["supervisor_state"])),
        plan_time_s=float(last["plan_time_s"]),
        plan_end_s=float(last["plan_end_s"]),
        states=_states(log),
        faults=_faults(log),
        waits=_waits(log),
        tracking=_tracking(log),
        wrench=[
            WrenchError(limb, _rms(force[stance[:, i], i]), _rms(moment[stance[:, i], i]))
            for i, limb in enumerate(LIMB_NAMES)
        ],
        force_rms_N=_rms(force[stance]),
        moment_rms_Nm=_rms(moment[stance]),
        missed_cycles=int(last["missed_cycles"]),
        timing=_timing(log),
        refusals=[ack.reason for ack in log.acknowledgements if ack.verdict != 0],
        notes=log.notes,
        verdict=_verdict(log),
    )
