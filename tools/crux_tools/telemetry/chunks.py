"""A log by its index: what the summary and the message indexes behind the chunks tell without reading all of it."""

from __future__ import annotations

import os
import struct
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import IO, Any

import numpy as np
from mcap.opcode import Opcode
from mcap.records import (
    Attachment,
    AttachmentIndex,
    Channel,
    Chunk,
    ChunkIndex,
    Footer,
    Header,
    Metadata,
    MetadataIndex,
    Schema,
    Statistics,
)
from mcap.summary import Summary

from crux_tools.telemetry.records import MAGIC, READ_ERRORS, RECORD, record_at
from crux_tools.telemetry.unpack import Unpacker

_ENTRY = np.dtype([("time_ns", "<u8"), ("offset", "<u8")])
_INDEX_HEAD = struct.Struct("<BQHI")  # opcode, length, channel, bytes of the entries
_FOOTER_BYTES = RECORD.size + 20
_SUMMARY = {
    Opcode.SCHEMA, Opcode.CHANNEL, Opcode.STATISTICS, Opcode.CHUNK_INDEX, Opcode.ATTACHMENT_INDEX,
    Opcode.METADATA_INDEX,
}  # fmt: skip
RECORD_HEAD, MESSAGE_HEAD = 9, 22  # bytes before a record's content, and before a message's in that


def summary_of(file: IO[bytes]) -> Summary | None:
    """Of a whole file; None where it has none. Raises one of READ_ERRORS."""
    size = file.seek(0, os.SEEK_END)
    file.seek(max(size - _FOOTER_BYTES - len(MAGIC), 0))
    footer = record_at(file, size)
    if not isinstance(footer, Footer):
        raise EOFError
    if not footer.summary_start:
        return None
    summary = Summary()
    file.seek(footer.summary_start)
    while True:
        at = file.tell()
        opcode, length = RECORD.unpack(file.read(RECORD.size))
        if opcode == Opcode.FOOTER:
            return summary
        file.seek(at)
        if opcode in _SUMMARY:
            _put(summary, record_at(file, size))
        file.seek(at + RECORD.size + length)


def _put(summary: Summary, record: Any) -> None:
    if isinstance(record, Statistics):
        summary.statistics = record
    elif isinstance(record, Schema):
        summary.schemas[record.id] = record
    elif isinstance(record, Channel):
        summary.channels[record.id] = record
    elif isinstance(record, ChunkIndex):
        summary.chunk_indexes.append(record)
    elif isinstance(record, AttachmentIndex):
        summary.attachment_indexes.append(record)
    elif isinstance(record, MetadataIndex):
        summary.metadata_indexes.append(record)


class IndexedLog:
    """A log with an index of all its chunks. What the index names several times is read once."""

    def __init__(self, file: IO[bytes], summary: Summary, statistics: Statistics) -> None:
        self.summary, self.statistics = summary, statistics
        self._file = file
        self._size = self._unread = file.seek(0, os.SEEK_END)
        self.unpacker = Unpacker(self._size)

    def header(self) -> Header:
        """The file's first record. Raises one of READ_ERRORS."""
        header: Header = self._record(len(MAGIC), Header)
        return header

    def metadata(self) -> Iterator[Metadata]:
        """Every record of them. Raises one of READ_ERRORS."""
        return (self._record(at, Metadata) for at in _offsets(self.summary.metadata_indexes))

    def attachments(self) -> Iterator[Attachment]:
        """Every record of them. Raises one of READ_ERRORS."""
        return (self._record(at, Attachment) for at in _offsets(self.summary.attachment_indexes))

    def _record(self, at: int, kind: type[Any]) -> Any:
        self._file.seek(at)
        record = record_at(self._file, self._size)
        self._unread -= self._file.tell() - at
        if not isinstance(record, kind) or self._unread < 0:
            raise ValueError("the index is wrong")
        return record

    def chunks(self) -> list[ChunkIndex]:
        """Each of them once, in their order in the file."""
        by_offset = {index.chunk_start_offset: index for index in self.summary.chunk_indexes}
        return [by_offset[at] for at in sorted(by_offset)]

    def content(self, index: ChunkIndex) -> tuple[bytes, dict[int, np.ndarray]]:
        """A chunk's records, nothing of one that is left out, and times and offsets of its messages by channel. Raises
        one of READ_ERRORS."""
        self._file.seek(index.chunk_start_offset)
        chunk = record_at(self._file, self._size)
        if not isinstance(chunk, Chunk) or index.message_index_length > self._size:
            raise ValueError("the index is wrong")
        content = self.unpacker.content(chunk, index.chunk_start_offset)
        return content, entries_of(self._file.read(index.message_index_length))


def _offsets(indexes: Iterable[MetadataIndex | AttachmentIndex]) -> list[int]:
    return list(dict.fromkeys(index.offset for index in indexes))


def indexed(file: IO[bytes]) -> IndexedLog | None:
    """None of a file that has no summary, is cut off, or has no index of all its chunks."""
    try:
        summary = summary_of(file)
    except READ_ERRORS:
        return None
    if summary is None or summary.statistics is None or summary.statistics.chunk_count != len(summary.chunk_indexes):
        return None
    return IndexedLog(file, summary, summary.statistics)


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
        found = indexed(file)
    if found is None:
        return 0.0, 0.0
    return found.statistics.message_start_time / 1e9, found.statistics.message_end_time / 1e9
