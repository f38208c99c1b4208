"""What is in a log file: its channels, what it says of itself, and what is attached."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

from mcap.records import Attachment, Channel, Message, Metadata, Schema

from crux_tools.log.edit import NS, Damage, records
from crux_tools.telemetry import LogError


@dataclass
class ChannelContents:
    """A channel; times of its first and last message, None where it has none."""

    topic: str
    type: str
    messages: int = 0
    bytes: int = 0
    from_s: float | None = None
    to_s: float | None = None


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
    """Reads a file to its end, or as far as it goes. Raises LogError where it is none."""
    if not path.is_file():
        raise LogError(f"{path}: {'is a folder' if path.is_dir() else 'no such file'}, a log (.mcap) is needed")
    found, damage = Contents(path.stat().st_size), Damage()
    types: dict[int, str] = {}
    channels: dict[int, ChannelContents] = {}
    for record in records(path, damage):
        if isinstance(record, Schema):
            types[record.id] = record.name
        elif isinstance(record, Channel):
            channels.setdefault(record.id, ChannelContents(record.topic, types.get(record.schema_id, "")))
        elif isinstance(record, Message) and record.channel_id in channels:
            channel, time_s = channels[record.channel_id], record.log_time / NS
            channel.messages += 1
            channel.bytes += len(record.data)
            channel.from_s = time_s if channel.from_s is None else min(channel.from_s, time_s)
            channel.to_s = time_s if channel.to_s is None else max(channel.to_s, time_s)
        elif isinstance(record, Metadata):
            found.metadata.append((record.name, dict(record.metadata)))
        elif isinstance(record, Attachment):
            found.attachments[record.name] = len(record.data)
    found.channels = sorted(channels.values(), key=lambda channel: channel.topic)
    found.messages = sum(channel.messages for channel in found.channels)
    found.damage = damage.words()
    return found
