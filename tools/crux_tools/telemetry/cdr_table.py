"""ROS 2 message definitions of fixed size as NumPy record types, so that a whole channel decodes in one step.

CDR (the plain little-endian kind that mcap profile `ros2` carries) aligns every number to its own size, counted from
the end of the four-byte encapsulation header. A message without strings, sequences and nested messages therefore has
one layout, which a structured dtype with offsets says exactly.
"""

from __future__ import annotations

import re

import numpy as np

ENCAPSULATION_BYTES = 4
LITTLE_ENDIAN_HEADER = b"\x00\x01"
MOST_BYTES = 16_384  # of a message: the newest one stands for every cycle until the next. control_input has 1 kB
NUMBERS = {
    "bool": "u1",
    "byte": "u1",
    "char": "u1",
    "int8": "i1",
    "uint8": "u1",
    "int16": "<i2",
    "uint16": "<u2",
    "int32": "<i4",
    "uint32": "<u4",
    "int64": "<i8",
    "uint64": "<u8",
    "float32": "<f4",
    "float64": "<f8",
}
_FIELD = re.compile(r"^(?P<type>[a-z0-9]+)(\[(?P<count>\d+)\])?\s+(?P<name>[a-z][a-z0-9_]*)$")


def fixed_dtype(definition: str) -> np.dtype | None:
    """Record type of a ROS 2 message definition, header included; None where a field has no fixed size. Raises
    ValueError for one of more than MOST_BYTES."""
    names: list[str] = []
    formats: list[tuple[str, tuple[int, ...]]] = []
    offsets: list[int] = []
    offset = 0
    for raw in definition.splitlines():
        line = raw.split("#", 1)[0].strip()
        if not line or "=" in line:
            continue
        match = _FIELD.match(line)
        if match is None or match["type"] not in NUMBERS:
            return None
        number = np.dtype(NUMBERS[match["type"]])
        count = int(match["count"]) if match["count"] else None
        offset += -offset % number.itemsize
        names.append(match["name"])
        formats.append((number.str, () if count is None else (count,)))
        offsets.append(ENCAPSULATION_BYTES + offset)
        offset += number.itemsize * (1 if count is None else count)
    if not names:
        return None
    if offset > MOST_BYTES:
        raise ValueError(f"messages of {offset} bytes, expected at most {MOST_BYTES}")
    return np.dtype({"names": names, "formats": formats, "offsets": offsets, "itemsize": ENCAPSULATION_BYTES + offset})


def decode_table(payloads: list[bytes], dtype: np.dtype) -> np.ndarray:
    """All messages of one channel, (n,), from their CDR bytes. Raises ValueError where a message has another size."""
    wrong = [payload for payload in payloads if len(payload) < dtype.itemsize or payload[:2] != LITTLE_ENDIAN_HEADER]
    if wrong:
        raise ValueError(f"a message of {len(wrong[0])} bytes where {dtype.itemsize} are defined")
    if any(len(payload) != dtype.itemsize for payload in payloads):  # writers may pad the end
        payloads = [payload[: dtype.itemsize] for payload in payloads]
    return np.frombuffer(b"".join(payloads), dtype=dtype)
