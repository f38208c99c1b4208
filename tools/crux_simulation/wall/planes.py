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
STRIP_M = 0.1
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
    on = np.where(_near(samples, found[0]), 0, -1)
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


def _near(samples: Samples, plane: Plane) -> NDArray[np.bool_]:
    """The samples that lie in a plane and face its way."""
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
    part = np.flatnonzero(free & _near(samples, plane))
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


@dataclass(frozen=True, eq=False)
class Elsewhere:
    """A body that no gripper takes which is upright on the plane that is climbed, its middle (3,) [m], frame W, its
    samples, and the reason.
    """

    name: str
    position_m: Array
    which: Indices
    reason: str


def elsewhere(samples: Samples, on: Planes, of: Indices) -> list[Elsewhere]:
    """The bodies on other planes, and those that two planes share: what is on another plane belongs to what it touches
    on the one that is climbed. `of` is the body of each sample.
    """
    if len(on.planes) == 1:
        return []
    parts: dict[int, list[int]] = {}  # by body on the plane that is climbed
    outside = np.flatnonzero((of >= 0) & (on.of > 0))
    for i, around in zip(outside, samples.tree.query_ball_point(samples.points[outside], LINK_M), strict=True):
        for body in {int(of[other]) for other in around if of[other] >= 0 and on.of[other] == 0}:
            parts.setdefault(body, []).append(int(of[i]))
    shared = {other for others in parts.values() for other in others}
    found = []
    for body in range(of.max(initial=-1) + 1):
        which = np.flatnonzero(np.isin(of, [body, *parts.get(body, [])]))
        plane = int(on.of[which[0]])
        if body in parts:
            reason = "lies across two planes"
        elif plane == 0 or body in shared:
            continue
        else:
            reason = f"is on another plane, {on.planes[plane].words()}"
        middle = (samples.points[which].min(axis=0) + samples.points[which].max(axis=0)) / 2.0
        found.append(Elsewhere(f"body-{body + 1}", middle, which, reason))
    return found


def obstacles(samples: Samples, on: Planes, of: Indices, found: list[Elsewhere]) -> list[tuple[str, Array, str]]:
    """Name, points and reason of what of other planes and of `found` stands out of the one that is climbed; planes in
    strips, so that steps stand for a slope.
    """
    points, out = samples.points, samples.points[:, 2] > ON_M
    groups = [(each.name, points[each.which[out[each.which]]], each.reason) for each in found]
    for number, plane in enumerate(on.planes[1:], start=1):
        mine = points[out & (on.of == number) & (of < 0)]
        size = float(np.hypot(*plane.normal[:2]))
        along = mine[:, :2] @ plane.normal[:2] / size if size > 0.0 else np.zeros(len(mine))
        strip = np.floor((along - along.min(initial=np.inf)) / STRIP_M)
        reason = f"another plane, {plane.words()}"
        groups += [(f"plane-{number + 1}-{int(k) + 1}", mine[strip == k], reason) for k in np.unique(strip)]
    return groups
