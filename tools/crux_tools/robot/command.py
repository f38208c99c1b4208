"""`crux robot`: each action's parser sets `action`, a function of the options."""

from __future__ import annotations

import argparse
import textwrap
from pathlib import Path
from typing import Any

from crux_tools.arguments import positive, taught, within
from crux_tools.output import add_json_option
from crux_tools.page_address import add_address, check_address


def add_parser(subparsers: Any) -> None:
    """Adds `crux robot` with its actions."""
    parser = subparsers.add_parser(
        "robot",
        help="bring a robot in, check what it can do, and look at it",
        **taught(
            "Robot descriptions: a folder with robot.yaml and a URDF. import makes one of a URDF and a mapping. "
            "check says what is wrong with one, all at once, and what the robot reaches and holds, also where planner "
            "and runtime do not take it yet. show has it in the browser.",
            "crux robot import maker.urdf --mapping mapping.yaml -o robots/mine",
            "crux robot check robots/mine",
            "crux robot show robots/mine",
        ),
    )
    actions = parser.add_subparsers(dest="robot_action", metavar="ACTION", required=True)
    _add_import(actions)
    _add_check(actions)
    _add_show(actions)


def _add_import(actions: Any) -> None:
    from crux_tools.robot.mapping import EXAMPLE

    how = taught(
        "Makes a robot folder of a maker's URDF, or of xacro where `pip install xacro` has installed that: a body, "
        "and limbs of four to seven joints, a gripper and two fingers. What is fixed or locked to a link becomes "
        "part of it; frames, senses and names become crux's. What a URDF cannot say stands in a mapping; everything "
        "that neither says is listed at once, and nothing is written then. Exit status 0 also where planner and "
        "runtime do not take the robot yet: `crux robot check` gives every reason.",
        "crux robot import maker.urdf --mapping mapping.yaml -o robots/mine",
    )
    how["epilog"] += "\n\na mapping:\n" + textwrap.indent(EXAMPLE, "  ")
    parser = actions.add_parser("import", help="make a robot folder of a URDF and a mapping", **how)
    parser.add_argument("urdf", type=Path, metavar="URDF", help="of the robot's makers")
    parser.add_argument("--mapping", type=Path, metavar="FILE", help="what the URDF does not say (see below)")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="DIR", help="the new robot folder")
    parser.add_argument(
        "--xacro",
        action="append",
        default=[],
        metavar="NAME:=VALUE",
        help="an argument of a xacro file; may be repeated",
    )
    add_json_option(parser)
    parser.set_defaults(action=_import)


def _import(options: argparse.Namespace) -> int:
    from crux_tools.output import note, print_json
    from crux_tools.robot.described import reasons
    from crux_tools.robot.imported import imported

    done = imported(options.urdf, options.mapping, options.output, options.xacro)
    for line in done.assumed:
        note(line)
    taken = "take it" if not done.problems else f"do not take it, for {reasons(done.problems)}"
    note(f"{done.folder}: planner and runtime {taken}; next: crux robot check {done.folder}")
    if options.json:
        result = {"ok": True, "folder": str(done.folder), "assumed": done.assumed}
        print_json({**result, "taken": not done.problems, "problems": done.problems})
    return 0


def _add_check(actions: Any) -> None:
    parser = actions.add_parser(
        "check",
        help="description, kinematics, masses, reach, collisions, loads and gains of a robot",
        **taught(
            "Checks a robot description and the robot that it describes: everything that is wrong with the files; "
            "joints, masses and limits; where the grippers reach the wall; a stance in the middle of that, its "
            "clearances, and what share of the peak and the continuous torques it takes to hang there on walls of 0 "
            "to 180 degrees, on four limbs and on three; how late the drives may answer. With --wall also a first "
            "wall: the steepest, up to 90 degrees, on which its motors bear it on three limbs and a plan is found. "
            "Exit status 1: something is bad.",
            "crux robot check scaler",
            "crux robot check robots/mine --friction 0.8 --json",
            "crux robot check mine --wall first-wall.yaml",
        ),
    )
    parser.add_argument("robot", metavar="ROBOT", help="name of a robot, or its folder or archive")
    _add_friction(parser)
    parser.add_argument(
        "--wall", type=Path, metavar="FILE", help="fit a first wall to the robot, and write its scenario"
    )
    add_json_option(parser)
    parser.set_defaults(action=_check)


