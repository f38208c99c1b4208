"""(9a) as the robot's real limbs have it: every gripper pose along the way is reached within the joint limits, at the
plan's own clock within the speed limits, and the planned wrenches are held within the joints' torques.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from crux_planner.checker import inverse_kinematics, tolerances
from crux_planner.checker.geometry import Array, rotation_about_z
from crux_planner.checker.limb_model import WholeRobot
from crux_planner.checker.report import Findings, JointLoad
from crux_planner.checker.sampling import Samples


@dataclass(frozen=True)
class LimbMotion:
    """Joint angles (T, J) and torques (T, J) of one limb at the samples, and where they reach the planned pose (T,)."""

    q_rad: Array
    torque_Nm: Array
    reached: NDArray[np.bool_]


def check_kinematics(
    samples: Samples, robot: WholeRobot, gravity_w: Array, continuous_Nm: Array, findings: Findings
) -> tuple[list[LimbMotion], list[JointLoad]]:
    """Inverse kinematics of every limb at every sample; returns the motions and the loads of all joints."""
    inverse = samples.rotation.swapaxes(1, 2)
    gravity_b = inverse @ gravity_w
    motions, loads = [], []
    for index, limb in enumerate(robot.limbs):
        offset = samples.gripper_position[:, index] - samples.body_position
        position_b = (inverse @ offset[..., None])[..., 0]
        rotation_b = inverse @ rotation_about_z(samples.gripper_yaw[:, index])
        solution = inverse_kinematics.solve(limb, position_b, rotation_b)
        times, q = samples.time_s, solution.q_rad
        findings.add_series(
            "inverse_kinematics", solution.position_error_m, times, "m", tolerance=tolerances.LENGTH_M, limb=index
        )
        findings.add_series(
            "inverse_kinematics_orientation",
            solution.rotation_error_rad,
            times,
            "rad",
            tolerance=tolerances.ANGLE_RAD,
            limb=index,
        )
        reached = (solution.position_error_m <= tolerances.LENGTH_M) & (
            solution.rotation_error_rad <= tolerances.ANGLE_RAD
        )
        state = limb.forward(q, samples.opening[:, index])
        torque = limb.gravity_torque(state, gravity_b) + limb.contact_torque(
            state,
            (inverse @ samples.force[:, index, :, None])[..., 0],
            (inverse @ samples.moment[:, index, :, None])[..., 0],
        )
        speed = np.zeros_like(q)
        speed[1:] = np.abs(np.diff(q, axis=0)) / np.diff(times)[:, None]
        speed[1:][~(reached[1:] & reached[:-1])] = 0.0
        beyond = np.maximum(limb.lower_rad - q, q - limb.upper_rad)
        for j, joint in enumerate(limb.joints):
            name = joint.name
            for constraint, amount, tolerance, unit in (
                ("joint_position", beyond[:, j], tolerances.ANGLE_RAD, "rad"),
                ("joint_speed", speed[:, j] - joint.velocity, tolerances.RATE_RAD_S, "rad/s"),
                ("joint_torque", np.abs(torque[:, j]) - joint.effort, tolerances.TORQUE_NM, "N m"),
            ):
                # a pose out of reach is reported once, as such
                applies = np.where(reached, amount, -np.inf)
                findings.add_series(constraint, applies, times, unit, tolerance=tolerance, limb=index, detail=name)
            mean_square = np.trapezoid(torque[:, j] ** 2, times) / (times[-1] - times[0])
            loads.append(
                JointLoad(
                    limb.name,
                    name,
                    float(np.abs(torque[:, j]).max()),
                    float(np.sqrt(mean_square)),
                    joint.effort,
                    float(continuous_Nm[j]),
                    float(speed[:, j].max()),
                    joint.velocity,
                )
            )
        motions.append(LimbMotion(q, torque, reached))
    return motions, loads
