"""Convex hulls in the plane: what takes scipy.spatial a tenth of a second to import."""

import numpy as np

from crux_planner.model.arrays import Array

_FLAT = 1e-12  # of the square of its extent: an area that counts as none


def sides_of(points: Array) -> Array | None:
    """Sides (n, 3) of the hull of points (m, 2): a, b, c with a x + b y + c <= 0 inside, (a, b) of length one; None
    where it has next to no area.
    """
    order = points[np.lexsort(points.T[::-1])]
    corners = np.array([*_chain(order), *_chain(order[::-1])])
    along = np.roll(corners, -1, axis=0) - corners
    twice_area = float(np.sum(corners[:, 0] * along[:, 1] - corners[:, 1] * along[:, 0]))
    if len(corners) < 3 or twice_area <= _FLAT * float(np.ptp(points, axis=0).max()) ** 2:
        return None
    normals = np.column_stack([along[:, 1], -along[:, 0]]) / np.linalg.norm(along, axis=1)[:, None]
    return np.column_stack([normals, -(normals * corners).sum(axis=1)])


def _chain(order: Array) -> list[Array]:
    """Corners of the lower side, from the first point of an order along x up to the last, without it."""
    chain: list[Array] = []
    for point in order:
        while len(chain) > 1 and _turn(chain[-2], chain[-1], point) <= 0.0:
            chain.pop()
        chain.append(point)
    return chain[:-1]


def _turn(a: Array, b: Array, c: Array) -> float:
    return float((b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]))
