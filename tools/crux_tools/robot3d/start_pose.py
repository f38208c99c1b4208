"""Puts the model into the first knot of a plan: numeric inverse kinematics on MuJoCo's own Jacobians."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import mujoco
import numpy as np
from crux_contracts.gripper_frames import gripper_rotation
from crux_contracts.robot_bounds import JOINTS
from crux_msgs import limb_knot_t
from numpy.typing import NDArray

from crux_tools.errors import UsageError
from crux_tools.robot3d.linkages import close_linkages
from crux_tools.robot3d.robot_model import Ints, RobotModel
from crux_tools.telemetry.rotations import rotation_from_rpy

DAMPING = 1e-4  # of the least-squares step
ITERATIONS = 100
TOLERANCE_M = 1e-6  # of gripper position, and of orientation in rad
STARTS = 20

Floats = NDArray[np.float64]


class StartPoseError(UsageError):
    """The plan's first knot cannot be taken by this robot."""


def _gripper_error(robot: RobotModel, data: mujoco.MjData, limb: int, position_w_m: Floats, wanted: Floats) -> Floats:
    site = robot.gripper_sites[limb]
    present = data.site_xmat[site].reshape(3, 3)
    turn = np.empty(4)
    mujoco.mju_mat2Quat(turn, (wanted @ present.T).ravel())
    rotation = np.empty(3)
    mujoco.mju_quat2Vel(rotation, turn, 1.0)
    return np.concatenate([position_w_m - data.site_xpos[site], rotation])


def _jacobian(robot: RobotModel, data: mujoco.MjData, limb: int, dof: Ints) -> Floats:
    """(6, S) of the gripper, with `data` as it stands."""
    jacobian = np.zeros((6, robot.model.nv))
    mujoco.mj_jacSite(robot.model, data, jacobian[:3], jacobian[3:], robot.gripper_sites[limb])
    return np.asarray(jacobian[:, dof])


def _spare_ways(robot: RobotModel, data: mujoco.MjData, limb: int, qpos: Ints, dof: Ints, middle_rad: Floats) -> Floats:
    """(S - 6, S) what leaves the gripper at rest with the joints in the middle of their ranges: of the angles of seven
    joints those count that are none of it off the middle.
    """
    if len(dof) == JOINTS:
        return np.zeros((0, JOINTS))
    kept = data.qpos[qpos].copy()
    data.qpos[qpos] = middle_rad
    mujoco.mj_kinematics(robot.model, data)
    mujoco.mj_comPos(robot.model, data)
    _, _, ways = np.linalg.svd(_jacobian(robot, data, limb, dof))
    data.qpos[qpos] = kept
    return np.asarray(ways[JOINTS:])


def _limits_rad(robot: RobotModel, limb: int, dof: Ints) -> tuple[Floats, Floats]:
    """(S,) each: those of the model, and of joints what the robot's actuators leave of them."""
    low, high = robot.model.jnt_range[robot.model.dof_jntid[dof]].T
    for j, joint in enumerate(robot.robot.limbs[limb].joints):
        if joint.kind == "revolute":
            low[j], high[j] = joint.lower, joint.upper
    return low, high


