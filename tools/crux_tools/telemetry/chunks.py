"""A log by its index: what the summary and the message indexes behind the chunks tell without reading all of it."""

from __future__ import annotations

import struct
from pathlib import Path
from typing import IO

import numpy as np
from mcap.reader import McapReader, make_reader
from mcap.records import Chunk, ChunkIndex, Statistics
from mcap.stream_reader import StreamReader
from mcap.summary import Summary

from crux_tools.telemetry.records import READ_ERRORS, chunk_bytes

_ENTRY = np.dtype([("time_ns", "<u8"), ("offset", "<u8")])
_INDEX_HEAD = struct.Struct("<BQHI")  # opcode, length, channel, bytes of the entries
RECORD_HEAD, MESSAGE_HEAD = 9, 22  # bytes before a record's content, and before a message's in that


def reader_and_summary(file: IO[bytes]) -> tuple[McapReader, Summary, Statistics] | None:
    """Of a file from its begin; None where it has no summary, is cut off, or has no index of all its chunks."""
    try:
        file.seek(0)
        reader = make_reader(file)
        summary = reader.get_summary()
    except READ_ERRORS:
        return None
    if summary is None or summary.statistics is None or summary.statistics.chunk_count != len(summary.chunk_indexes):
        return None
    return reader, summary, summary.statistics


def content_of(file: IO[bytes], index: ChunkIndex, notes: list[str]) -> tuple[bytes, dict[int, np.ndarray]]:
    """A chunk's records, nothing of a damaged one, and times and offsets of its messages by channel."""
    file.seek(index.chunk_start_offset)
    chunk = next(StreamReader(file, skip_magic=True, emit_chunks=True).records)
    if not isinstance(chunk, Chunk):
        raise ValueError("the index names a chunk where there is none")
    content = chunk_bytes(chunk, notes)
    return content, entries_of(file.read(index.message_index_length))


def entries_of(data: bytes) -> dict[int, np.ndarray]:
    """The records of message indexes behind a chunk: times and offsets by channel, in the order of time."""
    found, at = {}, 0
    while at < len(data):
        _, length, channel, size = _INDEX_HEAD.unpack_from(data, at)
        entries = np.frombuffer(data, _ENTRY, size // _ENTRY.itemsize, at + _INDEX_HEAD.size)
        found[channel] = np.sort(entries, order="time_ns", kind="stable")
        at += RECORD_HEAD + length
    return found


def message_bytes(content: bytes, entries: np.ndarray) -> np.ndarray:
    """(n,) sizes of messages in a chunk, as their records give them. Raises IndexError for one outside of it."""
    heads = np.frombuffer(content, np.uint8)[entries["offset"].astype(np.int64)[:, None] + np.arange(1, RECORD_HEAD)]
    return np.ascontiguousarray(heads).view("<u8")[:, 0].astype(np.int64) - MESSAGE_HEAD


def span_s(path: Path) -> tuple[float, float]:
    """Times of the first and the last message, by the log's index; 0 where it has none. Raises OSError."""
    with path.open("rb") as file:
        found = reader_and_summary(file)
    return (0.0, 0.0) if found is None else (found[2].message_start_time / 1e9, found[2].message_end_time / 1e9)
