"""The records of an MCAP file as a stream, also of a file that ends in mid-write."""

from __future__ import annotations

import os
import struct
from collections.abc import Iterator
from typing import IO, Any

from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Chunk
from mcap.stream_reader import StreamReader, get_chunk_data_stream

MAGIC = b"\x89MCAP0\r\n"
READ = {  # of the rest, indexes and what else a summary repeats, only the length is looked at
    Opcode.HEADER, Opcode.FOOTER, Opcode.SCHEMA, Opcode.CHANNEL, Opcode.MESSAGE, Opcode.CHUNK, Opcode.METADATA,
    Opcode.ATTACHMENT,
}  # fmt: skip
_RECORD = struct.Struct("<BQ")
READ_ERRORS = (McapError, struct.error, ValueError, RuntimeError, EOFError, KeyError, OverflowError)


def chunk_bytes(chunk: Chunk, notes: list[str]) -> bytes:
    """A chunk's records, nothing of a damaged one."""
    try:
        stream, length = get_chunk_data_stream(chunk, validate_crc=True)
        whole: bytes = stream.read(length)
    except READ_ERRORS:
        notes.append("a damaged chunk was left out")
        return b""
    return whole


def records(file: IO[bytes], size: int) -> Iterator[Any]:
    """The records of a file from here on that tell something, chunks whole. Raises one of READ_ERRORS at a cut."""
    while True:
        head = file.read(_RECORD.size)
        opcode, length = _RECORD.unpack(head)
        if length > size:
            raise EOFError
        if opcode not in READ:
            file.seek(length, os.SEEK_CUR)
            continue
        file.seek(-_RECORD.size, os.SEEK_CUR)
        yield next(StreamReader(file, skip_magic=True, emit_chunks=True, record_size_limit=size).records)
        if opcode == Opcode.FOOTER:
            if file.read(len(MAGIC)) != MAGIC:
                raise EOFError
            return


def chunk_records(data: bytes) -> Iterator[tuple[int, bytes]]:
    """Opcode and content of the records in a chunk, as far as it is whole."""
    at, end = 0, len(data)
    while at + _RECORD.size <= end:
        opcode, length = _RECORD.unpack_from(data, at)
        at += _RECORD.size
        if at + length > end:
            return
        yield opcode, data[at : at + length]
        at += length
