"""Bodies on a wall as cuboids: holds where places on them allow it, else obstacles that nothing may touch. The faces of
a hold lean in as the surface does.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import trimesh
from crux_contracts.robot import Robot
from crux_contracts.scenario_checks import Footprint, overlap_m
from crux_contracts.yaml_document import Node
from crux_tools.telemetry.rotations import rpy_of

from crux_simulation.wall.frame import CLIMBED, Frame
from crux_simulation.wall.places import REASONS, TAKEN, Flags, Indices, Places, lean_m
from crux_simulation.wall.surface import Array, Surface

SAME_YAW_RAD, SAME_WIDTH_M, SAME_LINE_M = np.radians(8.0), 0.004, 0.003
PAD_HEIGHT_M = 0.001  # of the pads in a plan from where the body was looked at
APART_M = 1e-3  # between cuboids, more than rounding moves them
COVERED_M = 0.006  # beside cuboids that is not covered: plans keep fingers farther off them
LEANS_RAD = np.radians(5.0)  # faces that lean less are upright
LEAST_TOP_M = 0.006
STEEP = "its faces lean so much that its top is too small, or too low for the pads"
LEAST_M, LEAST_POINTS = 0.012, 4  # of obstacles, smaller ones are specks
ON_A_LINE = 1e-6  # of points' length, as far as they lie beside a line
BEYOND_M = 0.008  # what reaches so far out of a hold's cuboid, at the pads' height or over it, is an obstacle
IN_ANOTHER = "its cuboid would stand in that of another hold"
CUBOID = "its grips are of no cuboid: the pads' height in a plan is not where they are"


@dataclass(frozen=True)
class Box:
    """A cuboid on a plane of the wall, in its frame: middle of its foot (2,), sizes (3,) [m], yaw. `faces` says which
    pairs can be gripped, `tilt_rad` how far the worse face of each is off the gripper's axis. `lean_rad` is how much
    the side faces lean in (+x, -x, +y, -y), `aside_rad` what the worse face of each pair is off the axis besides.
    """

    name: str
    position_m: Array
    size_m: Array
    yaw_rad: float
    faces: tuple[bool, bool]
    tilt_rad: tuple[float, float]
    reason: str  # why it cannot be gripped
    lean_rad: tuple[float, float, float, float] = (0.0,) * 4
    aside_rad: tuple[float, float] | None = None  # as `tilt_rad`, where no face leans
    frame: Frame = CLIMBED

    @property
    def is_hold(self) -> bool:
        return any(self.faces)

    @property
    def foot_m(self) -> Array:
        """(3,) the middle of its foot in W [m]."""
        return self.frame.in_w(np.array([*self.position_m, 0.0]))

    @property
    def rotation(self) -> Array:
        """(3, 3) of the cuboid in W."""
        c, s = np.cos(self.yaw_rad), np.sin(self.yaw_rad)
        return np.asarray(self.frame.rotation.T @ np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]))

    @property
    def rpy_rad(self) -> Array:
        """(3,) roll, pitch and yaw of the cuboid in W."""
        return np.array([0.0, 0.0, self.yaw_rad]) if self.frame is CLIMBED else rpy_of(self.rotation)


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
    why = [CUBOID if stage == TAKEN else REASONS[stage] for stage in reason]
    merit = np.zeros(len(reason))
    np.maximum.at(merit, places.body, places.merit)
    for body in np.flatnonzero(merit > 0.0)[np.argsort(-merit[merit > 0.0], kind="stable")]:
        hold = _hold(f"hold-{body + 1}", surface.samples.points[of == body], places.of(places.body == body), robot)
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
            along = _along(box.yaw_rad, rest[:, :2] - box.position_m)[int(box.size_m[:2].argmax())]
            waiting += [(rest[along < 0.0], met[0].yaw_rad), (rest[along >= 0.0], met[0].yaw_rad)]


def _beside(box: Box, points: Array) -> Flags:
    """Which points lie beyond the side of a cuboid that has the most beyond it."""
    x, y = _along(box.yaw_rad, points[:, :2] - box.position_m)
    over = np.stack([x, -x, y, -y]) > np.repeat(box.size_m[:2] / 2.0 + 2.0 * APART_M, 2)[:, None]
    return np.asarray(over[over.sum(axis=1).argmax()])


def _lanes(hold: Box, robot: Robot) -> list[Box]:
    """What the fingers need beside a hold to open: by pair of faces that can be gripped, from finger to finger."""
    thick = 2.0 * robot.gripper.pad_radius_m
    found = []
    for axis, can in enumerate(hold.faces):
        length = min(hold.size_m[axis] + thick, 2.0 * robot.gripper.opening_m[1]) + 2.0 * thick
        if can:
            size = np.array([length, thick, hold.size_m[2]])
            yaw = hold.yaw_rad + axis * np.pi / 2.0
            found.append(Box(hold.name, hold.position_m, size, yaw, (False, False), (0.0, 0.0), ""))
    return found


def _covers(box: Box, points: Array) -> Array:
    x, y = _along(box.yaw_rad, points[:, :2] - box.position_m)
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
        off = (
            side
            * size[axis]
            * np.array([[np.cos(box.yaw_rad), np.sin(box.yaw_rad)], [-np.sin(box.yaw_rad), np.cos(box.yaw_rad)]])[axis]
        )
        half = replace(box, position_m=box.position_m + off, size_m=size)
        found += _pieces(half, [each for each in met if _overlap_in_w(half, each)])
    return found


def _overlap_in_w(a: Box, b: Box) -> bool:
    return a.frame is not b.frame and overlap_m(_footprint(a), _footprint(b)) > 0.0


def _footprint(box: Box) -> Footprint:
    (x, y, z), (roll, pitch, yaw) = box.foot_m, box.rpy_rad
    half = box.size_m / 2.0
    return Footprint(box.name, Node("", box.name, 0), x, y, half[0], half[1], yaw, box.size_m[2], (roll, pitch), z)


def _hold(name: str, points: Array, places: Places, robot: Robot) -> Box | str:
    """The cuboid about the best place, and the places in line with it; why not, where no cuboid puts the pads there."""
    best = int(places.merit.argmax())
    yaw, radius = float(places.yaw_rad[best]), robot.gripper.pad_radius_m
    x, y = _along(yaw, places.middle[:, :2] - places.middle[best, :2])
    turned = np.abs((places.yaw_rad - yaw + np.pi / 2.0) % np.pi - np.pi / 2.0)
    same = turned < SAME_YAW_RAD
    same &= (np.abs(places.width_m - places.width_m[best]) < SAME_WIDTH_M) & (np.abs(x) < SAME_LINE_M)
    lean = _leans(places, best)
    over, rim = radius * float(np.sin(max(lean))), radius * float((np.cos(lean) - np.sin(lean)).max())
    low, high = (
        places.middle[same, 2].min() + over,
        places.middle[same, 2].max() + over,
    )  # of pads, over where they touch
    allowed = robot.grasp.pad_height_m
    pads = float(np.clip(sum(allowed) / 2.0, low, high))
    top = float(points[:, 2].max())
    height = max(top, pads + rim) if pads >= sum(allowed) / 2.0 - PAD_HEIGHT_M else pads + rim
    planned = max(min(sum(allowed) / 2.0, height - rim), allowed[0], height - robot.gripper.finger_height_m)
    if not low - PAD_HEIGHT_M <= planned <= min(high + PAD_HEIGHT_M, allowed[1]):
        return CUBOID
    width, tilt, across = float(places.width_m[best]), float(places.tilt_rad[best].max()), 0.0
    beside, body = _along(yaw, points[:, :2] - places.middle[best, :2])
    body = body[np.abs(beside) < width / 2.0 + SAME_WIDTH_M]
    ends = max(float(y[same].min()) - radius, body.min()), min(float(y[same].max()) + radius, body.max())
    crossed = np.flatnonzero((turned > np.pi / 2.0 - SAME_YAW_RAD) & (np.abs(y - sum(ends) / 2.0) < radius))
    if len(crossed):
        second = crossed[places.merit[crossed].argmax()]
        length, across = float(places.width_m[second]), float(places.tilt_rad[second].max())
        ends = y[second] - length / 2.0, y[second] + length / 2.0
    centre = places.middle[best, :2] + sum(ends) / 2.0 * np.array([-np.sin(yaw), np.cos(yaw)])
    aside = float(places.aside_rad[best].max()), 0.0
    leans = (*lean, 0.0, 0.0)
    size = np.array([width, ends[1] - ends[0], height])
    if len(crossed):
        flipped = np.cos(places.yaw_rad[second] - yaw - np.pi / 2.0) < 0.0
        ahead, behind = _leans(places, int(second))
        leans = (*lean, behind, ahead) if flipped else (*lean, ahead, behind)
        aside = aside[0], float(places.aside_rad[second].max())
    upright = Box(name, centre, size, yaw, (True, len(crossed) > 0), (tilt, across), "")
    if not any(leans):
        return upright
    touched_m = pads - over, float(places.middle[second, 2]) if len(crossed) else 0.0
    leaning = _leaned(replace(upright, lean_rad=leans, aside_rad=aside), touched_m)
    lowest = min(leaning.size_m[2] - rim, pads)
    return leaning if lowest >= max(low - PAD_HEIGHT_M, allowed[0]) else STEEP


def _leaned(box: Box, touched_m: tuple[float, float]) -> Box:
    """A box that is as wide as it says where pads touch the two pairs of faces, at heights `touched_m`: its foot is
    larger, and it ends where its top gets too small.
    """
    slope = np.tan(box.lean_rad).reshape(2, 2)
    out = slope * np.array(touched_m)[:, None]
    along = np.array([[np.cos(box.yaw_rad), np.sin(box.yaw_rad)], [-np.sin(box.yaw_rad), np.cos(box.yaw_rad)]])
    foot = box.size_m[:2] + out.sum(axis=1)
    highest = (foot - LEAST_TOP_M) / np.maximum(slope.sum(axis=1), 1e-9)
    size = np.array([*foot, min(box.size_m[2], *highest)])
    return replace(box, position_m=box.position_m + (out[:, 0] - out[:, 1]) / 2.0 @ along, size_m=size)


def _leans(places: Places, which: int) -> tuple[float, float]:
    """How much the faces of a place lean in, of that at the axis's end first; 0 where that is little."""
    first, second = (float(each) if each > LEANS_RAD else 0.0 for each in places.lean_rad[which])
    return first, second


