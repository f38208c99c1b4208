"""`crux log info`, `cut`, `merge` and `recover`."""

from __future__ import annotations

import argparse
import math
from dataclasses import asdict
from pathlib import Path
from typing import Any

from crux_contracts.terminal import in_a_line, say

from crux_tools.arguments import taught, within
from crux_tools.errors import UsageError
from crux_tools.output import add_json_option, note, print_json


def _log(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("log", type=Path, metavar="LOG.mcap", help="telemetry of a climb")


def _output(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="OUT.mcap", help="the log to write")
    add_json_option(parser)


def add_span(parser: argparse.ArgumentParser) -> None:
    """--from and --to: a part of the log."""
    seconds = within(-math.inf, math.inf, "a number of seconds")
    parser.add_argument(
        "--from",
        type=seconds,
        default=-math.inf,
        dest="from_s",
        metavar="S",
        help="first second (default: the log's start)",
    )
    parser.add_argument(
        "--to", type=seconds, default=math.inf, dest="to_s", metavar="S", help="last second (default: the log's end)"
    )


def add_edits(actions: Any) -> None:
    """Adds the parsers."""
    info = actions.add_parser(
        "info",
        help="show what a log holds",
        **taught(
            "Says when, where and by which versions a log was made, how the climb went, and what channels, metadata "
            "and attached files are in it. Damaged logs are read as far as possible.",
            "crux log info out/climb.mcap",
        ),
    )
    _log(info)
    add_json_option(info)
    info.set_defaults(action=run_info)
    _add_cut(actions)
    merge = actions.add_parser(
        "merge",
        help="join the parts of one run",
        **taught(
            "Joins the parts of one run into one log, in the order of time; what several parts hold is written once. "
            "Logs of different runs are refused.",
            "crux log merge out/a.mcap out/b.mcap -o out/whole.mcap",
        ),
    )
    merge.add_argument("logs", type=Path, nargs="+", metavar="LOG.mcap", help="two or more")
    _output(merge)
    merge.set_defaults(action=run_merge)
    recover = actions.add_parser(
        "recover",
        help="repair a log that is cut off or damaged",
        **taught(
            "Writes everything that can be read of a damaged log into a complete file with an index, which other tools "
            "can open. Says what was lost.",
            "crux log recover out/killed.mcap -o out/whole.mcap",
        ),
    )
    _log(recover)
    _output(recover)
    recover.set_defaults(action=run_recover)


def _add_cut(actions: Any) -> None:
    cut = actions.add_parser(
        "cut",
        help="cut out some seconds of a log",
        **taught(
            "Writes the part of a log between two log times (as crux report and crux replay show them), with the log's "
            "metadata and the plan that was climbed. crux replay --check cannot recompute a part, because the control "
            "core's state at its first cycle is not in it.",
            "crux log cut out/climb.mcap -o out/slip.mcap --from 41.5 --to 44",
        ),
    )
    _log(cut)
    add_span(cut)
    _output(cut)
    cut.set_defaults(action=run_cut)


def _written(options: argparse.Namespace, messages: int, lost: list[str]) -> int:
    for words in lost:
        note(f"crux log {options.log_action}: {words}")
    if options.json:
        print_json({"ok": True, "file": str(options.output), "messages": messages, "lost": lost})
    else:
        note(f"{options.output}: {messages} messages")
    return 0


def _looked_at(options: argparse.Namespace, logs: list[Path]) -> None:
    """Raises LogError for an input that is none, OutputError for such an output."""
    from crux_contracts.output_file import look_at_outputs

    from crux_tools.telemetry import LogError

    for log in logs:
        if not log.is_file():
            raise LogError(f"{log}: {'is a folder' if log.is_dir() else 'no such file'}, a log (.mcap) is needed")
    look_at_outputs({"-o": options.output}, logs)


def run_cut(options: argparse.Namespace) -> int:
    """Exit status 0 when it was written."""
    from crux_contracts.output_file import whole_file

    from crux_tools.log.edit import cut

    if options.from_s > options.to_s or (options.from_s, options.to_s) == (-math.inf, math.inf):
        raise UsageError("--from and --to: give one of them at least, the second not before the first")
    _looked_at(options, [options.log])
    limits = max(options.from_s, -1e9), min(options.to_s, 9e9)
    with whole_file(options.output) as scratch:
        messages, damage = cut(options.log, scratch, *limits)
    return _written(options, messages, damage.words())


def run_merge(options: argparse.Namespace) -> int:
    """Exit status 0 when it was written."""
    from crux_contracts.output_file import whole_file

    from crux_tools.log.edit import merge

    if len(options.logs) < 2:
        raise UsageError("LOG.mcap: give two logs or more")
    _looked_at(options, options.logs)
    with whole_file(options.output) as scratch:
        messages = merge(options.logs, scratch)
    return _written(options, messages, [])


def run_recover(options: argparse.Namespace) -> int:
    """Exit status 0 when something could be recovered."""
    from crux_contracts.output_file import whole_file

    from crux_tools.log.edit import recover

    _looked_at(options, [options.log])
    with whole_file(options.output) as scratch:
        messages, damage = recover(options.log, scratch)
    return _written(options, messages, damage.words() or ["nothing was lost"])


def run_info(options: argparse.Namespace) -> int:
    """Exit status 0 when it is a log, or what is left of one."""
    from crux_tools.log.contents import contents_of
    from crux_tools.log.index import STATE_TOPIC, entry_of, entry_of_end
    from crux_tools.telemetry import LogError
    from crux_tools.telemetry.log_format import newer_format

    found = contents_of(options.log)
    try:
        cycles = sum(channel.messages for channel in found.channels if channel.topic == STATE_TOPIC)
        entry = entry_of_end(options.log, cycles) or entry_of(options.log)
    except LogError as error:
        note(f"crux log info: {error}")
        entry = None
    if newer := newer_format(dict(pair for name, said in found.metadata if name == "crux" for pair in said.items())):
        note(f"crux log info: {newer}")
    if options.json:
        climb = None if entry is None else {k: v for k, v in asdict(entry).items() if k != "least_margin_N"}
        print_json({"ok": True, "climb": climb, **asdict(found)})
        return 0
    rows = [("file", f"{options.log}, {found.bytes / 1e6:.2f} MB, {found.messages} messages")]
    rows += [("damage", words) for words in found.damage]
    if entry is not None:
        faults = ", ".join(dict.fromkeys(entry.faults)) or "none"
        rows += [("verdict", ": ".join(filter(None, (entry.verdict, entry.reason)))), ("faults", faults)]
        rows += [("note", entry.note)] if entry.note else []
    rows += [(name, f"{key}: {value}") for name, said in found.metadata for key, value in said.items()]
    rows += [("attached", f"{name}, {size} bytes") for name, size in found.attachments.items()]
    width = max(len(what) for what, _ in rows)
    last = ""
    for what, value in rows:
        say(f"{'' if what == last else what:<{width}}  {in_a_line(value)}")
        last = what
    say(f"\n{'topic':<20} {'messages':>9} {'bytes':>11} {'from s':>9} {'to s':>9}  message")
    for channel in found.channels:
        times = "" if channel.from_s is None else f"{channel.from_s:>9.3f} {channel.to_s:>9.3f}"
        topic, kind = in_a_line(channel.topic), in_a_line(channel.type)
        say(f"{topic:<20} {channel.messages:>9} {channel.bytes:>11} {times:>19}  {kind}")
    return 0
