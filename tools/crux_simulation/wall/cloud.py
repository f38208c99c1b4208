"""A cloud of points as a surface: where the signed distance to the planes of the points around is zero."""

from __future__ import annotations

import itertools
from pathlib import Path

import numpy as np
from crux_tools.errors import UsageError
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import breadth_first_order, connected_components, minimum_spanning_tree
from scipy.spatial import cKDTree

from crux_simulation.wall.surface import Array, Surface

Keys = NDArray[np.int64]

PITCH_M = 0.0025  # of the grid, where the points are dense enough
MOST_SPACING_M = 0.008  # between points: on wider ones the faces of holds are not seen
NEIGHBOURS = 10  # by which planes are fitted and distances told: few, so that edges stay sharp
LINKED, LEAST_POINTS = 8, 50  # neighbours by which points hang together, and the least part of them: others are noise
REACH = 2  # cells from the points: so far the distance is known
KERNEL = 1.2  # cells: how far a point's plane counts
CHUNK = 200_000
STRIDE = np.array([1 << 42, 1 << 21, 1])  # of a corner's key, by axis
CORNERS = np.array(list(itertools.product((0, 1), repeat=3)))  # of a cell
EDGES = [(a, b) for a, b in itertools.combinations(range(8), 2) if np.abs(CORNERS[a] - CORNERS[b]).sum() == 1]


def surface_of(points: Array, outward: Array, path: Path) -> Surface:
    """Triangles through points (n, 3) [m] of a wall whose outermost points face about `outward`."""
    points = _thinned(points, 0.8 * PITCH_M)
    if len(points) < LEAST_POINTS:
        raise UsageError(f"{path}: has {len(points)} points and no triangles: expected at least {LEAST_POINTS} points")
    apart = _spacing(points)
    if apart > MOST_SPACING_M:
        raise UsageError(f"{path}: its points are {apart:.2g} m apart, expected at most {MOST_SPACING_M:g} m")
    pitch = max(PITCH_M, 1.2 * apart)
    tree = cKDTree(points)
    near = tree.query(points, k=NEIGHBOURS)[1]
    around = points[near] - points[near].mean(axis=1, keepdims=True)
    normals = np.linalg.eigh(np.einsum("nki,nkj->nij", around, around))[1][:, :, 0]
    sign = _signs(points, normals, near[:, 1 : LINKED + 1], 3.0 * pitch, outward / np.linalg.norm(outward))
    kept = sign != 0.0
    if not kept.any():
        raise UsageError(f"{path}: its points lie on no surface")
    return _zero(points[kept], points[near].mean(axis=1)[kept], (sign[:, None] * normals)[kept], pitch)


