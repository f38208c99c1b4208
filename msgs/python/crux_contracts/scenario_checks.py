"""What must hold between the parts of a scenario: names, overlaps, grasps."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

from .reading import Checker, did_you_mean
from .yaml_document import Node

OVERLAP_TOLERANCE_M = 1e-6
OFF_WAY_M = 20.0  # from the way between start and goal, along each axis


@dataclass(frozen=True)
class Footprint:
    """A cuboid seen from above."""

    name: str
    node: Node
    x_m: float
    y_m: float
    half_x_m: float
    half_y_m: float
    yaw_rad: float

    def axes(self) -> tuple[tuple[float, float], tuple[float, float]]:
        c, s = math.cos(self.yaw_rad), math.sin(self.yaw_rad)
        return (c, s), (-s, c)

    def reach(self, axis: tuple[float, float]) -> float:
        """Half its extent along a direction."""
        (ux, uy), (vx, vy) = self.axes()
        return self.half_x_m * abs(ux * axis[0] + uy * axis[1]) + self.half_y_m * abs(vx * axis[0] + vy * axis[1])


def overlap_m(a: Footprint, b: Footprint) -> float:
    """Least way to push two footprints apart, by the separating axis theorem; not positive when they are apart."""
    dx, dy = b.x_m - a.x_m, b.y_m - a.y_m
    gap = math.hypot(dx, dy) - math.hypot(a.half_x_m, a.half_y_m) - math.hypot(b.half_x_m, b.half_y_m)
    if gap > 0:  # spares the exact test for nearly all pairs
        return -gap
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
        turns = _items(pose.get("rpy_deg"))
        yaw = turns[2].content if len(turns) == 3 else 0.0
    else:
        position, size = _floats(keys.get("position_m"), 2), _floats(keys.get("size_m"), 3)
        yaw = keys["yaw_deg"].content if "yaw_deg" in keys else 0.0
    if position is None or size is None or min(size) <= 0:
        return None
    if isinstance(yaw, bool) or not isinstance(yaw, (int, float)) or not math.isfinite(yaw):
        return None
    name = keys["name"].shown() if "name" in keys else node.key
    return Footprint(name, node, position[0], position[1], size[0] / 2, size[1] / 2, math.radians(yaw))


def check_places(check: Checker, keys: dict[str, Node]) -> None:
    """Nothing stands far from the way between start and goal and from all else: what does is likely in another unit."""
    ends = [_items(_members(_members(keys.get(part)).get("body")).get("position_m")) for part in ("start", "goal")]
    cuboids = [*_items(keys.get("holds")), *_items(keys.get("obstacles"))]
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
    nodes = [*_items(keys.get("holds")), *_items(keys.get("obstacles"))]
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
        if depth > OVERLAP_TOLERANCE_M:
            place = f"[{b.x_m:g}, {b.y_m:g}]"
            check.note_at(
                b.node,
                "pose.position_m" if "pose" in _members(b.node) else "position_m",
                place,
                f"{b.name} overlaps {a.name} ({a.node.key}, line {a.node.line}) by {depth:.3g} m; move them apart",
            )


def _near(footprints: list[Footprint]) -> Iterator[tuple[int, int]]:
    """Pairs whose extents along x meet, the earlier first."""
    extents = [math.hypot(each.half_x_m, each.half_y_m) for each in footprints]
    order = sorted(range(len(footprints)), key=lambda i: footprints[i].x_m - extents[i])
    open_: list[int] = []
    for i in order:
        begin = footprints[i].x_m - extents[i]
        open_ = [j for j in open_ if footprints[j].x_m + extents[j] >= begin]
        yield from ((min(i, j), max(i, j)) for j in open_)
        open_.append(i)


def check_grasps(check: Checker, keys: dict[str, Node]) -> None:
    """Every grasp names a hold; no hold has two limbs."""
    holds = [_members(node).get("name") for node in _items(keys.get("holds"))]
    known = [node.content for node in holds if node is not None and isinstance(node.content, str)]
    obstacles = [_members(node).get("name") for node in _items(keys.get("obstacles"))]
    forbidden = {node.content for node in obstacles if node is not None}
    for part in ("start", "goal"):
        taken: dict[str, str] = {}
        for limb, grasp in _members(_members(keys.get(part)).get("grasps")).items():
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
