"""The surface of a region of cells, smoothed, as triangles."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Indices = NDArray[np.int64]
SMOOTHINGS, SHARE = 4, 0.5  # how often corners move so far towards the middle of their neighbours


def surface(held: NDArray[np.bool_], first_m: Array, step_m: float) -> tuple[Array, Indices]:
    """Corners (n, 3) [m] and triangles (m, 3), seen from outside against the clock, around the cells (x, y, z) that are
    held; `first_m` (3,) is the centre of the first cell.
    """
    quads = np.concatenate([_faces(np.pad(held, 1), axis) for axis in range(3)])
    lattice, numbers = np.unique(quads.reshape(-1, 3), axis=0, return_inverse=True)
    quads = numbers.reshape(-1, 4)
    corners = first_m + step_m * (lattice - 1.5)
    ends = np.concatenate([quads[:, [i, (i + 1) % 4]] for i in range(4)])
    count = np.zeros(len(corners))
    np.add.at(count, ends[:, 0], 1.0)
    for _ in range(SMOOTHINGS):
        total = np.zeros_like(corners)
        np.add.at(total, ends[:, 0], corners[ends[:, 1]])
        corners += SHARE * (total / count[:, None] - corners)
    return corners, np.concatenate([quads[:, [0, 1, 2]], quads[:, [0, 2, 3]]])


def _faces(held: NDArray[np.bool_], axis: int) -> Indices:
    """(n, 4, 3) corners, in whole cells, of the faces across an axis between cells held and not held."""
    along = np.moveaxis(held, axis, 0)
    i, j, k = np.nonzero(along[1:] != along[:-1])
    at = np.stack([i + 1, j, k], axis=-1)
    square = at[:, None] + np.array([[0, 0, 0], [0, 1, 0], [0, 1, 1], [0, 0, 1]])
    inwards = along[i + 1, j, k] != (axis == 1)  # the two other axes are in the order of a left-handed frame
    square[inwards] = square[inwards, ::-1]
    return np.asarray(square[..., np.argsort([axis, *(each for each in range(3) if each != axis)])])
