"""CDR of the message types: XCDR1, little-endian, as ROS 2 and the generated C++ write it."""

from __future__ import annotations

import struct
from typing import Any

import crux_msgs
from crux_msgs.tables import MEMBERS

ENCAPSULATION = b"\x00\x01\x00\x00"
_FORMATS = {"int8_t": "b", "int16_t": "h", "int32_t": "i", "int64_t": "q", "byte": "B", "double": "d", "float": "f"}


class CdrError(ValueError):
    """Bytes that are no message of the type, or a message that is no CDR."""


class _Writer:
    def __init__(self) -> None:
        self.out = bytearray()

    def pack(self, code: str, values: Any, count: int) -> None:
        size = struct.calcsize(code)
        if count > 0:
            self.out += bytes(-len(self.out) % size) + struct.pack(f"<{count}{code}", *values)

    def text(self, value: str) -> None:
        data = value.encode("utf-8")
        self.pack("I", (len(data) + 1,), 1)
        self.out += data + b"\0"

    def message(self, type_name: str, message: Any) -> None:
        for name, kind, dimension in MEMBERS[type_name]:
            value = getattr(message, name)
            if dimension is None:
                self.elements(kind, (value,), 1)
                continue
            count = dimension if isinstance(dimension, int) else int(getattr(message, dimension))
            if len(value) != count:
                raise CdrError(f"{type_name}.{name} has {len(value)} elements, expected {count}")
            if isinstance(dimension, str):
                self.pack("I", (count,), 1)
            self.elements(kind, value, count)

    def elements(self, kind: str, values: Any, count: int) -> None:
        if kind in _FORMATS:
            self.pack(_FORMATS[kind], values, count)
            return
        for value in values:
            if kind == "string":
                self.text(value)
            else:
                self.message(kind, value)


class _Reader:
    def __init__(self, data: bytes) -> None:
        if data[:4] != ENCAPSULATION:
            raise CdrError("the bytes do not begin like little-endian CDR")
        self._data = data
        self._position = 4

    def unpack(self, code: str, count: int) -> tuple[Any, ...]:
        if count == 0:
            return ()
        size = struct.calcsize(code)
        start = self._position + -(self._position - 4) % size
        self._position = start + count * size
        if self._position > len(self._data):
            raise CdrError("the bytes end too early")
        return struct.unpack_from(f"<{count}{code}", self._data, start)

    def text(self) -> str:
        length = int(self.unpack("I", 1)[0])
        start, self._position = self._position, self._position + length
        if length == 0 or self._position > len(self._data) or self._data[self._position - 1] != 0:
            raise CdrError("a string does not end")
        try:
            return self._data[start : self._position - 1].decode("utf-8")
        except UnicodeDecodeError:
            raise CdrError("a string is not UTF-8") from None

    def message(self, type_name: str) -> Any:
        message = getattr(crux_msgs, type_name)()
        for name, kind, dimension in MEMBERS[type_name]:
            if dimension is None:
                setattr(message, name, self.elements(kind, 1)[0])
                continue
            count = dimension if isinstance(dimension, int) else int(self.unpack("I", 1)[0])
            if isinstance(dimension, str) and count != getattr(message, dimension):
                raise CdrError(
                    f"{type_name}.{name} has {count} elements, {dimension} says {getattr(message, dimension)}"
                )
            if count > len(self._data):
                raise CdrError(f"{type_name}.{name} is longer than the bytes")
            values = self.elements(kind, count)
            setattr(message, name, bytes(values) if kind == "byte" else values)
        return message

    def elements(self, kind: str, count: int) -> list[Any]:
        if kind in _FORMATS:
            return list(self.unpack(_FORMATS[kind], count))
        return [self.text() if kind == "string" else self.message(kind) for _ in range(count)]

    def finish(self) -> None:
        if self._position != len(self._data):
            raise CdrError(f"{len(self._data) - self._position} bytes too many")


def encode(message: Any) -> bytes:
    """Bytes of a crux_msgs message with the encapsulation header. Raises CdrError, e.g. for a wrong array length."""
    writer = _Writer()
    try:
        writer.message(type(message).__name__, message)
    except struct.error as error:
        raise CdrError(f"{type(message).__name__}: {error}") from None
    return ENCAPSULATION + bytes(writer.out)


def decode(type_name: str, data: bytes) -> Any:
    """The message of a type ("plan_t") from its bytes. Raises CdrError."""
    reader = _Reader(data)
    message = reader.message(type_name)
    reader.finish()
    return message
