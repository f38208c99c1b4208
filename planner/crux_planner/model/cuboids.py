"""Equation (14): fingers stay outside every cuboid on the wall, the holds included, with clearance.

A point is outside a cuboid when it lies beyond one of its faces, n_h . (p - o_v) >= s_h with n_h the outward normal;
the largest of these over the faces is what `excess` returns, so that (14) reads max_h excess >= clearance.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from crux_contracts.gripper_frames import yaw_and_tilt
from crux_contracts.scenario import Cuboid

from crux_planner.model.arrays import Array, Flags
from crux_planner.model.kinematics import rotation_from_rpy, rotation_z

_ALONG_WALL = 1e-9


@dataclass(frozen=True)
class Cuboids:
    """V cuboids on the wall plane z = 0, upright on it where `tilt_rad` and `foot_z_m` are None."""

    foot_h_m: Array  # (V, 2) centres
    half_m: Array  # (V, 3) half edges along their own axes
    yaw_rad: Array  # (V,)
    tilt_rad: Array | None = None  # (V, 2) roll and pitch: R = Rz(yaw) Ry(pitch) Rx(roll) about the foot's centre
    foot_z_m: Array | None = None  # (V,) of the foot's centre

    @property
    def upright(self) -> bool:
        """Whether all stand upright on the wall."""
        return self.tilt_rad is None

    @cached_property
    def rotation(self) -> Array:
        """(V, 3, 3) H <- their own axes."""
        return rotation_from_rpy(np.column_stack([self._tilts, self.yaw_rad]))

    @property
    def _tilts(self) -> Array:
        """(V, 2)"""
        return np.zeros((len(self.yaw_rad), 2)) if self.tilt_rad is None else self.tilt_rad

    @cached_property
    def foot_m(self) -> Array:
        """(V, 3) the centres of their feet in H."""
        z = np.zeros(len(self.yaw_rad)) if self.foot_z_m is None else self.foot_z_m
        return np.column_stack([self.foot_h_m, z])

    def yaw_and_tilt(self, index: int) -> tuple[float, Array]:
        """Yaw and tilt (2,) [rad] of a gripper that comes along a cuboid's own z, see model.hands."""
        if self.tilt_rad is None or not self.tilt_rad[index].any():
            return float(self.yaw_rad[index]), np.zeros(2)
        return yaw_and_tilt(self.rotation[index])

    @cached_property
    def _centre_h_m(self) -> Array:
        """(V, 3)"""
        return self.foot_m + self.rotation[:, :, 2] * self.half_m[:, 2:]

    @cached_property
    def top_m(self) -> Array:
        """Height of the highest points above the wall, (V,)."""
        if self.upright:
            return 2 * self.half_m[:, 2]
        return np.asarray(self._centre_h_m[:, 2] + (np.abs(self.rotation[:, 2]) * self.half_m).sum(axis=1))

    @cached_property
    def bottom_m(self) -> Array:
        """Height of the lowest points, (V,)."""
        if self.upright:
            return self.foot_m[:, 2]
        return np.asarray(self._centre_h_m[:, 2] - (np.abs(self.rotation[:, 2]) * self.half_m).sum(axis=1))

    def top_near(self, points_h: Array, reach_m: float) -> float:
        """Height of the highest point of those within `reach_m` of points (..., 3) in plan view, at least -inf; what is
        below the plane of a turned one's top counts as high as that.
        """
        points = points_h.reshape(-1, points_h.shape[-1])
        up = self.rotation[:, :, 2]
        rising = np.maximum(up[:, 2], _ALONG_WALL)
        off = points[:, None, :2] - (self.foot_m + 2 * up * self.half_m[:, 2:])[:, :2]
        height = (self.foot_m + 2 * up * self.half_m[:, 2:])[:, 2]
        plane = height + (reach_m * np.linalg.norm(up[:, :2], axis=1) - (off * up[:, :2]).sum(axis=-1)) / rising
        tops = np.minimum(np.where(up[:, 2] > _ALONG_WALL, plane, np.inf), self.top_m)
        return float(np.where(self.plan_distance(points) < reach_m, tops, -np.inf).max(initial=-np.inf))

    @cached_property
    def outline(self) -> tuple[Array, Array]:
        """Centres (V, 2) and half edges (V, 2) of rectangles, turned by their yaws, around them in plan view."""
        if self.tilt_rad is None:
            return self.foot_h_m, self.half_m[:, :2]
        tilted = rotation_from_rpy(np.column_stack([self.tilt_rad, 0.0 * self.yaw_rad]))
        return self._centre_h_m[:, :2], (np.abs(tilted[:, :2]) @ self.half_m[..., None])[..., 0]

    def some(self, which: Flags) -> Cuboids:
        """Those of the flags (V,)."""
        tilt, z = (None if each is None else each[which] for each in (self.tilt_rad, self.foot_z_m))
        return Cuboids(self.foot_h_m[which], self.half_m[which], self.yaw_rad[which], tilt, z)

    def and_others(self, others: Cuboids) -> Cuboids:
        """These and others."""
        if not len(others.yaw_rad):
            return self
        tilts, heights = zip(*((each._tilts, each.foot_m[:, 2]) for each in (self, others)), strict=True)
        parts = ((each.foot_h_m, each.half_m, each.yaw_rad) for each in (self, others))
        foot, half, yaw = map(np.concatenate, zip(*parts, strict=True))
        return Cuboids(foot, half, yaw, np.concatenate(tilts), np.concatenate(heights))

    def near(self, points_h: Array, reach_m: float) -> Cuboids:
        """Those that stand within `reach_m` of the bounding box of points (..., 3), in plan view (more at times)."""
        flat = points_h.reshape(-1, points_h.shape[-1])[:, :2]
        middle, half = self.outline
        extent = np.linalg.norm(half, axis=1)[:, None] + reach_m
        beyond = np.maximum(flat.min(axis=0) - middle, middle - flat.max(axis=0))
        return self.some((beyond <= extent).all(axis=1))

    def excess(self, points_h: Array) -> Array:
        """Coordinates beyond the faces, (..., V, 3), of points (..., 3): per axis |local| - half."""
        if not self.upright:
            local = np.einsum("...vi,vij->...vj", points_h[..., None, :] - self._centre_h_m, self.rotation)
            return np.asarray(np.abs(local) - self.half_m)
        height = np.abs(points_h[..., None, 2] - self.half_m[:, 2]) - self.half_m[:, 2]
        return np.concatenate([self._plan_excess(points_h), height[..., None]], axis=-1)

    def _plan_excess(self, points_h: Array) -> Array:
        """The same (..., V, 2) of their outlines."""
        middle, half = self.outline
        plan = points_h[..., None, :2] - middle
        c, s = np.cos(self.yaw_rad), np.sin(self.yaw_rad)
        local = [c * plan[..., 0] + s * plan[..., 1], -s * plan[..., 0] + c * plan[..., 1]]
        return np.asarray(np.abs(np.stack(local, axis=-1)) - half)

    def distance(self, points_h: Array) -> Array:
        """Signed distances (..., V) of points (..., 3), negative inside."""
        return _outside(self.excess(points_h))

    def plan_distance(self, points_h: Array) -> Array:
        """Signed distances (..., V) in plan view of points (..., 2 or 3) to their outlines, endlessly high."""
        return _outside(self._plan_excess(points_h))


NO_CUBOIDS = Cuboids(np.zeros((0, 2)), np.zeros((0, 3)), np.zeros(0))


def cuboids_of(parts: Sequence[Cuboid], heading_rad: float) -> Cuboids:
    """Of a scenario, in axes turned by a heading about W's z."""
    if not parts:
        return NO_CUBOIDS
    foot = np.array([c.position_m for c in parts]) @ rotation_z(-heading_rad)[:2, :2].T
    given = foot, np.array([c.size_m for c in parts]) / 2, np.array([c.yaw_rad - heading_rad for c in parts])
    if not any(each.turned for each in parts):
        return Cuboids(*given)
    return Cuboids(*given, np.array([c.tilt_rad for c in parts]), np.array([c.foot_z_m for c in parts]))


def _outside(excess: Array) -> Array:
    return np.asarray(np.linalg.norm(np.maximum(excess, 0.0), axis=-1) + np.minimum(excess.max(axis=-1), 0.0))
