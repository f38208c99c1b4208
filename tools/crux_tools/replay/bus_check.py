"""The end-to-end checks of a log's CAN frames done again, and compared with what the runtime counted (/bus_health)."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from crux_contracts import LIMB_NAMES, can_codec
from crux_msgs import can_frames_t

from crux_tools.telemetry.can_frames import HEALTH, CanFrames, can_frames_of, checksum
from crux_tools.telemetry.cdr_table import decode_table, fixed_dtype
from crux_tools.telemetry.channels import Payloads

ID_BITS = 11  # of a standard identifier
COUNTS = ("crc_errors", "repeated", "lost")
UNREPEATED = ("Identity", "Emergency")  # a node that has restarted counts anew: these count all the same


@dataclass(frozen=True)
class BusCheck:
    """`frames` judged again; `first_difference` in words, None where all counts come out as logged."""

    frames: int
    first_difference: str | None


def checked(log: Payloads) -> BusCheck | None:
    """`log` has what it has of CHECKED. None for a log that has not the frames of every cycle."""
    frames = can_frames_of(log)
    if not len(frames.cycles) or frames.lost[1:].any() or (np.diff(frames.cycles) != 1).any():
        return None
    dtype = fixed_dtype(log.definitions.get(HEALTH, ""))
    if frames.cycles[0] > 1 or dtype is None or not log.payloads[HEALTH]:
        return None
    health = decode_table(log.payloads[HEALTH], dtype)
    rows = np.flatnonzero(frames.direction == can_frames_t.RECEIVED)
    counted_at = _counted_at(frames)[rows]
    verdicts = _verdicts(frames, rows)
    for limb, name in enumerate(LIMB_NAMES):
        told = health[health["limb"] == limb]
        told = told[told["cycle"] > 1]  # from the second on: before the first one nothing is in the log
        mine = frames.bus[rows] == limb
        for kind, field in enumerate(COUNTS):
            bad = counted_at[mine & (verdicts == kind)]
            counted = np.searchsorted(np.sort(bad), told["cycle"], "right")
            off = np.flatnonzero(np.diff(told[field]) != np.diff(counted))
            if len(off):
                cycle, before = (int(told["cycle"][off[0] + n]) for n in (1, 0))
                logged, again = (int(np.diff(values)[off[0]]) for values in (told[field], counted))
                words = f"cycles {before} to {cycle}, {name}: {field} {logged} in {HEALTH}, {again} by /can_frames"
                return BusCheck(len(rows), words)
    return BusCheck(len(rows), None)


def _counted_at(frames: CanFrames) -> np.ndarray:
    """(n,) the cycle whose /bus_health counts a frame first: its own when it was read before that cycle's sending."""
    sent = np.cumsum(frames.direction == can_frames_t.SENT)
    first = np.flatnonzero(np.diff(frames.cycle, prepend=frames.cycle[0] - 1))  # they stand in the order of cycles
    before = np.repeat(np.where(first > 0, sent[first - 1], 0), np.diff(np.append(first, len(sent))))
    return np.asarray(frames.cycle + (sent > before))


def _verdicts(frames: CanFrames, rows: np.ndarray) -> np.ndarray:
    """(len(rows),) an index of COUNTS for each received frame that was not simply good, else -1."""
    verdicts = np.full(len(rows), -1)
    lengths = {m.frame_id: (m.length, m.name) for m in can_codec.database().messages if "HOST" not in m.senders}
    keys = (frames.bus[rows].astype(np.uint16) << ID_BITS) | frames.identifier[rows].astype(np.uint16)
    order = np.argsort(keys, kind="stable")  # of 16 bits: by their digits, not by comparing
    for alike in np.split(order, np.flatnonzero(np.diff(keys[order])) + 1):
        identifier = int(frames.identifier[rows[alike[0]]]) if len(alike) else 0
        length, name = lengths.get(identifier, (0, ""))
        mine = alike[frames.length[rows[alike]] == length]
        if not length or not len(mine):
            continue
        data = frames.data[frames.begin[rows[mine]][:, None] + np.arange(length)]
        good = checksum(identifier, data) == (data[:, 0] | data[:, 1].astype(np.uint32) << 8)
        verdicts[mine[~good]] = COUNTS.index("crc_errors")
        step = np.diff(data[good, 2].astype(np.int64)) % 256
        again, gap = np.append(False, step == 0), np.append(False, step > 1)
        verdicts[mine[good][gap]] = COUNTS.index("lost")
        if not name.endswith(UNREPEATED):
            verdicts[mine[good][again]] = COUNTS.index("repeated")
    return verdicts
