"""`crux wall check`."""

from __future__ import annotations

import argparse
import dataclasses
import math
from pathlib import Path
from typing import Any

from crux_tools.arguments import positive, taught
from crux_tools.output import add_json_option

LIMIT_S, LOOKS = 20.0, 4000
SHOWN = 5  # stances


def add_check(actions: Any) -> None:
    """Adds `check` to the actions of `crux wall`."""
    parser = actions.add_parser(
        "check",
        help="which holds a robot can grip, and how far up it gets",
        **taught(
            "Looks at a wall without planning a climb. For every hold and pair of faces: whether it can be gripped, by "
            "which limbs and from which places of a level body, else why not. Then the stances to start from, and "
            "how high the body gets from the start, one limb after the other, and what stops it there. 'proven' "
            "stands where no pose of a level body has a hold in reach; all else is what was found. Exit status: 0 "
            "there is a start, 1 there is none, 2 the wall or the usage is wrong.",
            "crux wall check msgs/scenarios/climb-field.yaml --picture field.png",
            "crux wall check wall.yaml --robot robots/mine --json",
        ),
    )
    parser.add_argument("wall", type=Path, metavar="WALL", help="a scenario, which may lack start and goal")
    parser.add_argument("--robot", metavar="R", help="name, folder or archive of the robot (the scenario's)")
    parser.add_argument(
        "--time-limit",
        type=positive,
        default=LIMIT_S,
        metavar="S",
        help="of the way up, in seconds of CPU (%(default)g)",
    )
    parser.add_argument("--picture", type=Path, metavar="FILE.png", help="a picture of the holds and who reaches them")
    add_json_option(parser)
    parser.set_defaults(action=_check)


def _check(options: argparse.Namespace) -> int:
    from crux_contracts.output_file import look_at_outputs, write_whole
    from crux_contracts.robot import robot_of
    from crux_contracts.yaml_document import read_bytes
    from crux_planner.method_report import wall_report
    from crux_tools.output import note, print_json, progress

    from crux_simulation.wall.edit.content import scenario_of
    from crux_simulation.wall.edit.wall_file import read_wall

    look_at_outputs({"--picture": options.picture}, (options.wall,))
    content, own = read_wall(read_bytes(options.wall), options.wall)
    robot = robot_of(options.robot) if options.robot else own
    scenario = scenario_of(content, robot, str(options.wall))
    with progress("checking the wall", 1.0) as bar:
        report = wall_report(scenario, robot, options.time_limit, LOOKS, bar.at)
    for line in _lines(report):
        note(line)
    if options.picture is not None:
        from crux_simulation.wall.check_picture import picture

        write_whole(options.picture, picture(scenario, report))
    done = report.top is not None
    if options.json:
        print_json({"ok": done, "wall": str(options.wall), **_described(report)})
    return 0 if done else 1


def _lines(report: Any) -> list[str]:
    """For people."""
    gripped = sum(not pair.reason for pair in report.pairs)
    lines = [f"{gripped} of {len(report.pairs)} pairs of faces can be gripped, a level body given:"]
    for pair in report.pairs:
        name = f"  {pair.hold} {pair.faces}"
        if pair.reason:
            lines.append(f"{name}: no, {pair.reason}")
            continue
        off = " (off the middle of its faces)" if pair.off_centre else ""
        lines.append(f"{name}: {', '.join(pair.limbs)}{off}")
        for limb, place in pair.limbs.items():
            x, y, height = (f"{low:.2f}..{high:.2f}" for low, high in (place.x_m, place.y_m, place.height_m))
            lines.append(f"    {limb} with the body at x {x}, y {y}, {height} m off the wall")
        lines += [f"    not {limb}: {why}" for limb, why in pair.without.items()]
    if report.refused:
        lines.append(f"the scenario's start: {report.refused}")
    lines.append(f"{len(report.stances)} places of the body with four holds in reach; the lowest:")
    lines += [f"  {_place(stance)}" for stance in report.stances[:SHOWN]]
    if report.top is None:
        return [*lines, "no start from which the map leads on"]
    top, (x, y, _) = report.top, report.top.body_h_m
    seen = "all stances were looked at" if top.complete else f"the search ended after {top.stances} stances"
    lines.append(f"from {_place(report.begun)}")
    lines.append(f"the body gets up to x {x:.2f} m (y {y:.2f} m) in {top.moves} moves; {seen}. There:")
    return [*lines, *(f"  {limb} {why}" for limb, why in top.stops.items())]


def _place(stance: Any) -> str:
    holds = ", ".join(f"{limb} {hold} {faces}" for limb, (hold, faces) in stance.grasps.items())
    return "body at ({:.2f}, {:.2f}, {:.3f}) m: ".format(*stance.body_m) + holds


def _described(report: Any) -> dict[str, Any]:
    pairs = [
        {
            "hold": pair.hold,
            "faces": pair.faces,
            "gripped": not pair.reason,
            "reason": pair.reason or None,
            "off_centre": pair.off_centre,
            "limbs": {
                limb: {
                    "body_m": place.body_m,
                    "heading_deg": math.degrees(place.heading_rad),
                    "x_m": place.x_m,
                    "y_m": place.y_m,
                    "height_m": place.height_m,
                    "share": place.share,
                }
                for limb, place in pair.limbs.items()
            },
            "without": pair.without,
            "reached_from_start_by": report.held_by.get((pair.hold, pair.faces), []),
        }
        for pair in report.pairs
    ]
    start = {
        "refused": report.refused or None,
        "begun": report.begun and dataclasses.asdict(report.begun),
        "places": len(report.stances),
        "stances": [dataclasses.asdict(stance) for stance in report.stances[:SHOWN]],
    }
    top = report.top and {
        "body_m": report.top.body_h_m,
        "moves": report.top.moves,
        "stances": report.top.stances,
        "complete": report.top.complete,
        "stops": report.top.stops,
    }
    return {"pairs": pairs, "start": start, "highest": top}
