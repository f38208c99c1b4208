"""CAN frames of a log, as candump, SavvyCAN and Vector's tools read them.

A log of --log-frames has the frames. Any other has the signals of the cyclic frames: they are made anew from the
commands the runtime gave and the answers it took, by the CAN database. Signals, their steps, counters and checksums are
those of the bus; the time of a frame within its cycle, temperatures (-128, not known), heartbeats and emergencies are
not in such a log.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import can
import numpy as np
from cantools.database.can import Message
from crux_contracts import LIMB_NAMES, can_codec
from crux_contracts.robot import Robot
from crux_msgs import can_frames_t

from crux_tools.log.seen import NS, Seen
from crux_tools.telemetry import Telemetry
from crux_tools.telemetry.can_frames import CanFrames, checksum

WRITERS = {"asc": can.ASCWriter, "blf": can.BLFWriter, "candump": can.CanutilsLogWriter}
UNKNOWN_DEGC = -128

Signals = dict[str, np.ndarray | float]


def packed(message: Message, signals: Signals, counter: np.ndarray) -> np.ndarray:
    """(n, length) payloads of a message of the database, with counters (n,) and checksums; what is left out is 0.

    Values out of a signal's range are clipped, as the runtime does it.
    """
    data = np.zeros((len(counter), message.length), dtype=np.uint8)
    for signal in message.signals:
        value = np.asarray(signals.get(signal.name, 0.0), dtype=np.float64)
        if signal.is_float:
            raw = np.broadcast_to(value.astype("<f4"), len(counter)).copy().view("<u4").astype(np.uint64)
        else:
            least = -(1 << signal.length - 1) if signal.is_signed else 0
            steps = np.round((value - signal.offset) / signal.scale)
            whole = np.clip(steps, least, least + (1 << signal.length) - 1).astype(np.int64)
            raw = np.broadcast_to(whole, len(counter)).astype(np.uint64) & np.uint64((1 << signal.length) - 1)
        shifted = raw << np.uint64(signal.start % 8)
        first, last = signal.start // 8, (signal.start + signal.length - 1) // 8
        for byte in range(first, last + 1):
            data[:, byte] |= (shifted >> np.uint64(8 * (byte - first)) & np.uint64(0xFF)).astype(np.uint8)
    data[:, 2] = counter % 256
    crc = checksum(message.frame_id, data)
    data[:, 0], data[:, 1] = crc & 0xFF, crc >> 8
    return data


def _joint(log: Telemetry, robot: Robot, limb: int, joint: int) -> Iterator[tuple[Message, Signals, np.ndarray]]:
    """Status and command of a joint over all cycles, and in which the frame was there."""
    node, at = can_codec.JOINT_NODES[joint], limb * robot.slots + joint
    ins, outs = log.inputs, log.outputs
    yield (
        can_codec.message("JointStatus", node),
        {
            "State": ins["joint_state"][:, at],
            "Position_rad": ins["joint_position_rad"][:, at],
            "Velocity_rad_s": ins["joint_velocity_rad_s"][:, at],
            "Torque_Nm": ins["joint_torque_nm"][:, at],
            "CycleEcho": (ins["cycle"] - 1) & 0xFFFF,
            "Faults": ins["joint_faults"][:, at] & 0xFF,
            "Temperature_degC": UNKNOWN_DEGC,
        },
        ins["joint_fresh"][:, at] != 0,
    )
    yield (
        can_codec.message("JointCommand", node),
        {
            "Mode": outs["joint_mode"][:, at],
            "Position_rad": outs["joint_position_rad"][:, at],
            "Velocity_rad_s": outs["joint_velocity_rad_s"][:, at],
            "Torque_Nm": outs["joint_torque_nm"][:, at],
            "Kp_Nm_rad": robot.servo.position_gain_Nm_rad[joint],
            "Kd_Nms_rad": robot.servo.velocity_gain_Nms_rad[joint],
        },
        np.ones(len(outs), dtype=bool),
    )


def _gripper(log: Telemetry, limb: int) -> Iterator[tuple[Message, Signals, np.ndarray]]:
    ins, outs = log.inputs, log.outputs
    echo = (ins["cycle"] - 1) & 0xFFFF
    force, moment = (ins[name].reshape(len(ins), len(LIMB_NAMES), 3) for name in ("ft_force_g_n", "ft_moment_g_nm"))
    wrench: Signals = {f"Force{axis}_N": force[:, limb, i] for i, axis in enumerate("XYZ")}
    wrench |= {f"Moment{axis}_Nm": moment[:, limb, i] for i, axis in enumerate("XYZ")}
    yield (
        can_codec.message("GripperStatus"),
        {
            "State": ins["gripper_state"][:, limb],
            "Opening_m": ins["finger_opening_m"][:, limb],
            "Speed_m_s": ins["finger_speed_m_s"][:, limb],
            "Force_N": ins["finger_force_n"][:, limb],
            "CycleEcho": echo,
            "Faults": ins["gripper_faults"][:, limb] & 0xFF,
            "Temperature_degC": UNKNOWN_DEGC,
        },
        ins["gripper_fresh"][:, limb] != 0,
    )
    yield (
        can_codec.message("ForceTorque"),
        {"Status": ins["ft_status"][:, limb], "CycleEcho": echo, **wrench},
        (ins["ft_fresh"][:, limb] != 0) & np.isfinite(force[:, limb]).all(axis=1),
    )
    every = np.ones(len(outs), dtype=bool)
    yield (
        can_codec.message("GripperCommand"),
        {
            "Mode": outs["gripper_mode"][:, limb],
            "Opening_m": outs["finger_opening_m"][:, limb],
            "SpeedLimit_m_s": outs["finger_speed_limit_m_s"][:, limb],
            "ForceLimit_N": outs["finger_force_limit_n"][:, limb],
        },
        every,
    )
    yield can_codec.message("Sync"), {"Cycle": outs["cycle"]}, every


@dataclass(frozen=True)
class Frames:
    """One identifier of one bus: payloads (m, length) and the cycles, as rows of the log, they belong to."""

    channel: int
    identifier: int
    is_answer: bool
    rows: np.ndarray
    data: np.ndarray


def frames(log: Telemetry, robot: Robot) -> list[Frames]:
    """All frames, a bus after the other, each in the order of a cycle: answers, commands, Sync."""
    found = []
    for limb in range(len(LIMB_NAMES)):
        joints = [part for joint in range(len(robot.limbs[limb].joints)) for part in _joint(log, robot, limb, joint)]
        for message, signals, there in sorted([*joints, *_gripper(log, limb)], key=lambda part: _order(part[0])):
            rows = np.flatnonzero(there)
            chosen = {name: value[rows] if isinstance(value, np.ndarray) else value for name, value in signals.items()}
            data = packed(message, chosen, np.arange(len(rows)))
            found.append(Frames(robot.limbs[limb].bus, message.frame_id, _is_answer(message), rows, data))
    return found


def _is_answer(message: Message) -> bool:
    return "HOST" not in message.senders


def _order(message: Message) -> tuple[bool, bool, int]:
    return not _is_answer(message), message.name == "Sync", message.frame_id


def write_can(path: Path, form: str, seen: Seen, logged: CanFrames) -> int:
    """Writes the frames of all buses in every cycle, as `logged` where every cycle is; returns their number."""
    with path.open("wb" if form == "blf" else "w") as file, WRITERS[form](file) as writer:
        whole = len(logged.cycles) >= len(seen.log.time_s)
        return _write_logged(writer, seen, logged) if whole else _write_made(writer, seen)


def _write_logged(writer: Any, seen: Seen, logged: CanFrames) -> int:
    """A frame's time is its cycle's, and what had passed since the first frame of that cycle, a cycle at most."""
    _, first = np.unique(logged.cycle, return_index=True)
    begin_ns = np.repeat(logged.host_ns[first], np.diff(np.append(first, len(logged.cycle))))
    within_ns = np.minimum(logged.host_ns - begin_ns, round(seen.log.inputs["dt_s"][0] * NS))
    times_s = seen.clock(logged.log_ns + within_ns) / NS
    rows = np.flatnonzero(logged.direction != can_frames_t.ECHO)
    for row in rows.tolist():
        identifier, is_rx = int(logged.identifier[row]), logged.direction[row] == can_frames_t.RECEIVED
        channel = seen.robot.limbs[logged.bus[row]].bus
        writer.on_message_received(_message(times_s[row], channel, identifier, logged.payload(row), bool(is_rx)))
    return len(rows)


def _message(time_s: float, channel: int, identifier: int, data: bytes, is_rx: bool) -> can.Message:
    return can.Message(
        timestamp=time_s,
        arbitration_id=identifier,
        is_extended_id=False,
        channel=channel,
        data=data,
        is_fd=True,
        bitrate_switch=True,
        is_rx=is_rx,
    )


def _write_made(writer: Any, seen: Seen) -> int:
    kinds = frames(seen.log, seen.robot)
    times_ns = seen.clock(np.round(seen.log.time_s * NS).astype(np.int64))
    count = 0
    next_of = [0] * len(kinds)
    for row, time_ns in enumerate(times_ns.tolist()):
        for i, kind in enumerate(kinds):
            at = next_of[i]
            if at < len(kind.rows) and kind.rows[at] == row:
                next_of[i] = at + 1
                count += 1
                data = kind.data[at].tobytes()
                writer.on_message_received(_message(time_ns / NS, kind.channel, kind.identifier, data, kind.is_answer))
    return count
