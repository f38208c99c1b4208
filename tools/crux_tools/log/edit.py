"""Logs cut, merged and recovered, record by record: what is in a message is not looked at.

Every result is a whole MCAP file with an index, whatever its source lacked.
"""

from __future__ import annotations

import heapq
import os
from collections.abc import Iterator
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO, Any

from mcap.records import Attachment, Channel, Chunk, Header, Message, Metadata, Schema
from mcap.writer import CompressionType, Writer

from crux_tools.errors import UsageError
from crux_tools.log.mcap_export import LATCHED
from crux_tools.telemetry import LogError
from crux_tools.telemetry.chunks import indexed
from crux_tools.telemetry.records import MAGIC, READ_ERRORS, record_at, records_inside
from crux_tools.telemetry.records import records as known_records
from crux_tools.telemetry.unpack import Unpacker

LIBRARY = "crux log"
NS = 10**9
SAME_RUN = ("started_utc", "host", "robot_sha256", "commit", "command_line")  # of metadata "crux"


@dataclass
class Damage:
    """What a file lost."""

    bytes: int = 0  # behind the last whole record
    chunks: int = 0
    reasons: list[str] = field(default_factory=list)  # why chunks are left out

    def take(self, unpacker: Unpacker) -> None:
        """Notes the chunks that were left out."""
        self.chunks, self.reasons = unpacker.left_out, unpacker.notes()

    def words(self) -> list[str]:
        """A sentence each."""
        cut = [f"cut off: its last {self.bytes} bytes are no whole record"] if self.bytes else []
        return cut + self.reasons


def records(path: Path, damage: Damage) -> Iterator[Any]:
    """All records in the order written, chunks taken apart, as far as the file goes. Raises LogError, OSError."""
    with path.open("rb") as file:
        for _, record in _placed_records(path, file, damage):
            yield record


def _placed_records(path: Path, file: IO[bytes], damage: Damage) -> Iterator[tuple[int, Any]]:
    """The same, with the byte of the file at which it begins, or the chunk that it is in."""
    if file.read(len(MAGIC)) != MAGIC:
        raise LogError(f"{path}: not an MCAP file, expected a log of the runtime")
    size = file.seek(0, os.SEEK_END)
    whole = file.seek(len(MAGIC))
    unpacker = Unpacker(size)
    try:
        for at, record in known_records(file, size):
            whole = file.tell()
            if isinstance(record, Chunk):
                yield from ((at, each) for each in records_inside(unpacker.content(record, at)))
            elif record is not None:
                yield at, record
    except READ_ERRORS:
        damage.bytes = size - whole
    damage.take(unpacker)


def records_between(path: Path, damage: Damage, first_ns: int, last_ns: int) -> Iterator[Any]:
    """The same, but of messages only chunks with some between two times, or with a latched one before them, where the
    file has an index. Raises LogError, OSError."""
    with path.open("rb") as file:
        log = indexed(file)
        if log is None:
            yield from records(path, damage)
            return
        try:
            others = [log.header(), *log.metadata(), *log.attachments()]
        except READ_ERRORS:  # the index is wrong
            yield from records(path, damage)
            return
        summary = log.summary
        yield from (*others, *summary.schemas.values(), *summary.channels.values())
        latched = {number for number, channel in summary.channels.items() if channel.topic in LATCHED}
        for index in log.chunks():
            topics = index.message_index_offsets.keys()
            before = index.message_start_time < first_ns and (latched & topics or not topics)
            if before or (index.message_end_time >= first_ns and index.message_start_time <= last_ns):
                try:
                    content, _ = log.content(index)
                except READ_ERRORS:
                    log.unpacker.damaged += 1
                else:
                    yield from records_inside(content)
        damage.take(log.unpacker)


class Copy:
    """A file that records of others are put into; what is there already is not put in again."""

    def __init__(self, path: Path) -> None:
        self._file = path.open("wb")
        self._writer = Writer(self._file, compression=CompressionType.LZ4)
        self._writer.start(profile="ros2", library=LIBRARY)
        self._channels: dict[tuple[str, str, bytes], int] = {}
        self._sequences: dict[int, int] = {}
        self._said: set[tuple[str, Any]] = set()
        self.messages = 0

    def message(self, channel: Channel, schema: Schema, message: Message) -> None:
        """Puts a message in."""
        key = (channel.topic, schema.name, schema.data)
        if key not in self._channels:
            number = self._writer.register_schema(schema.name, schema.encoding, schema.data)
            self._channels[key] = self._writer.register_channel(
                channel.topic, channel.message_encoding, number, dict(channel.metadata)
            )
        at = self._channels[key]
        sequence = self._sequences.get(at, 0)
        self._sequences[at] = sequence + 1
        self._writer.add_message(at, message.log_time, message.data, message.publish_time, sequence)
        self.messages += 1

    def other(self, record: Any) -> None:
        """Puts in what is metadata or an attachment, and nothing else."""
        if isinstance(record, Metadata):
            self.metadata(record.name, record.metadata)
        elif isinstance(record, Attachment) and ("attachment", record.name) not in self._said:
            self._said.add(("attachment", record.name))
            self._writer.add_attachment(
                record.create_time, record.log_time, record.name, record.media_type, record.data
            )

    def metadata(self, name: str, said: dict[str, str]) -> None:
        """Puts metadata in."""
        key = (name, tuple(sorted(said.items())))
        if key not in self._said:
            self._said.add(key)
            self._writer.add_metadata(name, dict(said))

    def close(self) -> None:
        """Ends the file."""
        self._writer.finish()  # type: ignore[no-untyped-call]
        self._file.close()


