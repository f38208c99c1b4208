"""Equation (14): fingers stay outside every cuboid that stands on the wall, the holds included, with clearance.

A point is outside a cuboid when it lies beyond one of its faces, n_h . (p - o_v) >= s_h with n_h the outward normal;
the largest of these over the faces is what `excess` returns, so that (14) reads max_h excess >= clearance.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from crux_planner.model.arrays import Array


@dataclass(frozen=True)
class Cuboids:
    """V cuboids standing on the wall plane z = 0."""

    foot_h_m: Array  # (V, 2) centres
    half_m: Array  # (V, 3) half edges along their own axes
    yaw_rad: Array  # (V,)

    @property
    def top_m(self) -> Array:
        """Height of the tops above the wall, (V,)."""
        return 2 * self.half_m[:, 2]

    def near(self, points_h: Array, reach_m: float) -> Cuboids:
        """Those that stand within `reach_m` of the bounding box of points (..., 3), in plan view (more at times)."""
        flat = points_h.reshape(-1, points_h.shape[-1])[:, :2]
        extent = np.linalg.norm(self.half_m[:, :2], axis=1)[:, None] + reach_m
        beyond = np.maximum(flat.min(axis=0) - self.foot_h_m, self.foot_h_m - flat.max(axis=0))
        close = (beyond <= extent).all(axis=1)
        return Cuboids(self.foot_h_m[close], self.half_m[close], self.yaw_rad[close])

    def excess(self, points_h: Array) -> Array:
        """Coordinates beyond the faces, (..., V, 3), of points (..., 3): per axis |local| - half."""
        plan = points_h[..., None, :2] - self.foot_h_m
        c, s = np.cos(self.yaw_rad), np.sin(self.yaw_rad)
        local = np.stack(
            [
                c * plan[..., 0] + s * plan[..., 1],
                -s * plan[..., 0] + c * plan[..., 1],
                np.broadcast_to(points_h[..., None, 2] - self.half_m[:, 2], plan.shape[:-1]),
            ],
            axis=-1,
        )
        return np.abs(local) - self.half_m

    def distance(self, points_h: Array) -> Array:
        """Signed distances (..., V) of points (..., 3), negative inside."""
        return _outside(self.excess(points_h))

    def plan_distance(self, points_h: Array) -> Array:
        """Signed distances (..., V) in plan view of points (..., 2 or 3): as if the cuboids were endlessly high."""
        flat = np.concatenate([points_h[..., :2], np.zeros((*points_h.shape[:-1], 1))], axis=-1)
        return _outside(self.excess(flat)[..., :2])


def _outside(excess: Array) -> Array:
    return np.asarray(np.linalg.norm(np.maximum(excess, 0.0), axis=-1) + np.minimum(excess.max(axis=-1), 0.0))
