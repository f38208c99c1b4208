"""`crux wall import`: a scan becomes a scenario of cuboids, and every body that is no hold says why."""

from __future__ import annotations

from collections import Counter
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import crux_planner
import numpy as np
import yaml
from crux_contracts import LIMB_NAMES
from crux_contracts.output_file import write_whole
from crux_contracts.robot import Robot, load_robot
from crux_contracts.scenario import ScenarioError
from crux_contracts.scenario_bodies import SIDE_FACES
from crux_contracts.scenario_types import MAX_CUBOIDS, Wall
from crux_planner.method_report import wall_lacks, wall_stances, way_up
from crux_tools.errors import UsageError
from crux_tools.output import progress
from crux_tools.telemetry.rotations import rpy_of

from crux_simulation.wall.board import read_board
from crux_simulation.wall.box import DIGITS, Box
from crux_simulation.wall.boxes import apart, boxes
from crux_simulation.wall.edit.content import scenario_of
from crux_simulation.wall.frame import CLIMBED, Placed, placed
from crux_simulation.wall.parts import WALL, Bounded, behind, bounded, parts
from crux_simulation.wall.places import Limits, bodies, find_places
from crux_simulation.wall.planes import planes
from crux_simulation.wall.read import read_surface
from crux_simulation.wall.stances import Ends, Way, ends
from crux_simulation.wall.surface import Array

if TYPE_CHECKING:
    from crux_planner.method_report import StartStance

SLIPPERY = "its faces lean so much that friction holds nothing"
LOOKS, WAY_UP_S = 60, 10.0  # at moves from one start, and seconds of computing for these at most
HORIZON = {"steps": 200, "dt_s": 2.0}


@dataclass(frozen=True)
class Options:
    """How a scan is read, and what its surface is taken to be."""

    robot: str = "scaler"
    scale: float = 1.0
    pitch_m: float | None = None
    outward: tuple[float, float, float] = (0.0, 0.0, 1.0)
    down: tuple[float, float, float] | None = None
    slope_deg: float = 90.0
    friction: float = 2.2
    limits: Limits = field(default_factory=Limits)


@dataclass(frozen=True)
class Imported:
    """What came of a scan, or of a board's table, which has no surface."""

    boxes: list[Box]
    ends: Ends
    slope_deg: float
    wall: Placed | None
    surfaces: list[Bounded] = field(default_factory=list)

    @property
    def holds(self) -> list[Box]:
        return [box for box in self.boxes if box.is_hold]

    @property
    def reasons(self) -> dict[str, int]:
        """How many bodies are no holds, by the reason."""
        bodies = [(box.name, box.reason) for box in self.boxes if box.name.startswith("body-")]
        names = {name.split("-")[1]: reason for name, reason in bodies}
        return dict(Counter(names.values()))


def imported(scan: Path, output: Path, options: Options) -> Imported:
    """Writes the scenario. Raises UsageError where the scan, or what is asked of it, cannot be."""
    robot = load_robot(options.robot)
    with progress(f"reading {scan.name}", 3) as bar:
        wall: Placed | None = None
        surfaces: list[Bounded] = []
        if scan.suffix.lower() == ".csv":
            found, slope_deg = read_board(scan), options.slope_deg
        else:
            wall = _placed(scan, options)
            bar.at(1)
            (found, surfaces), slope_deg = _found(wall, robot, options), wall.slope_deg
        if (most := max(Counter(box.is_hold for box in found).values(), default=0)) > MAX_CUBOIDS:
            hint = "cut the scan, or give the plane that the robot climbs by --outward"
            raise UsageError(f"{scan}: needs {most} holds or obstacles, expected at most {MAX_CUBOIDS} of each; {hint}")
        bar.at(2)
        document = _document(scan, robot, found, surfaces, slope_deg, options)
        while wall is not None and (lost := _ungripped(document, found, robot)):
            found = [_without(box, lost[box.name]) if box.name in lost else box for box in found]
            document = _document(scan, robot, found, surfaces, slope_deg, options)
        chosen = _ends(document, robot)
    if chosen.start is not None and chosen.goal is not None:
        document |= {"start": _start(chosen.start), "goal": _end(chosen.goal)}
    text = _said(scan, robot, chosen, wall, options) + yaml.safe_dump(
        document, sort_keys=False, allow_unicode=True, default_flow_style=None, width=140
    )
    output.parent.mkdir(parents=True, exist_ok=True)
    write_whole(output, text.encode())
    return Imported(found, chosen, slope_deg, wall, surfaces)


def _placed(scan: Path, options: Options) -> Placed:
    outward, down = np.array(options.outward), None if options.down is None else np.array(options.down)
    surface = read_surface(scan, options.scale, options.pitch_m, outward)
    return placed(surface, outward, down, options.slope_deg)


