"""Bodies on a wall as cuboids: holds where places on them allow it, else obstacles that nothing may touch. The faces of
a hold lean in as the surface does.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import trimesh
from crux_contracts.robot import Robot
from crux_contracts.scenario_checks import Footprint, overlap_m
from crux_contracts.yaml_document import Node

from crux_simulation.wall.box import Box, along_axes
from crux_simulation.wall.holds import hold_of
from crux_simulation.wall.places import REASONS, Flags, Indices, Places, lean_m
from crux_simulation.wall.surface import Array, Surface

APART_M = 1e-3  # between cuboids, more than rounding moves them
COVERED_M = 0.006  # beside cuboids that is not covered: plans keep fingers farther off them
LEAST_M, LEAST_POINTS = 0.012, 4  # of obstacles, smaller ones are specks
ON_A_LINE = 1e-6  # of points' length, as far as they lie beside a line
BEYOND_M = 0.008  # what reaches so far out of a hold's cuboid, at the pads' height or over it, is an obstacle
IN_ANOTHER = "its cuboid would stand in that of another hold"


def boxes(
    surface: Surface,
    of: Indices,
    places: Places,
    reason: Indices,
    robot: Robot,
    others: Sequence[tuple[str, Array, str]] = (),
) -> list[Box]:
    """All bodies as cuboids that stand apart, holds first, the best ones before others; `of`, `places` and `reason` are
    those of `bodies` and `find_places`. `others`: name, points and reason of what else is in the way.
    """
    found: list[Box] = []
    why = [REASONS[stage] for stage in reason]
    merit = np.zeros(len(reason))
    np.maximum.at(merit, places.body, places.merit)
    for body in np.flatnonzero(merit > 0.0)[np.argsort(-merit[merit > 0.0], kind="stable")]:
        hold = hold_of(f"hold-{body + 1}", surface.samples.points[of == body], places.of(places.body == body), robot)
        if isinstance(hold, str):
            why[body] = hold
            continue
        other = next((each.name for each in found if _overlap(hold, each)), None)
        if other is None:
            found.append(hold)
        else:
            why[body] = IN_ANOTHER
    holds = {hold.name: hold for hold in found}
    lanes = [lane for hold in found for lane in _lanes(hold, robot)]
    for body in range(len(reason)):
        points, name = surface.samples.points[of == body], f"hold-{body + 1}"
        if name in holds:
            outside = points[_beyond(holds[name], points, robot)]
            _cover(found, lanes, f"beside-{name}", outside, f"a part of {name} that its cuboid leaves out")
        else:
            _cover(found, lanes, f"body-{body + 1}", points, why[body])
    for name, points, words in others:
        _cover(found, lanes, name, points, words)
    return found


def _cover(found: list[Box], lanes: list[Box], name: str, points: Array, reason: str) -> None:
    """Adds obstacles over points, apart from what was found before: what that covers is left out, the rest cut along
    its sides, as by the lanes of fingers.
    """
    waiting: list[tuple[Array, float | None]] = [(points, None)]
    pieces = 0
    while waiting:
        rest, yaw = waiting.pop()
        rest = rest[~np.any([_covers(box, rest) for box in found], axis=0)] if found else rest
        if len(rest) < LEAST_POINTS:
            continue
        box = _obstacle(name if pieces == 0 else f"{name}-{pieces + 1}", rest, reason, yaw)
        met = [each for each in (*found, *lanes) if _overlap(box, each)]
        cuts = [(each, cut) for each in met if 0 < (cut := _beside(each, rest)).sum() < len(rest)]
        if cuts:
            other, cut = cuts[0]
            waiting += [(rest[~cut], yaw), (rest[cut], other.yaw_rad)]
        elif all(any(each is lane for lane in lanes) for each in met):
            found.append(box)
            pieces += 1
        elif box.size_m[:2].max() > LEAST_M:
            along = along_axes(box.yaw_rad, rest[:, :2] - box.position_m)[int(box.size_m[:2].argmax())]
            waiting += [(rest[along < 0.0], met[0].yaw_rad), (rest[along >= 0.0], met[0].yaw_rad)]


def _beside(box: Box, points: Array) -> Flags:
    """Which points lie beyond the side of a cuboid that has the most beyond it."""
    x, y = along_axes(box.yaw_rad, points[:, :2] - box.position_m)
    over = np.stack([x, -x, y, -y]) > np.repeat(box.size_m[:2] / 2.0 + 2.0 * APART_M, 2)[:, None]
    return np.asarray(over[over.sum(axis=1).argmax()])


def _lanes(hold: Box, robot: Robot) -> list[Box]:
    """What the fingers need beside a hold to open: by pair of faces that can be gripped, from finger to finger."""
    thick = 2.0 * robot.gripper.pad_radius_m
    found = []
    for axis, can in enumerate(hold.faces):
        length = min(hold.size_m[axis] + thick, 2.0 * robot.gripper.opening_m[1]) + 2.0 * thick
        for grip in hold.as_hold.places("xy"[axis]) if can else ():
            size = np.array([length, thick, hold.size_m[2]])
            yaw = hold.yaw_rad + axis * np.pi / 2.0
            aside = (0.0 if grip is None else grip.aside_m) * hold.axes[1 - axis]
            found.append(Box(hold.name, hold.position_m + aside, size, yaw, (False, False), (0.0, 0.0), ""))
    return found


def _covers(box: Box, points: Array) -> Array:
    x, y = along_axes(box.yaw_rad, points[:, :2] - box.position_m)
    return np.asarray((np.abs(x) <= box.size_m[0] / 2.0 + COVERED_M) & (np.abs(y) <= box.size_m[1] / 2.0 + COVERED_M))


def _overlap(a: Box, b: Box) -> bool:
    one, other = (
        Footprint(
            box.name, Node("", box.name, 0), float(x), float(y), box.size_m[0] / 2.0, box.size_m[1] / 2.0, box.yaw_rad
        )
        for box, (x, y) in ((a, a.position_m), (b, b.position_m))
    )
    return overlap_m(one, other) > -APART_M


def apart(found: list[Box]) -> list[Box]:
    """Boxes of several planes that stand apart in W, too: holds first, and of the others what is not in what was kept
    before, but for specks.
    """
    kept: list[Box] = []
    rest = [box for box in found if not box.is_hold]
    for box in (each for each in found if each.is_hold):
        if any(_overlap_in_w(box, each) for each in kept):
            rest.append(replace(box, name=box.name.replace("hold", "body"), faces=(False, False), reason=IN_ANOTHER))
        else:
            kept.append(box)
    for box in rest:
        pieces = _pieces(box, [each for each in kept if _overlap_in_w(box, each)])
        names = [box.name, *(f"{box.name}-piece-{i + 2}" for i in range(len(pieces)))]
        kept += [replace(piece, name=name) for name, piece in zip(names, pieces, strict=False)]
    return kept


def _pieces(box: Box, met: list[Box]) -> list[Box]:
    """A cuboid, or its halves and theirs, as far as none is in one of `met`."""
    if not met:
        return [box]
    axis = int(box.size_m[:2].argmax())
    size = box.size_m * np.where(np.arange(3) == axis, 0.5, 1.0)
    if size[axis] < LEAST_M:
        return []
    found = []
    for side in (-0.5, 0.5):
        off = side * size[axis] * box.axes[axis]
        half = replace(box, position_m=box.position_m + off, size_m=size)
        found += _pieces(half, [each for each in met if _overlap_in_w(half, each)])
    return found


def _overlap_in_w(a: Box, b: Box) -> bool:
    return a.frame is not b.frame and overlap_m(_footprint(a), _footprint(b)) > 0.0


def _footprint(box: Box) -> Footprint:
    (x, y, z), (roll, pitch, yaw) = box.foot_m, box.rpy_rad
    half = box.size_m / 2.0
    return Footprint(box.name, Node("", box.name, 0), x, y, half[0], half[1], yaw, box.size_m[2], (roll, pitch), z)


def _beyond(hold: Box, points: Array, robot: Robot) -> Array:
    """Which points stand out of a hold's cuboid, no lower than the pads reach: faces that lean do so by as much as
    `find_places` leaves to the fingers.
    """
    radius = robot.gripper.pad_radius_m
    most = hold.size_m[:2] / 2.0 + np.maximum(BEYOND_M, [lean_m(radius, tilt) for tilt in hold.tilt_rad])
    out = (np.abs(np.column_stack(along_axes(hold.yaw_rad, points[:, :2] - hold.position_m))) > most).any(axis=1)
    heights = [grip.height_m for grip in hold.grips if grip.height_m is not None]
    pads = min(heights or [sum(robot.grasp.pad_height_m) / 2.0, hold.size_m[2] - radius])
    return np.asarray(out & (points[:, 2] > pads - radius))


def _obstacle(name: str, points: Array, reason: str, yaw: float | None) -> Box:
    """The smallest upright cuboid about points, or the one of this yaw."""
    if yaw is None:
        size, axes = np.linalg.svd(points[:, :2] - points[:, :2].mean(axis=0), full_matrices=False)[1:]
        if size[1] > ON_A_LINE * size[0]:
            axes = np.linalg.inv(trimesh.bounds.oriented_bounds_2D(points[:, :2])[0])[:2, :2].T
        yaw = float(np.arctan2(axes[0, 1], axes[0, 0]))
    c, s = np.cos(yaw), np.sin(yaw)
    low, high = (edge(np.stack(along_axes(yaw, points[:, :2])), axis=1) for edge in (np.min, np.max))
    sizes = np.maximum(np.array([*(high - low), points[:, 2].max()]), 0.005)
    middle = np.array([[c, -s], [s, c]]) @ (low + high) / 2.0
    return Box(name, middle, sizes, yaw, (False, False), (0.0, 0.0), reason)
