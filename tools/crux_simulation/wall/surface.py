"""A wall as triangles: rays against it, even samples of it, and the plane that most of it lies in."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import mujoco
import numpy as np
import trimesh
from numpy.typing import NDArray
from scipy.spatial import cKDTree

Array = NDArray[np.float64]
SAMPLE_M = 0.004  # between samples
SMOOTH_M = 0.008  # normals of samples are means over so far: facets of a scan are noisy
NEIGHBOURS = 24
SAME_SIDE = 0.5  # cosine of normals that are averaged
PLANE_TRIES, PLANE_M, PLANE_COS = 300, 0.006, float(np.cos(np.radians(8.0)))


@dataclass(frozen=True, eq=False)
class Surface:
    """Vertices (v, 3) [m] and triangles (f, 3), counterclockwise as seen from outside."""

    vertices: Array
    faces: NDArray[np.int64]
    sampled: Samples | None = None  # in place of those that are drawn

    @cached_property
    def mesh(self) -> trimesh.Trimesh:
        return trimesh.Trimesh(self.vertices, self.faces, process=False)

    @cached_property
    def _scene(self) -> tuple[mujoco.MjModel, mujoco.MjData]:
        spec = mujoco.MjSpec()
        spec.add_mesh(
            name="wall",
            uservert=self.vertices.ravel().tolist(),
            userface=self.faces.ravel().tolist(),
            inertia=mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL,
        )
        spec.worldbody.add_geom(type=mujoco.mjtGeom.mjGEOM_MESH, meshname="wall", contype=0, conaffinity=0)
        model = spec.compile()
        data = mujoco.MjData(model)
        mujoco.mj_forward(model, data)
        return model, data

    def cast(self, origin: Array, direction: Array) -> tuple[Array, Array]:
        """Distance (n,) [m] to the first triangle along unit directions (n, 3) from origins (n, 3), inf where there is
        none, and its outward normal (n, 3), whichever side is hit.
        """
        model, data = self._scene
        distance, normal, which = np.empty(len(origin)), np.zeros((len(origin), 3)), np.zeros(1, np.int32)
        for i, (start, way) in enumerate(zip(origin, direction, strict=True)):
            distance[i] = mujoco.mj_ray(model, data, start, way, None, 1, -1, which, normal[i])
        return np.where(distance < 0.0, np.inf, distance), normal

    @cached_property
    def samples(self) -> Samples:
        """About one in a square of `SAMPLE_M`; the same for the same triangles."""
        if self.sampled is not None:
            return self.sampled
        mesh = self.mesh
        count = int(1.6 * mesh.area / SAMPLE_M**2)
        points, face = trimesh.sample.sample_surface(mesh, count, seed=0)
        kept = np.unique(np.floor(points / (0.7 * SAMPLE_M)).astype(int), axis=0, return_index=True)[1]
        return Samples(points[kept], mesh.face_normals[face[kept]])

    def plane(self, outward: Array) -> tuple[Array, float]:
        """Outward normal (3,) and offset [m] of the plane near which the most of the surface lies that faces about
        `outward`, to within 60 degrees.
        """
        faces = self.samples.smooth @ (outward / np.linalg.norm(outward)) > SAME_SIDE
        points, normals = self.samples.points[faces], self.samples.smooth[faces]
        random, best, most = np.random.default_rng(0), (outward / np.linalg.norm(outward), 0.0), -1
        if not len(points):
            return best
        for i in random.integers(len(points), size=PLANE_TRIES):
            normal = normals[i]
            offset = float(points[i] @ normal)
            near = (np.abs(points @ normal - offset) < PLANE_M) & (normals @ normal > PLANE_COS)
            if (count := int(near.sum())) > most:
                middle = points[near] - points[near].mean(axis=0)
                fitted = np.linalg.svd(middle, full_matrices=False)[2][2]
                fitted *= np.sign(fitted @ normal)
                best, most = (fitted, float(np.median(points[near] @ fitted))), count
        return best

    def moved(self, rotation: Array, offset: Array, keep_samples: bool = False) -> Surface:
        """Each vertex x as rotation @ x + offset, and each sample, else they are drawn anew."""
        points, normals = self.samples.points @ rotation.T + offset, self.samples.normals @ rotation.T
        kept = Samples(points, normals) if keep_samples else None
        return Surface(self.vertices @ rotation.T + offset, self.faces, kept)


@dataclass(frozen=True, eq=False)
class Samples:
    """Points (n, 3) [m] of a surface, with the normals (n, 3) of their triangles."""

    points: Array
    normals: Array

    @cached_property
    def tree(self) -> cKDTree:
        return cKDTree(self.points)

    @cached_property
    def smooth(self) -> Array:
        """(n, 3) means of the normals around, of the same side."""
        near = self.tree.query(self.points, k=NEIGHBOURS, distance_upper_bound=SMOOTH_M)[1]
        known = near < len(self.points)
        around = self.normals[np.where(known, near, 0)]
        same = known & (np.einsum("nki,ni->nk", around, self.normals) > SAME_SIDE)
        mean = np.einsum("nki,nk->ni", around, same.astype(float))
        return np.asarray(mean / np.linalg.norm(mean, axis=1, keepdims=True))
