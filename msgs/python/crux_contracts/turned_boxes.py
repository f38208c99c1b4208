"""Boxes turned any way, in one frame: whether two stand in each other."""

from __future__ import annotations

import math
from dataclasses import dataclass

Vector = tuple[float, float, float]
_PARALLEL = 1e-9  # sine of the angle below which two edges span no direction of their own


@dataclass(frozen=True)
class TurnedBox:
    """Its middle [m], its axes, of length 1, and half its edges along these [m]."""

    middle_m: Vector
    axes: tuple[Vector, Vector, Vector]
    half_m: Vector

    @classmethod
    def on_foot(cls, foot_m: Vector, size_m: Vector, rpy_rad: Vector) -> TurnedBox:
        """The box whose foot has its middle there, turned about it by R = Rz(yaw) Ry(pitch) Rx(roll)."""
        axes = axes_of(rpy_rad)
        up = axes[2]
        middle = (
            foot_m[0] + up[0] * size_m[2] / 2,
            foot_m[1] + up[1] * size_m[2] / 2,
            foot_m[2] + up[2] * size_m[2] / 2,
        )
        return cls(middle, axes, (size_m[0] / 2, size_m[1] / 2, size_m[2] / 2))

    def reach(self, way: Vector) -> float:
        """Half its extent along a direction."""
        return sum(half * abs(_dot(axis, way)) for half, axis in zip(self.half_m, self.axes, strict=True))


def axes_of(rpy_rad: Vector) -> tuple[Vector, Vector, Vector]:
    """x, y and z of a frame turned by R = Rz(yaw) Ry(pitch) Rx(roll)."""
    (sr, cr), (sp, cp), (sy, cy) = ((math.sin(angle), math.cos(angle)) for angle in rpy_rad)
    x = (cy * cp, sy * cp, -sp)
    y = (cy * sp * sr - sy * cr, sy * sp * sr + cy * cr, cp * sr)
    return x, y, (cy * sp * cr + sy * sr, sy * sp * cr - cy * sr, cp * cr)


def depth_m(a: TurnedBox, b: TurnedBox) -> float:
    """Least way to push two boxes apart, by the separating axis theorem; not positive when they are apart."""
    away = (b.middle_m[0] - a.middle_m[0], b.middle_m[1] - a.middle_m[1], b.middle_m[2] - a.middle_m[2])
    ways = [*a.axes, *b.axes]
    for one in a.axes:
        for other in b.axes:
            across = _cross(one, other)
            if (length := math.sqrt(_dot(across, across))) > _PARALLEL:
                ways.append((across[0] / length, across[1] / length, across[2] / length))
    return min(a.reach(way) + b.reach(way) - abs(_dot(away, way)) for way in ways)


def _dot(a: Vector, b: Vector) -> float:
    return a[0] * b[0] + a[1] * b[1] + a[2] * b[2]


def _cross(a: Vector, b: Vector) -> Vector:
    return (a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0])
