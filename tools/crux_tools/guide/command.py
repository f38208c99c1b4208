"""`crux guide`: beside a runtime, plans again where the robot holds for a cause that another plan may avoid."""

from __future__ import annotations

import argparse
import sys
import time
from pathlib import Path
from typing import Any

from crux_tools.arguments import taught, whole
from crux_tools.errors import UsageError, WorkFailed
from crux_tools.output import add_json_option, note, print_json

LOOKS_EVERY_S = 0.1
_DESCRIPTION = """Listens to a runtime that climbs PLAN.mcap. When the robot holds because a hold was lost, moved or is
slippery, the body is displaced or a limb is weak, it updates its map with what was measured, plans again from the
present stance, with limbs in the air if necessary, says what it will do, uploads the plan and starts it. If no way
leads to the goal, it plans a way back to the last safe stance. After any other fault it says what to do and waits for
the operator. The runtime does not need the guide: without it the robot holds, or finishes its plan. Exit status 0: the
robot is at the goal; 1: the guide gave up, and said why."""
_EXAMPLES = (
    "crux guide out/plan.mcap",
    "crux guide out/plan.mcap --ask",
    "crux climb out/plan.mcap -o out/climb.mcap --world tools/worlds/hold-vanishes-four.yaml --guide",
)


def add_parser(subparsers: Any) -> None:
    """Adds the parser of `crux guide`."""
    from crux_tools.key_command import add_key_option
    from crux_tools.operator_link import DEFAULT_URL

    parser = subparsers.add_parser(
        "guide", help="plan again where the robot holds, and go on", **taught(_DESCRIPTION, *_EXAMPLES)
    )
    parser.add_argument("plan", type=Path, metavar="PLAN.mcap", help="the plan that the runtime climbs")
    parser.add_argument("--ask", action="store_true", help="ask on the terminal before another plan is uploaded")
    parser.add_argument(
        "--tries", type=whole(1), default=5, metavar="N", help="plans to try at most (default: %(default)s)"
    )
    parser.add_argument(
        "--lcm", default=DEFAULT_URL, metavar="URL", help="LCM URL of the runtime (default: %(default)s)"
    )
    add_key_option(parser)
    add_json_option(parser)
    parser.set_defaults(func=run)


def _agrees() -> bool:
    try:
        return input("guide: climb that? [y/N] ").strip().lower() in ("y", "yes")
    except EOFError:
        return False


def run(options: argparse.Namespace) -> int:
    """Looks at the runtime ten times a second until the robot is at the goal or no plan leads on."""
    from crux_contracts.plan_file import read_plan

    from crux_tools.guide.guide import Attended, Guide
    from crux_tools.operator_link import OperatorLink
    from crux_tools.plan_robot import robot_of_plan

    if options.ask and not sys.stdin.isatty():
        raise UsageError("--ask: standard input is no terminal to ask on")
    plan = read_plan(options.plan)
    said: list[str] = []

    def say(line: str) -> None:
        said.append(line)
        note(f"{time.strftime('%H:%M:%S')} {line}")

    agrees = _agrees if options.ask else lambda: True
    with OperatorLink(options.lcm, first_request=time.time_ns(), key=options.key) as link:
        guide = Guide(link, plan, robot_of_plan(plan, options.plan), say, options.tries, agrees)
        note(f"guide: listens on {options.lcm}")
        attended = Attended.NOTHING
        while attended not in (Attended.DONE, Attended.GAVE_UP):
            time.sleep(LOOKS_EVERY_S)
            attended = guide.attend()
    if attended is Attended.GAVE_UP:
        raise WorkFailed(said[-1])
    if options.json:
        print_json({"ok": True, "tries": guide.tried, "plan_id": guide.plan.plan_id, "said": said})
    return 0
