"""(9a) as the robot's real limbs have it: every gripper pose along the way is reached within the joint limits, at the
plan's own clock within the speed limits, and the planned wrenches are held within the joints' torques.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np

from crux_planner.checker import inverse_kinematics, tolerances
from crux_planner.checker.geometry import Array, Flags, turned_back
from crux_planner.checker.limb_model import ChainState, Limb, WholeRobot
from crux_planner.checker.report import Findings, JointLoad
from crux_planner.checker.sampling import Samples


@dataclass(frozen=True)
class LimbMotion:
    """Links of one limb at the samples, and where it reaches its pose (T,)."""

    state: ChainState
    reached: Flags


@dataclass(frozen=True)
class Turning:
    """Joints or actuators of a limb: angles and torques (T, J), and their limits (J,)."""

    what: str
    names: tuple[str, ...]
    angle_rad: Array
    torque_Nm: Array
    low_rad: Array
    high_rad: Array
    most_rad_s: Array
    most_Nm: Array


def check_kinematics(
    samples: Samples, robot: WholeRobot, gravity_w: Array, continuous_Nm: Array, findings: Findings
) -> tuple[list[LimbMotion], list[JointLoad], list[JointLoad]]:
    """Inverse kinematics of every limb at every sample; returns the motions and the loads of all joints, and of all
    actuators that are none.
    """
    turn, body, limbs = samples.rotation, samples.body_position, range(len(robot.limbs))
    solutions = inverse_kinematics.solve(
        robot.limbs,
        [turned_back(turn, samples.gripper_position[:, i] - body) for i in limbs],
        [_gripper_in_body(turn, samples, i) for i in limbs],
    )
    motions: list[LimbMotion] = []
    loads: list[JointLoad] = []
    actuators: list[JointLoad] = []
    for index, (limb, solution) in enumerate(zip(robot.limbs, solutions, strict=True)):
        times, q = samples.time_s, solution.q_rad
        findings.add_series("inverse_kinematics", solution.position_error_m, times, "m", limb=index)
        findings.add_series("inverse_kinematics_orientation", solution.rotation_error_rad, times, "rad", limb=index)
        reached = solution.position_error_m <= tolerances.LENGTH_M
        reached = reached & (solution.rotation_error_rad <= tolerances.ANGLE_RAD)
        state = limb.forward(q, samples.opening[:, index])
        torque = held_torque(limb, state, samples, index, gravity_w)
        speeds, efforts = (np.array([getattr(each, key) for each in limb.joints]) for key in ("velocity", "effort"))
        names = tuple(joint.name for joint in limb.joints)
        turning = Turning("joint", names, q, torque, limb.lower_rad, limb.upper_rad, speeds, efforts)
        loads += _check_turning(turning, limb.name, reached, times, continuous_Nm, index, findings)
        if (by := limb.actuators) is not None:
            moved, borne = by.angles_rad(q), by.torques_Nm(q, torque)
            turning = Turning("actuator", by.names, moved, borne, by.low_rad, by.high_rad, by.speed_rad_s, by.torque_Nm)
            actuators += _check_turning(turning, limb.name, reached, times, continuous_Nm, index, findings)
            if (singular := by.singular(q)) is not None:
                findings.add_series("linkage_singular", np.where(reached, singular, -np.inf), times, "sine", limb=index)
        motions.append(LimbMotion(state, reached))
    return motions, loads, actuators


def _check_turning(
    turning: Turning, limb: str, reached: Flags, times: Array, continuous_Nm: Array, number: int, findings: Findings
) -> list[JointLoad]:
    """Loads of each."""
    angle, size = turning.angle_rad, np.abs(turning.torque_Nm)
    speed = np.zeros_like(angle)
    speed[1:] = np.abs(np.diff(angle, axis=0)) / np.diff(times)[:, None]
    speed[1:][~(reached[1:] & reached[:-1])] = 0.0
    beyond = np.maximum(turning.low_rad - angle, angle - turning.high_rad)
    mean_square = np.trapezoid(turning.torque_Nm**2, times, axis=0) / (times[-1] - times[0])
    for j, name in enumerate(turning.names):
        for constraint, amount, tolerance, unit in (
            ("position", beyond[:, j], tolerances.ANGLE_RAD, "rad"),
            ("speed", speed[:, j] - turning.most_rad_s[j], tolerances.RATE_RAD_S, "rad/s"),
            ("torque", size[:, j] - turning.most_Nm[j], tolerances.TORQUE_NM, "N m"),
        ):
            # a pose out of reach is reported once, as such
            applies = np.where(reached, amount, -np.inf)
            where: dict[str, Any] = {"tolerance": tolerance, "limb": number, "detail": name, "joint": j}
            findings.add_series(f"{turning.what}_{constraint}", applies, times, unit, **where)
    columns = (size.max(axis=0), np.sqrt(mean_square), turning.most_Nm, continuous_Nm[: len(turning.names)],
               speed.max(axis=0), turning.most_rad_s)  # fmt: skip
    rows = zip(turning.names, *(column.tolist() for column in columns), strict=True)
    return [JointLoad(limb, *row) for row in rows]


def held_torque(limb: Limb, state: ChainState, samples: Samples, index: int, gravity_w: Array) -> Array:
    """Joint torques (T, J) of limb number `index` for its own weight and the samples' wrench at its gripper."""
    vectors = gravity_w, samples.force[:, index], samples.moment[:, index]
    gravity_b, *wrench_b = (turned_back(samples.rotation, vector) for vector in vectors)
    return limb.gravity_torque(state, gravity_b) + limb.contact_torque(state, *wrench_b)


def _gripper_in_body(rotation: Array, samples: Samples, limb: int) -> Array:
    """Of a limb's gripper, (T, 3, 3), for body rotations (T, 3, 3)."""
    if samples.gripper_tilt[:, limb].any():
        return np.asarray(np.swapaxes(rotation, 1, 2) @ samples.gripper_rotation[:, limb])
    yaw = samples.gripper_yaw[:, limb]
    x, y = rotation[:, 0].T, rotation[:, 1].T
    sine, cosine = np.sin(yaw), np.cos(yaw)
    return np.array([cosine * x + sine * y, cosine * y - sine * x, rotation[:, 2].T]).T