def _found(wall: Placed, robot: Robot, options: Options) -> tuple[list[Box], list[Bounded]]:
    samples = wall.surface.samples
    on = planes(samples)
    of = bodies(wall.surface, on)
    found: list[Box] = []
    for part in parts(samples, on, of):
        turned = part.frame is not CLIMBED
        rotation, origin = part.frame.rotation, part.frame.origin_m
        seen = wall.surface.moved(rotation, -rotation @ origin, keep_samples=True) if turned else wall.surface
        places, reason = find_places(seen, part.body, robot, options.limits)
        if turned:  # the sides of turned holds do not lean
            places = replace(places, lean_rad=np.zeros_like(places.lean_rad))
        if part.reason:
            places = places.of(np.zeros(0, np.int64))
        in_way = () if turned else behind(samples, on, of)
        mine = _with_friction(boxes(seen, part.body, places, reason, robot, in_way), options.friction)
        found += [replace(box, frame=part.frame, reason=part.reason or box.reason) for box in mine]
    return (apart(found), bounded(wall.surface, on, of)) if len(on.planes) > 1 else (found, [])


def tilted(friction: float, tilt_rad: float) -> float:
    """What friction is left along a gripper's axis on faces that lean so much: the cone of a leaning face, less."""
    return float(np.tan(max(np.arctan(friction) - tilt_rad, 0.0)))


def _with_friction(found: list[Box], friction: float) -> list[Box]:
    """Pairs of faces that lean beyond friction are none."""
    kept = []
    for box in found:
        pairs = zip(box.faces, box.tilt_rad, strict=True)
        first, second = (can and tilted(friction, tilt) > 0.0 for can, tilt in pairs)
        lost = box.is_hold and not (first or second)
        kept.append(replace(box, faces=(first, second), reason=SLIPPERY if lost else box.reason))
    return kept


def _ungripped(document: dict[str, Any], found: list[Box], robot: Robot) -> dict[str, dict[str, str]]:
    """By hold and pair of faces why the planner has no grasp there, with what stands beside it."""
    try:
        lacks = wall_lacks(scenario_of(document, robot, "wall"), robot)
    except ScenarioError:  # said where start and goal are looked for
        return {}
    lost = dict[str, dict[str, str]]()
    for index, box in enumerate(box for box in found if box.is_hold):
        for pair, can in zip("xy", box.faces, strict=True):
            if can and (index, pair) in lacks:
                lost.setdefault(box.name, {})[pair] = lacks[index, pair]
    return lost


def _without(box: Box, lost: dict[str, str]) -> Box:
    """A hold that is not gripped by these pairs of faces; an obstacle, where none is left."""
    first, second = (can and pair not in lost for pair, can in zip("xy", box.faces, strict=True))
    if first or second:
        return replace(box, faces=(first, second))
    name, why = box.name.replace("hold", "body"), next(iter(lost.values()))
    return replace(box, name=name, faces=(False, False), lean_rad=(0.0,) * 4, aside_rad=None, reason=why)


def _document(
    scan: Path, robot: Robot, found: list[Box], surfaces: list[Bounded], slope_deg: float, options: Options
) -> dict[str, Any]:
    """The scenario but for start and goal."""
    contact = {
        "model": "patch",
        "patch_radius_m": robot.gripper.pad_radius_m,
        "max_normal_N": robot.gripper.max_finger_force_N,
        "spine_shear_N": 5,
        "spine_twist_Nm": 0.05,
    }
    version = 2 if surfaces or any(box.leans or box.grips for box in found if box.is_hold) else 1
    head = {"version": version, "name": scan.stem, "robot": options.robot}
    wall: dict[str, Any] = {"wall": {"slope_deg": round(slope_deg, 1)}}
    if version == 2:
        gravity = _rounded(np.array(Wall(round(slope_deg, 1)).gravity_w_m_s2))
        wall = {"gravity_m_s2": gravity, "surfaces": _surfaces(surfaces)}
    return {
        **head,
        **wall,
        "contact": contact,
        "holds": [_hold(box, options.friction, version) for box in found if box.is_hold],
        "obstacles": [_cuboid(box, version) for box in found if not box.is_hold],
        "horizon": HORIZON,
    }


def _surfaces(bounded: list[Bounded]) -> list[dict[str, Any]]:
    """The plane z = 0 of W, unless it is bounded as well, and the others."""
    whole = {"name": WALL, "plane": {"point_m": [0.0, 0.0, 0.0], "normal": [0.0, 0.0, 1.0]}}
    rectangles = [
        {
            "name": each.name,
            "rectangle": {
                "pose": pose(each.frame.origin_m, rpy_of(each.frame.rotation.T)),
                "size_m": _rounded(each.size_m),
                "depth_m": round(each.depth_m, DIGITS),
            },
        }
        for each in bounded
    ]
    return rectangles if any(each.name == WALL for each in bounded) else [whole, *rectangles]


