"""A log as tables, a file a topic: Parquet for pandas, polars and DuckDB, CSV for all else. One column a number."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow
from crux_contracts import LIMB_NAMES, can_codec
from crux_contracts.output_file import look_at_outputs, whole_file
from pyarrow import csv, parquet

from crux_tools.log.mcap_export import OF_A_LIMB
from crux_tools.log.seen import Seen
from crux_tools.telemetry import Channels

XYZ = ("x", "y", "z")
JOINTS = [f"{limb}_joint{joint + 1}" for limb in LIMB_NAMES for joint in range(can_codec.JOINTS)]
FINGERS = [f"{limb}_finger{finger}" for limb in LIMB_NAMES for finger in (1, 2)]
WXYZ = ("w", *XYZ)
LABELS = {3: XYZ, 4: LIMB_NAMES, 24: JOINTS, 8: FINGERS, 12: [f"{limb}_{axis}" for limb in LIMB_NAMES for axis in XYZ]}


def _labels(field: str, count: int) -> list[str]:
    """What the numbers of an array are called."""
    if "quaternion" in field:
        return list(WXYZ) if count == 4 else [f"{limb}_{part}" for limb in LIMB_NAMES for part in WXYZ]
    if field.startswith("pad_position"):
        return [f"{finger}_{axis}" for finger in FINGERS for axis in XYZ]
    return list(LABELS.get(count) or map(str, range(count)))


def columns(table: np.ndarray) -> Iterator[tuple[str, np.ndarray]]:
    """Names and values of the columns of a record array."""
    for field in table.dtype.names or ():
        values = table[field]
        if values.ndim == 1:
            yield field, values
        else:
            labels = _labels(field, values.shape[1])
            yield from ((f"{field}_{label}", values[:, i]) for i, label in enumerate(labels))


def tables(channels: Channels, seen: Seen, utc: bool) -> Iterator[tuple[str, pyarrow.Table]]:
    """(name, table) of every topic of numbers, of the margins and the events."""

    def table(times_ns: np.ndarray, names_and_values: Any) -> pyarrow.Table:
        made = {"time_s": times_ns / 1e9}
        if utc:
            made["utc"] = pyarrow.array(seen.clock(times_ns), type=pyarrow.timestamp("ns", tz="UTC"))
        return pyarrow.table(made | {name: np.ascontiguousarray(values) for name, values in names_and_values})

    for topic, records in channels.tables.items():
        times_ns = channels.times_ns[topic]
        name = topic.strip("/").replace("/", "_")
        if topic not in OF_A_LIMB:
            yield name, table(times_ns, columns(records))
            continue
        for limb, limb_name in enumerate(LIMB_NAMES):
            rows = records["limb"] == limb
            yield f"{limb_name}_{name}", table(times_ns[rows], columns(records[rows]))
    row_ns = np.round(seen.log.time_s[seen.rows] * 1e9).astype(np.int64)
    yield "margins", table(row_ns, ((f"{limb}_margin_n", seen.margin_n[:, i]) for i, limb in enumerate(LIMB_NAMES)))
    events = {name: [getattr(event, name) for event in seen.events] for name in ("level", "text")}
    event_ns = np.array([event.log_ns for event in seen.events], dtype=np.int64)
    yield (
        "events",
        table(event_ns, [("level", np.array(events["level"], dtype=np.int32))]).append_column(
            "text", pyarrow.array(events["text"], type=pyarrow.string())
        ),
    )


def write_tables(folder: Path, form: str, channels: Channels, seen: Seen, utc: bool) -> list[Path]:
    """Writes NAME.parquet or NAME.csv into the folder; returns the files. Raises OutputError, OSError."""
    written = []
    for name, table in tables(channels, seen, utc):
        path = folder / f"{name}.{form}"
        look_at_outputs({"-o": path}, (seen.log.path,))
        with whole_file(path) as scratch:
            if form == "parquet":
                parquet.write_table(table, scratch)
            else:
                csv.write_csv(table, scratch)
        written.append(path)
    return written
