"""`crux log ls`: the logs of a folder, one a line."""

from __future__ import annotations

import argparse
from datetime import date
from pathlib import Path
from typing import TYPE_CHECKING, Any

from crux_contracts.terminal import in_a_line, say

from crux_tools.arguments import taught, whole
from crux_tools.errors import UsageError
from crux_tools.output import add_json_option, note, print_json, progress

if TYPE_CHECKING:
    from crux_tools.log.index import Entry

_DESCRIPTION = """Lists the logs below a folder: start (UTC), wall, robot, verdict, slips, least margin with the
squeeze that the robot applied, faults, and note. The first run reads every log and keeps what it found in an index
(~/.cache/crux/logs.sqlite3); later runs read only new and changed logs. Other files are ignored."""
_EXAMPLES = (
    "crux log ls out",
    "crux log ls out --verdict failed --wall overhang --sort margin",
    "crux log ls out --fault slip --since 2026-11-01 --json",
)
# What a sort goes by; logs without it come last.
KEYS = {
    "date": "started_utc",
    "wall": "wall",
    "robot": "robot",
    "verdict": "verdict",
    "slips": "slips",
    "margin": "least_margin_N",
    "goal": "goal_error_m",
    "duration": "duration_s",
    "size": "bytes",
    "path": "path",
}


def _day(text: str) -> str:
    try:
        return date.fromisoformat(text).isoformat()
    except ValueError:
        raise argparse.ArgumentTypeError(f"{text!r}: expected a date such as 2026-11-22") from None


def add_ls(actions: Any) -> None:
    """Adds the parser of `crux log ls`."""
    parser = actions.add_parser("ls", help="list the logs below a folder", **taught(_DESCRIPTION, *_EXAMPLES))
    parser.add_argument("folder", type=Path, nargs="?", default=Path("."), metavar="DIR", help="(default: this one)")
    parser.add_argument("--wall", metavar="TEXT", help="scenarios with this in their name")
    parser.add_argument("--robot", metavar="NAME", help="this robot")
    parser.add_argument("--host", metavar="NAME", help="recorded on this machine")
    parser.add_argument("--verdict", choices=["climbed", "failed", "unjudged"], help="unjudged: logs of a robot")
    parser.add_argument("--fault", metavar="TEXT", help="a fault with this in its number, name or limb")
    parser.add_argument("--note", metavar="TEXT", help="a note with this in it")
    parser.add_argument("--since", type=_day, metavar="DATE", help="begun on this day (UTC) or later")
    parser.add_argument("--until", type=_day, metavar="DATE", help="begun on this day (UTC) or earlier")
    parser.add_argument("--sort", choices=KEYS, default="date", help="(default: %(default)s)")
    parser.add_argument("--reverse", action="store_true", help="greatest first")
    parser.add_argument("--limit", type=whole(1), metavar="N", help="the first N alone")
    add_json_option(parser)
    parser.set_defaults(action=run_ls)


def _has(text: str | None, wanted: str | None) -> bool:
    return wanted is None or wanted.lower() in (text or "").lower()


def _is_wanted(entry: Entry, options: argparse.Namespace) -> bool:
    day = (entry.started_utc or "")[:10]
    return (
        _has(entry.wall, options.wall)
        and options.robot in {None, entry.robot}
        and options.host in {None, entry.host}
        and options.verdict in {None, entry.verdict}
        and (options.fault is None or any(_has(fault, options.fault) for fault in entry.faults))
        and _has(entry.note, options.note)
        and (options.since is None or day >= options.since)
        and (options.until is None or "" < day <= options.until)
    )


def _sorted(found: list[Entry], key: str, reverse: bool) -> list[Entry]:
    there = [entry for entry in found if getattr(entry, key) is not None]
    lacking = [entry for entry in found if getattr(entry, key) is None]
    return [*sorted(there, key=lambda entry: getattr(entry, key), reverse=reverse), *lacking]


def _cells(entry: Entry, folder: Path) -> list[str]:
    path = Path(entry.path)
    return [
        (entry.started_utc or "–")[:16].replace("T", " "),
        entry.wall or "–",
        entry.robot or "–",
        entry.verdict + (f": {entry.reason}" if entry.reason else "") + ("" if entry.closed else " (not closed)"),
        "–" if entry.slips is None else str(entry.slips),
        "–" if entry.least_margin_N is None else f"{entry.least_margin_N:.2f} N",
        ", ".join(dict.fromkeys(entry.faults)) or "–",
        entry.note or "–",
        str(path.relative_to(folder)),
    ]


def run_ls(options: argparse.Namespace) -> int:
    """Exit status 0, however many logs there are."""
    from dataclasses import asdict

    from crux_tools.log.index import entries

    if not options.folder.is_dir():
        raise UsageError(f"{options.folder}: is no folder; crux log info shows a single log")
    with progress("reading new logs", 1.0) as bar:
        found = entries(
            options.folder, lambda text: note(f"crux log ls: {text}"), lambda done, of: bar.at(done / max(of, 1))
        )
    chosen = [entry for entry in found if _is_wanted(entry, options)]
    chosen = _sorted(chosen, KEYS[options.sort], options.reverse)[: options.limit]
    if options.json:
        print_json({"ok": True, "of": len(found), "logs": [asdict(entry) for entry in chosen]})
        return 0
    heads = ["begun (UTC)", "wall", "robot", "verdict", "slips", "margin", "faults", "note", "log"]
    rows = (_cells(entry, options.folder.resolve()) for entry in chosen)
    lines = [heads, *([in_a_line(cell) for cell in row] for row in rows)]
    widths = [max(len(line[column]) for line in lines) for column in range(len(heads))]
    for line in lines:
        say("  ".join(cell.ljust(width) for cell, width in zip(line, widths, strict=True)).rstrip())
    note(f"{len(chosen)} of {len(found)} logs")
    return 0
