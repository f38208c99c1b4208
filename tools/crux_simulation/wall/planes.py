"""The planes of a wall that has several: what stands on which, and how the others lie to the one that is climbed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.sparse import csr_matrix
from scipy.sparse.csgraph import connected_components, dijkstra

from crux_simulation.wall.surface import NEIGHBOURS, PLANE_COS, PLANE_M, SAMPLE_M, Array, Samples

Indices = NDArray[np.int64]

ON_M = 0.01  # what is nearer to its plane is a part of it
TRIES = 200
LEAST_M, LEAST_M2 = 0.25, 0.1  # of a plane's narrower side and area: the faces of holds are smaller
CELL_M = 0.02  # by which an area is counted
LINK_M = 2.0 * SAMPLE_M
LOOKED_AT = 20_000  # samples, of many
MOST_PLANES = 12  # that are looked for
AXIS_COS = float(np.cos(np.radians(10.0)))


@dataclass(frozen=True, eq=False)
class Plane:
    """Outward normal (3,) and its distance [m] from the origin along that, frame W."""

    normal: Array
    offset_m: float

    def words(self) -> str:
        """How it lies to the plane z = 0."""
        axis = np.array([-self.normal[1], self.normal[0]])  # z × normal
        sine = float(np.linalg.norm(axis))
        if sine < np.sqrt(1.0 - PLANE_COS**2) and self.normal[2] > 0.0:
            return f"{abs(self.offset_m):.2f} m {'off' if self.offset_m > 0.0 else 'behind'} the one that is climbed"
        degrees = float(np.degrees(np.arctan2(sine, self.normal[2])))
        axis = axis / sine if sine > 0.0 else np.array([0.0, 1.0])
        for name, along in zip("xy", axis, strict=True):
            if abs(along) > AXIS_COS:
                return f"turned by {np.copysign(degrees, along):.0f}° about {name}"
        return f"turned by {degrees:.0f}° about ({axis[0]:.1f}, {axis[1]:.1f}, 0)"


@dataclass(frozen=True, eq=False)
class Planes:
    """Of a surface in frame W: its planes, that which is climbed, z = 0, first; and of each sample the plane on which
    it stands, nearest to it along the surface, and its height over that [m].
    """

    planes: list[Plane]
    of: Indices
    height_m: Array


def planes(samples: Samples) -> Planes:
    """Planes besides z = 0 are as large as `LEAST_M2`, and something stands on them or they stand out of z = 0."""
    points = samples.points
    found = [Plane(np.array([0.0, 0.0, 1.0]), 0.0)]
    links, random = _links(samples), np.random.default_rng(0)
    on = np.where(lies_in(samples, found[0]), 0, -1)
    free = on < 0
    for _ in range(MOST_PLANES):
        plane, part = _largest(samples, free, links, random)
        if plane is None:
            break
        free[part] = False
        if _wide(points[part], plane):
            on[part] = len(found)
            found.append(plane)
    of = _spread(links, on)
    normals, offsets = np.array([each.normal for each in found]), np.array([each.offset_m for each in found])
    height = np.einsum("ni,ni->n", points, normals[of]) - offsets[of]
    if ((of > 0) & ((height > ON_M) | (points[:, 2] > ON_M))).any():
        return Planes(found, of, height)
    return Planes(found[:1], np.zeros(len(points), np.int64), points[:, 2])


def lies_in(samples: Samples, plane: Plane) -> NDArray[np.bool_]:
    """Which samples lie in a plane and face its way."""
    off = samples.points @ plane.normal - plane.offset_m
    return np.asarray((np.abs(off) < ON_M) & (samples.smooth @ plane.normal > np.cos(np.radians(30.0))))


def _links(samples: Samples) -> csr_matrix:
    """Lengths [m] between samples that are neighbours, both ways."""
    near = samples.tree.query(samples.points, k=NEIGHBOURS, distance_upper_bound=LINK_M)
    one, other = np.nonzero(np.isfinite(near[0]) & (near[0] > 0.0))
    size = (len(samples.points),) * 2
    return csr_matrix((near[0][one, other], (one, near[1][one, other])), shape=size)


def _largest(
    samples: Samples, free: NDArray[np.bool_], links: csr_matrix, random: np.random.Generator
) -> tuple[Plane | None, Indices]:
    """The plane in which the most of the free samples lie, and those of them that hang together; none where these are
    few.
    """
    which = np.flatnonzero(free)
    few = which[:: 1 + len(which) // LOOKED_AT]
    points, normals = samples.points[few], samples.smooth[few]
    best, most = None, LEAST_M2 / SAMPLE_M**2 / 2.0 * len(few) / max(len(which), 1)
    for i in random.integers(len(points), size=TRIES) if len(points) else ():
        near = (np.abs((points - points[i]) @ normals[i]) < PLANE_M) & (normals @ normals[i] > PLANE_COS)
        if (count := int(near.sum())) > most:
            best, most = near, count
    if best is None:
        return None, which[:0]
    middle = points[best].mean(axis=0)
    normal = np.linalg.svd(points[best] - middle, full_matrices=False)[2][2]
    normal *= np.sign(normal @ normals[best].sum(axis=0))
    plane = Plane(normal, float(middle @ normal))
    part = np.flatnonzero(free & lies_in(samples, plane))
    groups = connected_components(links[part][:, part], directed=False)[1]
    return plane, part[groups == np.bincount(groups).argmax()]


def _wide(points: Array, plane: Plane) -> bool:
    """Whether points of a plane cover as much as a wall does."""
    along = np.linalg.svd(np.eye(3) - np.outer(plane.normal, plane.normal))[0][:, :2]
    flat = (points - points.mean(axis=0)) @ along
    flat = flat @ np.linalg.svd(flat, full_matrices=False)[2].T
    cells = len(np.unique(np.floor(flat / CELL_M), axis=0))
    return bool(np.ptp(flat, axis=0).min() > LEAST_M and cells * CELL_M**2 > LEAST_M2)


def _spread(links: csr_matrix, on: Indices) -> Indices:
    """By sample the plane that is nearest along the surface; `on` has those that lie in one, and -1."""
    start = np.flatnonzero(on >= 0)
    source = dijkstra(links, directed=False, indices=start, min_only=True, return_predecessors=True)[2]
    return np.where(source >= 0, on[np.maximum(source, 0)], 0)
