"""What must hold between the parts of a scenario: names, overlaps, grasps."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

from .reading import Checker, did_you_mean
from .turned_boxes import TurnedBox, depth_m
from .yaml_document import Node

OVERLAP_TOLERANCE_M = 1e-6
TURNED_TOLERANCE_M = 1e-3  # where a body is turned: what stands on its faces has places that are rounded
OFF_WAY_M = 20.0  # from the way between start and goal, along each axis


@dataclass(frozen=True)
class Footprint:
    """A cuboid seen from above, and how it is turned out of the wall's plane."""

    name: str
    node: Node
    x_m: float
    y_m: float
    half_x_m: float
    half_y_m: float
    yaw_rad: float
    height_m: float = 0.0
    tilt_rad: tuple[float, float] = (0.0, 0.0)  # roll and pitch
    foot_z_m: float = 0.0

    @property
    def turned(self) -> bool:
        return any(self.tilt_rad) or self.foot_z_m != 0.0

    @property
    def extent_m(self) -> float:
        """Farther from the middle of its foot it is nowhere, seen from above."""
        return math.hypot(self.half_x_m, self.half_y_m) + (self.height_m if self.turned else 0.0)

    def box(self) -> TurnedBox:
        size = (2 * self.half_x_m, 2 * self.half_y_m, self.height_m)
        return TurnedBox.on_foot((self.x_m, self.y_m, self.foot_z_m), size, (*self.tilt_rad, self.yaw_rad))

    def axes(self) -> tuple[tuple[float, float], tuple[float, float]]:
        c, s = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        return (c, s), (-s, c)

    def reach(self, axis: tuple[float, float]) -> float:
        """Half its extent along a direction."""
        (ux, uy), (vx, vy) = self.axes()
        return self.half_x_m * abs(ux * axis[0] + uy * axis[1]) + self.half_y_m * abs(vx * axis[0] + vy * axis[1])


def overlap_m(a: Footprint, b: Footprint) -> float:
    """Least way to push two footprints apart, by the separating axis theorem, or where one is turned the cuboids
    themselves; not positive when they are apart.
    """
    dx, dy = b.x_m - a.x_m, b.y_m - a.y_m
    gap = math.hypot(dx, dy) - a.extent_m - b.extent_m
    if gap > 0:  # spares the exact test for nearly all pairs
        return -gap
    if a.turned or b.turned:
        return depth_m(a.box(), b.box())
    return min(a.reach(n) + b.reach(n) - abs(dx * n[0] + dy * n[1]) for n in (*a.axes(), *b.axes()))


def _members(node: Node | None) -> dict[str, Node]:
    return node.content if node is not None and isinstance(node.content, dict) else {}


def _items(node: Node | None) -> list[Node]:
    return node.content if node is not None and isinstance(node.content, list) else []


def _floats(node: Node | None, count: int) -> list[float] | None:
    values = [item.content for item in _items(node)]
    if len(values) != count:
        return None
    numbers = [float(v) for v in values if isinstance(v, (int, float)) and not isinstance(v, bool)]
    return numbers if len(numbers) == count and all(math.isfinite(v) for v in numbers) else None


def _footprint(node: Node) -> Footprint | None:
    """None where a value is wrong in itself, which has been noted already."""
    keys = _members(node)
    if "pose" in keys:  # of version 2
        pose, shape = _members(keys["pose"]), _members(keys.get("shape"))
        position, size = _floats(pose.get("position_m"), 3), _floats(shape.get("box_m"), 3)
        turns = _floats(pose["rpy_deg"], 3) if "rpy_deg" in pose else [0.0, 0.0, 0.0]
    else:
        position, size = _floats(keys.get("position_m"), 2), _floats(keys.get("size_m"), 3)
        yaw = keys["yaw_deg"].content if "yaw_deg" in keys else 0.0
        turns = [0.0, 0.0, float(yaw)] if isinstance(yaw, (int, float)) and not isinstance(yaw, bool) else None
    if position is None or size is None or min(size) <= 0 or turns is None or not math.isfinite(turns[2]):
        return None
    name = keys["name"].shown() if "name" in keys else node.key
    (x, y, *z), (roll, pitch, yaw_rad) = position, map(math.radians, turns)
    half = size[0] / 2, size[1] / 2
    return Footprint(name, node, x, y, *half, yaw_rad, size[2], (roll, pitch), *z)


def check_places(check: Checker, keys: dict[str, Node]) -> None:
    """Nothing stands far from the way between start and goal and from all else: what does is likely in another unit."""
    ends = [_items(_members(_members(keys.get(part)).get("body")).get("position_m")) for part in ("start", "goal")]
    cuboids = [node for part in ("holds", "obstacles", "footholds") for node in _items(keys.get(part))]
    places = [
        _members(_members(each).get("pose")).get("position_m", _members(each).get("position_m")) for each in cuboids
    ]
    places += _members(_members(keys.get("start")).get("feet")).values()
    for axis in (0, 1):
        way = [check.number(end[axis], -math.inf, math.inf) for end in ends if len(end) == 3]
        nodes = [_items(place)[axis] for place in places]
        values = [check.number(node, -math.inf, math.inf) for node in nodes]
        low, high = (sign * _edge([sign * v for v in way], [sign * v for v in values]) for sign in (-1.0, 1.0))
        for node in nodes if way else ():
            check.number(node, low - OFF_WAY_M, high + OFF_WAY_M, "m")


