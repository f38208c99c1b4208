"""Between the actuators of a limb, which its nodes know, and its joints, which kinematics knows.

Arrays have a number an actuator or joint behind all other axes, shoulder outwards. The runtime has the same in
runtime/core/robot/transmission.cpp; msgs/golden/transmissions.json holds both to it.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from crux_msgs.robot_keys import Transmissions
from numpy.typing import NDArray

from .five_bar import FiveBar
from .urdf import Joint
from .yaml_document import Problem

Array = NDArray[np.float64]
LEAST_DETERMINANT = 1e-6  # of actuators that move every joint
ROUNDING = 1e-9  # of what does not move at all
UNLIMITED = 1e9  # the default of speeds and torques


@dataclass(frozen=True, eq=False)
class Limits:
    """Of joints or of actuators: angles, greatest speeds and peak torques."""

    low_rad: Array
    high_rad: Array
    speed_rad_s: Array
    torque_Nm: Array


@dataclass(frozen=True, eq=False)
class Transmission:
    """Actuators at `matrix` @ joints + `offset_rad`; what a section `transmissions` says of a limb's joints. Where
    there is a `five_bar`, its crank's angle stands in place of its next joint's.
    """

    matrix: Array
    offset_rad: Array
    five_bar: FiveBar | None = None

    @classmethod
    def of(cls, section: Transmissions, joints: int, five_bar: FiveBar | None = None) -> Transmission:
        """Of a limb with so many joints; `transmission_problems` has found nothing."""
        matrix = np.diag(section.ratio[:joints])
        for j in range(joints):
            if section.coupled_to[j] > 0:
                matrix[j, int(section.coupled_to[j]) - 1] += section.coupling[j]
        return cls(matrix, np.array(section.offset_rad[:joints]), five_bar)

    @cached_property
    def _inverse(self) -> Array:
        return np.asarray(np.linalg.inv(self.matrix), dtype=np.float64)

    @property
    def direct(self) -> bool:
        """Each actuator is its joint."""
        same = np.array_equal(self.matrix, np.eye(len(self.matrix))) and not self.offset_rad.any()
        return same and self.five_bar is None

    def actuators_rad(self, joints_rad: Array) -> Array:
        """(..., J) where the joints are there."""
        turned = joints_rad
        if self.five_bar is not None:
            turned = np.array(joints_rad)
            turned[..., self._pair.stop - 1] = self.five_bar.crank_rad(joints_rad[..., self._pair])
        return np.asarray(turned @ self.matrix.T + self.offset_rad)

    def joints_rad(self, actuators_rad: Array) -> Array:
        """(..., J) where the actuators are there."""
        joints = np.asarray((actuators_rad - self.offset_rad) @ self._inverse.T)
        if self.five_bar is not None:
            first, crank = np.moveaxis(joints[..., self._pair], -1, 0)
            joints[..., self._pair.stop - 1] = self.five_bar.next_rad(first, crank)
        return joints

    def slope(self, joints_rad: Array) -> Array:
        """(..., J, J) speeds of the actuators by those of the joints."""
        shape = (*joints_rad.shape, joints_rad.shape[-1])
        if self.five_bar is None:
            return np.broadcast_to(self.matrix, shape)
        linkage = np.array(np.broadcast_to(np.eye(len(self.matrix)), shape))
        linkage[..., self._pair.stop - 1, self._pair] = np.stack(
            self.five_bar.slopes(joints_rad[..., self._pair]), axis=-1
        )
        return np.asarray(self.matrix @ linkage)

    def joint_torque_Nm(self, joints_rad: Array, actuators_Nm: Array) -> Array:
        """(..., J) slope^T torque: what the actuators' torques make of the joints'."""
        return np.asarray((np.swapaxes(self.slope(joints_rad), -1, -2) @ actuators_Nm[..., None])[..., 0])

    def actuator_torque_Nm(self, joints_rad: Array, joints_Nm: Array) -> Array:
        """(..., J) what the actuators need for the joints' torques."""
        back = np.linalg.inv(np.swapaxes(self.slope(joints_rad), -1, -2))
        return np.asarray((back @ joints_Nm[..., None])[..., 0])

    def joint_stiffness_Nm_rad(self, joints_rad: Array, actuators_Nm_rad: Array) -> Array:
        """(..., J, J) slope^T K slope of gains (J,) of the actuators."""
        slope = self.slope(joints_rad)
        return np.asarray(np.swapaxes(slope, -1, -2) @ (actuators_Nm_rad[:, None] * slope))

    def within(self, joints: Limits, actuators: Limits) -> Limits:
        """The joints' limits, narrowed until the actuators keep theirs whatever the joints do within: as little as can
        be where an actuator moves one joint, else about the middle; low above high where that leaves nothing.
        """
        low, high = joints.low_rad.copy(), joints.high_rad.copy()
        for i, row in enumerate(self.matrix):
            if self.five_bar is not None and i == self._pair.stop - 1:
                continue  # of the crank
            offset, least, most = self.offset_rad[i], actuators.low_rad[i], actuators.high_rad[i]
            moved = np.flatnonzero(row)
            if len(moved) == 1:
                ends = sorted(((least - offset) / row[moved[0]], (most - offset) / row[moved[0]]))
                low[moved], high[moved] = max(low[moved[0]], ends[0]), min(high[moved[0]], ends[1])
                continue
            middle, half = (low[moved] + high[moved]) / 2, (high[moved] - low[moved]) / 2
            room = (most - least) / 2 - abs(row[moved] @ middle + offset - (least + most) / 2)
            half = half * min(1.0, room / max(np.abs(row[moved]) @ half, ROUNDING))
            low[moved], high[moved] = middle - half, middle + half
        speeds, torques = np.abs(self.matrix), np.abs(self._inverse.T)
        if self.five_bar is not None:
            pair = self._pair
            low[pair], high[pair] = self.five_bar.box(low[pair], high[pair], self.crank_limits_rad(actuators))
            if (low <= high).all():
                by_speed, by_torque = np.eye(len(low)), np.eye(len(low))
                by_speed[pair, pair], by_torque[pair, pair] = self.five_bar.steepest(low[pair], high[pair])
                speeds, torques = speeds @ by_speed, torques @ by_torque
        speed = _shrunk(joints.speed_rad_s, speeds, actuators.speed_rad_s)
        torque = _shrunk(joints.torque_Nm, torques, actuators.torque_Nm)
        return Limits(low, high, speed, torque)

    def reached(self, left: Limits, joints: Limits, actuators: Limits) -> Limits:
        """Of the actuators, what they come to as the joints do all that is `left` of their limits; those of a five-bar
        have their own `actuators`, as far as its joints' own `joints` let them.
        """
        if self.direct:
            return left
        middle = (left.low_rad + left.high_rad) / 2 @ self.matrix.T + self.offset_rad
        half = np.abs(self.matrix) @ (left.high_rad - left.low_rad) / 2
        speed, torque = np.abs(self.matrix) @ left.speed_rad_s, np.abs(self._inverse.T) @ left.torque_Nm
        low, high = middle - half, middle + half
        if self.five_bar is not None:
            pair, first = self._pair, self._pair.start
            speed[pair], torque[pair] = actuators.speed_rad_s[pair], actuators.torque_Nm[pair]
            turns = np.array([[joints.low_rad[first], joints.high_rad[first]],
                              self.five_bar.crank_range_rad(self.crank_limits_rad(actuators))])  # fmt: skip
            turns = np.sort(self.matrix.diagonal()[pair, None] * turns + self.offset_rad[pair, None], axis=1)
            low[pair], high[pair] = np.maximum(turns[:, 0], actuators.low_rad[pair]), turns[:, 1]
            high[pair] = np.minimum(high[pair], actuators.high_rad[pair])
        return Limits(low, high, speed, torque)

    def crank_limits_rad(self, actuators: Limits) -> tuple[float, float]:
        """Of the five-bar's crank, by its actuator's."""
        crank = self._pair.stop - 1
        ends = np.array([actuators.low_rad[crank], actuators.high_rad[crank]]) - self.offset_rad[crank]
        low, high = np.sort(ends / self.matrix[crank, crank])
        return float(low), float(high)

    def in_five_bar(self, joint: int) -> bool:
        """Whether the joint of this number, from 0, is one of a five-bar's."""
        return self.five_bar is not None and joint in range(self._pair.start, self._pair.stop)

    @property
    def _pair(self) -> slice:
        """The five-bar's two joints."""
        assert self.five_bar is not None
        return slice(self.five_bar.first, self.five_bar.first + 2)


