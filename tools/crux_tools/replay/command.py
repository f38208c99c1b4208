"""`crux replay`: a logged climb in figures and in a 3-D view."""

from __future__ import annotations

import argparse
import errno
import socket
from pathlib import Path
from typing import Any

from crux_tools.arguments import taught
from crux_tools.errors import UsageError
from crux_tools.output import add_json_option, note, print_json

DEFAULT_PORT = 8737
_DESCRIPTION = """Prints what happened in a logged climb - states, faults, waits, tracking, wrench errors, timing - and
shows it in a 3-D view in the browser: the robot as its joints were measured, the plan as a ghost, the contact forces.
Logs of a runtime that was killed open too, as far as they go. With --check it instead computes every cycle again, by
the runtime's own control core from the logged inputs, and compares all it gave out bit by bit; in a log of
--log-frames it also does the end-to-end checks of all CAN frames again, and compares with what the runtime counted."""
_EXAMPLES = (
    "crux replay out/climb.mcap",
    "crux replay out/climb.mcap --no-view --json",
    "crux replay out/climb.mcap --check",
)


def _port(text: str) -> int:
    port = int(text) if text.isdigit() else -1
    if not 0 <= port <= 65535:
        raise argparse.ArgumentTypeError(f"'{text}' is not a port: 1 … 65535, or 0 for any free one")
    return port


def add_parser(subparsers: Any) -> None:
    """Adds the parser of `crux replay`."""
    parser = subparsers.add_parser(
        "replay",
        help="show a logged climb",
        **taught(_DESCRIPTION, *_EXAMPLES),
    )
    parser.add_argument("log", type=Path, metavar="LOG.mcap", help="telemetry of a climb")
    parser.add_argument("--no-view", action="store_true", help="print the summary and end")
    parser.add_argument("--check", action="store_true", help="compute every cycle again and compare bit by bit")
    parser.add_argument("--host", default="127.0.0.1", help="address the view is served on (default: %(default)s)")
    parser.add_argument(
        "--port", type=_port, default=DEFAULT_PORT, help="port of the view, 0 for any free one (default: %(default)s)"
    )
    add_json_option(parser)
    parser.set_defaults(func=run)


def _print_table(table: list[tuple[str, str]]) -> None:
    width = max(len(key) for key, _ in table)
    for key, value in table:
        first, *more = value.split("; ")
        print(f"{key:<{width}}  {first}")
        for line in more:
            print(f"{'':<{width}}  {line}")


def _check(options: argparse.Namespace) -> int:
    from crux_tools.replay.bus_check import HEALTH, check_frames
    from crux_tools.replay.recompute import recompute

    found, bus = recompute(options.log), check_frames(options.log)
    ok = found.ok and (bus is None or bus.first_difference is None)
    if options.json:
        print_json(found.to_json() | {"ok": ok, "bus": None if bus is None else vars(bus)})
        return 0 if ok else 1
    if found.first_difference is not None:
        print(f"differs: {found.first_difference}")
    else:
        print(f"{found.cycles} cycles computed again: every output and state the same, bit for bit")
    if found.missing_cycle is not None:
        print(f"cycle {found.missing_cycle} is not in the log: nothing from there on can be computed again")
    if bus is not None and bus.first_difference is not None:
        print(f"differs: {bus.first_difference}")
    elif bus is not None:
        print(f"{bus.frames} CAN frames checked again: every count of {HEALTH} comes out the same")
    return 0 if ok else 1


def _check_address(host: str, port: int) -> None:
    """Where nothing can listen, viser would wait for its own server for ever. Raises UsageError."""
    try:
        family, kind, protocol, _, address = socket.getaddrinfo(host, port, type=socket.SOCK_STREAM)[0]
        with socket.socket(family, kind, protocol) as probe:
            probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
            probe.bind(address)
    except (OSError, UnicodeError) as error:
        if isinstance(error, OSError) and error.errno == errno.EADDRINUSE:
            return
        why = getattr(error, "strerror", None) or str(error)
        raise UsageError(
            f"--host {host} --port {port}: cannot be listened on: {why}; right is an address of this machine, such as "
            "127.0.0.1, or 0.0.0.0 for all of them"
        ) from error


def run(options: argparse.Namespace) -> int:
    """Exit status 0 when the log could be shown, however the climb went; with --check, when nothing differs."""
    if options.check:
        return _check(options)
    if not options.no_view:
        _check_address(options.host, options.port)
    from crux_tools.telemetry import read_log
    from crux_tools.telemetry.summary import summarise
    from crux_tools.telemetry.wording import rows

    log = read_log(options.log)
    summary = summarise(log)
    for remark in summary.notes:
        note(f"crux replay: {remark}")
    if options.json:
        print_json({"ok": True, **summary.to_json()})
    else:
        _print_table(rows(summary))
    if options.no_view:
        return 0
    if log.plan is None:
        note("crux replay: no view: no plan was accepted in this log, so there is no wall to show")
        return 0
    from crux_tools.replay.viewer import Viewer

    viewer = Viewer(log, options.host, options.port)
    try:
        note(f"view: {viewer.url} (Ctrl-C ends it)")
        viewer.wait()
    except KeyboardInterrupt:  # how it is meant to end
        pass
    viewer.close()
    return 0
