"""Adds channels and metadata to a log that its runtime has ended, without moving a byte of what is there.

    records … | DataEnd, summary, Footer, magic                          the log before
    records … | filler (the old end) | chunks | DataEnd, summary, Footer, magic

The new records and a new end go behind the old one, which nine bytes then make a filler: a record that readers skip.
Until those bytes are written, who reads from the start reads the log as it was; who begins at the end finds the old log
until the new end is whole. So a kill or a full disk at any time costs nothing of it. A log without a summary, that of a
runtime that was killed, gets none here either: readers go through it from the start.
"""

from __future__ import annotations

import os
import struct
import zlib
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import IO

from crux_contracts.channels import BY_TOPIC, SCHEMAS
from mcap.data_stream import RecordBuilder
from mcap.exceptions import McapError
from mcap.opcode import Opcode
from mcap.records import Channel, Chunk, DataEnd, Footer, McapRecord, Message, Schema, SummaryOffset
from mcap.summary import Summary
from mcap.writer import MCAP0_MAGIC, CompressionType, Writer

from crux_tools.telemetry.chunks import summary_of
from crux_tools.telemetry.records import records, records_inside
from crux_tools.telemetry.unpack import Unpacker

FILLER = 0x80  # the MCAP specification leaves opcodes from here on to applications
_FRAME = struct.Struct("<BQ")  # opcode and length before every record
_DATA_END = struct.Struct("<BQI")
_FOOTER = struct.Struct("<BQQQI")
_END_BYTES = _DATA_END.size + _FOOTER.size + len(MCAP0_MAGIC)  # without a summary


@dataclass(frozen=True)
class Series:
    """Messages of one channel of msgs/channels.yaml: n payloads in CDR, and their log times."""

    topic: str
    times_ns: Sequence[int]
    payloads: Sequence[bytes]


def append(path: Path, series: Iterable[Series], metadata: Mapping[str, Mapping[str, str]] | None = None) -> None:
    """Adds the messages, and metadata by name, behind all others. Raises OSError, or ValueError for a file that does
    not end as a log of the runtime does; the log is as it was then.
    """
    with path.open("r+b") as file:
        size = file.seek(0, os.SEEK_END)
        try:
            end_at, crc = _old_end(file, size)
            summary = summary_of(file)
            chunks, added = _records(_known(file, size) if summary is None else summary, series, metadata or {}, size)
        except (McapError, struct.error, EOFError) as error:
            raise ValueError(f"the file is damaged ({type(error).__name__})") from error
        filler = _FRAME.pack(FILLER, size - end_at - _FRAME.size)
        if crc:
            file.seek(end_at + _FRAME.size)
            crc = zlib.crc32(chunks, zlib.crc32(filler + file.read(), crc))
        tail = chunks + _end(summary and _merged(summary, added), crc, size + len(chunks))
        try:
            _write(file.fileno(), tail, size)
            _write_all(file.fileno(), filler, end_at)
        except OSError:
            os.truncate(file.fileno(), size)
            raise


def _old_end(file: IO[bytes], size: int) -> tuple[int, int]:
    """Where the record DataEnd stands, and the checksum in it: of all bytes before it, 0: none."""
    footer_at = max(size - _FOOTER.size - len(MCAP0_MAGIC), 0)
    file.seek(footer_at)
    end = file.read()
    if size < _END_BYTES or end[0] != Opcode.FOOTER or not end.endswith(MCAP0_MAGIC):
        raise ValueError("the file does not end like an MCAP file")
    summary_at = _FOOTER.unpack_from(end)[2]
    at = (summary_at or footer_at) - _DATA_END.size
    file.seek(max(at, 0))
    opcode, _, crc = _DATA_END.unpack(file.read(_DATA_END.size))
    if at < 0 or opcode != Opcode.DATA_END:
        raise ValueError("the file's data does not end like that of an MCAP file")
    return at, crc


def _write(file: int, tail: bytes, at: int) -> None:
    """The tail into the file behind its end at `at`; there is always an end of an MCAP file at the end of the file."""
    final = at + len(tail) - _END_BYTES
    _write_all(file, _end(None, 0, 0), final)
    _write_all(file, tail[:-_END_BYTES], at)
    os.fdatasync(file)
    _write_all(file, tail[-_END_BYTES:], final)


def _write_all(file: int, data: bytes, at: int) -> None:
    rest = memoryview(data)
    while rest:
        done = os.pwrite(file, rest, at)
        rest, at = rest[done:], at + done


def _known(file: IO[bytes], size: int) -> Summary:
    """Schemas and channels of a log without a summary: the runtime writes them before its first message."""
    known, unpacker = Summary(), Unpacker(size)
    file.seek(len(MCAP0_MAGIC))
    for at, record in records(file, size):
        inside = records_inside(unpacker.content(record, at)) if isinstance(record, Chunk) else [record]
        for each in inside:
            if isinstance(each, Message):
                return known
            if isinstance(each, Schema):
                known.schemas[each.id] = each
            elif isinstance(each, Channel):
                known.channels[each.id] = each
    return known


