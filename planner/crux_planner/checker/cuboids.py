"""Holds and obstacles of a plan as arrays."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from crux_contracts.scenario import Slab

from crux_planner.checker.geometry import Array, Flags, rotation_about_z, rotation_from_rpy

OUTWARD = np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, -1.0, 0.0], [0.0, 0.0, 1.0]])
"""Outward normals of a cuboid's faces in its own frame: +x, -x, +y, -y, top (of the wall itself: FACE_WALL)."""


@dataclass(frozen=True)
class Cuboids:
    """Holds and obstacles, shapes (H, ...); friction and spines by face: +x, -x, +y, -y, top."""

    names: tuple[str, ...]
    graspable: Flags
    foot_w_m: Array
    size_m: Array
    yaw_rad: Array
    friction: Array
    spines: Flags
    lean_rad: Array
    """Of the side faces, off the upright, (H, 4)."""
    tilt_rad: Array
    """Roll and pitch, (H, 2)."""

    @cached_property
    def centre_w_m(self) -> Array:
        """Centres (H, 3)."""
        if not self.tilt_rad.any():
            return self.foot_w_m + np.array([0.0, 0.0, 0.5]) * self.size_m
        return self.foot_w_m + 0.5 * self.size_m[:, 2:] * self.rotation[:, :, 2]

    @cached_property
    def rotation(self) -> Array:
        """Rotations W <- cuboid, shape (H, 3, 3)."""
        if not self.tilt_rad.any():
            return rotation_about_z(self.yaw_rad)
        return rotation_from_rpy(np.column_stack([self.tilt_rad, self.yaw_rad]))

    def side_planes(self, index: int) -> tuple[Array, Array]:
        """Outward normals (4, 3) and offsets (4,) of a cuboid's side faces in its centred frame: n . p is the offset on
        a face, which stands on the foot's edge and leans in.
        """
        cosine, sine = np.cos(self.lean_rad[index]), np.sin(self.lean_rad[index])
        normals = cosine[:, None] * OUTWARD[:4] + sine[:, None] * OUTWARD[4]
        half = 0.5 * self.size_m[index]
        return normals, cosine * half[[0, 0, 1, 1]] - sine * half[2]

    def with_slabs(self, slabs: tuple[Slab, ...]) -> "Cuboids":
        """These, and after them the solids behind bounded surfaces."""
        if not slabs:
            return self
        more = len(slabs)
        parts = (
            (self.graspable, np.zeros(more, dtype=bool)),
            (self.foot_w_m, [(*slab.position_m, slab.foot_z_m) for slab in slabs]),
            (self.size_m, [slab.size_m for slab in slabs]),
            (self.yaw_rad, [slab.yaw_rad for slab in slabs]),
            (self.friction, np.zeros((more, 5))),
            (self.spines, np.zeros((more, 5), dtype=bool)),
            (self.lean_rad, np.zeros((more, 4))),
            (self.tilt_rad, [slab.tilt_rad for slab in slabs]),
        )
        names = (*self.names, *(f"the surface {slab.name}" for slab in slabs))
        return Cuboids(names, *(np.concatenate(pair) for pair in parts))

    @cached_property
    def reach_w_m(self) -> Array:
        """Half extents along the axes of W, (H, 3)."""
        return np.asarray((np.abs(self.rotation) @ (0.5 * self.size_m[..., None]))[..., 0])
