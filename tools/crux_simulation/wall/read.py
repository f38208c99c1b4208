"""A scan read from its file, in metres: meshes by trimesh, clouds of points, height maps as grids of triangles."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import trimesh
from crux_tools.errors import UsageError
from numpy.typing import NDArray

from crux_simulation.wall.cloud import surface_of
from crux_simulation.wall.facing import facing_out
from crux_simulation.wall.pcd import read_pcd
from crux_simulation.wall.surface import Array, Surface

MESHES = (".stl", ".obj", ".ply", ".glb", ".gltf", ".off", ".xyz")
MAPS = (".npy", ".npz", ".png", ".tif", ".tiff")
POINTS = "xyz_m"  # in an npz, a cloud [m]
PIXEL_SIZE, NO_DATA = 33550, 42113  # tags of a GeoTIFF
LEAST_VERTICES, MAX_TRIANGLES = 4, 4_000_000
SIZE_M = (0.2, 40.0)  # of a wall; outside of it a scale is wrong


def read_surface(path: Path, scale: float, pitch_m: float | None, outward: Array) -> Surface:
    """Metres are `scale` times the file's unit; `pitch_m` is that of a height map which does not say its own, and
    `outward` about the way off the wall.
    """
    if not path.is_file():
        raise UsageError(f"{path}: no such file")
    suffix = path.suffix.lower()
    if suffix == ".pcd":
        surface = _points(read_pcd(path), scale)
    elif suffix in MESHES:
        surface = _mesh(path, scale)
    elif suffix in MAPS:
        surface = _arrays(path, scale, pitch_m)
    else:
        kinds = ", ".join((*MESHES, ".pcd", *MAPS))
        raise UsageError(f"{path}: {suffix or 'no ending'}: expected one of {kinds}")
    if not np.isfinite(surface.vertices).all():
        raise UsageError(f"{path}: has vertices that are not finite numbers")
    if not len(surface.vertices):
        raise UsageError(f"{path}: has neither triangles nor points")
    size = float(np.ptp(surface.vertices, axis=0).max())
    if not SIZE_M[0] <= size <= SIZE_M[1]:
        hint = "looks like millimetres: --scale 0.001?" if 200.0 <= size <= 40000.0 else "give --scale"
        raise UsageError(f"{path}: is {size:.3g} m across, expected {SIZE_M[0]:g} to {SIZE_M[1]:g} m; {hint}")
    if not len(surface.faces):
        return _few_enough(surface_of(surface.vertices, outward, path), path)
    _few_enough(surface, path)
    return surface if suffix in MAPS else facing_out(surface, outward, path)


def _few_enough(surface: Surface, path: Path) -> Surface:
    if len(surface.vertices) < LEAST_VERTICES:
        raise UsageError(f"{path}: {len(surface.vertices)} vertices: expected a wall and what stands on it")
    if not 0 < len(surface.faces) <= MAX_TRIANGLES:
        raise UsageError(
            f"{path}: {len(surface.faces):,} triangles: expected 1 to {MAX_TRIANGLES:,}; simplify it first"
        )
    return surface


def _mesh(path: Path, scale: float) -> Surface:
    """Without triangles, the vertices are a cloud of points."""
    try:
        mesh = trimesh.load(path, process=False)
        mesh = mesh.to_mesh() if isinstance(mesh, trimesh.Scene) else mesh
    except Exception as error:  # each of trimesh's readers raises its own
        raise UsageError(f"{path}: cannot be read as a mesh: {error}") from None
    if isinstance(mesh, trimesh.PointCloud):
        return _points(mesh.vertices, scale)
    mesh.merge_vertices()
    return Surface(scale * np.asarray(mesh.vertices, float), np.asarray(mesh.faces, np.int64).reshape(-1, 3))


def _points(points: NDArray[Any], scale: float) -> Surface:
    """A cloud (n, 3), without triangles; places that were not seen are not finite."""
    seen = np.isfinite(points).all(axis=1)
    return Surface(scale * np.asarray(points[seen], float), np.zeros((0, 3), np.int64))


def _arrays(path: Path, scale: float, pitch_m: float | None) -> Surface:
    """Heights [rows: y, columns: x], NaN or below any number of use where unseen; of an npz also `POINTS`."""
    places: list[Array | None] = [None, None]
    try:
        if path.suffix.lower() == ".npz":
            with np.load(path, allow_pickle=False) as arrays:
                if POINTS in arrays and arrays[POINTS].shape[1:] == (3,):
                    return _points(arrays[POINTS], scale)
                grids = [name for name in arrays if arrays[name].ndim == 2]
                if len(grids) != 1:
                    raise UsageError(f"{path}: has {len(grids)} two-dimensional arrays: expected one, of heights")
                (name,) = grids
                heights = _metres(arrays[name], name, scale)
                places = [arrays.get(f"{axis}_m") for axis in "xy"]
        elif path.suffix.lower() == ".npy":
            heights = _metres(np.load(path, allow_pickle=False), "", scale)
        else:
            from PIL import Image

            with Image.open(path) as image:
                tags, grid = getattr(image, "tag_v2", {}), np.asarray(image)[::-1]  # the first row is an image's top
                if NO_DATA in tags:
                    grid = np.where(grid == float(tags[NO_DATA]), np.nan, grid)
                heights = _metres(grid, "", scale)
                if PIXEL_SIZE in tags and pitch_m is None and heights.ndim == 2:
                    sizes = zip(tags[PIXEL_SIZE][:2], heights.shape[::-1], strict=True)
                    places = [scale * size * np.arange(float(count)) for size, count in sizes]
    except (OSError, ValueError) as error:
        raise UsageError(f"{path}: cannot be read as a height map: {error}") from None
    if heights.ndim != 2 or min(heights.shape) < 2:
        raise UsageError(f"{path}: has the shape {heights.shape}: expected rows and columns of heights")
    rows, columns = heights.shape
    x, y = places
    if x is None or y is None:
        if pitch_m is None:
            raise UsageError(
                f"{path}: says no place of its columns and rows (x_m, y_m): give --pitch, metres between them"
            )
        x, y = (pitch_m * np.arange(float(count)) for count in (columns, rows))
    if (len(x), len(y)) != (columns, rows):
        raise UsageError(
            f"{path}: x_m has {len(x)} and y_m {len(y)} values, the heights {columns} columns, {rows} rows"
        )
    return _grid(heights, x, y)


def _metres(heights: NDArray[Any], name: str, scale: float) -> Array:
    """As floats [m]; `z_tenth_mm` and the like say their unit, whole numbers at the end of their range are unseen."""
    signed = np.issubdtype(heights.dtype, np.signedinteger)
    unseen = heights == np.iinfo(heights.dtype).min if signed else np.zeros(heights.shape, bool)
    unit = next((size for ending, size in (("_tenth_mm", 1e-4), ("_mm", 1e-3)) if name.endswith(ending)), 1.0)
    return np.where(unseen, np.nan, scale * unit * heights.astype(float))


def _grid(heights: Array, x: Array, y: Array) -> Surface:
    rows, columns = heights.shape
    vertices = np.stack([*np.meshgrid(x, y), heights], axis=2).reshape(-1, 3)
    k = np.arange(rows * columns).reshape(rows, columns)
    a, b, c, d = k[:-1, :-1], k[:-1, 1:], k[1:, 1:], k[1:, :-1]
    faces = np.concatenate([np.stack(corners, axis=-1).reshape(-1, 3) for corners in ((a, b, c), (a, c, d))])
    faces = faces if (x[1] - x[0]) * (y[1] - y[0]) > 0 else faces[:, ::-1]
    seen = faces[np.isfinite(vertices[faces, 2]).all(axis=1)]
    used, faces = np.unique(seen, return_inverse=True)
    return Surface(vertices[used], faces.reshape(-1, 3).astype(np.int64))
