"""`crux replay`: a logged climb in figures and in a 3-D view."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import TYPE_CHECKING, Any

from crux_contracts.terminal import say

from crux_tools.arguments import positive, taught
from crux_tools.errors import UsageError
from crux_tools.output import add_json_option, note, print_json
from crux_tools.page_address import add_address, check_address

if TYPE_CHECKING:
    from crux_tools.replay.bus_check import BusCheck

_DESCRIPTION = """Prints what happened in a logged climb - states, faults, waits, tracking, wrench errors, timing - and
shows it in the browser as crux view does. Logs of a killed runtime open as far as they go. With --check it recomputes
every cycle from the logged inputs with the runtime's own control core, and compares all outputs bit by bit; if the log
has CAN frames (--log-frames), their end-to-end checks are repeated too. With --robot the core uses another robot
description, for example with a changed gain: the first number that differs is reported."""
_EXAMPLES = (
    "crux replay out/climb.mcap",
    "crux replay out/climb.mcap --no-view --json",
    "crux replay out/climb.mcap --check",
    "crux replay out/climb.mcap --check --robot stiffer/",
)


def add_parser(subparsers: Any) -> None:
    """Adds the parser of `crux replay`."""
    parser = subparsers.add_parser(
        "replay",
        help="show a logged climb",
        **taught(_DESCRIPTION, *_EXAMPLES),
    )
    parser.add_argument("log", type=Path, metavar="LOG.mcap", help="telemetry of a climb")
    parser.add_argument("--no-view", action="store_true", help="only print the summary")
    parser.add_argument("--check", action="store_true", help="compute every cycle again and compare bit by bit")
    parser.add_argument(
        "--within",
        type=positive,
        default=0.0,
        metavar="X",
        help="with --check: tolerance for numbers [SI units], not for states; for logs from another processor",
    )
    parser.add_argument(
        "--robot",
        metavar="NAME|PATH",
        help="with --check: robot description to use (default: the one in the log)",
    )
    add_address(parser)
    add_json_option(parser)
    parser.set_defaults(func=run)


def _print_table(table: list[tuple[str, str]]) -> None:
    width = max(len(key) for key, _ in table)
    for key, value in table:
        first, *more = value.split("\n")
        say(f"{key:<{width}}  {first}")
        for line in more:
            say(f"{'':<{width}}  {line}")


def _check(options: argparse.Namespace) -> int:
    from crux_contracts.robot import load_robot

    from crux_tools.replay import recompute
    from crux_tools.telemetry.can_frames import CHECKED, HEALTH
    from crux_tools.telemetry.channels import read_payloads

    def frames() -> BusCheck | None:
        from crux_tools.replay.bus_check import checked  # while the core computes, which takes longest

        return checked(read_payloads(options.log, CHECKED))

    robot = None if options.robot is None else load_robot(options.robot)
    found, bus = recompute.recomputed(options.log, frames, options.within, robot)
    ok = found.ok and (bus is None or bus.first_difference is None)
    for remark in found.lost:
        note(f"crux replay: {remark}")
    if options.json:
        print_json(found.to_json() | {"ok": ok, "bus": None if bus is None else vars(bus)})
        return 0 if ok else 1
    if found.first_difference is not None:
        say(f"differs: {found.first_difference}")
    elif found.largest:
        say(f"{found.cycles} cycles computed again: every state the same, numbers within {found.largest:.1e}")
    elif found.cycles:
        say(f"{found.cycles} cycles computed again: every output and state the same, bit for bit")
    if found.missing_cycle is not None:
        say(f"cycle {found.missing_cycle} is not in the log: nothing from there on can be computed again")
    if bus is not None and bus.first_difference is not None:
        say(f"differs: {bus.first_difference}")
    elif bus is not None:
        say(f"{bus.frames} CAN frames checked again: every count of {HEALTH} comes out the same")
    return 0 if ok else 1


def run(options: argparse.Namespace) -> int:
    """Exit status 0 when the log could be shown, however the climb went; with --check, when nothing differs."""
    if options.check:
        return _check(options)
    if options.robot is not None:
        raise UsageError("--robot needs --check: nothing else computes by a robot's description")
    if not options.no_view:
        check_address(options.host, options.port)
    from crux_tools.telemetry import read_channels, telemetry_of
    from crux_tools.telemetry.summary import summarise
    from crux_tools.telemetry.wording import rows

    channels = read_channels(options.log)
    log = telemetry_of(options.log, channels)
    summary = summarise(log)
    for remark in summary.notes:
        note(f"crux replay: {remark}")
    if options.json:
        print_json({"ok": True, **summary.to_json()})
    else:
        _print_table(rows(summary))
    if options.no_view:
        return 0
    from crux_tools.view.command import serve
    from crux_tools.view.recording import recording_of_log
    from crux_tools.view.server import still

    recording = recording_of_log(log, channels)
    if recording is None:
        note("crux replay: no view: no plan was accepted in this log, so there is no wall to show")
    else:
        serve([still(recording)], options.host, options.port)
    return 0
