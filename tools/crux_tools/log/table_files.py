"""A log as tables, a file a topic: Parquet for pandas, polars and DuckDB, CSV for all else. One column a number."""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pyarrow
from crux_contracts import LIMB_NAMES
from crux_contracts.output_file import look_at_outputs, whole_file
from pyarrow import csv, parquet

from crux_tools.log.mcap_export import OF_A_LIMB
from crux_tools.log.seen import Seen
from crux_tools.telemetry import Channels
from crux_tools.telemetry.columns import columns


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
