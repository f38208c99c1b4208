"""`crux wall` and its `import`."""

from __future__ import annotations

import argparse
import math
from collections.abc import Callable
from pathlib import Path
from typing import Any

from crux_contracts.scenario_types import MAX_LEAN_DEG, MAX_SLOPE_DEG
from crux_tools.arguments import positive, taught, within
from crux_tools.output import add_json_option

from crux_simulation.wall.check_command import add_check
from crux_simulation.wall.edit.command import add_edit


def degrees(most: float) -> Callable[[str], float]:
    """The `type` of an option that takes an angle from 0 to `most` degrees."""
    return within(0.0, most, f"0 to {most:g} degrees")


def add_import(actions: Any) -> None:
    """Adds `import` to the actions of `crux wall`."""
    parser = actions.add_parser(
        "import",
        help="make a scenario of a scanned wall",
        **taught(
            "Makes a scenario of a mesh (STL, OBJ, PLY, glTF, OFF), a cloud of points at most 8 mm apart (PLY, PCD, "
            "XYZ, npz with xyz_m), or a height map (npy, npz, PNG, TIFF, GeoTIFF; rows are y, columns x). A "
            "mesh is taken as seen from --outward, whatever way its triangles look. The plane "
            "that most of it lies in becomes z = 0. Where it has several, all become surfaces that end where their "
            "points do; that at z = 0 is endless unless others go behind it. Every body that stands on a plane, or "
            "across the edge of two, becomes a hold where the robot's gripper can take it along the normal: two "
            "patches that are opposite, flat, and within its opening, with space for fingers and palm; where pads bear "
            "in part, or not everywhere, it has grips, with the share that bears, a half at least. All others "
            "become obstacles, with the reason. Of a board's table (CSV with the columns name, x_m up, y_m left, "
            "yaw_deg, size_x_m, size_y_m, size_z_m; the last four may be left out) every row is a hold. Holds are "
            "cuboids, in the plan as in the simulation; faces that lean have less friction, and only those of holds "
            "on z = 0 lean in the scenario, too. Start and goal are a low and a high stance of a level body, the goal "
            "one to which the planner's map has a way. Exit status: 0 the scenario is complete, 1 it is written, but "
            "no such stances were found, 2 the scan or the usage is wrong.",
            "crux wall import scan.ply -o wall.yaml --down 0 0 -1 --picture wall.png",
            "crux wall import corner.ply -o wall.yaml --down 0 0 -1 --outward 1 0 0",
            "crux wall import heights.npz -o wall.yaml --slope 90 --tilt 35",
            "crux wall import board.csv -o wall.yaml --slope 130",
        ),
    )
    parser.add_argument("scan", type=Path, metavar="SCAN", help="a mesh, a cloud, a height map or a board's table")
    parser.add_argument("-o", "--output", type=Path, required=True, metavar="WALL.yaml", help="the new scenario")
    parser.add_argument("--robot", default="scaler", metavar="R", help="name, folder or archive of the robot (scaler)")
    parser.add_argument("--scale", type=positive, default=1.0, metavar="M", help="metres of the scan's unit (1)")
    parser.add_argument("--pitch", type=positive, metavar="M", help="between the columns of a height map [m]")
    vector = {"nargs": 3, "type": within(-math.inf, math.inf, "a finite number"), "metavar": ("X", "Y", "Z")}
    parser.add_argument(
        "--outward", default=(0.0, 0.0, 1.0), help="about the way off the wall, in the scan's frame (0 0 1)", **vector
    )
    slope = parser.add_mutually_exclusive_group()
    slope.add_argument("--down", help="the way of gravity in the scan's frame; gives slope and the way up", **vector)
    slope.add_argument(
        "--slope",
        type=degrees(MAX_SLOPE_DEG),
        default=90.0,
        metavar="DEG",
        help="without --down: x of the scan goes up a wall of this slope (90)",
    )
    parser.add_argument("--friction", type=positive, default=2.2, metavar="MU", help="of all faces (2.2: sandpaper)")
    parser.add_argument(
        "--tilt", type=degrees(MAX_LEAN_DEG), default=15.0, metavar="DEG", help="the most that a face may lean (15)"
    )
    parser.add_argument("--picture", type=Path, metavar="FILE.png", help="a picture of the holds and the reasons")
    add_json_option(parser)
    parser.set_defaults(action=_import)


