"""Reads channels.yaml and faults.yaml and checks them against the message types."""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import yaml

from .lcm_types import Struct

EVENT_RATE = -1.0
WRITERS = ("tools", "runtime", "simulation")


class TableError(Exception):
    """A contract table that contradicts itself or the message types."""


@dataclass(frozen=True)
class Channel:
    """`rate_Hz` is EVENT_RATE for a message sent when something happens, 0 for one that is only logged. Of a logged
    channel every `log_every`-th control cycle is in the log, `per_limb` on a topic for each limb: /LF and so on before
    `topic`."""

    name: str
    type: str
    rate_Hz: float
    writer: str
    logged: bool
    topic: str
    log_every: int
    per_limb: bool


@dataclass(frozen=True)
class Fault:
    code: int
    name: str
    to: str
    recovers: bool
    text: str
    cause: str
    do: str


def read_log_format(path: Path) -> int:
    number = document(path).get("log_format")
    if not isinstance(number, int) or number < 1:
        raise TableError(f"{path}: log_format is {number!r}, must be a whole number from 1 on")
    return number


def document(path: Path) -> dict[str, Any]:
    document: dict[str, Any] = yaml.safe_load(path.read_text(encoding="utf-8"))
    if document.get("version") != 1:
        raise TableError(f"{path}: version must be 1")
    return document


def _load(path: Path, key: str) -> list[dict[str, Any]]:
    entries: list[dict[str, Any]] = document(path)[key]
    return entries


def read_channels(path: Path, structs: dict[str, Struct]) -> list[Channel]:
    channels = []
    for entry in _load(path, "channels"):
        rate = EVENT_RATE if entry["rate_Hz"] == "event" else float(entry["rate_Hz"])
        channel = Channel(
            entry["name"],
            entry["type"],
            rate,
            entry["writer"],
            entry["logged"],
            entry["topic"] if entry["logged"] else "",
            int(entry.get("log_every", 1)),
            bool(entry.get("per_limb", False)),
        )
        if channel.type not in structs:
            raise TableError(f"{path}: {channel.name} carries the unknown type {channel.type}")
        if channel.writer not in WRITERS:
            raise TableError(f"{path}: {channel.name} is written by {channel.writer}, must be one of {WRITERS}")
        if channel.per_limb and "limb" not in {field.name for field in structs[channel.type].fields}:
            raise TableError(f"{path}: {channel.name} is per_limb, but {channel.type} has no member 'limb'")
        if channel.log_every < 1:
            raise TableError(f"{path}: {channel.name} has log_every {channel.log_every}, must be 1 or more")
        channels.append(channel)
    for attribute in ("name", "topic"):
        values = [getattr(channel, attribute) for channel in channels if getattr(channel, attribute)]
        if len(set(values)) != len(values):
            raise TableError(f"{path}: two channels share one {attribute}")
    return channels


def read_faults(path: Path, supervisor: Struct) -> list[Fault]:
    faults = [
        Fault(int(e["code"]), e["name"], e["to"], bool(e.get("recovers", False)), e["text"], e["cause"], e["do"])
        for e in _load(path, "faults")
    ]
    states = {constant.name for constant in supervisor.constants}
    for fault in faults:
        if strange := set(re.findall(r"{(.*?)}", fault.text)) - {"value", "limit"}:
            raise TableError(f"{path}: the text of {fault.name} has {strange}, must have {{value}} and {{limit}} alone")
        if fault.to not in states:
            raise TableError(f"{path}: fault {fault.name} leads to the unknown state {fault.to}")
    if [fault.code for fault in faults] != list(range(1, len(faults) + 1)):
        raise TableError(f"{path}: codes must count 1, 2, 3 ... without gaps")
    return faults
