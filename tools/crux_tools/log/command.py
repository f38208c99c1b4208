"""`crux log`: each action's parser sets `action`, a function of the options."""

from __future__ import annotations

import argparse
from typing import Any

from crux_tools.arguments import taught
from crux_tools.log.edit_commands import add_edits
from crux_tools.log.export_command import add_export
from crux_tools.log.lcm_command import add_lcm
from crux_tools.log.ls_command import add_ls
from crux_tools.log.note_command import add_note


def add_parser(subparsers: Any) -> None:
    """Adds `crux log` with its actions."""
    parser = subparsers.add_parser(
        "log",
        help="logs: for other tools, listed, annotated, cut, merged, recovered, played",
        **taught(
            "Logs from the robot or from crux climb: listed, inspected, annotated, cut, merged, recovered, "
            "played on LCM, and written for other tools.",
            "crux log ls out",
            "crux log export out/climb.mcap -o out/seen.mcap --foxglove",
            "crux log cut --help",
        ),
    )
    actions = parser.add_subparsers(dest="log_action", metavar="ACTION", required=True)
    add_ls(actions)
    add_edits(actions)
    add_note(actions)
    add_export(actions)
    add_lcm(actions)


def run(options: argparse.Namespace) -> int:
    """Exit status of the action."""
    return int(options.action(options))
