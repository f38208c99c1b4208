"""`crux plan`, also from where a robot hangs: as its runtime reports it, or as a log ends."""

from __future__ import annotations

import argparse
import tempfile
from pathlib import Path
from types import SimpleNamespace
from typing import Any

from crux_contracts import LIMB_NAMES

from crux_tools.errors import UsageError, WorkFailed
from crux_tools.output import note

FROM = """from a robot:
  --from-robot and --from-log take the start from where the robot hangs in place of the scenario's: the grippers whose
  fingers press are found on the holds of the scenario's map, the others are in the air. It needs no plan, so a robot
  that was put on the wall by hand is found, too. Where stances look alike --on says which it is.
  crux plan wall.yaml -o on.mcap --from-robot
  crux plan wall.yaml -o on.mcap --from-log climb.mcap
  crux plan wall.yaml -o on.mcap --from-robot --on LF=left-front-low"""
TOPICS = {"/robot_state", "/limb_reference", "/limb_telemetry"}


def add_parser(subparsers: Any) -> None:
    """Adds the parser of `crux plan`."""
    from crux_planner.cli import add_plan_parser

    from crux_tools.operator_link import DEFAULT_URL

    add_plan_parser(subparsers)
    parser = subparsers.choices["plan"]
    parser.epilog = f"{parser.epilog}\n\n{FROM}"
    where = parser.add_mutually_exclusive_group()
    where.add_argument("--from-robot", action="store_true", help="from where the runtime says that the robot hangs")
    where.add_argument("--from-log", type=Path, metavar="LOG.mcap", help="from where the robot hangs as a log ends")
    on = "with these: what a limb grips, where stances of the map look alike (repeatable)"
    parser.add_argument("--on", action="append", default=[], metavar="LIMB=HOLD", help=on)
    parser.add_argument(
        "--lcm", default=DEFAULT_URL, metavar="URL", help="LCM URL of the runtime (default: %(default)s)"
    )
    parser.set_defaults(func=run)


def run(options: argparse.Namespace) -> int:
    """As crux_planner.cli.run_plan, of the scenario as it is or from where the robot hangs."""
    from crux_planner.cli import run_plan

    if not options.from_robot and options.from_log is None:
        if options.on:
            raise UsageError("--on is about where a robot hangs: give --from-robot or --from-log LOG.mcap")
        return run_plan(options)
    if options.running is not None:
        raise UsageError("--from is about a plan that runs; --from-robot and --from-log are about where a robot hangs")
    with tempfile.TemporaryDirectory(prefix="crux-plan-") as folder:
        path = Path(folder) / options.scenario.name
        path.write_text(_scenario(options), encoding="utf-8")
        options.scenario = path
        return run_plan(options)


def _scenario(options: argparse.Namespace) -> str:
    from crux_contracts.robot import load_robot
    from crux_contracts.scenario import load_scenario
    from crux_contracts.yaml_document import DocumentError

    from crux_tools.guide.stance import scenario_from

    try:
        scenario = load_scenario(options.scenario)
        if scenario.footholds:
            named = f"limbs may stand on {scenario.footholds[0].name}"
            raise UsageError(f"{options.scenario}: footholds: {named}, and a start is found by grips on holds alone")
        robot = load_robot(scenario.robot)
        status = of_log(options.from_log) if options.from_log else of_robot(options.lcm)
        moved, stance = scenario_from(scenario, robot, status, dict(map(_named, options.on)))
    except DocumentError as error:
        raise UsageError(str(error)) from error
    in_air = [name for limb, name in enumerate(LIMB_NAMES) if limb not in stance.places]
    air = f", {' '.join(in_air)} in the air" if in_air else ""
    note(f"crux plan: from {stance.says(scenario)}{air}; fits the map within {1e3 * stance.off_m:.0f} mm")
    return moved.yaml_text


def _named(text: str) -> tuple[str, str]:
    limb, _, hold = text.partition("=")
    if limb not in LIMB_NAMES or not hold:
        raise UsageError(f"--on {text}: expected LIMB=HOLD with LIMB one of {', '.join(LIMB_NAMES)}")
    return limb, hold


def of_robot(url: str) -> Any:
    """A status_t. Raises WorkFailed."""
    from crux_msgs import command_t

    from crux_tools.operator_link import OperatorLink

    with OperatorLink(url) as link:
        link.send(command_t.STATUS)
        if link.status is None or link.status.state.cycle == 0:
            raise WorkFailed(f"the runtime on {url} has not heard all nodes yet: crux status shows which are silent")
        return link.status


def of_log(path: Path) -> Any:
    """What a log says last, with the attributes of a status_t. Raises UsageError."""
    from crux_tools.telemetry.channels import LogError, read_channels

    try:
        tables = read_channels(path, TOPICS).tables
    except (LogError, OSError) as error:
        raise UsageError(f"{path}: {getattr(error, 'strerror', None) or error}") from error
    if any(topic not in tables or len(tables[topic]) < len(LIMB_NAMES) for topic in TOPICS):
        raise UsageError(f"{path}: no {', '.join(sorted(TOPICS))} in it: this is no log of a climb")

    def last(topic: str) -> list[SimpleNamespace]:
        rows = sorted(tables[topic][-len(LIMB_NAMES) :], key=lambda row: int(row["limb"]))
        return [_of(row) for row in rows]

    state = _of(tables["/robot_state"][-1])
    return SimpleNamespace(state=state, reference=last("/limb_reference"), telemetry=last("/limb_telemetry"))


def _of(row: Any) -> SimpleNamespace:
    return SimpleNamespace(**{name: row[name] for name in row.dtype.names})
