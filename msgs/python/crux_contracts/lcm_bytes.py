"""LCM messages from bytes that may be hostile."""

from __future__ import annotations

import struct
from typing import Protocol, TypeVar, cast


class Message(Protocol):
    """What lcm-gen makes of a type."""

    def encode(self) -> bytes:
        """As it goes over LCM."""
        ...


M = TypeVar("M", bound=Message)


def decoded(kind: type[M], data: bytes) -> M:
    """The message that has exactly these bytes. Raises ValueError for any others: lcm-gen's decoder raises other errors
    for some of them, and reads the rest as if they were whole."""
    try:
        message = cast("M", kind.decode(data))  # type: ignore[attr-defined]
        whole = message.encode() == data
    except (ValueError, struct.error, OverflowError, MemoryError) as error:
        raise ValueError(f"no {kind.__name__}: {error}") from None
    if not whole:
        raise ValueError(f"no {kind.__name__}: bytes are missing or left over")
    return message
