"""What inverse kinematics turns: a limb's joints, without where its first one sits and how its gripper is mounted.

Limbs that differ only in these two have the same arm, and their poses are found together. Every joint has a frame whose
z is its axis, so that each is a turn about z after one constant turn. Vectors are (3, n), rotations (3, 3, n) with
columns first: component by component over n poses.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property, lru_cache

import numpy as np

from crux_planner.checker.geometry import Array, cross
from crux_planner.checker.limb_model import Limb, axis_frame


@dataclass(frozen=True, eq=False)
class Arm:
    """J joints: constant turns (J - 1, 3, 3) from each joint's frame to the next one's, offsets (J, 3) from each joint
    to the next and to the gripper, in the frame of the former, and limits (J,).
    """

    turns: Array
    offsets: Array
    lower_rad: Array
    upper_rad: Array

    @cached_property
    def alike(self) -> bytes:
        """The same for arms that are the same."""
        parts = (self.turns, self.offsets, self.lower_rad, self.upper_rad)
        return b"".join((part + 0.0).tobytes() for part in parts)  # no -0.0

    def forward(self, q_rad: Array) -> tuple[Array, Array, Array, Array]:
        """Position and rotation of the end for joint angles (J, n), origins and axes (3, J, n) of the joints."""
        joints, n = q_rad.shape
        sine, cosine = np.sin(q_rad), np.cos(q_rad)
        position, columns = np.zeros((3, n)), np.zeros((3, 3, n))
        origins, axes = np.empty((2, 3, joints, n))
        columns[0, 0] = columns[1, 1] = columns[2, 2] = 1.0
        for i in range(joints):
            if i > 0 and (self.turns[i - 1] != _IDENTITY).any():
                columns = (self.turns[i - 1].T @ columns.reshape(3, -1)).reshape(3, 3, n)
            origins[:, i], axes[:, i] = position, columns[2]
            turned = np.empty((3, 3, n))
            np.multiply(cosine[i], columns[0], out=turned[0])
            turned[0] += sine[i] * columns[1]
            np.multiply(cosine[i], columns[1], out=turned[1])
            turned[1] -= sine[i] * columns[0]
            turned[2] = columns[2]
            columns = turned
            for along, column in zip(self.offsets[i], columns, strict=True):
                if along != 0.0:
                    position = position + along * column
        return position, columns, origins, axes


_IDENTITY = np.eye(3)


def jacobian(position: Array, origins: Array, axes: Array) -> Array:
    """Geometric Jacobian (6, J, n) of a point (3, n) that moves with all joints: rows v, omega."""
    found = np.empty((6, *axes.shape[1:]))
    found[:3], found[3:] = cross(axes, position[:, None] - origins), axes
    return found


@dataclass(frozen=True)
class Mounting:
    """Where an arm's first joint is in the body, (3,) and (3, 3), and how the gripper is turned at its end, (3, 3)."""

    origin_b_m: Array
    rotation_b: Array
    gripper: Array

    def seen(self, position_b: Array, rotation_b: Array) -> tuple[Array, Array]:
        """Gripper poses (n, 3), (n, 3, 3) in the body as the arm has to place its end, (3, n) and (3, 3, n)."""
        position = self.rotation_b.T @ (position_b - self.origin_b_m).T
        columns = np.tensordot(self.gripper, rotation_b.T, axes=1)  # of rotation_b gripper^T
        return position, np.tensordot(columns, self.rotation_b, axes=(1, 0)).transpose(0, 2, 1)


@lru_cache(maxsize=16)
def arm_of(limb: Limb) -> tuple[Arm, Mounting]:
    """A limb's arm and how it is mounted."""
    poses: list[tuple[Array, Array]] = []  # of every joint's frame in the one before, and the gripper's in the last
    position, rotation = np.zeros(3), np.eye(3)
    for joint in limb.chain:
        position, rotation = position + rotation @ joint.origin_m, rotation @ joint.rotation
        if joint.kind == "revolute":
            frame = axis_frame(joint.axis)
            poses.append((position, rotation @ frame))
            position, rotation = np.zeros(3), frame.T
    poses.append((position, rotation))
    arm = Arm(
        np.array([turn for _, turn in poses[1:-1]]),
        np.array([offset for offset, _ in poses[1:]]),
        limb.lower_rad,
        limb.upper_rad,
    )
    return arm, Mounting(*poses[0], poses[-1][1])
