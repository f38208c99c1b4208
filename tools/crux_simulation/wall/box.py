"""A body on a wall as a cuboid, whose sides may lean in."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from crux_contracts.scenario_types import Grip, Hold
from crux_tools.telemetry.rotations import rpy_of

from crux_simulation.wall.frame import CLIMBED, Frame
from crux_simulation.wall.surface import Array

DIGITS, LEAN_DIGITS = 4, 1  # of lengths [m], and of leans [degrees], in a scenario


@dataclass(frozen=True)
class Box:
    """A cuboid on a plane of the wall, in its frame: middle of its foot (2,), sizes (3,) [m], yaw. `faces` says which
    pairs can be gripped, `tilt_rad` how far the worse face of each is off the gripper's axis. `lean_rad` is how much
    the side faces lean in (+x, -x, +y, -y), `aside_rad` what the worse face of each pair is off the axis besides.
    """

    name: str
    position_m: Array
    size_m: Array
    yaw_rad: float
    faces: tuple[bool, bool]
    tilt_rad: tuple[float, float]
    reason: str  # why it cannot be gripped
    lean_rad: tuple[float, float, float, float] = (0.0,) * 4
    aside_rad: tuple[float, float] | None = None  # as `tilt_rad`, where no face leans
    frame: Frame = CLIMBED
    grips: tuple[Grip, ...] = ()  # as a hold has them: the only places for grippers, where there are any

    @property
    def is_hold(self) -> bool:
        return any(self.faces)

    @property
    def leans(self) -> bool:
        return any(self.lean_rad)

    @property
    def foot_m(self) -> Array:
        """(3,) the middle of its foot in W [m]."""
        return self.frame.in_w(np.array([*self.position_m, 0.0]))

    @property
    def axes(self) -> Array:
        """(2, 2) its own x and y in the plane."""
        c, s = np.cos(self.yaw_rad), np.sin(self.yaw_rad)
        return np.array([[c, s], [-s, c]])

    @property
    def rotation(self) -> Array:
        """(3, 3) of the cuboid in W."""
        c, s = np.cos(self.yaw_rad), np.sin(self.yaw_rad)
        return np.asarray(self.frame.rotation.T @ np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]]))

    @property
    def rpy_rad(self) -> Array:
        """(3,) roll, pitch and yaw of the cuboid in W."""
        return np.array([0.0, 0.0, self.yaw_rad]) if self.frame is CLIMBED else rpy_of(self.rotation)

    @property
    def lean_deg(self) -> tuple[float, ...]:
        """(4,) `lean_rad` as a scenario has it."""
        return tuple(round(float(lean), LEAN_DIGITS) for lean in np.degrees(self.lean_rad))

    @property
    def as_hold(self) -> Hold:
        """Sizes, leans and grips as a scenario has them; its foot's middle is at (0, 0), unturned."""
        x, y, z = (round(float(size), DIGITS) for size in self.size_m)
        grips = tuple(grip for grip in self.grips if self.faces["xy".index(grip.faces)])
        return Hold(name=self.name, position_m=(0.0, 0.0), size_m=(x, y, z), lean_deg=self.lean_deg, grips=grips)


def along_axes(yaw: float, points: Array) -> tuple[Array, Array]:
    """Coordinates of points (n, 2) along the own axes of a cuboid with this yaw."""
    return points @ [np.cos(yaw), np.sin(yaw)], points @ [-np.sin(yaw), np.cos(yaw)]
