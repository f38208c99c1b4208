"""Whether two cuboids stand in each other, against clipping one footprint by the other."""

from __future__ import annotations

import math

import pytest
from crux_contracts.scenario_checks import Footprint, overlap_m
from crux_contracts.yaml_document import Node
from hypothesis import assume, given
from hypothesis import strategies as st

Point = tuple[float, float]


def footprint(x: float, y: float, width: float, depth: float, yaw: float) -> Footprint:
    return Footprint("box", Node(None, "", 1), x, y, width / 2, depth / 2, yaw)


def corners(box: Footprint) -> list[Point]:
    """Counter-clockwise."""
    (ux, uy), (vx, vy) = box.axes()
    return [
        (
            box.x_m + i * box.half_x_m * ux + j * box.half_y_m * vx,
            box.y_m + i * box.half_x_m * uy + j * box.half_y_m * vy,
        )
        for i, j in ((-1, -1), (1, -1), (1, 1), (-1, 1))
    ]


def common_area(a: Footprint, b: Footprint) -> float:
    """Of two convex polygons: Sutherland and Hodgman's clipping, then the shoelace formula."""
    polygon, edges = corners(a), corners(b)
    for (ax, ay), (bx, by) in zip(edges, edges[1:] + edges[:1], strict=True):

        def side(p: Point, ax: float = ax, ay: float = ay, bx: float = bx, by: float = by) -> float:
            return (bx - ax) * (p[1] - ay) - (by - ay) * (p[0] - ax)

        clipped: list[Point] = []
        for p, q in zip(polygon, polygon[1:] + polygon[:1], strict=True):
            if side(p) >= 0:
                clipped.append(p)
            if side(p) * side(q) < 0:
                t = side(p) / (side(p) - side(q))
                clipped.append((p[0] + t * (q[0] - p[0]), p[1] + t * (q[1] - p[1])))
        polygon = clipped
        if not polygon:
            return 0.0
    return sum(p[0] * q[1] - q[0] * p[1] for p, q in zip(polygon, polygon[1:] + polygon[:1], strict=True)) / 2


lengths = st.floats(0.01, 0.3)
places = st.floats(-0.3, 0.3)
angles = st.floats(-math.pi, math.pi)


@given(places, places, lengths, lengths, lengths, lengths, angles, angles)
def test_overlap_is_told_from_distance(
    x: float, y: float, w1: float, d1: float, w2: float, d2: float, yaw1: float, yaw2: float
) -> None:
    a, b = footprint(0.0, 0.0, w1, d1, yaw1), footprint(x, y, w2, d2, yaw2)
    depth = overlap_m(a, b)
    assume(abs(depth) > 1e-3)  # where they barely touch, both ways of counting round
    assert (depth > 0) == (common_area(a, b) > 1e-9)
    assert overlap_m(b, a) == pytest.approx(depth)


def test_depth_is_the_least_way_apart() -> None:
    a = footprint(0.0, 0.0, 0.06, 0.06, 0.0)
    assert overlap_m(a, footprint(0.05, 0.0, 0.06, 0.06, 0.0)) == pytest.approx(0.01)
    assert overlap_m(a, footprint(0.0, 0.0, 0.06, 0.06, math.pi / 4)) == pytest.approx(0.03 * (1 + math.sqrt(2)))
    assert overlap_m(a, footprint(0.06, 0.0, 0.06, 0.06, 0.0)) == pytest.approx(0.0)
    assert overlap_m(a, footprint(0.2, 0.2, 0.06, 0.06, 0.3)) < 0
