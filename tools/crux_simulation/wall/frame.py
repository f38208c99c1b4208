"""The wall's frame in a scan: z off the plane in which most of it lies, x up the slope."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from crux_tools.errors import UsageError

from crux_simulation.wall.surface import Array, Surface

LEVEL = 0.02  # sine of the angle under which a plane counts as level


@dataclass(frozen=True)
class Placed:
    """A surface in frame W, the slope of its plane [degrees], and `rotation` @ file's x + `offset` of each vertex."""

    surface: Surface
    slope_deg: float
    rotation: Array
    offset: Array


def placed(surface: Surface, outward: Array, down: Array | None, slope_deg: float) -> Placed:
    """`outward` is about the way off the wall, `down` that of gravity, both in the file's frame; without `down` the
    file's x (or y, where it points off the wall) goes up a wall of `slope_deg`.
    """
    normal, along = surface.plane(outward)
    if down is not None:
        up = -down / np.linalg.norm(down)
        slope_deg = float(np.degrees(np.arccos(np.clip(normal @ up, -1.0, 1.0))))
        if np.linalg.norm(up - (up @ normal) * normal) < LEVEL:
            up = np.array([1.0, 0.0, 0.0])
    else:
        up = np.array([1.0, 0.0, 0.0])
    if abs(up @ normal) > np.cos(0.3):
        up = np.array([0.0, 1.0, 0.0])
    x = up - (up @ normal) * normal
    x /= np.linalg.norm(x)
    rotation = np.stack([x, np.cross(normal, x), normal])
    near = surface.samples.points @ rotation.T
    on_plane = near[np.abs(near[:, 2] - along) < 0.01]
    if not len(on_plane):
        raise UsageError("no plane found that much of the surface lies in")
    middle = (on_plane[:, :2].min(axis=0) + on_plane[:, :2].max(axis=0)) / 2.0
    offset = -np.array([*middle, along])
    return Placed(surface.moved(rotation, offset), slope_deg, rotation, offset)
