"""Puts the model into the first knot of a plan: numeric inverse kinematics on MuJoCo's own Jacobians."""

from __future__ import annotations

from typing import Any

import mujoco
import numpy as np
from numpy.typing import NDArray

from crux_tools.bench.robot_model import RobotModel

DAMPING = 1e-4  # of the least-squares step
ITERATIONS = 100
TOLERANCE_M = 1e-6  # of gripper position, and of orientation in rad
STARTS = 20

Floats = NDArray[np.float64]


class StartPoseError(ValueError):
    """The plan's first knot cannot be taken by this robot."""


def rotation_from_rpy(rpy_rad: Any) -> Floats:
    """Rotation W <- B of intrinsic z-y-x angles (roll, pitch, yaw), (3, 3)."""
    (cr, cp, cy), (sr, sp, sy) = np.cos(rpy_rad), np.sin(rpy_rad)
    return np.array(
        [
            [cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr],
            [sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr],
            [-sp, cp * sr, cp * cr],
        ]
    )


def _gripper_error(robot: RobotModel, data: mujoco.MjData, limb: int, position_w_m: Floats, yaw_rad: float) -> Floats:
    site = robot.gripper_sites[limb]
    present = data.site_xmat[site].reshape(3, 3)
    wanted = rotation_from_rpy([0.0, 0.0, yaw_rad])
    turn = np.empty(4)
    mujoco.mju_mat2Quat(turn, (wanted @ present.T).ravel())
    rotation = np.empty(3)
    mujoco.mju_quat2Vel(rotation, turn, 1.0)
    return np.concatenate([position_w_m - data.site_xpos[site], rotation])


def solve_limb(robot: RobotModel, data: mujoco.MjData, limb: int, position_w_m: Floats, yaw_rad: float) -> bool:
    """Moves the six joints of `limb` until its gripper stands at the pose; False when it cannot within the limits."""
    model = robot.model
    qpos, dof = robot.joint_qpos[6 * limb : 6 * limb + 6], robot.joint_dof[6 * limb : 6 * limb + 6]
    low, high = model.jnt_range[model.dof_jntid[dof]].T
    jacobian = np.zeros((6, model.nv))
    generator = np.random.default_rng(0)
    for attempt in range(STARTS):
        share = 0.5 if attempt == 0 else generator.uniform(0.2, 0.8, 6)
        data.qpos[qpos] = low + share * (high - low)
        for _ in range(ITERATIONS):
            mujoco.mj_kinematics(model, data)
            mujoco.mj_comPos(model, data)
            error = _gripper_error(robot, data, limb, position_w_m, yaw_rad)
            if np.abs(error).max() < TOLERANCE_M:
                return True
            mujoco.mj_jacSite(model, data, jacobian[:3], jacobian[3:], robot.gripper_sites[limb])
            j = jacobian[:, dof]
            step = j.T @ np.linalg.solve(j @ j.T + DAMPING * np.eye(6), error)
            data.qpos[qpos] = np.clip(data.qpos[qpos] + np.clip(step, -0.3, 0.3), low, high)
    return False


def take_start_pose(robot: RobotModel, data: mujoco.MjData, plan: Any) -> None:
    """Body and grippers of `data` at knot 0 of `plan`, pads just touching. Raises StartPoseError when out of reach."""
    knot = plan.knots[0]
    data.qpos[:3] = knot.body_position_w_m
    mujoco.mju_mat2Quat(data.qpos[3:7], rotation_from_rpy(knot.body_rpy_rad).ravel())
    for limb, name in enumerate(robot.robot["limbs"]):
        pose = knot.limbs[limb]
        data.qpos[robot.finger_qpos[limb]] = pose.finger_separation_m / 2
        position = np.array(pose.gripper_position_w_m)
        if not solve_limb(robot, data, limb, position, pose.gripper_yaw_w_rad):
            raise StartPoseError(
                f"limb {name} cannot take its start grasp at {np.round(position, 3).tolist()} m, "
                f"yaw {pose.gripper_yaw_w_rad:.3f} rad, within its joint limits: the plan does not fit this robot"
            )