def solve_limb(
    robot: RobotModel,
    data: mujoco.MjData,
    limb: int,
    position_w_m: Floats,
    rotation_w: Floats,
    near: bool = False,
    starts: int = STARTS,
) -> bool:
    """Moves the joints of `limb` until its gripper stands at the place (3,), turned by `rotation_w` (3, 3), W <-
    gripper; False when it cannot within the limits.
    `near`: begins with the joints as they are, so that a motion is followed; then from so many postures (`starts`).
    """
    model = robot.model
    slots = robot.robot.slots
    own = slice(slots * limb, slots * (limb + 1))
    qpos, dof = robot.joint_qpos[own], robot.joint_dof[own]
    low, high = _limits_rad(robot, limb, dof)
    middle = (low + high) / 2
    spare = _spare_ways(robot, data, limb, qpos, dof, middle)
    generator = np.random.default_rng(0)
    for attempt in range(-1 if near else 0, starts):
        if attempt >= 0:
            share = 0.5 if attempt == 0 else generator.uniform(0.2, 0.8, slots)
            data.qpos[qpos] = low + share * (high - low)
        for _ in range(ITERATIONS):
            mujoco.mj_kinematics(model, data)
            mujoco.mj_comPos(model, data)
            off = spare @ (middle - data.qpos[qpos])
            error = np.concatenate([_gripper_error(robot, data, limb, position_w_m, rotation_w), off])
            if np.abs(error).max() < TOLERANCE_M:
                return True
            j = np.concatenate([_jacobian(robot, data, limb, dof), spare])
            step = j.T @ np.linalg.solve(j @ j.T + DAMPING * np.eye(len(j)), error)
            data.qpos[qpos] = np.clip(data.qpos[qpos] + np.clip(step, -0.3, 0.3), low, high)
    return False


@dataclass(frozen=True)
class RobotPose:
    """Where body and grippers are, frame W; limbs LF, RF, LR, RR."""

    body_position_m: Floats  # (3,)
    body_rpy_rad: Floats  # (3,)
    gripper_position_m: Floats  # (4, 3)
    gripper_yaw_rad: Floats  # (4,)
    gripper_tilt_rad: Floats  # (4, 2), see crux_contracts.gripper_frames
    finger_opening_m: Floats  # (4,) pad face to gripper centre

    @classmethod
    def of_knot(cls, knot: Any, robot: RobotModel) -> RobotPose:
        """Pose of a plan's knot (plan_knot_t). Grippers of a walk, and on footholds, stand one pad radius above their
        foot points.
        """
        yaw = np.array([limb.gripper_yaw_w_rad for limb in knot.limbs])
        tilt = np.array([limb.gripper_tilt_w_rad for limb in knot.limbs])
        up = gripper_rotation(yaw, tilt)[..., 2]
        foot = [limb.phase == limb_knot_t.STANCE and limb.finger1_face == limb_knot_t.FACE_WALL for limb in knot.limbs]
        lift = robot.robot.gripper.pad_radius_m * (np.array(foot) | robot.point_feet)
        return cls(
            np.array(knot.body_position_w_m),
            np.array(knot.body_rpy_rad),
            np.array([limb.gripper_position_w_m for limb in knot.limbs]) + lift[:, None] * up,
            yaw,
            tilt,
            np.array([limb.finger_separation_m / 2 for limb in knot.limbs]),
        )


def take_pose(robot: RobotModel, data: mujoco.MjData, pose: RobotPose, near: bool = False) -> list[int]:
    """Moves body, limbs and fingers of `data` to `pose`, `near` as in solve_limb; returns the limbs that cannot."""
    data.qpos[:3] = pose.body_position_m
    mujoco.mju_mat2Quat(data.qpos[3:7], rotation_from_rpy(pose.body_rpy_rad).ravel())
    data.qpos[robot.finger_qpos] = pose.finger_opening_m[:, None]
    turned = gripper_rotation(pose.gripper_yaw_rad, pose.gripper_tilt_rad)
    missed = [
        limb
        for limb in range(len(pose.gripper_yaw_rad))
        if not solve_limb(robot, data, limb, pose.gripper_position_m[limb], turned[limb], near)
    ]
    close_linkages(robot.robot, robot.model, data)
    return missed


def take_start_pose(robot: RobotModel, data: mujoco.MjData, plan: Any) -> None:
    """Body and grippers of `data` at knot 0 of `plan`, pads just touching. Raises StartPoseError when out of reach."""
    pose = RobotPose.of_knot(plan.knots[0], robot)
    for limb in take_pose(robot, data, pose):
        raise StartPoseError(
            f"limb {robot.robot.limbs[limb].name} cannot take its start grasp at "
            f"{np.round(pose.gripper_position_m[limb], 3).tolist()} m, yaw {pose.gripper_yaw_rad[limb]:.3f} rad, "
            "within its joint limits: the plan does not fit this robot"
        )
