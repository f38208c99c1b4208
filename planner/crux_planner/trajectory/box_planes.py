"""Planes that keep links off boxes, and the trunk off the solids behind bounded surfaces, in the exact P1.

Two boxes are apart along one of a few axes: the one along which they are farthest apart on the path stays between them.
"""

from __future__ import annotations

from collections.abc import Sequence
from itertools import product

import numpy as np

from crux_planner.model.arrays import Array, Flags
from crux_planner.model.kinematics import rotation_from_rpy
from crux_planner.reach.solids import Box
from crux_planner.reach.trunk_clearance import axes_between

_NEAR_M = 0.15  # links farther off boxes need no plane
CORNERS = np.array([*product((-1.0, 1.0), repeat=3)])
_ALONG = np.linspace(0.0, 1.0, 17)  # samples of a link
_LOWEST = 4  # corners of a box that are nearest to a plane, and stay on their side of it


def capsules_off(
    boxes: Sequence[Box], ends: tuple[Array, Array], radius_m: Array, apart_m: Array, off_m: float
) -> tuple[Array, Array]:
    """Normals (N, P, 3) and how far (N, P) along them both ends (N, P, 3) of capsules are at least, so that they are
    `apart_m` (N,) off the nearest of some boxes, -inf where none is near; no more beyond `off_m` than they are now.
    """
    start, end = ends
    points = start[:, :, None] + _ALONG[:, None] * (end - start)[:, :, None]
    normals, least = np.zeros(start.shape), np.full(start.shape[:2], -np.inf)
    nearest = np.full(least.shape, _NEAR_M)
    for box in boxes:
        seen = (points - box.centre_m) @ box.rotation
        off = seen - np.clip(seen, -box.half_m, box.half_m)
        gap = np.linalg.norm(off, axis=-1)
        which = np.argmin(gap, axis=-1)[..., None]
        gap = np.take_along_axis(gap, which, axis=-1)[..., 0]
        away = np.take_along_axis(off, which[..., None], axis=2)[:, :, 0] / np.maximum(gap, 1e-9)[..., None]
        normal = away @ box.rotation.T
        border = normal @ box.centre_m + np.abs(away) @ box.half_m + radius_m + apart_m[:, None]
        here = np.minimum(*((each * normal).sum(axis=-1) for each in (start, end)))
        near = (gap > 0.0) & (gap < nearest)
        wanted = np.minimum(border, here + apart_m[:, None] - off_m)
        normals[near], least[near], nearest[near] = normal[near], wanted[near], gap[near]
    return normals, least


def separation(box: Box, slab: Box, poses: Array) -> tuple[Array, Array]:
    """The axes (N, 3) in H, from the slab to the box, along which these are farthest apart, and how far (N,)."""
    normals, gaps = np.zeros((len(poses), 3)), np.zeros(len(poses))
    for k, to_h in enumerate(rotation_from_rpy(poses[:, 3:6])):
        turned = to_h @ box.rotation
        axes = axes_between(turned, slab.rotation)
        way = axes @ (poses[k, :3] + to_h @ box.centre_m - slab.centre_m)
        gap = np.abs(way) - np.abs(axes @ turned) @ box.half_m - np.abs(axes @ slab.rotation) @ slab.half_m
        best = int(np.argmax(gap))
        normals[k], gaps[k] = axes[best] * (1.0 if way[best] >= 0.0 else -1.0), gap[best]
    return normals, gaps


def trunk_off(box: Box, slab: Box, poses: Array, apart_m: Array, off_m: float) -> tuple[Array, Array]:
    """Normals (N, 3) in H and how far (N, 8) along them corners of a box of the trunk are at least, so that it is
    `apart_m` (N,) off a slab with the body at poses (N, 6), -inf where others are nearer; no more beyond `off_m`
    than it is there.
    """
    normals, _ = separation(box, slab, poses)
    corners = box.centre_m + (CORNERS * box.half_m) @ box.rotation.T
    along = (places(poses, corners) * normals[:, None]).sum(axis=-1)
    border = normals @ slab.centre_m + np.abs(normals @ slab.rotation) @ slab.half_m + apart_m
    wanted = np.minimum(border, along.min(axis=1) + apart_m - off_m)
    rank = np.argsort(np.argsort(along, axis=1, kind="stable"), axis=1)
    return normals, np.where(rank < _LOWEST, wanted[:, None], -np.inf)


def trunk_clear(trunk: Sequence[Box], slabs: Sequence[Box], poses: Array, clear_m: float) -> Flags:
    """(N,) whether the trunk is so far off all slabs with the body at poses (N, 6)."""
    gaps = [separation(box, slab, poses)[1] >= clear_m for box, slab in product(trunk, slabs)]
    return np.logical_and.reduce(gaps) if gaps else np.ones(len(poses), dtype=bool)


def places(poses: Array, points: Array) -> Array:
    """(N, P, 3) in H of points (P, 3) or (N, P, 3) in the body frame."""
    return np.asarray(poses[:, None, :3] + points @ np.swapaxes(rotation_from_rpy(poses[:, 3:6]), 1, 2))
