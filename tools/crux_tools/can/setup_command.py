"""`crux can up` and `crux can check`: this machine's CAN interfaces as the robot's buses need them."""

from __future__ import annotations

import argparse
import dataclasses
import os
import subprocess
from typing import Any

from crux_contracts.terminal import say

from crux_tools.arguments import positive, taught
from crux_tools.errors import WorkFailed
from crux_tools.output import add_json_option, note, print_json

INTERFACES = ["can0", "can1", "can2", "can3"]


def _add(actions: Any, name: str, text: str, teaching: dict[str, Any], action: Any) -> argparse.ArgumentParser:
    parser: argparse.ArgumentParser = actions.add_parser(name, help=text, **teaching)
    parser.add_argument(
        "interfaces", nargs="*", default=INTERFACES, metavar="NAME", help=f"which (default: {' '.join(INTERFACES)})"
    )
    parser.add_argument("--robot", default="scaler", metavar="NAME", help="whose buses (default: %(default)s)")
    add_json_option(parser)
    parser.set_defaults(action=action)
    return parser


def add_up(actions: Any) -> None:
    """crux can up."""
    parser = _add(
        actions,
        "up",
        "set interfaces up for the robot's buses",
        taught(
            "Sets bit rates, sample points, transmit queue and restart as the robot's buses need them, and brings the "
            "interfaces up. Needs root; --dry-run prints the commands.",
            "sudo .venv/bin/crux can up",
            "crux can up can4 can5 can6 can7 --dry-run",
            "sudo .venv/bin/crux can up --persist",
        ),
        run_up,
    )
    parser.add_argument("--dry-run", action="store_true", help="only print what root would have to run")
    parser.add_argument(
        "--persist",
        action="store_true",
        help="at every boot: files for udev and systemd-networkd that name the buses by their adapters canLF, canRF, "
        "canLR, canRR, and set them up",
    )


def add_check(actions: Any) -> None:
    """crux can check."""
    parser = _add(
        actions,
        "check",
        "check interfaces and measure the load of the buses",
        taught(
            "Checks bit rates, sample points, transmit queue, restart and the controllers' states, and the load of the "
            "buses against the budget: planned from the CAN database, and measured when --measure says how long. Exit "
            "status 1 when something is wrong.",
            "crux can check --measure 2",
            "crux can check can0 --commands broadcast --rate 1000",
        ),
        run_check,
    )
    parser.add_argument("--measure", type=positive, metavar="S", help="listen so long to each bus")
    parser.add_argument(
        "--commands",
        choices=["each", "broadcast"],
        default="each",
        help="frames of the commands: one a node, or one for all (default: %(default)s)",
    )
    parser.add_argument("--rate", type=positive, metavar="HZ", help="cycles a second (default: the robot's)")


def _found(names: list[str]) -> dict[str, Any]:
    """The interfaces asked for; raises WorkFailed when one is missing."""
    from crux_tools.can.interfaces import present

    interfaces = present()
    missing = [name for name in names if name not in interfaces]
    if missing:
        there = ", ".join(interfaces) or "none"
        raise WorkFailed(f"no CAN interface {', '.join(missing)} here (there are: {there}); is its driver loaded?")
    return {name: interfaces[name] for name in names}


def run_up(options: argparse.Namespace) -> int:
    """Exit status 0 when all are up."""
    from crux_tools.can.interfaces import set_up_commands, shell_line
    from crux_tools.plan_robot import robot_named

    robot = robot_named(options.robot)
    found = _found(options.interfaces)
    if options.persist:
        return _persist(list(found.values()), robot, options)
    commands = [command for interface in found.values() for command in set_up_commands(interface, robot)]
    lines = [shell_line(command) for command in commands]
    if options.dry_run:
        for line in [] if options.json else lines:
            say(line)
    else:
        if os.geteuid() != 0:
            raise WorkFailed(f"setting interfaces up needs root; run there: {' && '.join(lines)}")
        for command, line in zip(commands, lines, strict=True):
            done = subprocess.run(command, capture_output=True, text=True, check=False)
            if done.returncode != 0:
                raise WorkFailed(f"{line}: {done.stderr.strip()}")
    if options.json:
        print_json({"ok": True, "commands": lines, "done": not options.dry_run})
    elif not options.dry_run:
        note(f"up: {', '.join(found)}")
    return 0


def _persist(interfaces: list[Any], robot: Any, options: argparse.Namespace) -> int:
    from crux_tools.can.persist import RELOAD, files_of, write

    files = files_of(interfaces, robot)
    if not options.dry_run:
        if os.geteuid() != 0:
            raise WorkFailed("keeping interfaces over a boot needs root; --dry-run shows the files")
        write(files)
        note(f"written: {', '.join(f'/{name}' for name in files)}")
        note(f"now unplug and plug the adapters, or boot; as root: {RELOAD}")
    if options.json:
        print_json({"ok": True, "files": files, "done": not options.dry_run})
    elif options.dry_run:
        for name, text in files.items():
            say(f"# /{name}\n{text}")
    return 0


def _load(interface: Any, robot: Any, seconds: float) -> dict[str, Any]:
    """Measured load as an object, with the share of the budget's kind: the most that stuffing may take."""
    from crux_tools.can.bus_load import measured_load

    least, most, frames = measured_load(interface.name, seconds, robot.can.bit_rate, robot.can.data_bit_rate)
    return {"least": least, "most": most, "frames_Hz": frames / seconds}


def _measured(entry: dict[str, Any]) -> str:
    if "load" not in entry:
        return ""
    load = entry["load"]
    return f", load {100 * load['least']:.0f} .. {100 * load['most']:.0f} %, {load['frames_Hz']:.0f} frames/s"


def run_check(options: argparse.Namespace) -> int:
    """Exit status 0 when the robot can use every interface."""
    from crux_tools.can.bus_load import BUDGET, planned_load
    from crux_tools.can.interfaces import defects
    from crux_tools.plan_robot import robot_named

    robot = robot_named(options.robot)
    if options.rate is not None:
        robot = dataclasses.replace(robot, can=dataclasses.replace(robot.can, rate_Hz=options.rate))
    least, most = planned_load(robot, options.commands)
    budget = BUDGET[options.commands]
    problems: dict[str, list[str]] = {}
    report = []
    for name, interface in _found(options.interfaces).items():
        problems[name] = defects(interface, robot)
        entry: dict[str, Any] = {"name": name, "kind": interface.kind, "state": interface.state}
        if options.measure is not None and interface.up:
            load = entry["load"] = _load(interface, robot, options.measure)
            if load["most"] > budget:
                problems[name].append(f"load {100 * load['most']:.0f} %, the budget is {100 * budget:.0f} %")
        report.append(entry | {"errors": interface.errors, "problems": problems[name]})
    ok = most <= budget and not any(problems.values())
    if options.json:
        planned = {"least": least, "most": most, "budget": budget}
        print_json({"ok": ok, "planned_load": planned, "interfaces": report})
        return 0 if ok else 1
    first = f"planned load {100 * least:.0f} .. {100 * most:.0f} % of a bus at {robot.can.rate_Hz:g} Hz"
    note(f"{first}, budget {100 * budget:.0f} %")
    for entry in report:
        remarks = "; ".join(entry["problems"]) or "well"
        note(f"{entry['name']}: {entry['kind']}{_measured(entry)}: {remarks}")
    if any(problems.values()):
        note(f"as root: crux can up {' '.join(name for name, found in problems.items() if found)}")
    return 0 if ok else 1
