"""The frame W of a wall in its scan, z off the plane in which most of it lies, x up the slope; its planes' frames."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from crux_tools.errors import UsageError

from crux_simulation.wall.surface import Array, Surface

LEVEL = 0.02  # sine of the angle under which a plane counts as level


@dataclass(frozen=True, eq=False)
class Frame:
    """A plane's own frame: its axes in W are the rows of `rotation` (3, 3), z off the plane; its origin (3,) [m]."""

    rotation: Array
    origin_m: Array

    @classmethod
    def on(cls, normal: Array, origin_m: Array) -> Frame:
        """x is W's, or where that points off the plane W's y, as far as it lies in the plane."""
        return cls(_axes(np.array([1.0, 0.0, 0.0]), normal), origin_m)

    def seen(self, points: Array) -> Array:
        """Points (n, 3) of W in this frame."""
        return np.asarray((points - self.origin_m) @ self.rotation.T)

    def in_w(self, points: Array) -> Array:
        """Points (..., 3) of this frame in W."""
        return np.asarray(points @ self.rotation + self.origin_m)


CLIMBED = Frame(np.eye(3), np.zeros(3))  # of the plane z = 0


def _axes(up: Array, normal: Array) -> Array:
    """Rows x, along `up` or where that is off the plane y, and y and z of a plane with this normal."""
    if abs(up @ normal) > np.cos(0.3):
        up = np.array([0.0, 1.0, 0.0])
    x = up - (up @ normal) * normal
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(normal, x), normal])


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
    rotation = _axes(up, normal)
    near = surface.samples.points @ rotation.T
    on_plane = near[np.abs(near[:, 2] - along) < 0.01]
    if not len(on_plane):
        raise UsageError("no plane found that much of the surface lies in")
    middle = (on_plane[:, :2].min(axis=0) + on_plane[:, :2].max(axis=0)) / 2.0
    offset = -np.array([*middle, along])
    return Placed(surface.moved(rotation, offset), slope_deg, rotation, offset)
