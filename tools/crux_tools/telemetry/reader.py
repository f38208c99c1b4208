"""Reads a telemetry log: one climb, its channels aligned by control cycle.

A log that ends in mid-write opens as far as it was written; what is missing is said in `Telemetry.notes`.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from crux_contracts import N_LIMBS
from crux_contracts.channels import BY_TOPIC
from crux_msgs import truth_verdict_t
from crux_msgs.tables import MEMBERS

from crux_tools.telemetry.channels import Channels, LogError, read_channels
from crux_tools.telemetry.description import difference
from crux_tools.telemetry.log_format import newer_format

# Fields that logs of earlier runtimes do not have, and that nothing here needs.
ADDED = {
    "/control_input": {"bus_state", "command_value", "late_s"},
    "/plan": {"lean_rad", "tilt_rad", "gripper_tilt_w_rad"},
    "/command": {"value"},
    "/cycle_timing": {"answer_ns"},
    "/limb_reference": {"gripper_tilt_w_rad"},
    "/limb_telemetry": {
        *("utilisation", "stance_shift_g_m", "stance_turn_g_rad", "slip_m"),
        *("borne_friction", "slip_friction", "compliance_m_n", "admittance_gains"),
    },
    "/robot_state": {"motion", "speed_scale", "verified_time_s", "unbalanced_force_w_n", "unbalanced_moment_w_nm"},
}
PER_LIMB = ("/limb_reference", "/limb_telemetry")  # shared_topic() of each limb's
STATE_TOPIC = "/robot_state"
EVERY_CYCLE = (STATE_TOPIC, "/control_input", "/control_output")
PER_CYCLE = (*EVERY_CYCLE, *PER_LIMB)


@dataclass(frozen=True)
class Telemetry:
    """One climb as it was logged. Row i of every per-cycle table belongs to the same control cycle.

    Field names of the record arrays are those of msgs/lcm; limbs LF, RF, LR, RR.
    """

    path: Path
    plan: Any  # a plan_t as decoded from the log, None before the runtime accepted one; the last of
    plans: list[tuple[float, Any]]  # all, with their log times [s]
    time_s: np.ndarray  # (n,) log time: cycle * dt
    state: np.ndarray  # (n,) robot_state
    inputs: np.ndarray  # (n,) control_input
    outputs: np.ndarray  # (n,) control_output
    references: np.ndarray  # (n, 4) limb_reference, the newest one up to the cycle
    limbs: np.ndarray  # (n, 4) limb_telemetry, likewise
    limbs_fresh: np.ndarray  # (n,) whether references and limbs are of this very cycle
    timing: np.ndarray  # (m,) cycle_timing, perhaps of other cycles too
    faults: np.ndarray  # (f,) fault
    buses: np.ndarray  # (b,) bus_health, of every limb in turn
    acknowledgements: list[Any]
    commands: list[Any]
    metadata: dict[str, str]
    robot_files: dict[str, bytes]  # the robot description, empty in logs of earlier runtimes; see description.py
    end: dict[str, str] | None  # cycles, unanswered, missed_deadlines, dropped_records; None: killed, or still running
    notes: list[str]
    verdict: truth_verdict_t | None  # of the simulation's judge; None in the log of a robot or an earlier crux


def _by_limb(table: np.ndarray, times_ns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Cycles in which all four limbs were logged: (m, 4) records and (m,) times."""
    rows = [table["limb"] == limb for limb in range(N_LIMBS)]
    times = times_ns[rows[0]]
    for row in rows[1:]:
        times = np.intersect1d(times, times_ns[row])
    picked = [table[row][np.searchsorted(times_ns[row], times)] for row in rows]
    return np.stack(picked, axis=1), times


def _are_known(cycles_ns: np.ndarray, logged_ns: np.ndarray) -> np.ndarray:
    """(n,) Whether the record of a channel that is logged every so many cycles is there, not lost with its chunk."""
    if not len(logged_ns):
        return np.zeros(len(cycles_ns), dtype=bool)
    newest = np.searchsorted(logged_ns, cycles_ns, "right") - 1
    every_ns = np.diff(logged_ns).min(initial=np.iinfo(np.int64).max)
    return np.asarray((newest >= 0) & (cycles_ns - logged_ns[newest] < every_ns))


def read_log(path: Path) -> Telemetry:
    """A telemetry log; raises LogError when it is none or holds not one whole control cycle."""
    return telemetry_of(path, read_channels(path))


def is_log(channels: Channels) -> bool:
    """Whether a file is a telemetry log (and not a plan)."""
    return STATE_TOPIC in channels.tables


def telemetry_of(path: Path, channels: Channels) -> Telemetry:
    """The telemetry in channels already read; see read_log. Chunks that were left out, and that a log is of a newer
    format than is known here, stand in its notes, or behind the reason why it cannot be read.
    """
    newer = newer_format(channels.metadata)
    try:
        return _telemetry_of(path, channels, [newer] if newer else [])
    except LogError as error:
        raise LogError("; ".join([str(error), *channels.notes, *([newer] if newer else [])])) from None


