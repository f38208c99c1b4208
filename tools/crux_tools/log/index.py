"""What a folder's logs tell, one entry a log, kept in a file of this user so that each log is read once.

The file ($XDG_CACHE_HOME/crux/logs.sqlite3) holds nothing that the logs do not: it may be deleted at any time. An entry
stands as long as its log has the size and the time of change it had; one that is damaged is read again.
"""

from __future__ import annotations

import hashlib
import json
import os
import sqlite3
from collections.abc import Callable, Iterator
from contextlib import closing, suppress
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    from crux_tools.telemetry import Telemetry

END_S = 3.0  # of a log: its last state is in it
MOST = 10**6  # chunks, and moments of one
STATE_TOPIC = "/robot_state"
FORM = 2  # of the entries: another one makes all be read again
_TABLE = """create table if not exists logs
(path blob primary key, form integer, bytes integer, changed_ns integer, entry text, digest text) without rowid"""
CLIMBED, FAILED, UNJUDGED = "climbed", "failed", "unjudged"


@dataclass(frozen=True)
class Entry:
    """A log in a line. None: not in the log."""

    path: str
    bytes: int
    started_utc: str | None
    host: str | None
    commit: str | None
    robot: str | None
    wall: str | None  # name of the scenario
    world: str | None
    seed: str | None
    duration_s: float
    verdict: str  # climbed or failed, by the judge; unjudged: a log without ground truth
    reason: str  # why it failed; of an unjudged one how far the plan came
    slips: int | None
    largest_slip_m: float | None
    goal_error_m: float | None
    least_margin_N: float | None
    faults: list[str]
    closed: bool
    note: str | None


def entry_of(path: Path) -> Entry | None:
    """Reads a log; None where the file is none (a plan). Raises LogError."""
    from crux_tools.telemetry import is_log, read_channels, telemetry_of
    from crux_tools.telemetry.description import robot_of
    from crux_tools.telemetry.margins import measured_margin_n

    channels = read_channels(path)
    if not is_log(channels):
        return None
    log = telemetry_of(path, channels)
    margin = np.empty(0)
    if log.plan is not None:
        with robot_of(log.plan.robot_name, log.robot_files) as robot:
            margin = measured_margin_n(log, robot.control.force_filter_s)
    return _entry(log, len(log.time_s), float(np.nanmin(margin)) if np.isfinite(margin).any() else None)


def entry_of_end(path: Path, cycles: int) -> Entry | None:
    """The same of a log with an index, of so many cycles, without its margin: from its last seconds and all that is
    rare. None where it is none, or where its end does not tell; then `entry_of` does. Raises OSError.
    """
    from crux_tools.telemetry import LogError, is_log, telemetry_of
    from crux_tools.telemetry.chunks import span_s
    from crux_tools.telemetry.part import read_part
    from crux_tools.telemetry.records import READ_ERRORS

    end_s = span_s(path)[1]
    if not end_s:
        return None
    try:
        channels = read_part(path, end_s - END_S, end_s, chunks=MOST, rows=MOST)
        return _entry(telemetry_of(path, channels), cycles, None) if is_log(channels) else None
    except (LogError, *READ_ERRORS, IndexError):
        return None


def _entry(log: Telemetry, cycles: int, margin_N: float | None) -> Entry:
    from crux_tools.telemetry.summary import summarise

    path = log.path
    summary, said = summarise(log), log.metadata
    judged = log.verdict
    place = f"at plan time {summary.plan_time_s:.1f} of {summary.plan_end_s:.1f} s"
    state = "plan completed" if summary.plan_complete else f"{summary.final_state} {place}" if log.plan else "no plan"
    return Entry(
        path=str(path),
        bytes=path.stat().st_size,
        started_utc=said.get("started_utc"),
        host=said.get("host"),
        commit=said.get("commit"),
        robot=summary.robot or said.get("robot"),
        wall=summary.scenario,
        world=(judged.world if judged else said.get("world")) or None,
        seed=said.get("seed"),
        duration_s=float(cycles * log.inputs["dt_s"][0]),
        verdict=UNJUDGED if judged is None else CLIMBED if judged.ok else FAILED,
        reason=state if judged is None else judged.reason,
        slips=judged.slips if judged else None,
        largest_slip_m=judged.largest_slip_m if judged else None,
        goal_error_m=judged.goal_error_m if judged else None,
        least_margin_N=margin_N,
        faults=[f"{fault.code} {fault.name}{f' {fault.limb}' if fault.limb else ''}" for fault in summary.faults],
        closed=log.end is not None,
        note=said.get("note"),
    )


