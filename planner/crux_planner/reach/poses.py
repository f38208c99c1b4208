"""Grippers as a body sees them: what a limb reaches depends on nothing else."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from crux_planner.model.arrays import Array, Indices
from crux_planner.model.kinematics import rotation_from_rpy, rotation_z, wrap_near


@dataclass(frozen=True)
class GripperPoses:
    """Any number of grippers upright on the wall (their z along W's z): six arrays that broadcast together.

    A hold on a plane of another inclination has its own W: `of` makes these numbers of any rotation.

    x, y and z say where the gripper's centre is, off the body's origin and along the axes of its heading, which are
    W's turned by the body's yaw. The gripper's yaw is less the body's, and is not wrapped: the last joint follows it.
    Roll and pitch are the body's.
    """

    x_m: Array
    y_m: Array
    z_m: Array
    yaw_rad: Array
    roll_rad: Array
    pitch_rad: Array

    @classmethod
    def of(cls, place_b_m: Array, rotation_b: Array, near_rad: Array | float = 0.0) -> GripperPoses:
        """Of places (..., 3) and rotations (..., 3, 3) in the body frame; yaws within a quarter turn of `near_rad`, one
        or (...): of a rotation's two triples of angles the one that does not turn over where a body tilts by more than
        a right angle.
        """
        up = rotation_b[..., :, 2]
        pitch, roll = -np.arcsin(np.clip(up[..., 0], -1.0, 1.0)), np.arctan2(up[..., 1], up[..., 2])
        tilt = rotation_from_rpy(np.stack([roll, pitch, np.zeros_like(roll)], axis=-1))
        x, y, z = np.moveaxis((tilt @ place_b_m[..., None])[..., 0], -1, 0)
        along = (tilt @ rotation_b)[..., :, 0]
        yaw = np.arctan2(along[..., 1], along[..., 0])
        over = np.cos(yaw - near_rad) < 0.0
        x, y = (np.where(over, -each, each) for each in (x, y))
        yaw, roll = (np.where(over, each + np.pi, each) for each in (yaw, roll))
        return cls(x, y, z, wrap_near(yaw, near_rad), roll, np.where(over, np.pi - pitch, pitch))

    @property
    def arrays(self) -> tuple[Array, Array, Array, Array, Array, Array]:
        """x, y, z, yaw, roll and pitch."""
        return self.x_m, self.y_m, self.z_m, self.yaw_rad, self.roll_rad, self.pitch_rad

    @property
    def shape(self) -> tuple[int, ...]:
        """Of all arrays together."""
        return np.broadcast(*self.arrays).shape

    def where(self, index: Indices) -> GripperPoses:
        """The poses (n,) of this index (n,) into all of them, flattened."""
        shape = self.shape
        at = np.unravel_index(index, shape)
        return GripperPoses(
            *(_at(np.asarray(each), at[len(shape) - np.ndim(each) :], len(index)) for each in self.arrays)
        )

    def in_body(self) -> tuple[Array, Array]:
        """Places (..., 3) [m] and rotations (..., 3, 3) in the body frame."""
        x, y, z, yaw, roll, pitch = np.broadcast_arrays(*self.arrays)
        tilt = rotation_from_rpy(np.stack([roll, pitch, np.zeros_like(roll)], axis=-1))
        back = np.swapaxes(tilt, -1, -2)
        place = np.stack([x, y, z], axis=-1)
        return np.asarray((back @ place[..., None])[..., 0]), np.asarray(back @ rotation_z(yaw))


def _at(values: Array, at: tuple[Indices, ...], count: int) -> Array:
    """The values (count,) at places along each of their axes: the only one, where an axis has no other."""
    along = [axis for axis, size in enumerate(values.shape) if size != 1]
    if not along:
        return np.full(count, values.reshape(()))
    return np.asarray(values.squeeze()[tuple(at[axis] for axis in along)])
