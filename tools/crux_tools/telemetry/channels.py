"""Reads the channels of a log or plan as NumPy record arrays, one a channel: fast enough for a whole climb at once.

The file is read as a stream, never by its index, so a log that ends in mid-write (power cut, kill -9) opens as far as
it was written; what is missing is said in `Channels.notes`.
"""

from __future__ import annotations

import os
import struct
from collections import defaultdict
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace
from io import BytesIO
from pathlib import Path
from typing import Any

import numpy as np
from crux_contracts.channels import shared_topic
from mcap.data_stream import ReadDataStream
from mcap.opcode import Opcode
from mcap.records import Attachment, Channel, Chunk, Header, Message, Metadata, Schema

from crux_tools.telemetry.cdr_table import decode_table, fixed_dtype
from crux_tools.telemetry.definitions import decoder_of
from crux_tools.telemetry.records import MAGIC, READ_ERRORS, chunk_records, records
from crux_tools.telemetry.slots import for_robot, slots_of
from crux_tools.telemetry.unpack import Unpacker

METADATA = ("crux_tags", "crux", "crux_world", "crux_replans")
"""What the runtime was told to say, what it says itself; WORLD; REPLANS."""
REPLANNED = "replanned: "  # begins plan_t.method of what was planned on the way
REPLANS = "replans"  # what was planned again on the way of a simulated climb, kept or not, as JSON
WORLD = "world.yaml"  # that of a simulation, as its file would have it
NOTE_METADATA = "crux_note"  # of a user, when the log was written already
END_METADATA = "crux_end"  # the last thing an orderly end writes; a footer the runtime has at any time
CAN_FRAMES = "/can_frames"  # too many to be decoded one by one: see can_frames.py
_MESSAGE = struct.Struct("<HIQQ")
MAX_TIME_NS = 2**63 - 1


class LogError(Exception):
    """The file is not a log that can be read; the message says why."""


@dataclass
class Raw:
    """What the file holds before decoding: bytes a channel, in the order written."""

    schemas: dict[int, Schema] = field(default_factory=dict)
    channels: dict[int, Channel] = field(default_factory=dict)  # one for all limbs, with their shared topic
    home: dict[int, int] = field(default_factory=dict)  # number of any channel -> that of `channels`
    payloads: dict[int, list[bytes]] = field(default_factory=lambda: defaultdict(list))
    times_ns: dict[int, list[int]] = field(default_factory=lambda: defaultdict(list))
    metadata: dict[str, str] = field(default_factory=dict)
    attachments: dict[str, bytes] = field(default_factory=dict)
    end: dict[str, str] | None = None
    cut: bool = False  # its last record is not whole, or is no footer
    notes: list[str] = field(default_factory=list)

    def know(self, channel: Channel) -> None:
        """Messages of a channel that has a topic for each limb are read as one table, as logs before format 8 have
        them. Its schema is known already."""
        channel = replace(channel, topic=shared_topic(channel.topic))
        definition = self._definition(channel)
        same = (n for n, k in self.channels.items() if k.topic == channel.topic and self._definition(k) == definition)
        home = self.home[channel.id] = next(same, channel.id)
        self.channels.setdefault(home, channel)

    def _definition(self, channel: Channel) -> bytes | None:
        schema = self.schemas.get(channel.schema_id)
        return None if schema is None else schema.data

    def take_metadata(self, record: Metadata) -> None:
        """What the writer and a user say of the log."""
        if record.name in METADATA:
            self.metadata = record.metadata | self.metadata
        elif record.name == NOTE_METADATA:
            notes = (self.metadata.get("note"), record.metadata.get("note"))
            self.metadata["note"] = "; ".join(filter(None, notes))
        elif record.name == END_METADATA:
            self.end = dict(record.metadata)


@dataclass(frozen=True)
class Payloads:
    """CDR messages as they stand in the file, by topic in the order written, with their times and definitions."""

    payloads: dict[str, list[bytes]]
    times_ns: dict[str, list[int]]
    definitions: dict[str, str]
    types: dict[str, str]
    metadata: dict[str, str]
    attachments: dict[str, bytes]
    lost: list[str] = field(default_factory=list)  # what of the file is not in these, a sentence each


