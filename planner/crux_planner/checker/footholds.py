"""Footholds of a plan as arrays: places on surfaces where a gripper stands with both pads, and where that has its
frame.
"""

from dataclasses import dataclass, replace

import numpy as np
from crux_msgs import hold_t

from crux_planner.checker.geometry import Array, Flags, Indices, rotation_from_rpy

NOWHERE, PLANE = -1, -2
"""Of Footholds.surface: on no surface; on the plane z = 0 of W."""


@dataclass(frozen=True)
class Footholds:
    """F places, in plan_t.holds after all cuboids."""

    names: tuple[str, ...]
    place_w_m: Array
    """(F, 3)"""
    rpy_rad: Array
    """(F, 3): z of R = Rz(yaw) Ry(pitch) Rx(roll) is the surface's normal"""
    size_m: Array
    """(F, 3)"""
    friction: Array
    """(F, 5), by face as cuboids have it"""
    surface: Indices
    """(F,) index of the solid behind a bounded surface, after the cuboids; NOWHERE or PLANE"""

    @property
    def normal(self) -> Array:
        """(F, 3) of their surfaces."""
        return np.asarray(rotation_from_rpy(self.rpy_rad)[..., 2])

    def on(self, surface: Indices) -> "Footholds":
        """The same on these surfaces (F,)."""
        return replace(self, surface=surface)


NO_FOOTHOLDS = Footholds((), np.zeros((0, 3)), np.zeros((0, 3)), np.zeros((0, 3)), np.zeros((0, 5)), np.zeros(0, int))


def read_footholds(holds: list[hold_t]) -> Footholds:
    """Of those of a plan's holds that are footholds, on no surface yet."""
    if not holds:
        return NO_FOOTHOLDS
    parts = [
        np.array(rows, dtype=float)
        for rows in (
            [hold.position_w_m for hold in holds],
            [[*hold.tilt_rad, hold.yaw_rad] for hold in holds],
            [hold.size_m for hold in holds],
            [hold.friction for hold in holds],
        )
    ]
    place, rpy, size, friction = parts
    return Footholds(tuple(hold.name for hold in holds), place, rpy, size, friction, np.full(len(holds), NOWHERE))


def first_foothold(holds: list[hold_t]) -> int:
    """How many of a plan's holds are cuboids, which come first."""
    return next((i for i, hold in enumerate(holds) if hold.graspable == hold_t.FOOTHOLD), len(holds))


def misplaced(holds: list[hold_t]) -> bool:
    """Whether a cuboid comes after a foothold."""
    return any(hold.graspable != hold_t.FOOTHOLD for hold in holds[first_foothold(holds) :])


def above_m(standing: Flags, up: Array, pad_radius_m: float) -> Array:
    """(..., 3) from foot points to their grippers' frames, whose z is `up` (..., 3); 0 where no limb stands."""
    return np.where(standing[..., None], pad_radius_m * up, 0.0)
