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

from .urdf import Joint
from .yaml_document import Problem

Array = NDArray[np.float64]
LEAST_DETERMINANT = 1e-6  # of actuators that move every joint
ROUNDING = 1e-9  # of what does not move at all


@dataclass(frozen=True, eq=False)
class Limits:
    """Of joints or of actuators: angles, greatest speeds and peak torques."""

    low_rad: Array
    high_rad: Array
    speed_rad_s: Array
    torque_Nm: Array


@dataclass(frozen=True, eq=False)
class Transmission:
    """Actuators at `matrix` @ joints + `offset_rad`; what a section `transmissions` says of a limb's joints."""

    matrix: Array
    offset_rad: Array

    @classmethod
    def of(cls, section: Transmissions, joints: int) -> Transmission:
        """Of a limb with so many joints; `transmission_problems` has found nothing."""
        matrix = np.diag(section.ratio[:joints])
        for j in range(joints):
            if section.coupled_to[j] > 0:
                matrix[j, int(section.coupled_to[j]) - 1] += section.coupling[j]
        return cls(matrix, np.array(section.offset_rad[:joints]))

    @cached_property
    def _inverse(self) -> Array:
        return np.asarray(np.linalg.inv(self.matrix), dtype=np.float64)

    @property
    def direct(self) -> bool:
        """Each actuator is its joint."""
        return np.array_equal(self.matrix, np.eye(len(self.matrix))) and not self.offset_rad.any()

    def actuators_rad(self, joints_rad: Array) -> Array:
        """(..., J) where the joints are there."""
        return np.asarray(joints_rad @ self.matrix.T + self.offset_rad)

    def joints_rad(self, actuators_rad: Array) -> Array:
        """(..., J) where the actuators are there."""
        return np.asarray((actuators_rad - self.offset_rad) @ self._inverse.T)

    def slope(self, joints_rad: Array) -> Array:
        """(..., J, J) speeds of the actuators by those of the joints."""
        return np.broadcast_to(self.matrix, (*joints_rad.shape, joints_rad.shape[-1]))

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
        for row, offset, least, most in zip(
            self.matrix, self.offset_rad, actuators.low_rad, actuators.high_rad, strict=True
        ):
            moved = np.flatnonzero(row)
            if len(moved) == 1:
                ends = sorted(((least - offset) / row[moved[0]], (most - offset) / row[moved[0]]))
                low[moved], high[moved] = max(low[moved[0]], ends[0]), min(high[moved[0]], ends[1])
                continue
            middle, half = (low[moved] + high[moved]) / 2, (high[moved] - low[moved]) / 2
            room = (most - least) / 2 - abs(row[moved] @ middle + offset - (least + most) / 2)
            half = half * min(1.0, room / max(np.abs(row[moved]) @ half, ROUNDING))
            low[moved], high[moved] = middle - half, middle + half
        speed = _shrunk(joints.speed_rad_s, self.matrix, actuators.speed_rad_s)
        torque = _shrunk(joints.torque_Nm, np.asarray(self._inverse.T, dtype=np.float64), actuators.torque_Nm)
        return Limits(low, high, speed, torque)

    def reached(self, joints: Limits) -> Limits:
        """Of the actuators, what they come to as the joints do all that is within their limits."""
        if self.direct:
            return joints
        middle = self.actuators_rad((joints.low_rad + joints.high_rad) / 2)
        half = np.abs(self.matrix) @ (joints.high_rad - joints.low_rad) / 2
        speed = np.abs(self.matrix) @ joints.speed_rad_s
        return Limits(middle - half, middle + half, speed, np.abs(self._inverse.T) @ joints.torque_Nm)


def joint_limits(joints: Sequence[Joint]) -> Limits:
    """Of joints as they are."""
    each = [(joint.lower, joint.upper, joint.velocity, joint.effort) for joint in joints]
    return Limits(*np.array(each).T)


def narrowed(section: Transmissions, joints: Sequence[Joint]) -> tuple[Joint, ...]:
    """The joints with what their actuators leave of their limits."""
    limits = Transmission.of(section, len(joints)).within(joint_limits(joints), own_limits(section, len(joints)))
    each = zip(joints, limits.low_rad, limits.high_rad, limits.speed_rad_s, limits.torque_Nm, strict=True)
    return tuple(
        replace(joint, lower=float(low), upper=float(high), velocity=float(speed), effort=float(torque))
        for joint, low, high, speed, torque in each
    )


def own_limits(section: Transmissions, joints: int) -> Limits:
    """What the section says of the actuators themselves."""
    each = (section.low_rad, section.high_rad, section.speed_rad_s, section.torque_Nm)
    return Limits(*(np.array(values[:joints]) for values in each))


def transmission_problems(section: Transmissions, limb: str, each: Sequence[Joint]) -> Iterator[Problem]:
    """What is wrong with a section, for a limb with these joints; the first thing alone is to the point."""
    joints = len(each)
    for j, number in enumerate(section.coupled_to[:joints]):
        if number not in range(joints + 1) or number == j + 1:
            expected = f"expected 0 or the number of another joint, at most {joints}"
            yield Problem(f"transmissions.coupled_to[{j}]", f"{number:g}", expected)
            return
    if abs(np.linalg.det(Transmission.of(section, joints).matrix)) < LEAST_DETERMINANT:
        yield Problem("transmissions.ratio", "", "expected actuators that move every joint")
        return
    for j, (joint, left) in enumerate(zip(each, narrowed(section, each), strict=True)):
        if joint.lower < joint.upper and not left.lower < left.upper:
            expected = f"expected limits of actuators between which joint {j + 1} of limb {limb} can turn"
            yield Problem("transmissions.low_rad", "", expected)


def _shrunk(sizes: Array, matrix: Array, most: Array) -> Array:
    """`sizes` (J,), shrunk until |matrix| @ sizes is at most `most`."""
    sizes = sizes.copy()
    for row, limit in zip(np.abs(matrix), most, strict=True):
        sizes[row > ROUNDING] *= min(1.0, limit / max(row @ sizes, ROUNDING))
    return sizes