def _beyond(hold: Box, points: Array, robot: Robot) -> Array:
    """Which points stand out of a hold's cuboid, no lower than the pads reach: faces that lean do so by as much as
    `find_places` leaves to the fingers.
    """
    radius = robot.gripper.pad_radius_m
    most = hold.size_m[:2] / 2.0 + np.maximum(BEYOND_M, [lean_m(radius, tilt) for tilt in hold.tilt_rad])
    out = (np.abs(np.column_stack(_along(hold.yaw_rad, points[:, :2] - hold.position_m))) > most).any(axis=1)
    pads = min(sum(robot.grasp.pad_height_m) / 2.0, hold.size_m[2] - radius)
    return np.asarray(out & (points[:, 2] > pads - radius))


def _obstacle(name: str, points: Array, reason: str, yaw: float | None) -> Box:
    """The smallest upright cuboid about points, or the one of this yaw."""
    if yaw is None:
        size, axes = np.linalg.svd(points[:, :2] - points[:, :2].mean(axis=0), full_matrices=False)[1:]
        if size[1] > ON_A_LINE * size[0]:
            axes = np.linalg.inv(trimesh.bounds.oriented_bounds_2D(points[:, :2])[0])[:2, :2].T
        yaw = float(np.arctan2(axes[0, 1], axes[0, 0]))
    c, s = np.cos(yaw), np.sin(yaw)
    low, high = (edge(np.stack(_along(yaw, points[:, :2])), axis=1) for edge in (np.min, np.max))
    sizes = np.maximum(np.array([*(high - low), points[:, 2].max()]), 0.005)
    middle = np.array([[c, -s], [s, c]]) @ (low + high) / 2.0
    return Box(name, middle, sizes, yaw, (False, False), (0.0, 0.0), reason)


def _along(yaw: float, points: Array) -> tuple[Array, Array]:
    """Coordinates along a cuboid's own axes."""
    return points @ [np.cos(yaw), np.sin(yaw)], points @ [-np.sin(yaw), np.cos(yaw)]
