"""A planar five-bar between two joints of a limb and what turns them: section `five_bar` of robot.yaml.

In its plane x goes along the first joint's link where that joint is at 0, y is the joint's axis times x, and angles
turn from x towards y. The runtime has the same in runtime/core/robot/five_bar.cpp; msgs/golden/five_bars.json holds
both to it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property

import crux_msgs.robot_keys
import numpy as np
from numpy.typing import NDArray

from .robot_bounds import CRANK_TURN_RAD, FIVE_BAR_STEPS, FLAT, PARALLEL, SHORT_M

Array = NDArray[np.float64]
Flags = NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class FiveBar:
    """`first` counts the first joint from 0; its link is `link_m` long. The next joint turns about the same axis,
    or with `sense` -1 against it. `middle_rad` (2,) are the joints' angles by which branches are told apart.
    """

    section: crux_msgs.robot_keys.FiveBar
    link_m: float
    sense: float
    middle_rad: Array

    @property
    def first(self) -> int:
        return int(self.section.first_joint) - 1

    def crank_rad(self, joints_rad: Array) -> Array:
        """(...) angle of the crank for both joints' (..., 2): the nearest there is where the rod does not reach."""
        return self._middle_crank_rad + _wrapped(self._crank_rad(joints_rad) - self._middle_crank_rad)

    def next_rad(self, first_rad: Array, crank_rad: Array) -> Array:
        """(...) angle of the next joint for those of the first and of the crank, likewise."""
        away = self._crank_m(crank_rad) - _along(self.link_m, first_rad)
        far, arm = _length(away), self._arm_m
        bend = np.arccos(np.clip((arm**2 + far**2 - self.section.rod_m**2) / (2 * arm * far), -1, 1))
        pin = np.arctan2(away[..., 1], away[..., 0]) + self._opens * bend
        angle = self.sense * (pin - math.atan2(self.section.pin_y_m, self.section.pin_x_m) - first_rad)
        return np.asarray(self.middle_rad[1] + _wrapped(angle - self.middle_rad[1]))

    def slopes(self, joints_rad: Array) -> tuple[Array, Array]:
        """(...) each: speed of the crank by that of the first joint, and by that of the next.

        The rod keeps its length: along it, the pin is as fast as the crank's end.
        """
        crank, pin, from_first, rod = self._vectors(joints_rad)
        by_crank, by_next = _cross(crank, rod), _cross(pin, rod)
        crank_flat, pin_flat = FLAT * self.section.crank_m, FLAT * self._arm_m
        by_crank = np.where(np.abs(by_crank) < crank_flat, -self._bends * crank_flat, by_crank)
        by_next = np.where(np.abs(by_next) < pin_flat, self._opens * pin_flat, by_next)
        return _cross(from_first, rod) / by_crank, self.sense * by_next / by_crank

    def sine(self, joints_rad: Array) -> Array:
        """(...) the lesser sine of the angles between rod and crank, and between rod and the line to its pin: 0 where
        the linkage is singular, and less where it is in another branch or does not close.
        """
        crank, pin, _, rod = self._vectors(joints_rad)
        of_crank = -self._bends * _cross(crank, rod) / self.section.crank_m
        least = np.minimum(of_crank, self._opens * _cross(pin, rod) / self._arm_m)
        return np.where(np.abs(_length(rod) - 1.0) < FLAT, least, -1.0)

    def holds(self, joints_rad: Array, crank_rad: tuple[float, float]) -> Flags:
        """(...) whether the linkage is as far from singular as it must be, and the crank within its limits."""
        crank, (low, high) = self.crank_rad(joints_rad), self.crank_range_rad(crank_rad)
        return np.asarray((crank >= low) & (crank <= high) & (self.sine(joints_rad) >= self.section.least_sine))

    def crank_range_rad(self, crank_rad: tuple[float, float]) -> tuple[float, float]:
        """What is left of the crank's limits."""
        middle = self._middle_crank_rad
        return max(crank_rad[0], middle - CRANK_TURN_RAD), min(crank_rad[1], middle + CRANK_TURN_RAD)

    def box(self, low_rad: Array, high_rad: Array, crank_rad: tuple[float, float]) -> tuple[Array, Array]:
        """Ranges (2,) of both joints, within the given ones, in all of which the linkage holds(): grown from their
        middle, side after side, in steps; low above high where it does not hold in the middle.
        """
        ways = self._lattice(low_rad, high_rad)
        held = np.pad(self.holds(ways, crank_rad), 1, constant_values=True)
        around = [held[i : i + FIVE_BAR_STEPS + 1, k : k + FIVE_BAR_STEPS + 1] for i in range(3) for k in range(3)]
        held = np.all(around, axis=0)
        low, high = np.full(2, FIVE_BAR_STEPS // 2), np.full(2, FIVE_BAR_STEPS // 2)
        if not held[low[0], low[1]]:
            return high_rad.copy(), low_rad.copy()
        grows = True
        while grows:
            grows = False
            for joint in (0, 1):
                across = slice(low[1 - joint], high[1 - joint] + 1)
                for ends, step in ((low, -1), (high, 1)):
                    at = ends[joint] + step
                    if 0 <= at <= FIVE_BAR_STEPS and held[(at, across) if joint == 0 else (across, at)].all():
                        ends[joint], grows = at, True
        size = (high_rad - low_rad) / FIVE_BAR_STEPS
        return low_rad + low * size, low_rad + high * size

    def steepest(self, low_rad: Array, high_rad: Array) -> tuple[Array, Array]:
        """(2, 2) each, of the joints in these ranges: the greatest sizes of the slopes of first joint and crank, and of
        what torques of the joints make of theirs.
        """
        first, following = self.slopes(self._lattice(low_rad, high_rad))
        speeds = np.array([[1.0, 0.0], [np.abs(first).max(), np.abs(following).max()]])
        torques = np.array([[1.0, np.abs(first / following).max()], [0.0, np.abs(1.0 / following).max()]])
        return speeds, torques

    def _lattice(self, low_rad: Array, high_rad: Array) -> Array:
        size = (high_rad - low_rad) / FIVE_BAR_STEPS
        return np.stack(
            np.meshgrid(*(low_rad + np.arange(FIVE_BAR_STEPS + 1)[:, None] * size).T, indexing="ij"), axis=-1
        )

    @cached_property
    def _bends(self) -> float:
        return math.copysign(1.0, self.section.bends)

    @cached_property
    def _arm_m(self) -> float:
        return math.hypot(self.section.pin_x_m, self.section.pin_y_m)

    @cached_property
    def _middle_crank_rad(self) -> float:
        return float(self._crank_rad(self.middle_rad))

    @cached_property
    def _opens(self) -> float:
        _, pin, _, rod = self._vectors(self.middle_rad)
        return math.copysign(1.0, float(_cross(pin, rod)))

    def _crank_rad(self, joints_rad: Array) -> Array:
        pin = self._pin_m(joints_rad) + _along(self.link_m, joints_rad[..., 0])
        away, crank = pin - self._axis_m, self.section.crank_m
        far = _length(away)
        cosine = np.clip((crank**2 + far**2 - self.section.rod_m**2) / (2 * crank * far), -1, 1)
        return np.asarray(np.arctan2(away[..., 1], away[..., 0]) + self._bends * np.arccos(cosine))

    @cached_property
    def _axis_m(self) -> Array:
        return np.array([self.section.crank_x_m, self.section.crank_y_m])

    def _crank_m(self, crank_rad: Array) -> Array:
        """(..., 2) its end."""
        return self._axis_m + _along(self.section.crank_m, crank_rad)

    def _pin_m(self, joints_rad: Array) -> Array:
        """(..., 2) from the next joint."""
        angle = joints_rad[..., 0] + self.sense * joints_rad[..., 1]
        c, s = np.cos(angle), np.sin(angle)
        x, y = self.section.pin_x_m, self.section.pin_y_m
        return np.stack([c * x - s * y, s * x + c * y], axis=-1)

    def _vectors(self, joints_rad: Array) -> tuple[Array, Array, Array, Array]:
        """(..., 2) each: the crank, from the next joint to the pin, from the first joint to the pin, and the rod in its
        lengths.
        """
        crank, pin = _along(self.section.crank_m, self._crank_rad(joints_rad)), self._pin_m(joints_rad)
        from_first = _along(self.link_m, joints_rad[..., 0]) + pin
        return crank, pin, from_first, (from_first - self._axis_m - crank) / self.section.rod_m


def geometry(axes: Array, points_m: Array) -> tuple[float, float] | None:
    """Length of the first joint's link and sense of the next, of both joints' axes (2, 3) and a point on each (2, 3);
    None where they are not parallel, or the same line.
    """
    away = points_m[1] - points_m[0]
    length = float(np.linalg.norm(away - (away @ axes[0]) * axes[0]))
    if float(np.linalg.norm(np.cross(*axes))) > PARALLEL or length < SHORT_M:
        return None
    return length, math.copysign(1.0, float(axes[0] @ axes[1]))


def _along(length_m: float, angle_rad: Array) -> Array:
    return length_m * np.stack([np.cos(angle_rad), np.sin(angle_rad)], axis=-1)


def _length(v: Array) -> Array:
    return np.maximum(np.hypot(v[..., 0], v[..., 1]), SHORT_M)


def _cross(one: Array, other: Array) -> Array:
    return np.asarray(one[..., 0] * other[..., 1] - one[..., 1] * other[..., 0])


def _wrapped(angle_rad: Array) -> Array:
    """Within half a turn of 0."""
    return np.asarray(angle_rad - 2 * math.pi * np.round(angle_rad / (2 * math.pi)))