def joint_limits(joints: Sequence[Joint]) -> Limits:
    """Of joints as they are."""
    each = [(joint.lower, joint.upper, joint.velocity, joint.effort) for joint in joints]
    return Limits(*np.array(each).T)


def narrowed(transmission: Transmission, section: Transmissions, joints: Sequence[Joint]) -> tuple[Joint, ...]:
    """The joints with what their actuators leave of their limits."""
    limits = transmission.within(joint_limits(joints), own_limits(section, len(joints)))
    each = zip(joints, limits.low_rad, limits.high_rad, limits.speed_rad_s, limits.torque_Nm, strict=True)
    return tuple(
        replace(joint, lower=float(low), upper=float(high), velocity=float(speed), effort=float(torque))
        for joint, low, high, speed, torque in each
    )


def own_limits(section: Transmissions, joints: int) -> Limits:
    """What the section says of the actuators themselves."""
    each = (section.low_rad, section.high_rad, section.speed_rad_s, section.torque_Nm)
    return Limits(*(np.array(values[:joints]) for values in each))


def transmission_problems(section: Transmissions, joints: int) -> Iterator[Problem]:
    """What is wrong with a section, for a limb with so many joints; the first thing alone is to the point."""
    for j, number in enumerate(section.coupled_to[:joints]):
        if number not in range(joints + 1) or number == j + 1:
            expected = f"expected 0 or the number of another joint, at most {joints}"
            yield Problem(f"transmissions.coupled_to[{j}]", f"{number:g}", expected)
            return
    if abs(np.linalg.det(Transmission.of(section, joints).matrix)) < LEAST_DETERMINANT:
        yield Problem("transmissions.ratio", "", "expected actuators that move every joint")