def _import(options: argparse.Namespace) -> int:
    from crux_contracts.output_file import look_at_outputs, write_whole
    from crux_tools.errors import UsageError
    from crux_tools.output import note, print_json

    from crux_simulation.wall.imported import Options, imported
    from crux_simulation.wall.parts import WALL
    from crux_simulation.wall.places import Limits

    look_at_outputs({"-o": options.output, "--picture": options.picture}, (options.scan,))
    for name in ("outward", "down"):
        vector = getattr(options, name)
        if vector is not None and not any(vector):
            raise UsageError(f"--{name}: 0 0 0 points nowhere")
    chosen = Options(
        robot=options.robot,
        scale=options.scale,
        pitch_m=options.pitch,
        outward=tuple(options.outward),
        down=None if options.down is None else tuple(options.down),
        slope_deg=options.slope,
        friction=options.friction,
        limits=Limits(tilt_deg=options.tilt),
    )
    found = imported(options.scan, options.output, chosen)
    if options.picture is not None:
        from crux_simulation.wall.picture import picture

        write_whole(options.picture, picture(found))
    bodies = sum(found.reasons.values()) + len(found.holds)
    slope = f"slope {found.slope_deg:.1f}°"
    planes = sum(surface.name != WALL for surface in found.surfaces)
    also = f", with {planes} more {'plane' if planes == 1 else 'planes'}" if planes else ""
    note(f"{options.output}: {len(found.holds)} of {bodies} bodies on the wall are holds, {slope}{also}")
    for reason, count in found.reasons.items():
        note(f"  {count} not: {reason}")
    for box in found.holds:
        if max(box.tilt_rad) > math.radians(5.0):
            note(f"  {box.name}: faces lean by up to {math.degrees(max(box.tilt_rad)):.0f}°")
        for faces, share in {grip.faces: min(grip.share) for grip in box.as_hold.grips}.items():
            if share < 1.0:
                note(f"  {box.name}: {share:g} of a pad bears on faces {faces}")
    without = found.ends.without or None
    note(f"start and goal are left out: {without}" if without else f"next: crux plan {options.output} -o plan.mcap")
    if options.json:
        print_json({"ok": not without, "scenario": str(options.output), "without_start": without, **_described(found)})
    return 1 if without else 0


def _described(found: Any) -> dict[str, Any]:
    """Of the bodies, `position_m` and `yaw_deg` are in the frame of their plane, and `pose` is in W."""
    from crux_tools.telemetry.rotations import rpy_of

    from crux_simulation.wall.imported import grips_of, pose

    return {
        "slope_deg": found.slope_deg,
        "rotation": None if found.wall is None else found.wall.rotation.tolist(),
        "offset_m": None if found.wall is None else found.wall.offset.tolist(),
        "bodies": [
            {
                "name": box.name,
                "hold": box.is_hold,
                "reason": box.reason or None,
                "position_m": box.position_m.tolist(),
                "size_m": box.size_m.tolist(),
                "yaw_deg": math.degrees(box.yaw_rad),
                "pose": pose(box.foot_m, box.rpy_rad),
                "tilt_deg": [math.degrees(tilt) for tilt in box.tilt_rad],
                "grips": grips_of(box),
            }
            for box in found.boxes
        ],
        "surfaces": [
            {
                "name": each.name,
                **pose(each.frame.origin_m, rpy_of(each.frame.rotation.T)),
                "size_m": each.size_m.tolist(),
            }
            for each in found.surfaces
        ],
    }


def add_parser(subparsers: Any) -> None:
    """Adds `crux wall` with its actions."""
    parser = subparsers.add_parser(
        "wall",
        help="draw a wall, make one of a scan, and check what it offers",
        **taught(
            "Walls: edit draws one in the browser. import makes a scenario of a scan. check says which holds a "
            "robot can grip, by which limbs and from where, and how far up it gets.",
            "crux wall edit my-wall.yaml",
            "crux wall import scan.ply -o wall.yaml --down 0 0 -1",
            "crux wall check wall.yaml --picture wall.png",
        ),
    )
    actions = parser.add_subparsers(dest="wall_action", metavar="ACTION", required=True)
    add_import(actions)
    add_check(actions)
    add_edit(actions)


def run(options: argparse.Namespace) -> int:
    """Does the chosen action; returns the exit status."""
    return int(options.action(options))