def pose(place_m: Array, turn_rad: Array) -> dict[str, Any]:
    """As in a scenario of version 2, rounded."""
    turns = [round(float(each), 2) + 0.0 for each in np.degrees(turn_rad)]
    return {"position_m": [each + 0.0 for each in _rounded(place_m)], "rpy_deg": turns}


def _start(stance: StartStance) -> dict[str, Any]:
    """With the grips that it is about."""
    end = _end(stance)
    grips = {limb: {"grip": grip} for limb, grip in stance.grips.items()}
    return end | {"grasps": {limb: grasp | grips.get(limb, {}) for limb, grasp in end["grasps"].items()}}


def _end(stance: StartStance) -> dict[str, Any]:
    grasps = {limb: {"hold": hold, "faces": faces} for limb, (hold, faces) in stance.grasps.items()}
    return {"body": {"position_m": [round(each, DIGITS) for each in stance.body_m]}, "grasps": grasps}


def _ends(document: dict[str, Any], robot: Robot) -> Ends:
    """Start and goal by the planner's map."""

    def up(start: StartStance) -> Way | str:
        try:
            top, goal = way_up(scenario_of(document | {"start": _start(start)}, robot, "wall"), robot, WAY_UP_S, LOOKS)
        except (ScenarioError, crux_planner.InfeasibleError) as error:
            return str(error)
        moves = 0 if top.rest is None else top.rest.moves
        return Way(goal, moves, top.stops)

    if len(document["holds"]) < len(LIMB_NAMES):
        return ends([], up)
    return ends(wall_stances(scenario_of(document, robot, "wall"), robot), up)


def _said(scan: Path, robot: Robot, chosen: Ends, wall: Placed | None, options: Options) -> str:
    """The first lines of the file: where it comes from, and what was taken for it."""
    slope = "." if options.down is not None else ", the slope."
    said = [f"# From {scan.name} by `crux wall import`. Not in it, so assumed [A]: friction, spines{slope}"]
    if wall is not None:
        said += [
            f"# Cuboids stand for the holds that {robot.name}'s grippers can take; `crux climb` simulates them.",
            f"# W: rows of the rotation from the scan's frame {np.round(wall.rotation, DIGITS).tolist()},",
            f"# then the offset {np.round(wall.offset, DIGITS).tolist()} m.",
        ]
    if chosen.without:
        said.append("# No way up was found: give start and goal. `crux wall check` says what holds lack.")
    return "\n".join(said) + "\n"


def _cuboid(box: Box, version: int) -> dict[str, Any]:
    size, yaw_deg = _rounded(box.size_m), round(float(np.degrees(box.yaw_rad)), 2)
    if version == 1:
        return {"name": box.name, "position_m": _rounded(box.position_m), "size_m": size, "yaw_deg": yaw_deg}
    shape: dict[str, Any] = {"box_m": size}
    if box.leans:
        shape["lean_deg"] = {face: lean for face, lean in zip(SIDE_FACES, box.lean_deg, strict=True) if lean}
    return {"name": box.name, "pose": pose(box.foot_m, box.rpy_rad), "shape": shape}


def _hold(box: Box, friction: float, version: int) -> dict[str, Any]:
    """A face that no gripper can take has neither friction nor spines."""
    by_face: dict[str, float] = {}
    off_axis = box.tilt_rad if box.aside_rad is None else box.aside_rad
    for axis, can, tilt in zip("xy", box.faces, off_axis, strict=True):
        by_face |= dict.fromkeys((f"+{axis}", f"-{axis}"), round(tilted(friction, tilt), 3) if can else 0.0)
    spines = {face: by_face[face] > 0.0 for face in by_face} | {"top": False}
    grips = {"grips": grips_of(box)} if box.grips else {}
    return {**_cuboid(box, version), "friction": by_face | {"top": 0.0}, "spines": spines, **grips}


def grips_of(box: Box) -> list[dict[str, Any]]:
    """As a scenario of version 2 has them; `share` is left out where pads bear wholly."""
    found = []
    for grip in box.as_hold.grips:
        place = {"faces": grip.faces, "aside_m": grip.aside_m, "height_m": grip.height_m}
        found.append(place | ({"share": list(grip.share)} if min(grip.share) < 1.0 else {}))
    return found


def _rounded(values: Array) -> list[float]:
    return [round(float(each), DIGITS) for each in values]
