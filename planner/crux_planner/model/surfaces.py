"""The surfaces of a wall: the endless plane z = 0 of W, and rectangles with the solids behind them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from crux_contracts.scenario import Wall

from crux_planner.model.arrays import Array
from crux_planner.model.contacts import GripperShape, outline
from crux_planner.model.cuboids import Cuboids, cuboids_of


@dataclass(frozen=True)
class Surfaces:
    """In H. Slabs are the solids behind bounded surfaces, which are their tops."""

    endless: bool  # whether z = 0 is one
    slabs: Cuboids
    names: tuple[str, ...]  # of the slabs

    @classmethod
    def of(cls, wall: Wall, heading_rad: float) -> Surfaces:
        """Those of a scenario's wall, in axes turned by a heading about W's z."""
        return cls(wall.endless, cuboids_of(wall.slabs, heading_rad), tuple(slab.name for slab in wall.slabs))

    def nearest(self, centre: Array, turn: Array, opening_m: float, shape: GripperShape) -> tuple[float, str]:
        """How far [m] fingers and palm of a gripper are off these surfaces, and off which: its centre (3,) between the
        pads, its rotation (3, 3) with the opening axis first, the pads' faces so far from the centre.

        An upright gripper is off the plane where its pads are at a height that it can have.
        """
        found = [(np.inf, "the wall")]
        points = centre + outline(opening_m, shape) @ turn.T
        if self.endless and turn[2, 2] < 1.0:
            found.append((float(points[:, 2].min()) - shape.pad_radius, "the wall"))
        if self.names:
            gaps = self.slabs.distance(points).min(axis=0) - shape.pad_radius
            found += zip(gaps.tolist(), self.names, strict=True)
        return min(found)
