"""`crux preflight`: what has to be right on the robot's computer before a climb."""

from __future__ import annotations

import argparse
import dataclasses
from collections.abc import Iterator
from pathlib import Path
from typing import Any

from crux_tools.arguments import positive, taught
from crux_tools.output import Progress, add_json_option, note, print_json

MARKS = {"good": "good    ", "doubtful": "DOUBTFUL", "bad": "BAD     "}


def add_parser(subparsers: Any) -> None:
    """Adds `crux preflight`."""
    from crux_tools.can.setup_command import INTERFACES
    from crux_tools.operator_link import DEFAULT_URL

    parser = subparsers.add_parser(
        "preflight",
        help="check whether this machine is fit to run a robot",
        **taught(
            "Checks the kernel, processors and their sleep states, permissions, clock, disk, heat, joint gains, LCM, "
            "CAN, and measures for a minute the wake-up latency at the runtime's priority. Says what to do about each "
            "problem. Exit status 1: something is bad, do not climb. Run it as the user who runs crux-runtime.",
            "crux preflight",
            "crux preflight --seconds 5 --no-can",
        ),
    )
    parser.add_argument(
        "--seconds", type=positive, default=60.0, metavar="S", help="measure lateness so long (default: %(default)g)"
    )
    parser.add_argument("--rate", type=positive, metavar="HZ", help="cycles a second (default: the robot's)")
    parser.add_argument("--logs", type=Path, default=Path(), metavar="DIR", help="where logs go (default: here)")
    parser.add_argument("--lcm", default=DEFAULT_URL, metavar="URL", help="(default: %(default)s)")
    parser.add_argument("--robot", default="scaler", metavar="NAME", help="whose buses (default: %(default)s)")
    parser.add_argument(
        "--can", nargs="+", default=INTERFACES, metavar="NAME", help=f"interfaces (default: {' '.join(INTERFACES)})"
    )
    parser.add_argument("--no-can", action="store_true", help="leave the buses out")
    add_json_option(parser)


def _buses(names: list[str], robot: Any) -> Iterator[Any]:
    from crux_tools.can.interfaces import defects, present
    from crux_tools.errors import WorkFailed
    from crux_tools.preflight.machine import BAD, GOOD, Finding

    try:
        there = present()
    except WorkFailed as error:
        yield Finding("CAN", BAD, str(error))
        return
    for name in names:
        if name not in there:
            others = ", ".join(there) or "none"
            yield Finding(name, BAD, f"no such CAN interface (there are: {others})", "is the adapter's driver loaded?")
        elif found := defects(there[name], robot):
            yield Finding(name, BAD, "; ".join(found), f"as root: crux can up {name}")
        else:
            yield Finding(name, GOOD, f"{there[name].kind}, as the robot's buses need it")


def _status_at(url: str) -> Any:
    """Of a runtime that is there; else None."""
    import time

    from crux_msgs import command_t

    from crux_tools.errors import UsageError
    from crux_tools.operator_link import OperatorLink

    try:
        with OperatorLink(url, first_request=time.time_ns()) as link:
            link.command(command_t.STATUS)
            return link.status
    except (OSError, UsageError):  # what is wrong with LCM is told by its own check
        return None


def run(options: argparse.Namespace) -> int:
    """Exit status 0 where nothing is bad."""
    from crux_tools.plan_robot import robot_named
    from crux_tools.preflight.joints import joints
    from crux_tools.preflight.latency import histogram, lateness, lcm_loss, woken_late_us
    from crux_tools.preflight.machine import BAD, DOUBTFUL, GOOD, Kernel, of_machine

    robot = robot_named(options.robot)
    findings = []

    def tell(finding: Any) -> None:
        findings.append(finding)
        note(f"{MARKS[finding.verdict]}  {finding.topic}: {finding.found}")
        if finding.verdict != GOOD and finding.remedy:
            note(f"          {finding.remedy}")

    for finding in of_machine(Kernel(), options.logs):
        tell(finding)
    tell(joints(robot, _status_at(options.lcm)))
    tell(lcm_loss(options.lcm))
    for finding in [] if options.no_can else _buses(options.can, robot):
        tell(finding)
    period_s = 1.0 / (options.rate or robot.can.rate_Hz)
    bar = Progress("waking up", options.seconds)
    try:
        late_us, is_real_time = woken_late_us(options.seconds, period_s, bar.at)
    finally:
        bar.end()
    tell(lateness(late_us, is_real_time, period_s))
    bins = histogram(late_us)
    for name, count in bins:
        note(f"          {name:>18}: {count}")
    bad = sum(finding.verdict == BAD for finding in findings)
    doubtful = sum(finding.verdict == DOUBTFUL for finding in findings)
    note(f"{bad} bad, {doubtful} doubtful, {len(findings) - bad - doubtful} good")
    if options.json:
        checks = [dataclasses.asdict(finding) for finding in findings]
        print_json({"ok": bad == 0, "bad": bad, "doubtful": doubtful, "checks": checks, "woken_late": dict(bins)})
    return 0 if bad == 0 else 1
