"""Sets of body poses from which grippers are in reach: masks over a grid, their intersections and connected parts."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from itertools import combinations

import numpy as np

from crux_planner.model.arrays import Array, Flags, Indices
from crux_planner.model.hands import UPRIGHT, rotations
from crux_planner.model.kinematics import rotation_from_rpy
from crux_planner.reach import between, native
from crux_planner.reach.poses import GripperPoses
from crux_planner.reach.protocol import Reach

_EXACT = np.zeros(4)
LIFT_STEP_M = 0.02  # between heights looked at of a gripper that lifts


@dataclass(frozen=True)
class BodyGrid:
    """Poses of the body in W: every combination of these values, each ascending by even steps.

    Masks have one axis for each, in this order.
    """

    yaw_rad: Array
    roll_rad: Array
    pitch_rad: Array
    z_m: Array
    x_m: Array
    y_m: Array

    @property
    def axes(self) -> tuple[Array, Array, Array, Array, Array, Array]:
        """Values along each axis of a mask."""
        return self.yaw_rad, self.roll_rad, self.pitch_rad, self.z_m, self.x_m, self.y_m

    @property
    def shape(self) -> tuple[int, ...]:
        """Of a mask."""
        return tuple(len(axis) for axis in self.axes)

    @property
    def tilts(self) -> bool:
        """Whether bodies of different rolls or pitches are in it."""
        return len(self.roll_rad) > 1 or len(self.pitch_rad) > 1

    def pose(self, cell: Sequence[int]) -> tuple[Array, Array]:
        """Place (3,) [m] and roll, pitch and yaw (3,) of the body at a cell."""
        yaw, roll, pitch, z, x, y = (axis[i] for axis, i in zip(self.axes, cell, strict=True))
        return np.array([x, y, z]), np.array([roll, pitch, yaw])

    def poses(self, cells: Indices) -> Array:
        """(n, 6) places [m] and roll, pitch and yaw of cells (n,) of a mask that is flattened."""
        yaw, roll, pitch, z, x, y = (
            axis[i] for axis, i in zip(self.axes, np.unravel_index(cells, self.shape), strict=True)
        )
        return np.column_stack([x, y, z, roll, pitch, yaw])

    @cached_property
    def _open_axes(self) -> tuple[Array, ...]:
        """All axes as arrays that broadcast to a mask's shape; then cosine and sine of the yaws."""
        yaw, *others = np.ix_(*self.axes)
        return yaw, *others, np.cos(yaw), np.sin(yaw)

    def _at(self, cells: Indices) -> tuple[Array, ...]:
        """The same (n,) of cells (n,) by their numbers."""
        at = np.unravel_index(cells, self.shape)
        own = (axis[i] for axis, i in zip(self.axes, at, strict=True))
        return *own, np.cos(self.yaw_rad)[at[0]], np.sin(self.yaw_rad)[at[0]]

    def seen(self, gripper_w: Array, cells: Indices | None = None) -> GripperPoses:
        """A hand (4 or 6,) in W, see model.hands, as the body has it at every cell, or at some (n,) by their numbers
        among all.
        """
        if len(gripper_w) > UPRIGHT and gripper_w[UPRIGHT:].any():
            return self._seen_tilted(gripper_w, cells)
        yaw, roll, pitch, z, x, y, c, s = self._open_axes if cells is None else self._at(cells)
        east, north = gripper_w[0] - x, gripper_w[1] - y
        return GripperPoses(
            c * east + s * north, c * north - s * east, gripper_w[2] - z, gripper_w[3] - yaw, roll, pitch
        )

    def _seen_tilted(self, gripper_w: Array, cells: Indices | None) -> GripperPoses:
        """The same of a hand that is tilted: x, y and z are along the axes of a heading in the hand's own plane."""
        yaw, roll, pitch = np.meshgrid(self.yaw_rad, self.roll_rad, self.pitch_rad, indexing="ij")
        back = np.swapaxes(rotation_from_rpy(np.stack([roll, pitch, yaw], axis=-1)), -1, -2)
        turned = GripperPoses.of(np.zeros(3), back @ rotations(gripper_w), gripper_w[3] - yaw)
        tilt = rotation_from_rpy(np.stack([turned.roll_rad, turned.pitch_rad, np.zeros_like(yaw)], axis=-1))
        along, angles = tilt @ back, np.stack([turned.yaw_rad, turned.roll_rad, turned.pitch_rad], axis=-1)
        if cells is None:
            along, angles = (each[:, :, :, None, None, None] for each in (along, angles))
            *_, z, x, y = np.ix_(*self.axes)
        else:
            *turn, up, ahead, aside = np.unravel_index(cells, self.shape)
            along, angles = along[tuple(turn)], angles[tuple(turn)]
            z, x, y = self.z_m[up], self.x_m[ahead], self.y_m[aside]
        off = gripper_w[0] - x, gripper_w[1] - y, gripper_w[2] - z
        place = (sum(along[..., row, i] * off[i] for i in range(3)) for row in range(3))
        return GripperPoses(*place, *np.moveaxis(angles, -1, 0))

    def boxes(self, gripper_w: Array, slack: Array = _EXACT) -> tuple[GripperPoses, GripperPoses]:
        """Lowest and highest of `seen` over whole cells: bodies up to half a step off a cell's middle along each axis,
        grippers up to `slack` (4,) off theirs.

        Neighbouring cells meet, so what none of them reaches, nothing between them does. An axis of one value has no
        extent.
        """
        half = [(axis[-1] - axis[0]) / (2 * max(len(axis) - 1, 1)) for axis in self.axes]
        turn, roll, pitch, up, along, across = half
        along, across, up = along + slack[0], across + slack[1], up + slack[2]
        middle = self.seen(gripper_w)
        c, s = np.abs(np.cos(self.yaw_rad)), np.abs(np.sin(self.yaw_rad))
        wide_x, wide_y = (
            each.reshape(-1, 1, 1, 1, 1, 1) for each in (c * along + s * across, c * across + s * along)
        )  # of the cell's rectangle, turned by the middle yaw
        off_x, off_y = spread((middle.x_m, middle.y_m), (wide_x, wide_y), turn)
        off = (off_x, off_y, up, turn + slack[3], roll, pitch)
        low = GripperPoses(*(np.asarray(each - by) for each, by in zip(middle.arrays, off, strict=True)))
        high = GripperPoses(*(np.asarray(each + by) for each, by in zip(middle.arrays, off, strict=True)))
        return low, high

    def held(self, reach: Reach, gripper_w: Array) -> Flags:
        """From which a limb can hold with its gripper there."""
        return np.broadcast_to(reach.reaches(self.seen(gripper_w)), self.shape)

    def lifted(self, reach: Reach, gripper_w: Array, by_m: float) -> Flags:
        """From which it can hold there and raise its gripper straight by so much, or land from there: the way down is
        the way up.
        """
        mask = np.array(self.held(reach, gripper_w))
        way = np.zeros(len(gripper_w))
        way[:3] = rotations(gripper_w)[:, 2]
        for rise in np.linspace(0.0, by_m, int(np.ceil(by_m / LIFT_STEP_M)) + 1)[1:]:
            mask &= self.held(reach, gripper_w + rise * way)
        return mask

    def apart(
        self,
        mask: Flags,
        grippers_w: Mapping[int, Array],
        reaches: Sequence[Reach],
        clear_m: float,
        moving: Sequence[int] = (0, 1, 2, 3),
        hands: bool = True,
    ) -> Flags:
        """The part of a stance's mask in which `moving` limbs keep off all others; grippers (4,) by limb. `hands` as in
        `between.apart`.
        """
        cells = np.flatnonzero(mask)
        found = np.zeros(mask.shape, dtype=bool)
        links = {limb: reaches[limb].links(self.seen(at, cells)) for limb, at in grippers_w.items()}
        pairs = [pair for pair in combinations(links, 2) if not set(moving).isdisjoint(pair)]
        gaps = [between.apart(links[a], links[b], clear_m, hands) for a, b in pairs]
        found.reshape(-1)[cells] = np.logical_and.reduce(gaps)
        return found

    def ruled_out(self, reach: Reach, gripper_w: Array, slack: Array = _EXACT) -> Flags:
        """Cells of which no pose lets the limb hold there, or up to `slack` (4,) off, for certain; none where the hand
        is tilted.
        """
        if len(gripper_w) > UPRIGHT and gripper_w[UPRIGHT:].any():
            return np.zeros(self.shape, dtype=bool)
        return np.broadcast_to(reach.cannot(*self.boxes(gripper_w, slack)), self.shape)


def spread(middle_m: tuple[Array, Array], wide_m: tuple[Array, Array], turn_rad: Array | float) -> tuple[Array, Array]:
    """The most that x and y can be off those of places in the middle of rectangles, half as wide as `wide_m` along the
    axes of the middle heading, as headings up to `turn_rad` off that have them.
    """
    (wide_x, wide_y), turned, shortened = wide_m, np.sin(turn_rad), 1.0 - np.cos(turn_rad)
    far_x, far_y = (np.abs(at) + wide for at, wide in zip(middle_m, wide_m, strict=True))
    return wide_x + turned * far_y + shortened * far_x, wide_y + turned * far_x + shortened * far_y


def stance(masks: Sequence[Flags]) -> Flags:
    """Poses from which all limbs can do what their masks are about."""
    return np.asarray(np.logical_and.reduce(masks), dtype=bool)


def parts(mask: Flags) -> tuple[Indices, int]:
    """Connected parts of a set of poses: for every cell the number of its part, 0 outside; and how many there are.

    Cells next to each other along one axis are connected. Parts are numbered in the order of their first cells.
    """
    return native.parts(mask)