def index_path() -> Path:
    """Where the index of this user is."""
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "crux" / "logs.sqlite3"


def _opened() -> sqlite3.Connection:
    """The index; a new one where it is damaged, one in memory where none can be written."""
    path = index_path()
    for again in (True, False):
        try:
            path.parent.mkdir(parents=True, exist_ok=True)
            connection = sqlite3.connect(path, timeout=30)
            connection.text_factory = lambda text: text.decode(errors="replace")  # of a damaged file, too
            connection.execute(_TABLE)
            connection.execute("select path, form, bytes, changed_ns, entry, digest from logs limit 1")
            if connection.execute("pragma quick_check").fetchall() != [("ok",)]:
                raise sqlite3.DatabaseError("damaged")
            connection.execute("pragma synchronous = off")
            return connection
        except (OSError, sqlite3.DatabaseError, UnicodeDecodeError) as error:
            if not (_is_damage(error) and again):
                break
            with suppress(OSError):
                path.unlink()
    connection = sqlite3.connect(":memory:")
    connection.execute(_TABLE)
    return connection


def _is_damage(error: Exception) -> bool:
    """Rather than a file that is busy, or cannot be opened or written."""
    if isinstance(error, sqlite3.OperationalError):
        return error.sqlite_errorcode == sqlite3.SQLITE_ERROR  # another table than ours
    return not isinstance(error, OSError)  # UnicodeDecodeError: of what SQLite says of damaged text


def found_logs(folder: Path) -> Iterator[tuple[str, os.stat_result]]:
    """All *.mcap below a folder, with what the file system says of them."""
    waiting = [str(folder)]
    while waiting:
        with os.scandir(waiting.pop()) as inside:
            for each in inside:
                if each.is_dir(follow_symlinks=False):
                    waiting.append(each.path)
                elif each.name.endswith(".mcap") and not each.name.startswith(".") and each.is_file():
                    yield each.path, each.stat()


def entries(folder: Path, note: Callable[[str], None], at: Callable[[int, int], None]) -> list[Entry]:
    """All logs below a folder (plans are left out). `note` is told of files that cannot be read, `at` of how many of
    how many new ones have been. What has been read stays in the index when this is interrupted. Raises OSError.
    """
    from crux_contracts.yaml_document import DocumentError

    from crux_tools.telemetry import LogError

    folder = folder.resolve()
    files = sorted(found_logs(folder))
    with closing(_opened()) as index:
        known = _known(index, folder)
        new = [file for file in files if known.get(file[0], ((),))[0] != (file[1].st_size, file[1].st_mtime_ns)]
        for done, (path, stat) in enumerate(new):
            at(done, len(new))
            try:
                found = entry_of(Path(path))
                text = json.dumps(asdict(found)) if found else ""
            except (LogError, DocumentError, OSError) as error:
                text = json.dumps({"error": str(error)})
            key = (stat.st_size, stat.st_mtime_ns)
            row = (os.fsencode(path), FORM, *key, text)
            index.execute("insert or replace into logs values (?, ?, ?, ?, ?, ?)", (*row, _digest(row)))
            index.commit()
            known[path] = (key, text)
        gone = set(known) - {path for path, _ in files}
        index.executemany("delete from logs where path = ?", [(os.fsencode(path),) for path in gone])
        index.commit()
    told = [json.loads(known[path][1]) for path, _ in files if known[path][1]]
    for unreadable in (each["error"] for each in told if "error" in each):
        note(unreadable)
    return [Entry(**each) for each in told if "error" not in each]


def _digest(row: tuple[Any, ...]) -> str:
    """Of a row of the table but itself."""
    return hashlib.sha256(repr(row).encode()).hexdigest()


def _known(index: sqlite3.Connection, folder: Path) -> dict[str, tuple[Any, str]]:
    """Sizes and times of change with the entries of the logs below a folder; without what is damaged."""
    below = f"{folder}{os.sep}".replace(f"{os.sep}{os.sep}", os.sep)
    rows = index.execute(
        "select path, form, bytes, changed_ns, entry, digest from logs where form = ? and path >= ? and path < ?",
        (FORM, os.fsencode(below), os.fsencode(below[:-1] + chr(ord(os.sep) + 1))),
    )
    sound = (row for *row, digest in rows if _digest(tuple(row)) == digest)
    return {os.fsdecode(path): ((size, changed_ns), text) for path, _, size, changed_ns, text in sound}
