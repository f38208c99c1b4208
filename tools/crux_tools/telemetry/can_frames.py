"""The CAN frames of a log (/can_frames), all of them as columns."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

import numpy as np

from crux_tools.telemetry.channels import CAN_FRAMES, Payloads, read_payloads

HEALTH = "/bus_health"
CHECKED = {HEALTH, CAN_FRAMES}  # what the end-to-end checks are done again with
_ENCAPSULATION = 4  # bytes before the message, from whose end alignment counts
_HEAD = np.dtype([("encapsulation", "<u4"), ("cycle", "<i8"), ("lost", "<i4"), ("count", "<i4"), ("size", "<u4")])
_COLUMNS = (("host_ns", "<i8"), ("stamp_ns", "<i8"), ("identifier", "<i2"), ("bus", "<i1"), ("direction", "<i1"),
            ("length", "<i1"))  # fmt: skip
POLYNOMIAL = 0x1021  # of the end-to-end checksum, msgs/can/e2e.h


def _crc_table() -> np.ndarray:
    value = np.arange(256, dtype=np.uint32) << 8
    for _ in range(8):
        value = np.where(value & 0x8000, value << 1 ^ POLYNOMIAL, value << 1) & 0xFFFF
    return value


_CRC_TABLE = _crc_table()


def checksum(identifier: int, data: np.ndarray) -> np.ndarray:
    """(n,) end-to-end checksums of payloads (n, length) of an identifier."""
    crc = np.full(len(data), 0xFFFF, dtype=np.uint32)
    for column in (*data[:, 2:].T, *(np.full(len(data), byte) for byte in (identifier & 0xFF, identifier >> 8))):
        crc = (crc << 8 ^ _CRC_TABLE[crc >> 8 ^ column]) & 0xFFFF
    return crc


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
    heads = np.frombuffer(b"".join(payload[: _HEAD.itemsize] for payload in payloads), _HEAD)
    counts, sizes = heads["count"].astype(np.int64), np.array([len(payload) for payload in payloads], np.int64)
    ends, whole = np.cumsum(counts), {name: np.empty(int(counts.sum()), kind) for name, kind in _COLUMNS}
    data: list[np.ndarray] = [np.empty(0, np.uint8)] * len(payloads)
    # Messages of as many frames and bytes have one layout: they are taken apart together.
    for count, size in np.unique(np.stack([counts, sizes], axis=1), axis=0).tolist():
        mine = np.flatnonzero((counts == count) & (sizes == size))
        block = np.frombuffer(b"".join(payloads[row] for row in mine), np.uint8).reshape(-1, size)[:, _ENCAPSULATION:]
        places = (ends - counts)[mine][:, None] + np.arange(count)
        at = _HEAD.itemsize - _ENCAPSULATION - 4
        for name, kind in _COLUMNS:
            values, at = _sequence(block, at, kind, count)
            whole[name][places] = values
        begin = _ENCAPSULATION + -(-at // 4) * 4 + 8  # behind n_bytes and the sequence's own count
        for row, length in zip(mine, whole["length"][places].sum(axis=1, dtype=np.int64), strict=True):
            data[row] = np.frombuffer(payloads[row], np.uint8, length, begin)
    length = whole["length"].astype(np.int64)
    times_ns = np.array(log.times_ns.get(CAN_FRAMES, []), dtype=np.int64)
    return CanFrames(
        cycles=heads["cycle"].copy(),
        lost=heads["lost"].astype(np.int64),
        cycle=np.repeat(heads["cycle"], counts),
        log_ns=np.repeat(times_ns, counts),
        begin=np.cumsum(length) - length,
        data=np.concatenate(data) if data else np.empty(0, np.uint8),
        **(whole | {"length": length}),
    )


def _sequence(block: np.ndarray, at: int, kind: str, count: int) -> tuple[np.ndarray, int]:
    """A CDR sequence of `count` numbers at byte `at` or behind in each of the messages, and where it ends."""
    size = np.dtype(kind).itemsize
    at = -(-at // 4) * 4 + 4
    if not count:
        return np.empty((len(block), 0), kind), at
    at = -(-at // size) * size
    return block[:, at : at + count * size].copy().view(kind), at + count * size
