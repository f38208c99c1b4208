"""The CAN frames of a log (/can_frames), all of them as columns."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from crux_tools.telemetry.reader import CAN_FRAMES, Payloads, read_payloads

_ENCAPSULATION = 4  # bytes before the message, from whose end alignment counts
_COLUMNS = (("host_ns", "<i8"), ("stamp_ns", "<i8"), ("identifier", "<i2"), ("bus", "<i1"), ("direction", "<i1"),
            ("length", "<i1"))  # fmt: skip


@dataclass(frozen=True)
class CanFrames:
    """n frames in the order in which the runtime sent and read them; fields as in can_frames_t."""

    cycles: np.ndarray  # (m,) of the messages
    lost: np.ndarray  # (m,) frames that found no room in their messages
    cycle: np.ndarray  # (n,) of the message that a frame is in
    log_ns: np.ndarray  # (n,) log time of that message
    host_ns: np.ndarray
    stamp_ns: np.ndarray
    identifier: np.ndarray
    bus: np.ndarray
    direction: np.ndarray
    length: np.ndarray
    begin: np.ndarray  # (n,) of its payload in `data`
    data: np.ndarray  # bytes

    def payload(self, row: int) -> bytes:
        """Of one frame."""
        return self.data[self.begin[row] : self.begin[row] + self.length[row]].tobytes()


def read_can_frames(path: Path) -> CanFrames:
    """Raises LogError as the reader does; a log without frames gives none."""
    return can_frames_of(read_payloads(path, {CAN_FRAMES}))


def can_frames_of(log: Payloads) -> CanFrames:
    """The frames among messages that have been read."""
    payloads = log.payloads.get(CAN_FRAMES, [])
    parts: dict[str, list[np.ndarray]] = {name: [] for name, _ in (*_COLUMNS, ("data", ""))}
    cycles = np.zeros(len(payloads), dtype=np.int64)
    counts = np.zeros(len(payloads), dtype=np.int64)
    lost = np.zeros(len(payloads), dtype=np.int64)
    for row, payload in enumerate(payloads):
        body = memoryview(payload)[_ENCAPSULATION:]
        cycles[row] = np.frombuffer(body, "<i8", 1)[0]
        lost[row], counts[row] = np.frombuffer(body, "<i4", 2, 8)
        at = 16
        for name, kind in _COLUMNS:
            values, at = _sequence(body, at, kind)
            parts[name].append(values)
        values, _ = _sequence(body, -(-at // 4) * 4 + 4, "<u1")
        parts["data"].append(values)
    whole = {name: np.concatenate(each) if each else np.empty(0, np.int64) for name, each in parts.items()}
    length = whole["length"].astype(np.int64)
    times_ns = np.array(log.times_ns.get(CAN_FRAMES, []), dtype=np.int64)
    return CanFrames(
        cycles=cycles,
        lost=lost,
        cycle=np.repeat(cycles, counts),
        log_ns=np.repeat(times_ns, counts),
        begin=np.cumsum(length) - length,
        **(whole | {"length": length}),
    )


def _sequence(body: memoryview, at: int, kind: str) -> tuple[np.ndarray, int]:
    """The numbers of a CDR sequence at byte `at` or behind, and where it ends."""
    size = np.dtype(kind).itemsize
    at = -(-at // 4) * 4
    count = int(np.frombuffer(body, "<u4", 1, at)[0])
    at = -(-(at + 4) // size) * size if count else at + 4
    return np.frombuffer(body, kind, count, at) if count else np.empty(0, kind), at + count * size
