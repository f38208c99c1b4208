"""`crux log export`: a log for other tools."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from crux_tools.arguments import positive, taught
from crux_tools.output import add_json_option, note, print_json

DEFAULT_RATE_HZ = 50.0
_DESCRIPTION = """Writes a log anew, so that other tools see a robot that climbs and not numbers alone. --foxglove: an
MCAP file with the messages that Foxglove, Lichtblick, rviz and PlotJuggler draw by themselves: /tf, /tf_static,
/robot_description, /joint_states, /markers/wall and /markers/forces (holds, obstacles, measured and planned forces,
margins), wrenches and margin of each limb (/LF/wrench ...), /rosout (faults, states, waits and commands in words),
/diagnostics; and all that is in the log, each limb with topics of its own. Wrenches are in axes of the wall at the
gripper, frame LF_contact."""
_EXAMPLES = ("crux log export out/climb.mcap -o out/seen.mcap --foxglove",)


def add_export(actions: Any) -> None:
    """Adds the parser of `crux log export`."""
    parser = actions.add_parser("export", help="write a log for other tools", **taught(_DESCRIPTION, *_EXAMPLES))
    parser.add_argument("log", type=Path, metavar="LOG.mcap", help="telemetry of a climb")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="OUT", help="the file to write")
    forms = parser.add_mutually_exclusive_group(required=True)
    forms.add_argument(
        "--foxglove", action="store_const", const="foxglove", dest="form", help="MCAP with standard ROS 2 messages"
    )
    parser.add_argument(
        "--rate",
        type=positive,
        default=DEFAULT_RATE_HZ,
        metavar="HZ",
        help="of what is drawn (default: %(default)g); what is in the log keeps its own rate",
    )
    parser.add_argument("--utc", action="store_true", help="times are the date's, not seconds since the log began")
    add_json_option(parser)
    parser.set_defaults(action=run_export)


def run_export(options: argparse.Namespace) -> int:
    """Exit status 0 when everything was written."""
    from crux_contracts.output_file import look_at_outputs, whole_file

    from crux_tools.log.mcap_export import write_mcap
    from crux_tools.log.seen import seen, utc_clock
    from crux_tools.output import alone_with
    from crux_tools.telemetry.description import robot_of
    from crux_tools.telemetry.reader import read_both, telemetry_of

    look_at_outputs({"-o": options.output}, (options.log,))
    channels, payloads = read_both(options.log)
    log = telemetry_of(options.log, channels)
    clock = utc_clock(log) if options.utc else lambda times_ns: times_ns
    name = log.plan.robot_name if log.plan else log.metadata.get("robot", "")
    with alone_with(options.output), robot_of(name, log.robot_files) as robot, whole_file(options.output) as scratch:
        count = write_mcap(scratch, seen(log, channels, robot, options.rate, clock), payloads)
    for remark in log.notes:
        note(f"crux log export: {remark}")
    if options.json:
        print_json({"ok": True, "file": str(options.output), "form": options.form, "messages": count})
    else:
        note(f"{options.output}: {count} messages")
    return 0