def _check(options: argparse.Namespace) -> int:
    import dataclasses

    from crux_tools.output import note, print_json, progress
    from crux_tools.preflight.command import MARKS
    from crux_tools.preflight.machine import BAD, DOUBTFUL, GOOD
    from crux_tools.robot.check import findings
    from crux_tools.robot.described import described

    robot = described(options.robot)
    found = []
    with progress("checking", 9) as bar:
        for done, finding in enumerate(findings(robot, options.friction, options.wall)):
            found.append(finding)
            bar.at(done)
            note(f"{MARKS[finding.verdict]}  {finding.topic}: {finding.found}")
            if finding.verdict != GOOD and finding.remedy:
                note(f"          {finding.remedy}")
    bad, doubtful = (sum(each.verdict == verdict for each in found) for verdict in (BAD, DOUBTFUL))
    note(f"{bad} bad, {doubtful} doubtful, {len(found) - bad - doubtful} good")
    if options.json:
        checks = [dataclasses.asdict(finding) for finding in found]
        print_json({"ok": bad == 0, "problems": robot.problems, "checks": checks})
    return 0 if bad == 0 else 1


def _add_friction(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--friction", type=positive, default=2.2, metavar="MU", help="of the holds (default: %(default)g, sandpaper)"
    )


def _add_show(actions: Any) -> None:
    parser = actions.add_parser(
        "show",
        help="a robot in 3-D in the browser: joints, frames, reach, loads",
        **taught(
            "Serves a page, which needs no network, with a robot that its joints' sliders move: within their limits, "
            "by the robot's own names. It begins with every gripper in the middle of what its limb reaches. The page "
            "shows frames, where each gripper can be upright by the planner's map, links that meet (of two limbs, or "
            "of a limb and the body), and what share of its peak torque each joint bears while the robot hangs still "
            "on grips where the grippers are, on a wall of any slope. ? in the page lists keys and mouse. With "
            "-o it writes a picture of the page instead, by Chromium.",
            "crux robot show scaler",
            "crux robot show robots/mine --slope 120 --friction 0.8",
            "crux robot show scaler -o out/robot.png",
        ),
    )
    parser.add_argument("robot", metavar="ROBOT", help="name of a robot, or its folder or archive")
    parser.add_argument(
        "--slope",
        type=within(0.0, 180.0, "0 to 180 degrees"),
        default=45.0,
        metavar="DEG",
        help="of the wall, as the page begins: 0 floor, 90 vertical, 180 ceiling (default: %(default)g)",
    )
    _add_friction(parser)
    parser.add_argument("-o", "--output", type=Path, metavar="FILE.png", help="write a picture of the page")
    add_address(parser)
    parser.set_defaults(action=_show)


def _show(options: argparse.Namespace) -> int:
    from crux_contracts.output_file import look_at_outputs

    from crux_tools.output import note
    from crux_tools.robot.described import described

    check_address(options.host, options.port)
    look_at_outputs({"-o": options.output})
    robot = described(options.robot)
    from crux_tools.view.page_server import serve
    from crux_tools.view.robot.figure import Figure
    from crux_tools.view.robot.server import RobotPage, write_picture

    figure = Figure(robot, options.friction)
    if options.output is None:
        serve(RobotPage(figure, options.slope, options.host, options.port), "robot")
    else:
        write_picture(options.output, figure, options.slope)
        note(f"picture: {options.output}")
    return 0


def run(options: argparse.Namespace) -> int:
    """Exit status of the action."""
    return int(options.action(options))
