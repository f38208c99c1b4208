"""`crux log export`: a log for other tools."""

from __future__ import annotations

import argparse
import importlib.util
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from crux_tools.arguments import positive, taught
from crux_tools.errors import UsageError
from crux_tools.output import add_json_option, note, print_json

if TYPE_CHECKING:
    from crux_tools.log.seen import Seen
    from crux_tools.telemetry import Channels
    from crux_tools.telemetry.channels import Payloads

DEFAULT_RATE_HZ = 50.0
FORMS = {
    "foxglove": "an MCAP file with the ROS 2 messages that Foxglove, Lichtblick, rviz and PlotJuggler draw by "
    "themselves, and all that is in the log, each limb with topics of its own; tools/layouts has layouts for it",
    "rerun": "a recording (.rrd) with its blueprint, for the rerun viewer of the same version",
    "parquet": "a folder of Parquet tables, a file a topic, one column a number",
    "csv": "the same as CSV",
    "asc": "CAN frames of all buses, for Vector's tools and SavvyCAN",
    "blf": "the same in Vector's binary form",
    "candump": "the same as candump -L writes it, for can-utils",
}
TABLES, CAN = ("parquet", "csv"), ("asc", "blf", "candump")
_DESCRIPTION = """Converts a log for other tools. It adds what those tools can draw: the robot's shape and frames,
holds, obstacles, measured and planned forces, margins (the smaller of a limb's two fingers, in newtons), wrenches in
the wall's axes at the gripper, events as text, and the state of nodes and buses as diagnostics. Everything is computed
from the log and the robot description in it. CAN frames come from the log if it has those of every cycle
(--log-frames). Otherwise they are rebuilt from the logged signals, without heartbeats, emergencies, temperatures and
the time within a cycle."""
_EXAMPLES = (
    "crux log export out/climb.mcap -o out/seen.mcap --foxglove",
    "crux log export out/climb.mcap -o out/climb.rrd --rerun && rerun out/climb.rrd",
    "crux log export out/climb.mcap -o out/tables --parquet",
    "crux log export out/climb.mcap -o out/climb.log --candump --utc",
)


def add_export(actions: Any) -> None:
    """Adds the parser of `crux log export`."""
    parser = actions.add_parser("export", help="write a log for other tools", **taught(_DESCRIPTION, *_EXAMPLES))
    parser.add_argument("log", type=Path, metavar="LOG.mcap", help="telemetry of a climb")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="OUT", help="the file or folder to write")
    forms = parser.add_mutually_exclusive_group(required=True)
    for form, text in FORMS.items():
        forms.add_argument(f"--{form}", action="store_const", const=form, dest="form", help=text)
    parser.add_argument(
        "--rate",
        type=positive,
        default=DEFAULT_RATE_HZ,
        metavar="HZ",
        help="rate of the added topics (default: %(default)g); what is in the log keeps its own rate",
    )
    parser.add_argument("--utc", action="store_true", help="use dates, not seconds since the log began")
    add_json_option(parser)
    parser.set_defaults(action=run_export)


def run_export(options: argparse.Namespace) -> int:
    """Exit status 0 when everything was written; a folder of tables that come to nothing does not stay."""
    with ExitStack() as done:
        if options.form in TABLES and not options.output.exists():
            done.callback(_remove_if_empty, options.output)
        return _export(options)


def _remove_if_empty(folder: Path) -> None:
    with suppress(OSError):
        folder.rmdir()


def _export(options: argparse.Namespace) -> int:
    from crux_contracts.output_file import look_at_folder, look_at_outputs

    from crux_tools.log.seen import seen, utc_clock
    from crux_tools.output import alone_with
    from crux_tools.telemetry.channels import read_both
    from crux_tools.telemetry.description import robot_of
    from crux_tools.telemetry.reader import telemetry_of

    if options.form in TABLES:
        look_at_folder("-o", options.output)
    else:
        look_at_outputs({"-o": options.output}, (options.log,))
    if options.form == "rerun" and importlib.util.find_spec("rerun") is None:
        raise UsageError("--rerun: needs the package rerun-sdk: pip install rerun-sdk")
    channels, payloads = read_both(options.log)
    log = telemetry_of(options.log, channels)
    clock = utc_clock(log) if options.utc else lambda times_ns: times_ns
    name = log.plan.robot_name if log.plan else log.metadata.get("robot", "")
    with alone_with(options.output), robot_of(name, log.robot_files) as robot:
        what = _write(options, seen(log, channels, robot, options.rate, clock), channels, payloads)
    for remark in log.notes:
        note(f"crux log export: {remark}")
    if options.json:
        print_json({"ok": True, "file": str(options.output), "form": options.form, **what})
    else:
        note(f"{options.output}: {', '.join(f'{count} {word}' for word, count in what.items())}")
    return 0


def _write(options: argparse.Namespace, shown: Seen, channels: Channels, payloads: Payloads) -> dict[str, int]:
    """Writes it in the form asked for; returns what was written, counted."""
    from crux_contracts.output_file import whole_file

    if options.form in TABLES:
        from crux_tools.log.table_files import write_tables

        return {"tables": len(write_tables(options.output, options.form, channels, shown, options.utc))}
    with whole_file(options.output) as scratch:
        if options.form in CAN:
            from crux_tools.log.can_files import write_can
            from crux_tools.telemetry.can_frames import can_frames_of

            return {"frames": write_can(scratch, options.form, shown, can_frames_of(payloads))}
        if options.form == "rerun":
            from crux_tools.log.rerun_file import write_rerun

            write_rerun(scratch, shown, options.utc)
            return {"moments": len(shown.rows)}
        from crux_tools.log.mcap_export import write_mcap

        return {"messages": write_mcap(scratch, shown, payloads)}