def _edge(way: list[float], values: list[float]) -> float:
    """The last of the values from the way's highest on before the first gap of more than `OFF_WAY_M`."""
    edge = max(way, default=0.0)
    for value in sorted(values):
        edge = max(edge, value) if value <= edge + OFF_WAY_M else edge
    return edge


def check_cuboids(check: Checker, keys: dict[str, Node]) -> None:
    """Names are unique; nothing stands in something else."""
    nodes = [node for part in ("holds", "obstacles", "footholds") for node in _items(keys.get(part))]
    first_with: dict[str, Node] = {}
    for node in nodes:
        name = _members(node).get("name")
        if name is None or not isinstance(name.content, str):
            continue
        if name.content in first_with:
            check.note(name, f"expected a name of its own; line {first_with[name.content].line} has it too")
        first_with.setdefault(name.content, name)
    footprints = [footprint for footprint in map(_footprint, nodes) if footprint is not None]
    for second, first in sorted((j, i) for i, j in _near(footprints)):
        a, b = footprints[first], footprints[second]
        depth = overlap_m(a, b)
        if depth > (TURNED_TOLERANCE_M if a.turned or b.turned else OVERLAP_TOLERANCE_M):
            place = f"[{b.x_m:g}, {b.y_m:g}]"
            check.note_at(
                b.node,
                "pose.position_m" if "pose" in _members(b.node) else "position_m",
                place,
                f"{b.name} overlaps {a.name} ({a.node.key}, line {a.node.line}) by {depth:.3g} m; move them apart",
            )


def _near(footprints: list[Footprint]) -> Iterator[tuple[int, int]]:
    """Pairs whose extents along x meet, the earlier first."""
    extents = [each.extent_m for each in footprints]
    order = sorted(range(len(footprints)), key=lambda i: footprints[i].x_m - extents[i])
    open_: list[int] = []
    for i in order:
        begin = footprints[i].x_m - extents[i]
        open_ = [j for j in open_ if footprints[j].x_m + extents[j] >= begin]
        yield from ((min(i, j), max(i, j)) for j in open_)
        open_.append(i)


def check_grasps(check: Checker, keys: dict[str, Node]) -> None:
    """Every grasp names a hold, and of a start a grip that it has, or a foothold; none of these has two limbs."""
    holds = [_members(node).get("name") for node in _items(keys.get("holds"))]
    bodies = {name.content: node for name, node in zip(holds, _items(keys.get("holds")), strict=True) if name}
    known = [node.content for node in holds if node is not None and isinstance(node.content, str)]
    obstacles = [_members(node).get("name") for node in _items(keys.get("obstacles"))]
    forbidden = {node.content for node in obstacles if node is not None}
    footholds = [str(_members(node)["name"].content) for node in _items(keys.get("footholds"))]
    for part in ("start", "goal"):
        taken: dict[str, str] = {}
        for limb, grasp in _members(_members(keys.get(part)).get("grasps")).items():
            if (foothold := _members(grasp).get("foothold")) is not None:
                _check_foothold(check, foothold, limb, footholds, taken)
            hold = _members(grasp).get("hold")
            if hold is None or not isinstance(hold.content, str):
                continue
            if hold.content not in known:
                hint = did_you_mean(hold.content, known) if known else "the scenario has no holds"
                why = "is an obstacle" if hold.content in forbidden else "no such hold"
                check.note(hold, f"{why}; {hint}")
            elif hold.content in taken:
                check.note(hold, f"expected a hold of its own for {limb}; {taken[hold.content]} has this one")
            else:
                taken[hold.content] = limb
                _check_grip(check, part, _members(grasp), bodies[hold.content])


def _check_foothold(check: Checker, named: Node, limb: str, known: list[str], taken: dict[str, str]) -> None:
    """A foothold that is there, and that no other limb stands on."""
    name = str(named.content)
    if name not in known:
        hint = did_you_mean(name, known) if known else "the scenario has no footholds"
        check.note(named, f"no such foothold; {hint}")
    elif name in taken:
        check.note(named, f"expected a foothold of its own for {limb}; {taken[name]} has this one")
    taken.setdefault(name, limb)


def _check_grip(check: Checker, part: str, grasp: dict[str, Node], hold: Node) -> None:
    """A number of a hold's grips on the faces of a grasp."""
    number, faces = grasp.get("grip"), grasp.get("faces")
    if number is None or faces is None:
        return
    on = [_members(each).get("faces") for each in _items(_members(hold).get("grips"))]
    many = sum(each is not None and each.content == faces.content for each in on)
    if part == "goal":
        check.note(number, "is for starts: a goal takes any of the hold's grips; expected none")
    elif isinstance(number.content, int) and number.content >= many:
        check.note(number, f"expected less than {many}: the hold has so many grips on faces {faces.content}")
