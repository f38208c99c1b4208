"""Adds channels to a log that its runtime has ended, without moving a byte of what is there.

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
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from io import BytesIO
from pathlib import Path
from typing import IO

from crux_contracts.channels import BY_TOPIC, SCHEMAS
from mcap.data_stream import RecordBuilder
from mcap.opcode import Opcode
from mcap.reader import make_reader
from mcap.records import Channel, DataEnd, Footer, McapRecord, Message, Schema, Statistics, SummaryOffset
from mcap.stream_reader import StreamReader
from mcap.summary import Summary
from mcap.writer import MCAP0_MAGIC, CompressionType, Writer

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


def append(path: Path, series: Iterable[Series]) -> None:
    """Adds the messages behind all others. Raises OSError, or ValueError where the file does not end as an MCAP file;
    the log then is as it was."""
    with path.open("r+b") as file:
        size = file.seek(0, os.SEEK_END)
        old_end_at, crc = _old_end(file, size)
        file.seek(0)
        summary = make_reader(file).get_summary()
        filler = _FRAME.pack(FILLER, size - old_end_at - _FRAME.size)
        chunks, added = _chunks(_known(file) if summary is None else summary, series, size)
        if crc:
            file.seek(old_end_at + _FRAME.size)
            crc = zlib.crc32(chunks, zlib.crc32(filler + file.read(size), crc))
        if summary is not None:
            _merge(summary, added)
        tail = chunks + _end(summary, crc, size + len(chunks))
        try:
            _write(file, tail, size)
        except OSError:
            file.truncate(size)
            raise
        os.pwrite(file.fileno(), filler, old_end_at)


def _write(file: IO[bytes], tail: bytes, at: int) -> None:
    """What is behind `at` ends like an MCAP file, without a summary, until the tail's own end replaces that end."""
    final = at + len(tail) - _END_BYTES
    for data, place in ((_end(None, 0, 0), final), (tail[:-_END_BYTES], at)):
        _write_all(file, data, place)
    os.fdatasync(file.fileno())
    _write_all(file, tail[-_END_BYTES:], final)


def _write_all(file: IO[bytes], data: bytes, at: int) -> None:
    rest = memoryview(data)
    while rest:
        done = os.pwrite(file.fileno(), rest, at)
        rest, at = rest[done:], at + done


def _old_end(file: IO[bytes], size: int) -> tuple[int, int]:
    """Where the record DataEnd stands, and the checksum in it: of all bytes before it, 0: none."""
    try:
        file.seek(size - _FOOTER.size - len(MCAP0_MAGIC))
        opcode, _, summary_at, _, _ = _FOOTER.unpack(file.read(_FOOTER.size))
        whole = opcode == Opcode.FOOTER and file.read() == MCAP0_MAGIC
        at = (summary_at or size - _FOOTER.size - len(MCAP0_MAGIC)) - _DATA_END.size
        file.seek(at)
        opcode, length, crc = _DATA_END.unpack(file.read(_DATA_END.size))
    except (OSError, struct.error) as error:
        raise ValueError("the file is too short for an MCAP file") from error
    if not whole or opcode != Opcode.DATA_END or length != _DATA_END.size - _FRAME.size:
        raise ValueError("the file does not end like an MCAP file")
    return at, crc


def _known(file: IO[bytes]) -> Summary:
    """Schemas and channels of a log without a summary: the runtime writes them before its first message."""
    known = Summary()
    file.seek(0)
    for record in StreamReader(file).records:
        if isinstance(record, Message):
            break
        if isinstance(record, Schema):
            known.schemas[record.id] = record
        elif isinstance(record, Channel):
            known.channels[record.id] = record
    return known


def _chunks(old: Summary, series: Iterable[Series], at: int) -> tuple[bytes, Summary]:
    """The chunks with their message indexes as they stand in a file from byte `at` on, and what a summary says of them.

    The library writes them into a file of their own, with the old channels before the new ones, for the numbers."""
    scratch = BytesIO()
    writer = Writer(scratch, compression=CompressionType.LZ4)
    writer.start()
    known = [
        writer.register_schema(old.schemas[n].name, old.schemas[n].encoding, old.schemas[n].data)
        for n in sorted(old.schemas)
    ]
    for number in sorted(old.channels):
        channel = old.channels[number]
        known.append(writer.register_channel(channel.topic, channel.message_encoding, channel.schema_id))
    if known != [*sorted(old.schemas), *sorted(old.channels)]:
        raise ValueError("the file's schemas and channels are not numbered 1, 2, 3 … as in a log of crux-runtime")
    for one in series:
        wanted = SCHEMAS[BY_TOPIC[one.topic].type]
        schema_id = writer.register_schema(wanted.name, "ros2msg", wanted.definition.encode())
        channel_id = writer.register_channel(one.topic, "cdr", schema_id)
        for sequence, (time_ns, payload) in enumerate(zip(one.times_ns, one.payloads, strict=True)):
            writer.add_message(channel_id, time_ns, payload, time_ns, sequence)
    writer.finish()  # type: ignore[no-untyped-call]
    scratch.seek(0)
    added = make_reader(scratch).get_summary()
    assert added is not None
    first = added.chunk_indexes[0].chunk_start_offset
    last = added.chunk_indexes[-1]
    for index in added.chunk_indexes:
        index.chunk_start_offset += at - first
        for channel_id in index.message_index_offsets:
            index.message_index_offsets[channel_id] += at - first
    behind = last.chunk_start_offset + last.chunk_length + last.message_index_length
    return scratch.getvalue()[first : first + behind - at], added


def _merge(summary: Summary, added: Summary) -> None:
    summary.schemas, summary.channels = added.schemas, added.channels
    summary.chunk_indexes += added.chunk_indexes
    old, new = summary.statistics, added.statistics
    if old is None or new is None:
        return
    summary.statistics = Statistics(
        attachment_count=old.attachment_count,
        metadata_count=old.metadata_count,
        schema_count=new.schema_count,
        channel_count=new.channel_count,
        chunk_count=old.chunk_count + new.chunk_count,
        message_count=old.message_count + new.message_count,
        message_start_time=min(old.message_start_time, new.message_start_time),
        message_end_time=max(old.message_end_time, new.message_end_time),
        channel_message_counts=old.channel_message_counts | new.channel_message_counts,
    )


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
    return end.end()  # type: ignore[no-any-return]


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
    for opcode, records in groups:
        start = section.count
        for record in records:
            record.write(section)
        if section.count > start:
            SummaryOffset(opcode, at + start, section.count - start).write(offsets)
    offsets_at = at + section.count
    return section.end() + offsets.end(), offsets_at
