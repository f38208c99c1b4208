"""Some of a long log, found by its index: chunks here and there, or those between two times, and all that is rare."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from mcap.records import ChunkIndex

from crux_tools.telemetry.channels import CAN_FRAMES, Channels, LogError, Raw, decode
from crux_tools.telemetry.chunks import MESSAGE_HEAD, RECORD_HEAD, IndexedLog, indexed

RARE = {"/command", "/acknowledgement", "/plan", "/fault", "/truth/verdict"}
CLOCK = "/limb_telemetry"  # cycles that have it have all else


def read_part(path: Path, from_s: float, to_s: float, chunks: int, rows: int) -> Channels:
    """Of some `chunks` of those between two times, evenly apart, `rows` moments each; of RARE topics every message.
    Raises LogError or one of READ_ERRORS; the log has an index.
    """
    with path.open("rb") as file:
        log = indexed(file)
        if log is None:
            raise LogError(f"{path}: it has no index any more")
        raw = Raw(schemas=dict(log.summary.schemas))
        for channel in log.summary.channels.values():
            raw.know(channel)
        for record in log.metadata():
            raw.take_metadata(record)
        raw.attachments = {attachment.name: attachment.data for attachment in log.attachments()}
        rare = {number for number, home in raw.home.items() if raw.channels[home].topic in RARE}
        common = {number for number, home in raw.home.items() if raw.channels[home].topic != CAN_FRAMES}
        ordered = log.chunks()
        inside = [i for i in ordered if i.message_end_time >= from_s * 1e9 and i.message_start_time <= to_s * 1e9]
        at = np.linspace(0, len(inside) - 1, min(chunks, len(inside))).astype(int)
        chosen = {inside[n].chunk_start_offset for n in at}
        for index in ordered:
            if index.chunk_start_offset in chosen:
                _take(raw, log, index, common, rows)
            elif rare & index.message_index_offsets.keys():
                _take(raw, log, index, rare, rows)
        raw.notes += log.unpacker.notes()
    return decode(raw, path)


def _take(raw: Raw, log: IndexedLog, index: ChunkIndex, wanted: set[int], rows: int) -> None:
    """A chunk's messages of the wanted channels, at some moments. Raises one of READ_ERRORS."""
    content, entries = log.content(index)
    unread = len(content)
    clock = [entries[n]["time_ns"] for n in entries if raw.channels[raw.home[n]].topic == CLOCK]
    moments = np.unique(np.concatenate(clock)) if clock else np.empty(0)
    few = moments[:: max(len(moments) // rows, 1)]
    for number, found in entries.items():
        if number not in wanted or not content:
            continue
        home = raw.home[number]
        every = raw.channels[home].topic in RARE or rows >= len(moments)
        kept = found if every else found[np.isin(found["time_ns"], few)]
        for time_ns, offset in kept.tolist():
            length = int.from_bytes(content[offset + 1 : offset + RECORD_HEAD], "little")
            unread -= RECORD_HEAD + length
            if unread < 0:
                raise ValueError("the index is wrong")
            raw.payloads[home].append(content[offset + RECORD_HEAD + MESSAGE_HEAD : offset + RECORD_HEAD + length])
            raw.times_ns[home].append(time_ns)
