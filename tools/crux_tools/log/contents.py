"""What is in a log file: its channels, what it says of itself, and what is attached."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, field
from pathlib import Path
from typing import IO

from mcap.records import Attachment, Channel, Message, Metadata, Schema

from crux_tools.log.edit import NS, Damage, records
from crux_tools.telemetry import LogError
from crux_tools.telemetry.chunks import indexed, message_bytes
from crux_tools.telemetry.records import READ_ERRORS


@dataclass
class ChannelContents:
    """A channel; times of its first and last message, None where it has none."""

    topic: str
    type: str
    messages: int = 0
    bytes: int = 0
    from_s: float | None = None
    to_s: float | None = None

    def take(self, messages: int, size: int, from_s: float, to_s: float) -> None:
        """Counts some messages of so many bytes between two times."""
        self.messages += messages
        self.bytes += size
        self.from_s = from_s if self.from_s is None else min(self.from_s, from_s)
        self.to_s = to_s if self.to_s is None else max(self.to_s, to_s)


@dataclass
class Contents:
    """A file."""

    bytes: int
    messages: int = 0
    damage: list[str] = field(default_factory=list)
    metadata: list[tuple[str, dict[str, str]]] = field(default_factory=list)
    attachments: dict[str, int] = field(default_factory=dict)
    channels: list[ChannelContents] = field(default_factory=list)


def contents_of(path: Path) -> Contents:
    """By the file's index where it has one, else by reading it to its end, or as far as it goes. Raises LogError where
    it is no log."""
    if not path.is_file():
        raise LogError(f"{path}: {'is a folder' if path.is_dir() else 'no such file'}, a log (.mcap) is needed")
    found = None
    with path.open("rb") as file, suppress(*READ_ERRORS, IndexError):
        found = _by_index(file, Contents(path.stat().st_size))
    found = found or _by_reading(path, Contents(path.stat().st_size))
    found.channels = sorted(found.channels, key=lambda channel: channel.topic)
    found.messages = sum(channel.messages for channel in found.channels)
    return found


def _by_index(file: IO[bytes], found: Contents) -> Contents | None:
    """None where the index does not tell of every message. Raises one of READ_ERRORS or IndexError where it is wrong.

    Chunks are unpacked for their checksums and the sizes of messages, but no message is looked at.
    """
    log = indexed(file)
    if log is None:
        return None
    summary, damage = log.summary, Damage()
    schemas = summary.schemas
    channels = {
        number: ChannelContents(channel.topic, schemas[channel.schema_id].name if channel.schema_id in schemas else "")
        for number, channel in summary.channels.items()
    }
    counted = 0
    for index in log.chunks():
        content, entries = log.content(index)
        counted += sum(map(len, entries.values()))
        for number, messages in entries.items() if content else ():
            if len(messages):
                times_s = messages["time_ns"][[0, -1]] / NS
                channels[number].take(len(messages), int(message_bytes(content, messages).sum()), *map(float, times_s))
    if counted != log.statistics.message_count:
        return None
    found.channels = list(channels.values())
    damage.take(log.unpacker)
    found.damage = damage.words()
    found.metadata = [(record.name, dict(record.metadata)) for record in log.metadata()]
    found.attachments = {attachment.name: attachment.data_size for attachment in summary.attachment_indexes}
    return found


def _by_reading(path: Path, found: Contents) -> Contents:
    damage = Damage()
    types: dict[int, str] = {}
    channels: dict[int, ChannelContents] = {}
    for record in records(path, damage):
        if isinstance(record, Schema):
            types[record.id] = record.name
        elif isinstance(record, Channel):
            channels.setdefault(record.id, ChannelContents(record.topic, types.get(record.schema_id, "")))
        elif isinstance(record, Message) and record.channel_id in channels:
            channels[record.channel_id].take(1, len(record.data), record.log_time / NS, record.log_time / NS)
        elif isinstance(record, Metadata):
            found.metadata.append((record.name, dict(record.metadata)))
        elif isinstance(record, Attachment):
            found.attachments[record.name] = len(record.data)
    found.channels = list(channels.values())
    found.damage = damage.words()
    return found