@dataclass(frozen=True)
class Channels:
    """A file's channels: `tables` of fixed-size messages as record arrays, `messages` of the others as objects."""

    tables: dict[str, np.ndarray]
    messages: dict[str, list[Any]]
    times_ns: dict[str, np.ndarray]
    metadata: dict[str, str]  # what the writer says of itself: version, commit, robot, pace, started_utc, host …
    attachments: dict[str, bytes]  # of a log: robot.yaml and the URDF; of a plan: scenario.yaml
    end: dict[str, str] | None  # what the runtime counted over its run; None: it did not end in order
    notes: list[str]


def _take_chunk(raw: Raw, data: bytes, wanted: Callable[[str], bool]) -> None:
    """The records of a chunk. Logs are mostly messages: what of a channel is looked up is looked up once."""
    taken: dict[int, tuple[Callable[[bytes], None], Callable[[int], None]] | None] = {}
    for opcode, record in chunk_records(data):
        if opcode == Opcode.MESSAGE:
            channel_id, _, log_time, _ = _MESSAGE.unpack_from(record)
            if channel_id not in taken:
                home = raw.home.get(channel_id)
                if home is None or not wanted(raw.channels[home].topic):
                    taken[channel_id] = None
                else:
                    taken[channel_id] = raw.payloads[home].append, raw.times_ns[home].append
            if (take := taken[channel_id]) is not None:
                take[0](record[_MESSAGE.size :])
                take[1](log_time)
        elif opcode == Opcode.SCHEMA:
            schema = Schema.read(_stream(record))
            raw.schemas[schema.id] = schema
        elif opcode == Opcode.CHANNEL:
            channel = Channel.read(_stream(record))
            raw.know(channel)
            taken.pop(channel.id, None)


def _stream(record: bytes) -> ReadDataStream:
    return ReadDataStream(BytesIO(record))


def _raws(path: Path, wanted: Callable[[str], bool]) -> Iterator[tuple[Raw, float]]:
    """What is read so far, and the share of the file behind, 0 to 1: after every chunk, and at the end."""
    raw = Raw()
    with path.open("rb") as file:
        if file.read(len(MAGIC)) != MAGIC:
            raise LogError(f"{path}: not an MCAP file, expected a log of the runtime or a plan")
        size = file.seek(0, os.SEEK_END)
        file.seek(len(MAGIC))
        unpacker = Unpacker(size)
        try:
            for at, record in records(file, size):
                if isinstance(record, Chunk):
                    _take_chunk(raw, unpacker.content(record, at), wanted)
                    yield raw, at / size
                elif isinstance(record, Schema):
                    raw.schemas[record.id] = record
                elif isinstance(record, Channel):
                    raw.know(record)
                elif isinstance(record, Message) and wanted(raw.channels[raw.home[record.channel_id]].topic):
                    raw.payloads[raw.home[record.channel_id]].append(record.data)
                    raw.times_ns[raw.home[record.channel_id]].append(record.log_time)
                elif isinstance(record, Metadata):
                    raw.take_metadata(record)
                elif isinstance(record, Attachment):
                    raw.attachments[record.name] = record.data
                elif isinstance(record, Header) and record.profile != "ros2":
                    raise LogError(f"{path}: MCAP profile is '{record.profile}', crux writes 'ros2'")
        except READ_ERRORS:
            raw.end, raw.cut = None, True
        raw.notes += unpacker.notes()
    yield raw, 1.0


@contextmanager
def fits_definition(path: Path, topic: str) -> Iterator[None]:
    """For messages to be decoded in. Raises LogError."""
    try:
        yield
    except Exception as error:  # damaged definitions make the decoder raise a dozen unrelated kinds
        what = " ".join(str(error).split())[:120]
        raise LogError(f"{path}: channel {topic} does not fit its own definition: {what}") from error