def _spacing(points: Array) -> float:
    """Side [m] of the square that a point has to itself, of the middle one."""
    some = points[:: max(1, len(points) // 5000)]
    return float(np.median(cKDTree(points).query(some, k=LINKED + 1)[0][:, -1]) * np.sqrt(np.pi / LINKED))


def _thinned(points: Array, cell_m: float) -> Array:
    """The mean of the points of each cell."""
    keys = np.floor((points - points.min(axis=0)) / cell_m).astype(np.int64) @ STRIDE
    which, count = np.unique(keys, return_inverse=True, return_counts=True)[1:]
    sums = [np.bincount(which, points[:, axis]) for axis in range(3)]
    return np.asarray(np.stack(sums, axis=1) / count[:, None])


def _signs(points: Array, normals: Array, near: Keys, reach_m: float, outward: Array) -> Array:
    """(n,) +1 or -1 by which normals point outwards, 0 of specks: from the outermost point of each connected part to
    its neighbours, along the tree over which normals turn the least (Hoppe 1992).
    """
    one, other = np.repeat(np.arange(len(points)), near.shape[1]), near.ravel()
    turn = 1.0 - np.abs(np.einsum("ni,ni->n", normals[one], normals[other])) + 1e-6
    close = np.linalg.norm(points[one] - points[other], axis=1) < reach_m
    links = coo_matrix((turn[close], (one[close], other[close])), shape=(len(points), len(points)))
    tree = minimum_spanning_tree(links.tocsr())
    part = connected_components(tree, directed=False)[1]
    sign = np.zeros(len(points))
    faces, height = normals @ outward, points @ outward
    height = np.where(np.abs(faces) > 0.5, height, height - 1e3)  # the outermost that faces out or in
    for number in np.flatnonzero(np.bincount(part) >= LEAST_POINTS):
        mine = np.flatnonzero(part == number)
        first = int(mine[height[mine].argmax()])
        order, before = breadth_first_order(tree, first, directed=False)
        same = np.einsum("ni,ni->n", normals[order[1:]], normals[before[order[1:]]])
        sign[first] = 1.0 if faces[first] > 0.0 else -1.0
        for point, parent, product in zip(order[1:].tolist(), before[order[1:]].tolist(), same.tolist(), strict=True):
            sign[point] = sign[parent] if product > 0.0 else -sign[parent]
    return sign


def _zero(points: Array, on_plane: Array, normals: Array, pitch: float) -> Surface:
    """Where the distance to planes, weighted by how near their points are, changes its sign on a grid: one vertex a
    cell, in the middle of its edges' crossings, and a square about each edge that crosses (surface nets).
    """
    origin = points.min(axis=0) - (REACH + 2) * pitch
    keys = np.unique(np.floor((points - origin) / pitch).astype(np.int64) @ STRIDE)
    for step in STRIDE:
        keys = np.unique(np.concatenate([keys + step * i for i in range(-REACH + 1, REACH + 1)]))
    places = np.stack([keys >> 42, (keys >> 21) & 0x1FFFFF, keys & 0x1FFFFF], axis=1)
    away = _distance(origin + pitch * places, points, on_plane, normals, pitch)
    known = np.isfinite(away)
    keys, places, away = keys[known], places[known], away[known]
    corners = _found(keys, keys[:, None] + CORNERS @ STRIDE)
    cells = np.flatnonzero((corners >= 0).all(axis=1))
    value = away[corners[cells]]
    mixed = (value > 0.0).any(axis=1) & (value <= 0.0).any(axis=1)
    cells, value = cells[mixed], value[mixed]
    total, count = np.zeros((len(cells), 3)), np.zeros((len(cells), 1))
    for a, b in EDGES:
        crosses = (value[:, a] > 0.0) != (value[:, b] > 0.0)
        share = value[:, a] / np.where(crosses, value[:, a] - value[:, b], 1.0)
        total += np.where(crosses[:, None], CORNERS[a] + share[:, None] * (CORNERS[b] - CORNERS[a]), 0.0)
        count += crosses[:, None]
    vertices = origin + pitch * (places[cells] + total / count)
    faces = []
    for axis, step in enumerate(STRIDE):
        u, v = STRIDE[axis - 2], STRIDE[axis - 1]
        end = _found(keys, keys + step)
        edge = np.flatnonzero((end >= 0) & ((away > 0.0) != (away[end] > 0.0)))
        around = _found(keys[cells], keys[edge, None] - np.array([0, u, u + v, v]))
        whole = (around >= 0).all(axis=1)
        quad = np.where((away[edge] <= 0.0)[:, None], around, around[:, ::-1])[whole]
        faces += [quad[:, [0, 1, 2]], quad[:, [0, 2, 3]]]
    return Surface(vertices, np.concatenate(faces).astype(np.int64))


def _distance(at: Array, points: Array, on_plane: Array, normals: Array, pitch: float) -> Array:
    """(m,) [m], positive outside, NaN farther than `REACH` cells from all points."""
    tree, found = cKDTree(points), np.full(len(at), np.nan)
    for start in range(0, len(at), CHUNK):
        some = at[start : start + CHUNK]
        away, near = tree.query(some, k=NEIGHBOURS, distance_upper_bound=REACH * pitch + KERNEL * pitch)
        seen = np.flatnonzero(away[:, 0] < REACH * pitch)
        away, near = away[seen], np.minimum(near[seen], len(points) - 1)
        weight = np.exp(-((away / (KERNEL * pitch)) ** 2)) + 1e-12 * np.isfinite(away)
        off = np.einsum("nki,nki->nk", some[seen, None] - on_plane[near], normals[near])
        found[start + seen] = (weight * off).sum(axis=1) / weight.sum(axis=1)
    return found


def _found(keys: Keys, wanted: Keys) -> Keys:
    """Where in sorted `keys` each is, -1 where it is not."""
    at = np.minimum(np.searchsorted(keys, wanted), len(keys) - 1)
    return np.where(keys[at] == wanted, at, -1)
