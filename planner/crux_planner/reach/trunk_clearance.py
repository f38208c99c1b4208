"""The robot's trunk and links against the solids behind bounded surfaces."""

from __future__ import annotations

import itertools
from collections.abc import Sequence

import numpy as np

from crux_planner.model.arrays import Array, Flags
from crux_planner.model.cuboids import Cuboids
from crux_planner.model.kinematics import rotation_from_rpy
from crux_planner.reach import native
from crux_planner.reach.body_grid import BodyGrid
from crux_planner.reach.solids import Box, Links

_PARALLEL = 1e-6  # sine of the angle between two edges


def off_slabs(grid: BodyGrid, trunk: Sequence[Box], slabs: Cuboids, clear_m: float) -> Flags:
    """Body poses, a mask of the grid's shape, at which an axis shows that every box of the trunk is so far off every
    slab. Of two boxes whose nearest points are corners of both, some that are a little farther apart are left out.
    """
    clear = np.ones(grid.shape, dtype=bool)
    angles = (grid.yaw_rad, grid.roll_rad, grid.pitch_rad)
    places = np.stack(np.meshgrid(grid.x_m, grid.y_m, grid.z_m, indexing="ij"), axis=-1).transpose(2, 0, 1, 3)
    for cell in itertools.product(*(range(len(axis)) for axis in angles)):
        yaw, roll, pitch = (axis[i] for axis, i in zip(angles, cell, strict=True))
        to_h = rotation_from_rpy(np.array([roll, pitch, yaw]))
        for box, slab in itertools.product(trunk, range(len(slabs.yaw_rad))):
            turned, own = to_h @ box.rotation, slabs.rotation[slab]
            axes = axes_between(turned, own)
            sizes = np.abs(axes @ turned) @ box.half_m + np.abs(axes @ own) @ slabs.half_m[slab]
            middle = slabs.foot_m[slab] + own[:, 2] * slabs.half_m[slab, 2]
            gaps = np.abs((places + to_h @ box.centre_m - middle) @ axes.T) - sizes
            clear[cell] &= gaps.max(axis=-1) >= clear_m
    return clear


def links_off_slabs(poses: Array, links: Links, slabs: Cuboids, clear_m: float) -> Flags:
    """(n,) whether all links of a limb but its gripper's are so far off every slab, for body poses (n, 6)."""
    return native.off_boxes(links, poses[:, :3], rotation_from_rpy(poses[:, 3:]), boxes_of(slabs), clear_m)


def boxes_of(slabs: Cuboids) -> tuple[Box, ...]:
    """In H."""
    middles = slabs.foot_m + slabs.rotation[:, :, 2] * slabs.half_m[:, 2:]
    return tuple(Box(*each) for each in zip(middles, slabs.rotation, slabs.half_m, strict=True))


def axes_between(one: Array, two: Array) -> Array:
    """(n, 3) directions, of the faces of two boxes with these axes and across their edges, along which they are apart
    if they are apart at all.
    """
    across = np.cross(one.T[:, None], two.T).reshape(-1, 3)
    long = np.linalg.norm(across, axis=1)
    some = long > _PARALLEL
    return np.vstack([one.T, two.T, across[some] / long[some, None]])