def _lacking(message: Any, type_name: str) -> set[str]:
    """Fields of its type that a decoded message does not have, those of messages within it too."""
    lacking = set[str]()
    for name, kind, dimension in MEMBERS[type_name]:
        value = getattr(message, name, None)
        if value is None:
            lacking.add(name)
        elif kind in MEMBERS and (dimension is None or len(value)):
            lacking |= _lacking(value if dimension is None else value[0], kind)
    return lacking


def _telemetry_of(path: Path, channels: Channels, remarks: list[str]) -> Telemetry:
    tables = {topic: table for topic, table in channels.tables.items() if topic in BY_TOPIC}
    times_ns = dict(channels.times_ns)
    if not is_log(channels):
        raise LogError(f"{path}: no channel {STATE_TOPIC} in it: this is not a telemetry log")
    missing = [topic for topic in PER_CYCLE if topic not in tables]
    if missing:
        raise LogError(f"{path}: no channel {', '.join(missing)} in it: the log is cut off before its first cycle")
    for topic, table in tables.items():
        known = {name for name, *_ in MEMBERS[BY_TOPIC[topic].type]} - ADDED.get(topic, set())
        lacking = known - set(table.dtype.names or ())
        if lacking:
            raise LogError(f"{path}: channel {topic} has no {', '.join(sorted(lacking))}: written by another crux?")
    for topic, messages in channels.messages.items():
        found = _lacking(messages[0], BY_TOPIC[topic].type) if messages and topic in BY_TOPIC else set()
        if lacking := found - ADDED.get(topic, set()):
            raise LogError(f"{path}: channel {topic} has no {', '.join(sorted(lacking))}: written by another crux?")
    for topic in PER_LIMB:
        tables[topic], times_ns[topic] = _by_limb(tables[topic], times_ns[topic])
    common_ns = times_ns[EVERY_CYCLE[0]]
    for topic in EVERY_CYCLE[1:]:
        common_ns = np.intersect1d(common_ns, times_ns[topic])
    for topic in PER_LIMB:
        common_ns = common_ns[_are_known(common_ns, times_ns[topic])]
    if len(common_ns) == 0:
        raise LogError(f"{path}: the log holds not one whole control cycle")
    # Limb channels are logged less often (log_every in msgs/channels.yaml): their newest record stands until the next.
    aligned = {topic: tables[topic][np.searchsorted(times_ns[topic], common_ns, "right") - 1] for topic in PER_CYCLE}
    notes = [*remarks, *channels.notes]
    if channels.end is None:
        notes.append("the log was not closed (cut off, or its runtime killed or still writing): read as far as it goes")
    elif channels.end.get("dropped_records", "0") != "0":
        notes.append(f"{channels.end['dropped_records']} cycles are missing: the log's queue was full")
    other_robot = difference(channels.metadata, channels.attachments)
    notes += [other_robot] if other_robot else []
    plans, verdicts = channels.messages.get("/plan", []), channels.messages.get("/truth/verdict", [])
    return Telemetry(
        path=path,
        plan=_with_turns(plans[-1]) if plans else None,
        plans=list(zip((times_ns["/plan"] * 1e-9).tolist(), plans, strict=True)) if plans else [],
        time_s=common_ns * 1e-9,
        state=aligned[STATE_TOPIC],
        inputs=aligned["/control_input"],
        outputs=aligned["/control_output"],
        references=aligned["/limb_reference"],
        limbs=aligned["/limb_telemetry"],
        limbs_fresh=np.logical_and.reduce([np.isin(common_ns, times_ns[topic]) for topic in PER_LIMB]),
        timing=tables.get("/cycle_timing", np.empty(0)),
        faults=tables.get("/fault", np.empty(0)),
        buses=tables.get("/bus_health", np.empty(0)),
        acknowledgements=channels.messages.get("/acknowledgement", []),
        commands=channels.messages.get("/command", []),
        metadata=channels.metadata,
        robot_files=channels.attachments,
        end=channels.end,
        notes=notes,
        verdict=verdicts[-1] if verdicts else None,
    )


def _with_turns(plan: Any) -> Any:
    """The plan of a log; older ones do not say how faces lean, and holds and grippers are turned: none were."""
    for hold in plan.holds:
        for name, count in (("lean_rad", 4), ("tilt_rad", 2)):
            if not hasattr(hold, name):
                setattr(hold, name, [0.0] * count)
    for limb in (limb for knot in plan.knots for limb in knot.limbs):
        if not hasattr(limb, "gripper_tilt_w_rad"):
            limb.gripper_tilt_w_rad = [0.0] * 2
    return plan