@dataclass
class _Definitions:
    """Schemas and channels of a file, gathered on the way."""

    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)

    def take(self, record: Any, path: Path) -> tuple[Channel, Schema] | None:
        """Remembers a definition; of a message gives its own, None where they are lost."""
        if isinstance(record, Header) and record.profile != "ros2":
            raise LogError(f"{path}: MCAP profile is '{record.profile}', crux writes 'ros2'")
        if isinstance(record, Schema):
            self.schemas[record.id] = record
        elif isinstance(record, Channel):
            self.channels[record.id] = record
        elif isinstance(record, Message) and record.channel_id in self.channels:
            channel = self.channels[record.channel_id]
            schema = self.schemas.get(channel.schema_id)
            return None if schema is None else (channel, schema)
        return None


def cut(log: Path, out: Path, from_s: float, to_s: float) -> tuple[int, Damage]:
    """The messages of log times from_s .. to_s, with the plan that stood at from_s; their number.

    Raises UsageError where there are none, LogError, OSError.
    """
    damage, definitions, copy = Damage(), _Definitions(), Copy(out)
    first_ns, last_ns = round(from_s * NS), round(to_s * NS)
    standing: dict[str, tuple[Channel, Schema, Message]] = {}
    inside = 0
    for record in records_between(log, damage, first_ns, last_ns):
        known = definitions.take(record, log)
        if known is None:
            copy.other(record)
            continue
        if first_ns <= record.log_time <= last_ns:
            for each in standing.values():
                copy.message(*each)
            standing.clear()
            copy.message(*known, record)
            inside += 1
        elif record.log_time < first_ns and known[0].topic in LATCHED and not inside:
            standing[known[0].topic] = (*known, record)
    copy.metadata("crux_cut", {"of": log.name, "from_s": f"{from_s:g}", "to_s": f"{to_s:g}"})
    copy.close()
    if not inside:
        times_ns = [record.log_time for record in records(log, Damage()) if isinstance(record, Message)]
        there = f"goes from {min(times_ns) / NS:g} to {max(times_ns) / NS:g} s" if times_ns else "holds no message"
        raise UsageError(f"{log}: nothing in it from {from_s:g} to {to_s:g} s; it {there}")
    return copy.messages, damage


def recover(log: Path, out: Path) -> tuple[int, Damage]:
    """All that can be read; the number of messages. Raises UsageError where there is none, LogError, OSError."""
    damage, definitions, copy = Damage(), _Definitions(), Copy(out)
    for record in records(log, damage):
        known = definitions.take(record, log)
        if known is None:
            copy.other(record)
        else:
            copy.message(*known, record)
    copy.metadata("crux_recovered", {"of": log.name, "bytes": str(damage.bytes), "chunks": str(damage.chunks)})
    copy.close()
    if not copy.messages:
        raise UsageError(f"{log}: not one whole message in it: nothing to recover")
    return copy.messages, damage


def merge(logs: list[Path], out: Path) -> int:
    """Parts of one run in the order of time, what several of them have once; the number of messages.

    Raises UsageError where they are not of one run, LogError where one is not a whole file, OSError.
    """
    copy = Copy(out)
    parts = [_Part(log, copy) for log in logs]
    for part in parts[1:]:
        for key in SAME_RUN:
            if part.run.get(key) != parts[0].run.get(key):
                raise UsageError(
                    f"{part.log}: of another run than {logs[0]}: its {key} is {part.run.get(key, 'not recorded')}, not "
                    f"{parts[0].run.get(key, 'not recorded')}; right are parts of one log"
                )
    at, there = None, set[tuple[str, bytes]]()
    for channel, schema, message in heapq.merge(*(part.in_time() for part in parts), key=lambda each: each[2].log_time):
        if message.log_time != at:
            at, there = message.log_time, set()
        if (channel.topic, message.data) not in there:
            there.add((channel.topic, message.data))
            copy.message(channel, schema, message)
    copy.metadata("crux_merged", {str(number): log.name for number, log in enumerate(logs, 1)})
    copy.close()
    return copy.messages


class _Part:
    """A log that is merged; its metadata and attachments are put into the copy at once. `run`: what it says of its run.

    Raises LogError where it is not whole.
    """

    def __init__(self, log: Path, copy: Copy) -> None:
        self.log = log
        self.run = dict[str, str]()
        self._definitions = _Definitions()
        self._first_ns = dict[int, int]()  # time of the first message of what begins at a byte of the file
        damage = Damage()
        with log.open("rb") as file:
            for at, record in _placed_records(log, file, damage):
                copy.other(record)
                if isinstance(record, Metadata) and record.name == "crux":
                    self.run = dict(record.metadata)
                if self._definitions.take(record, log) is not None:
                    self._first_ns[at] = min(self._first_ns.get(at, record.log_time), record.log_time)
        if damage.words():
            raise LogError(f"{log}: {'; '.join(damage.words())}: recover it first (crux log recover)")

    def in_time(self) -> Iterator[tuple[Channel, Schema, Message]]:
        """Its messages in the order of time; a chunk is unpacked when its first message is due."""
        waiting: list[tuple[int, int, int, Message | None]] = [(t, at, 0, None) for at, t in self._first_ns.items()]
        heapq.heapify(waiting)
        with self.log.open("rb") as file:
            size = file.seek(0, os.SEEK_END)
            unpacker = Unpacker(size)
            while waiting:
                _, at, _, message = heapq.heappop(waiting)
                known = None if message is None else self._definitions.take(message, self.log)
                if message is not None and known is not None:
                    yield *known, message
                if message is None:
                    file.seek(at)
                    record = record_at(file, size)
                    inside = records_inside(unpacker.content(record, at)) if isinstance(record, Chunk) else [record]
                    for number, each in enumerate(inside, 1):
                        if isinstance(each, Message):
                            heapq.heappush(waiting, (each.log_time, at, number, each))