def limit_problems(limb: str, each: Sequence[Joint], narrowed: Sequence[Joint]) -> Iterator[Problem]:
    """Joints of which the actuators leave nothing."""
    for j, (joint, left) in enumerate(zip(each, narrowed, strict=True)):
        if joint.lower < joint.upper and not left.lower < left.upper:
            expected = f"expected limits of actuators between which joint {j + 1} of limb {limb} can turn"
            yield Problem("transmissions.low_rad", "", expected)


def five_bar_problems(section: Transmissions, five_bar: FiveBar, limb: str) -> Iterator[Problem]:
    """What is wrong with a five-bar and the section behind it."""
    first, keys = five_bar.first, five_bar.section
    if abs(keys.bends) != 1.0:
        yield Problem("five_bar.bends", f"{keys.bends:g}", "expected 1 or -1")
        return
    for j, number in enumerate(section.coupled_to):
        if number != 0 and (j in (first, first + 1) or number == first + 2):
            expected = "expected no coupling of the five-bar's actuators, and none to its crank"
            yield Problem(f"transmissions.coupled_to[{j}]", f"{number:g}", expected)
            return
    for key in ("speed_rad_s", "torque_Nm"):
        if max(getattr(section, key)[first : first + 2]) >= UNLIMITED:
            expected = f"expected those of the five-bar's actuators, number {first + 1} and {first + 2}"
            yield Problem(f"transmissions.{key}", "", expected)
            return
    if (sine := float(five_bar.sine(five_bar.middle_rad))) < keys.least_sine:
        found = f"{max(sine, 0.0):.2f}" if sine > -1.0 else "no angle: the rod does not reach"
        expected = f"expected at least {keys.least_sine:g}: other limits or lengths"
        yield Problem("five_bar.least_sine", found, f"in the middle of the ranges of limb {limb}, {expected}")


def _shrunk(sizes: Array, matrix: Array, most: Array) -> Array:
    """`sizes` (J,), shrunk until |matrix| @ sizes is at most `most`."""
    sizes = sizes.copy()
    for row, limit in zip(np.abs(matrix), most, strict=True):
        sizes[row > ROUNDING] *= min(1.0, limit / max(row @ sizes, ROUNDING))
    return sizes
