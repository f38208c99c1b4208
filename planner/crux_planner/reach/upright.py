"""Where a limb can have its gripper upright beside a level body: the inner map, at any yaw, as cells of a grid."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from crux_contracts.robot import Limb, Robot
from crux_contracts.robot_bounds import JOINTS

from crux_planner.model.arrays import Array, Flags
from crux_planner.model.chain import forward
from crux_planner.reach.arm import reaches_of
from crux_planner.reach.poses import GripperPoses
from crux_planner.reach.protocol import Reach

STEP_M, YAW_STEP_DEG = 0.03, 15


@dataclass(frozen=True)
class UprightReach:
    """Cells (x, y, z) in whose centre the limb can have its gripper; the centre (3,) of the first one, body frame."""

    held: Flags
    first_m: Array
    step_m: float = STEP_M


def upright_reach(robot: Robot, limb: int) -> UprightReach:
    """Of limb number `limb`, at yaws of `grasp.gripper_yaw_rad`, YAW_STEP_DEG apart. A limb of fewer than six joints is
    asked at the yaw that its joints make at each place.
    """
    own, reach = robot.limbs[limb], reaches_of(robot)[limb]
    axes = [
        middle + STEP_M * np.arange(-(span := np.ceil(own.longest_m / STEP_M)), span + 1) for middle in own.shoulder_b_m
    ]
    x, y, z = np.ix_(*axes)
    low, high = robot.grasp.gripper_yaw_rad
    level = np.zeros((1, 1, 1))
    if len(own.joints) < JOINTS:
        yaw = _made_yaw(own, reach, GripperPoses(x, y, z, np.full((1, 1, 1), (low + high) / 2), level, level))
        held = reach.reaches(GripperPoses(x, y, z, yaw, level, level)) & (yaw >= low) & (yaw <= high)
    else:
        held = np.zeros((x.size, y.size, z.size), dtype=bool)
        for at in np.arange(low, high + 1e-9, np.radians(YAW_STEP_DEG)):
            held |= reach.reaches(GripperPoses(x, y, z, np.full((1, 1, 1), at), level, level))
    return UprightReach(held, np.array([axis[0] for axis in axes]))


def _made_yaw(limb: Limb, reach: Reach, poses: GripperPoses) -> Array:
    """Of grippers at these places, of their shape: joints as for the pose, without turns that it lacks."""
    q = reach.angles(poses)
    shape = q.shape[:-1]
    q[..., len(limb.joints) :] = 0.0
    turn = forward(limb.at_zero, q.reshape(-1, q.shape[-1])).rotation
    return np.asarray(np.arctan2(turn[1, 0], turn[0, 0]).reshape(shape))