def _records(
    old: Summary, series: Iterable[Series], metadata: Mapping[str, Mapping[str, str]], at: int
) -> tuple[bytes, Summary]:
    """Metadata and chunks with their message indexes as they stand in a file from byte `at` on, and what a summary
    says of them.

    The library writes them into a file of their own, with the old channels before the new ones, for the numbers."""
    scratch = BytesIO()
    writer = Writer(scratch, compression=CompressionType.LZ4)
    writer.start()
    schemas, channels = sorted(old.schemas), sorted(old.channels)
    numbers = [
        *(writer.register_schema(old.schemas[n].name, old.schemas[n].encoding, old.schemas[n].data) for n in schemas),
        *(writer.register_channel(old.channels[n].topic, "cdr", old.channels[n].schema_id) for n in channels),
    ]
    if numbers != [*schemas, *channels]:
        raise ValueError("its schemas and channels are not numbered 1, 2, 3 … as in a log of crux-runtime")
    for name, said in metadata.items():
        writer.add_metadata(name, dict(said))
    for one in series:
        wanted = SCHEMAS[BY_TOPIC[one.topic].type]
        schema_id = writer.register_schema(wanted.name, "ros2msg", wanted.definition.encode())
        channel_id = writer.register_channel(one.topic, "cdr", schema_id)
        for sequence, (time_ns, payload) in enumerate(zip(one.times_ns, one.payloads, strict=True)):
            writer.add_message(channel_id, time_ns, payload, time_ns, sequence)
    writer.finish()  # type: ignore[no-untyped-call]
    added = summary_of(scratch)
    assert added is not None
    spans = [(index.offset, index.length) for index in added.metadata_indexes]
    spans += [(i.chunk_start_offset, i.chunk_length + i.message_index_length) for i in added.chunk_indexes]
    first, behind = spans[0][0], sum(spans[-1])
    for told in added.metadata_indexes:
        told.offset += at - first
    for index in added.chunk_indexes:
        index.chunk_start_offset += at - first
        offsets = index.message_index_offsets
        index.message_index_offsets = {number: offset + at - first for number, offset in offsets.items()}
    return scratch.getvalue()[first:behind], added


def _merged(old: Summary, added: Summary) -> Summary:
    """`added` has all schemas and channels already."""
    was, now = old.statistics, added.statistics
    if was is not None and now is not None:
        now.attachment_count = was.attachment_count
        now.metadata_count += was.metadata_count
        now.chunk_count += was.chunk_count
        now.message_start_time = min((s.message_start_time for s in (was, now) if s.message_count), default=0)
        now.message_count += was.message_count
        now.message_end_time = max(was.message_end_time, now.message_end_time)
        now.channel_message_counts |= was.channel_message_counts
    added.chunk_indexes[:0] = old.chunk_indexes
    added.metadata_indexes[:0] = old.metadata_indexes
    added.attachment_indexes = old.attachment_indexes
    return added


def _end(summary: Summary | None, crc: int, at: int) -> bytes:
    """What closes an MCAP file from byte `at` on: the checksum `crc` of all before, the summary, the footer."""
    end = RecordBuilder()
    DataEnd(crc).write(end)
    section, section_at, offsets_at = b"", 0, 0
    if summary is not None:
        section_at = at + end.count
        section, offsets_at = _summary_section(summary, section_at)
        footer = _FRAME.pack(Opcode.FOOTER, _FOOTER.size - _FRAME.size) + struct.pack("<QQ", section_at, offsets_at)
        end.write(section)
        Footer(section_at, offsets_at, zlib.crc32(section + footer)).write(end)
    else:
        Footer(0, 0, 0).write(end)
    end.write(MCAP0_MAGIC)
    whole: bytes = end.end()  # type: ignore[no-untyped-call]
    return whole


def _summary_section(summary: Summary, at: int) -> tuple[bytes, int]:
    """Its bytes as they stand from byte `at` of the file on, and where its offsets begin."""
    section, offsets = RecordBuilder(), RecordBuilder()
    groups: list[tuple[Opcode, Iterable[McapRecord]]] = [
        (Opcode.SCHEMA, summary.schemas.values()),
        (Opcode.CHANNEL, summary.channels.values()),
        (Opcode.STATISTICS, filter(None, [summary.statistics])),
        (Opcode.CHUNK_INDEX, summary.chunk_indexes),
        (Opcode.ATTACHMENT_INDEX, summary.attachment_indexes),
        (Opcode.METADATA_INDEX, summary.metadata_indexes),
    ]
    for opcode, group in groups:
        start = section.count
        for record in group:
            record.write(section)
        if section.count > start:
            SummaryOffset(opcode, at + start, section.count - start).write(offsets)
    offsets_at = at + section.count
    whole: bytes = section.end() + offsets.end()  # type: ignore[no-untyped-call]
    return whole, offsets_at
