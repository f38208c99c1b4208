"""`crux log note`: words of the user's into a log that is written already."""

from __future__ import annotations

import argparse
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from crux_tools.arguments import taught
from crux_tools.errors import UsageError
from crux_tools.output import add_json_option, note, print_json

_DESCRIPTION = """Adds a note to a log whose runtime has ended: what the climb was about, or what was seen later. Notes
given earlier (also by --note of crux climb, crux sim and crux-runtime) stay; crux log ls, crux log info and crux
report show all of them. Nothing else in the file changes."""


def add_note(actions: Any) -> None:
    """Adds the parser of `crux log note`."""
    parser = actions.add_parser(
        "note", help="add a note to a log", **taught(_DESCRIPTION, 'crux log note out/climb.mcap "left pad was wet"')
    )
    parser.add_argument("log", type=Path, metavar="LOG.mcap", help="a log whose runtime has ended")
    parser.add_argument("text", metavar="TEXT", help="the note")
    add_json_option(parser)
    parser.set_defaults(action=run_note)


def run_note(options: argparse.Namespace) -> int:
    """Exit status 0 when it is in the log."""
    from crux_tools.telemetry import LogError, is_log, read_channels
    from crux_tools.telemetry.append import append
    from crux_tools.telemetry.channels import NOTE_METADATA
    from crux_tools.telemetry.reader import STATE_TOPIC

    text = " ".join(options.text.split())
    if not text:
        raise UsageError("TEXT is empty; give at least one word")
    if not is_log(read_channels(options.log, {STATE_TOPIC})):
        raise LogError(f"{options.log}: no channel {STATE_TOPIC} in it: this is not a telemetry log")
    said = {"note": text, "written_utc": datetime.now(UTC).isoformat()}
    try:
        append(options.log, (), {NOTE_METADATA: said})
    except ValueError as error:
        raise LogError(f"{options.log}: {error}; crux log recover makes a whole file of it") from error
    notes = read_channels(options.log, set()).metadata.get("note")
    if notes is None:
        raise LogError(f"{options.log}: a damaged record hides the note: crux log recover makes a whole file of it")
    if options.json:
        print_json({"ok": True, "file": str(options.log), "note": notes})
    else:
        note(f"{options.log}: {notes}")
    return 0
