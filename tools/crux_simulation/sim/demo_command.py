"""`crux demo`: a first climb in simulation, from the scenario to the report."""

from __future__ import annotations

import argparse
import sys
from contextlib import redirect_stdout
from pathlib import Path
from typing import Any

from crux_tools.arguments import taught
from crux_tools.output import add_json_option, note, print_json
from crux_tools.paths import SCENARIOS

SCENARIO = "climb-makers.yaml"
_DESCRIPTION = """Plans a climb of the makers' SCALER on a 45 degree wall of eight holds, runs it in simulation and
writes a report, with the commands crux plan and crux climb, which it prints. FOLDER then holds plan.mcap, climb.mcap
and report.html. Exit status 0: the robot is at the goal, without slip or fall."""


def add_parser(subparsers: Any) -> None:
    """Adds the parser of `crux demo`."""
    parser = subparsers.add_parser(
        "demo", help="plan a wall of eight holds and climb it in simulation", **taught(_DESCRIPTION, "crux demo -o out")
    )
    folder = "where plan, log and report go (default: %(default)s)"
    parser.add_argument("-o", "--output", type=Path, default=Path("crux-demo"), metavar="FOLDER", help=folder)
    add_json_option(parser)
    parser.set_defaults(func=run)


def run(options: argparse.Namespace) -> int:
    """The exit status of the first command that does not succeed, else 0."""
    from crux_tools.cli import main

    plan, log, report = (options.output / name for name in ("plan.mcap", "climb.mcap", "report.html"))
    commands = (
        ["plan", str(SCENARIOS / SCENARIO), "--objective", "balanced", "-o", str(plan)],
        ["climb", str(plan), "-o", str(log), "--report", str(report)],
    )
    status = 0
    for words in commands:
        note(f"$ crux {' '.join(words)}")
        with redirect_stdout(sys.stderr):  # only the JSON object goes to standard output
            status = main(words)
        if status:
            break
    else:
        note(f"Look at it: {report} in a browser, or crux view {log}")
    if options.json:
        print_json({"ok": status == 0, "plan": str(plan), "log": str(log), "report": str(report)})
    return status
