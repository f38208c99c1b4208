"""A body as a cuboid that a gripper takes: about its best place and those in line with it, with `grips` where pads
would not bear wholly, or not be where they bear, wherever a plan may have them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from crux_contracts.robot import Robot
from crux_contracts.scenario_types import Grip
from crux_planner import Faces

from crux_simulation.wall.borne import Line, shares
from crux_simulation.wall.box import DIGITS, Box, along_axes
from crux_simulation.wall.places import Flags, Places
from crux_simulation.wall.surface import Array

SAME_YAW_RAD, SAME_WIDTH_M, SAME_LINE_M = np.radians(8.0), 0.004, 0.003
PAD_HEIGHT_M = 0.001  # of the pads in a plan from where the body was looked at
LEANS_RAD = np.radians(5.0)  # faces that lean less are upright
LEAST_TOP_M = 0.006
EDGE_M = 2e-4  # between a grip's pads and the edges of their faces, more than rounding moves them
FITS_M = 1e-6
STEEP = "its faces lean so much that its top is too small, or too low for the pads"
HIGH = "its faces lean so much that the pads' middles would be too high"
BEYOND = "the pads of its grips would be beyond the faces of its cuboid"


@dataclass(frozen=True, eq=False)
class _Pair:
    """A pair of faces that is gripped at place `best` of a line."""

    line: Line
    best: int
    lean_rad: tuple[float, float]  # of the plus and the minus face
    flipped: bool  # whether the place's axis ends on the minus face
    over_m: float  # of the pads' middles over where they touch
    rim_m: float  # of the top over them, at least

    @classmethod
    def of(cls, line: Line, best: int, flipped: bool, radius_m: float) -> _Pair:
        ahead, behind = _leans(line.places, best)
        lean = (behind, ahead) if flipped else (ahead, behind)
        over = radius_m * float(np.sin(max(lean)))
        return cls(line, best, lean, flipped, over, radius_m * float((np.cos(lean) - np.sin(lean)).max()))

    @property
    def pads_m(self) -> float:
        return float(self.line.pads_m[self.best])

    def bears(self, middle_m: float, width_m: float, pads_m: float, radius_m: float) -> bool:
        """Wholly in the middle of faces so wide, and at both ends."""
        slack = max(width_m / 2.0 - radius_m, 0.0)
        return self.line.bears_at((middle_m - slack, middle_m, middle_m + slack), pads_m)

    def grips(self, faces: str, box: Box, robot: Robot) -> tuple[Grip, ...]:
        """On the cuboid: at the best place, and at the ends where as much bears; those whose pads are on its faces."""
        which = [self.best, *self.line.ends(self.best, robot.gripper.pad_radius_m)]
        share = shares(self.line.places, self.best, self.flipped)
        aside = along_axes(box.yaw_rad, self.line.places.middle[which, :2] - box.position_m)[1 - "xy".index(faces)]
        found = []
        for off, pads in zip(aside.tolist(), self.line.pads_m[which].tolist(), strict=True):
            grip = Grip(faces, round(off, DIGITS) + 0.0, round(pads, DIGITS), share)
            at = Faces.of(box.as_hold, "xy".index(faces), robot, robot.gripper.pad_radius_m, grip)
            if at is not None and at.beyond_m <= FITS_M:
                found.append(grip)
        return tuple(found)


def hold_of(name: str, points: Array, places: Places, robot: Robot) -> Box | str:
    """The cuboid of a body with these points and places; why not, where no cuboid puts the pads there."""
    (low, high), top = robot.grasp.pad_height_m, float(points[:, 2].max())
    wanted = float(np.clip(top - Faces.top_over_pads_m(robot), (low + high) / 2.0, high))
    first, ends = _first(points, places, wanted, robot)
    if first is None:
        return HIGH
    radius, width = robot.gripper.pad_radius_m, float(places.width_m[first.best])
    narrow = 2.0 * (radius + EDGE_M)
    second = _second(places, first.best, ends, wanted, robot) if width >= narrow else None
    pairs = {"x": first}
    if second is not None:
        middle, length = float(first.line.along_m[second.best]), float(places.width_m[second.best])
        ends = middle - length / 2.0, middle + length / 2.0
        pairs = {"x": first, "y": second} if length >= narrow else {"y": second}
    pads, height = _planned(next(iter(pairs.values())), top, wanted, robot)
    spots = {"x": (sum(ends) / 2.0, ends[1] - ends[0]), "y": (0.0, width)}
    whole = pads is not None and all(pair.bears(*spots[faces], pads, radius) for faces, pair in pairs.items())
    if not whole:
        highest = max(pair.pads_m + pair.rim_m for pair in pairs.values()) + EDGE_M
        least = min(pair.pads_m for pair in pairs.values())
        height = min(max(top, highest), least + Faces.top_over_pads_m(robot))
        ends = (min(ends[0], -narrow / 2.0), max(ends[1], narrow / 2.0)) if second is None else ends
    box = _box(name, first, second, ends, height)
    box = replace(box, faces=("x" in pairs, "y" in pairs))
    if box.leans:
        touched = (first.pads_m if pads is None or not whole else pads) - first.over_m
        box = _leaned(box, (touched, 0.0 if second is None else second.pads_m - second.over_m))
        if whole and box.size_m[2] - first.rim_m < first.line.whole.lowest_m - PAD_HEIGHT_M:
            return STEEP
    return box if whole else _gripped(box, pairs, robot)


def _box(name: str, first: _Pair, second: _Pair | None, ends: tuple[float, float], height_m: float) -> Box:
    """About the place of the first pair, with ends off it along its faces."""
    places, best = first.line.places, first.best
    yaw, pairs = float(places.yaw_rad[best]), [first, *([] if second is None else [second])]
    foot = places.middle[best, :2] + sum(ends) / 2.0 * np.array([-np.sin(yaw), np.cos(yaw)])
    size = np.array([float(places.width_m[best]), ends[1] - ends[0], height_m])
    tilt, aside = ([*(float(of[pair.best].max()) for pair in pairs), 0.0] for of in (places.tilt_rad, places.aside_rad))
    box = Box(name, foot, size, yaw, (True, second is not None), (tilt[0], tilt[1]), "")
    leans = (*first.lean_rad, *((0.0, 0.0) if second is None else second.lean_rad))
    return replace(box, lean_rad=leans, aside_rad=(aside[0], aside[1])) if any(leans) else box


def _gripped(box: Box, pairs: dict[str, _Pair], robot: Robot) -> Box | str:
    """With the grips of those pairs whose pads are on their faces."""
    grips = tuple(grip for faces, pair in pairs.items() for grip in pair.grips(faces, box, robot))
    can = {grip.faces for grip in grips}
    return replace(box, grips=grips, faces=("x" in can, "y" in can)) if can else BEYOND


def _planned(first: _Pair, top_m: float, wanted_m: float, robot: Robot) -> tuple[float | None, float]:
    """How high plans have the pads on a cuboid as high as a body, and its height; None where they bear less there."""
    (low, high), over_m = robot.grasp.pad_height_m, Faces.top_over_pads_m(robot)
    heights = first.line.whole
    pads = float(np.clip(wanted_m, heights.lowest_m, heights.highest_m))
    height = min(max(top_m, pads + first.rim_m), pads + over_m)
    planned = float(np.clip((low + high) / 2.0, max(low, height - over_m), min(high, height - first.rim_m)))
    return pads if abs(planned - pads) <= PAD_HEIGHT_M else None, height


def _first(points: Array, places: Places, wanted_m: float, robot: Robot) -> tuple[_Pair | None, tuple[float, float]]:
    """The pair of faces of the best place, at the place in line with it that is nearest to the middle and to the wanted
    height of those as good, and the ends of the faces off it. None where the pads would be too high for the gripper.
    """
    radius, allowed = robot.gripper.pad_radius_m, robot.grasp.pad_height_m
    pads = _pads_m(places, radius)
    can = (pads >= allowed[0]) & (pads <= allowed[1])
    if not can.any():
        return None, (0.0, 0.0)
    best = int(np.where(can, places.merit, -1.0).argmax())
    same = _in_line(places, best) & can
    for _ in range(2):  # from the best place, then from the one taken
        yaw, which = float(places.yaw_rad[best]), np.flatnonzero(same)
        y = along_axes(yaw, places.middle[:, :2] - places.middle[best, :2])[1]
        beside, body = along_axes(yaw, points[:, :2] - places.middle[best, :2])
        body = body[np.abs(beside) < places.width_m[best] / 2.0 + SAME_WIDTH_M]
        ends = max(float(y[same].min()) - radius, body.min()), min(float(y[same].max()) + radius, body.max())
        line = Line(places, which, y, pads)
        best = line.best(sum(ends) / 2.0, wanted_m)
    shift = float(y[best])
    moved = Line(places, which, y - shift, pads)
    return _Pair.of(moved, best, False, radius), (float(ends[0]) - shift, float(ends[1]) - shift)


def _second(places: Places, best: int, ends: tuple[float, float], wanted_m: float, robot: Robot) -> _Pair | None:
    """The pair of faces across those of a place, gripped where the merit is the most."""
    radius, allowed = robot.gripper.pad_radius_m, robot.grasp.pad_height_m
    yaw = float(places.yaw_rad[best])
    x, y = along_axes(yaw, places.middle[:, :2] - places.middle[best, :2])
    pads = _pads_m(places, radius)
    crossed = _turned(places, best) > np.pi / 2.0 - SAME_YAW_RAD
    crossed &= (np.abs(y - sum(ends) / 2.0) < radius) & (pads >= allowed[0]) & (pads <= allowed[1])
    if not crossed.any():
        return None
    line = Line(places, np.flatnonzero(crossed), x, pads)
    chosen = line.best(0.0, wanted_m)
    flipped = bool(np.cos(places.yaw_rad[chosen] - yaw - np.pi / 2.0) < 0.0)
    return _Pair.of(line, chosen, flipped, radius)


def _in_line(places: Places, best: int) -> Flags:
    """Which places are between the same faces as the best."""
    x = along_axes(float(places.yaw_rad[best]), places.middle[:, :2] - places.middle[best, :2])[0]
    same = (np.abs(places.width_m - places.width_m[best]) < SAME_WIDTH_M) & (np.abs(x) < SAME_LINE_M)
    return np.asarray(same & (_turned(places, best) < SAME_YAW_RAD))


def _turned(places: Places, best: int) -> Array:
    """(m,) by how much the axes of places are turned against that of one."""
    return np.asarray(np.abs((places.yaw_rad - places.yaw_rad[best] + np.pi / 2.0) % np.pi - np.pi / 2.0))


def _leaned(box: Box, touched_m: tuple[float, float]) -> Box:
    """A box that is as wide as it says where pads touch the two pairs of faces, at heights `touched_m`: its foot is
    larger, and it ends where its top gets too small.
    """
    slope = np.tan(box.lean_rad).reshape(2, 2)
    out = slope * np.array(touched_m)[:, None]
    foot = box.size_m[:2] + out.sum(axis=1)
    highest = (foot - LEAST_TOP_M) / np.maximum(slope.sum(axis=1), 1e-9)
    size = np.array([*foot, min(box.size_m[2], *highest)])
    return replace(box, position_m=box.position_m + (out[:, 0] - out[:, 1]) / 2.0 @ box.axes, size_m=size)


def _pads_m(places: Places, radius_m: float) -> Array:
    """(m,) how high pads' middles are at places: balls that touch leaning faces under them."""
    lean = places.lean_rad.max(axis=1)
    return np.asarray(places.middle[:, 2] + radius_m * np.sin(np.where(lean > LEANS_RAD, lean, 0.0)))


def _leans(places: Places, which: int) -> tuple[float, float]:
    """How much the faces of a place lean in, of that at the axis's end first; 0 where that is little."""
    first, second = (float(each) if each > LEANS_RAD else 0.0 for each in places.lean_rad[which])
    return first, second
