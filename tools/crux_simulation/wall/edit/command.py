"""`crux wall edit`."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from crux_contracts.scenario_types import MAX_SLOPE_DEG
from crux_tools.arguments import taught, within
from crux_tools.page_address import add_address, check_address

SLOPE_DEG, ROBOT = 90.0, "scaler"


def add_edit(actions: Any) -> None:
    """Adds `edit` to the actions of `crux wall`."""
    parser = actions.add_parser(
        "edit",
        help="draw a wall in the browser, and plan on it",
        **taught(
            "Serves a page, which needs no network, to draw a wall: add, move, turn, resize and delete holds, choose "
            "start and goal among the stances that the robot has, and see who reaches which hold. Every change "
            "plans again: the page shows the plan, or why there is none. Only WALL.yaml is written, and only when "
            "you save; a file that does not exist begins as an empty wall. Comments in the file are kept. ? in the "
            "page lists keys and mouse. Exit status: 0 it was ended by Ctrl-C, 2 the file or the usage is wrong.",
            "crux wall edit my-wall.yaml",
            "crux wall edit my-wall.yaml --slope 70 --robot scaler",
        ),
    )
    parser.add_argument("wall", type=Path, metavar="WALL.yaml", help="a scenario, or a new file")
    slope = within(0.0, MAX_SLOPE_DEG, f"0 to {MAX_SLOPE_DEG:g} degrees")
    parser.add_argument("--slope", type=slope, metavar="DEG", help=f"of a new wall ({SLOPE_DEG:g})")
    parser.add_argument("--robot", metavar="R", help=f"of a new wall: name, folder or archive of the robot ({ROBOT})")
    add_address(parser)
    parser.set_defaults(action=_edit)


def _edit(options: argparse.Namespace) -> int:
    from crux_tools.errors import UsageError
    from crux_tools.view.page_server import serve

    from crux_simulation.wall.edit.server import Editor
    from crux_simulation.wall.edit.wall_file import WallFile

    check_address(options.host, options.port)
    for name in ("slope", "robot"):
        if options.wall.exists() and getattr(options, name) is not None:
            raise UsageError(f"--{name}: is for a new wall, and {options.wall} exists: change it in the file")
    slope_deg = SLOPE_DEG if options.slope is None else options.slope
    serve(Editor(WallFile(options.wall, options.robot or ROBOT, slope_deg), options.host, options.port), "edit")
    return 0
