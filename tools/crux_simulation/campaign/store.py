"""A campaign's folder: one file a finished job, written whole or not at all, is the truth; the table comes from them.

DIR/rows/KEY.json       one row, nested as commands print it with --json
DIR/failures/KEY/       everything about a job that failed; DIR/successes/KEY/ with `--keep all`
DIR/results.parquet     the rows as one table, a column a value: plan.seconds, climb.tracking.body_m, ...
"""

from __future__ import annotations

import json
import shutil
from collections.abc import Iterable
from pathlib import Path

from crux_contracts.output_file import write_whole
from crux_tools.report.results import ERROR, FAILURES, ROWS, Row, read_rows

from crux_simulation.campaign.job import Outcome

TABLE = "results.parquet"
SUCCESSES = "successes"


class Store:
    """Results in a folder."""

    def __init__(self, folder: Path, keep_all: bool = False) -> None:
        """Makes the folder; raises OSError where it cannot be made. `keep_all`: files of successes, too."""
        self.folder, self.keep_all = folder, keep_all
        (folder / ROWS).mkdir(parents=True, exist_ok=True)

    def clear(self) -> None:
        """Forgets everything."""
        for name in (ROWS, FAILURES, SUCCESSES):
            shutil.rmtree(self.folder / name, ignore_errors=True)
        (self.folder / ROWS).mkdir()

    def finished(self) -> set[str]:
        """Keys of the jobs that need not run again; those that ended with an error do."""
        return {row["key"] for row in read_rows(self.folder) if row["verdict"] != ERROR}

    def put(self, outcome: Outcome) -> None:
        """Keeps a result: its files first, its row last, so that whoever finds the row finds everything."""
        key = outcome.row["key"]
        if outcome.files and (self.keep_all or not outcome.ok):
            _put_folder(self.folder / (SUCCESSES if outcome.ok else FAILURES) / key, outcome.files)
        if outcome.ok:  # what an earlier error left
            shutil.rmtree(self.folder / FAILURES / key, ignore_errors=True)
        write_whole(self.folder / ROWS / f"{key}.json", json.dumps(outcome.row, default=float).encode())

    def write_table(self) -> None:
        """Writes the table of all rows there are."""
        write_table(self.folder / TABLE, read_rows(self.folder))


def _put_folder(folder: Path, files: dict[str, bytes]) -> None:
    scratch = folder.with_name(f".{folder.name}")
    shutil.rmtree(scratch, ignore_errors=True)
    scratch.mkdir(parents=True)
    for name, data in files.items():
        (scratch / name).write_bytes(data)
    shutil.rmtree(folder, ignore_errors=True)
    scratch.replace(folder)


def flat(row: Row, prefix: str = "") -> Row:
    """One value a column; lists as JSON text."""
    columns: Row = {}
    for name, value in row.items():
        if isinstance(value, dict):
            columns |= flat(value, f"{prefix}{name}.")
        else:
            columns[f"{prefix}{name}"] = json.dumps(value) if isinstance(value, list) else value
    return columns


def write_table(path: Path, rows: Iterable[Row]) -> None:
    """As Parquet."""
    import pyarrow
    from pyarrow import parquet

    flattened = [flat(row) for row in rows]
    names = dict.fromkeys(name for row in flattened for name in row)
    table = pyarrow.table({name: [row.get(name) for row in flattened] for name in names})
    buffer = pyarrow.BufferOutputStream()
    parquet.write_table(table, buffer)
    write_whole(path, buffer.getvalue().to_pybytes())
