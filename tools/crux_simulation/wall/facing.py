"""Triangles of a mesh that all look outwards, as a wall is read by them: scans come inside out, or mixed."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import trimesh
from crux_tools.output import note
from numpy.typing import NDArray
from scipy.sparse import coo_matrix
from scipy.sparse.csgraph import breadth_first_order, connected_components

from crux_simulation.wall.surface import Array, Surface

RAYS = 1500  # from outside at places of the surface
NEAR_M, LEAST_COS = 1e-3, 0.2  # a place is seen where a ray ends so near to it, and not along its triangle
LEAST_SHARE = 0.8  # of what they meet that looks at them; through holes of a mesh they meet its back


def facing_out(surface: Surface, outward: Array, path: Path) -> Surface:
    """The mesh of a wall that is seen from `outward`, with its triangles turned around where they look away, which is
    noted.
    """
    outward = outward / np.linalg.norm(outward)
    share = _share(surface, outward)
    if LEAST_SHARE > share > 1.0 - LEAST_SHARE:
        note(f"crux wall import: {path}: its triangles looked either way: turned as their neighbours are")
        return _parts_facing_out(_alike(surface), outward)
    if share <= 1.0 - LEAST_SHARE:
        way = " ".join(f"{v:.2g}" for v in outward + 0.0)
        note(f"crux wall import: {path}: its triangles look away from --outward {way}: all are turned around")
        return Surface(surface.vertices, surface.faces[:, ::-1])
    return surface


def _alike(surface: Surface) -> Surface:
    """With the triangles of each connected part turned as one of them is: two that share an edge pass it either way."""
    faces, count = surface.faces, len(surface.faces)
    pairs, edges = surface.mesh.face_adjacency, surface.mesh.face_adjacency_edges
    forward = [_passes(faces[pairs[:, side]], edges) for side in (0, 1)]
    turned = forward[0] == forward[1]
    links = coo_matrix((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(count, count)).tocsr()
    keys = {(a, b): other for (a, b), other in zip(np.sort(pairs, axis=1).tolist(), turned.tolist(), strict=True)}
    parts, back = connected_components(links, directed=False)[1], np.zeros(count, bool)
    for first in np.unique(parts, return_index=True)[1]:
        order, before = breadth_first_order(links, first, directed=False)
        for face in order[1:].tolist():
            parent = int(before[face])
            back[face] = back[parent] ^ keys[min(face, parent), max(face, parent)]
    return Surface(surface.vertices, np.where(back[:, None], faces[:, ::-1], faces))


def _passes(faces: NDArray[np.int64], edges: NDArray[np.int64]) -> NDArray[np.bool_]:
    """Whether each triangle (n, 3) passes the edge (n, 2) of it from its first to its second vertex."""
    ends = np.roll(faces, -1, axis=1)
    return np.asarray(((faces == edges[:, :1]) & (ends == edges[:, 1:])).any(axis=1))


def _parts_facing_out(surface: Surface, outward: Array) -> Surface:
    """Each connected part turned around where most of what is seen of it is a back."""
    faces = surface.faces.copy()
    which, facing = _seen(surface, outward)
    parts = trimesh.graph.connected_component_labels(surface.mesh.face_adjacency, node_count=len(faces))
    back = np.bincount(parts[which], np.sign(facing), minlength=parts.max() + 1)[parts] < 0
    faces[back] = faces[back, ::-1]
    return Surface(surface.vertices, faces)


def _share(surface: Surface, outward: Array) -> float:
    """Of the triangles that are seen from outside, those that look outwards."""
    _, facing = _seen(surface, outward)
    return float((facing > 0.0).mean()) if len(facing) else 1.0


def _seen(surface: Surface, outward: Array) -> tuple[NDArray[np.int64], Array]:
    """Triangles (n,) that are seen from outside, drawn by their area, and the cosines (n,) by which they look there."""
    points, which = trimesh.sample.sample_surface(surface.mesh, RAYS, seed=0)
    facing = surface.mesh.face_normals[which] @ outward
    far = float(np.ptp(surface.vertices @ outward)) + 1.0
    distance, _ = surface.cast(points + far * outward, np.tile(-outward, (len(points), 1)))
    seen = (np.abs(distance - far) < NEAR_M) & (np.abs(facing) > LEAST_COS)
    return np.asarray(which[seen], np.int64), np.asarray(facing[seen])
