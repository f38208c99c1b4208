"""Decoders of messages by the definition that a file brings, refused where a few bytes could decode into much."""

from __future__ import annotations

import re
from collections.abc import Callable
from typing import Any

import numpy as np
from mcap.records import Schema
from mcap_ros2.decoder import DecoderFactory

from crux_tools.telemetry.cdr_table import NUMBERS

OBJECT_BYTES = 8  # of numbers that each message inside another has at least; an object takes some 150 bytes of memory
_SEPARATOR = re.compile(r"^={3,}$", re.MULTILINE)
_NAME = re.compile(r"^MSG:\s+(\S+)$", re.MULTILINE)
_FIELD = re.compile(r"(?P<type>[\w/]+)(\[(?P<count>\d+)\])?\s+\w+")
_Least = tuple[int, int]  # bytes, and objects they become


def decoder_of(schema: Schema) -> Callable[[bytes], Any] | None:
    """Of CDR messages of a schema; None where there is none. Raises ValueError for a definition of which a message of a
    few bytes could take memory without bound: the library reads past the end of a message where a field takes nothing.
    """
    main, *parts = _SEPARATOR.split("\n".join(filter(str.strip, schema.data.decode().splitlines())))
    lines = {_short(schema.name): main.splitlines()}
    named = {_short(found[1]): part.splitlines() for part in parts if (found := _NAME.search(part))}
    lines |= named
    known: dict[str, _Least | None] = {}
    _least(_short(schema.name), lines, known)
    for name in named:
        size, objects = _least(name, lines, known)
        if size < OBJECT_BYTES * objects:
            raise ValueError(f"{name} may take {size} bytes, expected {OBJECT_BYTES * objects} at least")
    return DecoderFactory().decoder_for("cdr", schema)


def _short(name: str, package: str = "") -> str:
    """Package and name of a type, as fields give them."""
    first, *more = name.split("/")
    return f"{first}/{more[-1]}" if more else f"{package}/{first}"


def _least(name: str, lines: dict[str, list[str]], known: dict[str, _Least | None]) -> _Least:
    """What a message takes at least: only of fields of which that is sure."""
    if name in known:
        found = known[name]
        if found is None:
            raise ValueError(f"{name} is in itself")
        return found
    known[name] = None
    size, objects = 0, 1
    for line in lines.get(name, []):
        field = _FIELD.fullmatch(line.split("#", 1)[0].strip())
        if field is None:
            continue
        count, kind = int(field["count"] or 1), _short(field["type"], name.split("/", maxsplit=1)[0])
        if (number := NUMBERS.get(field["type"])) is not None:
            # An array of single bytes is cut from the message without a look at its end.
            size += count * np.dtype(number).itemsize if not field["count"] or number != "u1" else 0
        elif kind in lines:
            part = _least(kind, lines, known)
            size, objects = size + count * part[0], objects + count * part[1]
    known[name] = size, objects
    return size, objects