def decode(raw: Raw, path: Path) -> Channels:
    tables: dict[str, np.ndarray] = {}
    messages: dict[str, list[Any]] = {}
    times_ns: dict[str, np.ndarray] = {}
    slots = slots_of(raw.attachments)
    for channel_id, channel in raw.channels.items():
        if channel.topic == CAN_FRAMES:
            continue
        schema = raw.schemas.get(channel.schema_id)
        payloads = raw.payloads.get(channel_id, [])
        if schema is None or channel.message_encoding != "cdr":
            raise LogError(
                f"{path}: channel {channel.topic} has encoding '{channel.message_encoding}', crux writes 'cdr'"
            )
        with fits_definition(path, channel.topic):
            dtype = fixed_dtype(schema.data.decode())
            if dtype is not None:
                tables[channel.topic] = for_robot(decode_table(payloads, dtype), slots)
            else:
                decoder = decoder_of(schema)
                assert decoder is not None
                messages[channel.topic] = [decoder(payload) for payload in payloads]
        times_ns[channel.topic] = np.array(raw.times_ns.get(channel_id, []), dtype=np.int64)
    return Channels(tables, messages, times_ns, raw.metadata, raw.attachments, raw.end, raw.notes)


def read_channels(path: Path, topics: set[str] | None = None) -> Channels:
    """The channels of an MCAP file in profile ros2, all (but CAN frames) or those in `topics`; those of the limbs under
    their shared topic, whatever topics the log has.

    Raises LogError when the file is no such file; a cut-off end only leaves `end` out.
    """
    return decode(_opened(path, lambda topic: topic != CAN_FRAMES and (topics is None or topic in topics)), path)


def read_payloads(path: Path, topics: set[str], kept: set[str] | None = None) -> Payloads:
    """The messages of some topics, not decoded; with `kept`, of the others only the definitions. Raises LogError as
    `read_channels` does.
    """
    return _payloads(_opened(path, (topics if kept is None else kept).__contains__), topics)


def payload_blocks(path: Path, topics: set[str]) -> Iterator[tuple[Payloads, float]]:
    """The messages of some topics, a part of the file after the other, each with the share of the file behind it: as
    much as a chunk is in memory. Raises LogError as `read_channels` does.
    """
    for raw, share in _found(path, topics.__contains__):
        _clocked(raw, path)
        yield _payloads(raw, topics), share
        raw.payloads.clear()
        raw.times_ns.clear()


def read_both(path: Path) -> tuple[Channels, Payloads]:
    """All channels, decoded (but CAN frames) and not. Raises LogError as `read_channels` does."""
    raw = _opened(path, lambda _topic: True)
    return decode(raw, path), _payloads(raw, {channel.topic for channel in raw.channels.values()})


def _payloads(raw: Raw, topics: set[str]) -> Payloads:
    names = {number: channel.topic for number, channel in raw.channels.items() if channel.topic in topics}
    schemas = {name: raw.schemas[raw.channels[number].schema_id] for number, name in names.items()}
    definitions = {name: schema.data.decode(errors="replace") for name, schema in schemas.items()}
    types = {name: schema.name for name, schema in schemas.items()}
    payloads = {name: raw.payloads[number] for number, name in names.items()}
    times_ns = {name: raw.times_ns[number] for number, name in names.items()}
    lost = ["the end of the file is missing"] * raw.cut + raw.notes
    return Payloads(payloads, times_ns, definitions, types, raw.metadata, raw.attachments, lost)


def _opened(path: Path, wanted: Callable[[str], bool]) -> Raw:
    *_, (raw, _) = _found(path, wanted)
    _clocked(raw, path)
    return raw


def _found(path: Path, wanted: Callable[[str], bool]) -> Iterator[tuple[Raw, float]]:
    """As `_raws`. Raises LogError where there is no file, or none that may be read."""
    if path.is_dir():
        raise LogError(f"{path}: is a folder, a plan or log (.mcap) is needed")
    if not path.exists():
        raise LogError(f"{path}: no such file")
    try:
        yield from _raws(path, wanted)
    except PermissionError as error:
        raise LogError(f"{path}: may not be read (permission denied)") from error


def _clocked(raw: Raw, path: Path) -> None:
    for number, times_ns in raw.times_ns.items():
        if max(times_ns, default=0) > MAX_TIME_NS:
            topic = raw.channels[number].topic
            raise LogError(f"{path}: channel {topic}: a message of log time {max(times_ns)} ns, which no clock has")
