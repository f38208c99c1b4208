"""The records of an MCAP file as a stream, also of a file that ends in mid-write."""

from __future__ import annotations

import os
import struct
from collections.abc import Iterator
from contextlib import suppress
from io import BytesIO
from typing import IO, Any

from mcap.data_stream import ReadDataStream
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Message, Schema
from mcap.stream_reader import StreamReader

MAGIC = b"\x89MCAP0\r\n"
READ = {  # of the rest, indexes and what else a summary repeats, only the length is looked at
    Opcode.HEADER, Opcode.FOOTER, Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE, Opcode.CHUNK, Opcode.METADATA,
    Opcode.ATTACHMENT,
}  # fmt: skip
RECORD = struct.Struct("<BQ")
READ_ERRORS = (McapError, struct.error, ValueError, RuntimeError, EOFError, KeyError, OverflowError)


def record_at(file: IO[bytes], size: int) -> Any:
    """The record that comes next in a file of so many bytes, a chunk whole. It takes no more memory than it has bytes
    in the file, whatever it says of itself. Raises one of READ_ERRORS, also for a record of an unknown kind.
    """
    _, length = RECORD.unpack(file.read(RECORD.size))
    if length > size:
        raise EOFError
    file.seek(-RECORD.size, os.SEEK_CUR)
    whole = file.read(RECORD.size + length)
    if len(whole) < RECORD.size + length:
        raise EOFError
    return next(StreamReader(BytesIO(whole), skip_magic=True, emit_chunks=True).records)


def records(file: IO[bytes], size: int) -> Iterator[tuple[int, Any]]:
    """The records of a file from here on with the byte each begins at, chunks whole, None for what tells nothing.
    Raises one of READ_ERRORS at a cut."""
    while True:
        at = file.tell()
        opcode, length = RECORD.unpack(file.read(RECORD.size))
        if length > size:
            raise EOFError
        if opcode not in READ:
            file.seek(length, os.SEEK_CUR)
            yield at, None
            continue
        file.seek(at)
        yield at, record_at(file, size)
        if opcode == Opcode.FOOTER:
            if file.read(len(MAGIC)) != MAGIC:
                raise EOFError
            return


def chunk_records(data: bytes) -> Iterator[tuple[int, bytes]]:
    """Opcode and content of the records in a chunk, as far as it is whole."""
    at, end = 0, len(data)
    while at + RECORD.size <= end:
        opcode, length = RECORD.unpack_from(data, at)
        at += RECORD.size
        if opcode == 0 or at + length > end:  # 0 is no opcode
            return
        yield opcode, data[at : at + length]
        at += length


def records_inside(data: bytes) -> Iterator[Schema | Channel | Message]:
    """The records of a chunk, as far as it is whole."""
    with suppress(*READ_ERRORS):
        for opcode, content in chunk_records(data):
            stream = ReadDataStream(BytesIO(content))
            if opcode == Opcode.MESSAGE:
                yield Message.read(stream, len(content))
            elif opcode == Opcode.CHANNEL:
                yield Channel.read(stream)
            elif opcode == Opcode.SCHEMA:
                yield Schema.read(stream)
