"""Parameters of the drives of a robot's nodes, derived from its description (see core/drive/motor.h for meaning)."""

from __future__ import annotations

import ctypes
import math

from crux_contracts.motors import finger_current_A, flux_Wb, joint_current_A, of_both_fingers
from crux_contracts.robot import Robot
from crux_contracts.robot_types import of_slots
from crux_msgs.robot_keys import Machine

BANDWIDTH_OF_SWING = 25.0  # of a gripper's current loop, against the frequency its fingers swing with


class MotorParameters(ctypes.Structure):
    """crux_motor_parameters."""

    _fields_ = [
        ("pole_pairs", ctypes.c_uint32),
        ("resistance_ohm", ctypes.c_float),
        ("inductance_H", ctypes.c_float),
        ("flux_Wb", ctypes.c_float),
        ("peak_current_A", ctypes.c_float),
        ("continuous_current_A", ctypes.c_float),
        ("heating_time_s", ctypes.c_float),
        ("bandwidth_rad_s", ctypes.c_float),
        ("max_speed_rad_s", ctypes.c_float),
        ("encoder_counts", ctypes.c_uint32),
        ("supply_V", ctypes.c_float),
        ("temperature_limit_degC", ctypes.c_float),
    ]


class GearParameters(ctypes.Structure):
    """crux_gear_parameters."""

    _fields_ = [("ratio", ctypes.c_float), ("efficiency", ctypes.c_float)]


class ScrewParameters(ctypes.Structure):
    """crux_screw_parameters."""

    _fields_ = [
        ("lead_m", ctypes.c_float),
        ("efficiency", ctypes.c_float),
        ("release_torque", ctypes.c_float),
        ("inertia_kg_m2", ctypes.c_float),
        ("drag_Nms_rad", ctypes.c_float),
    ]


class JointDriveParameters(ctypes.Structure):
    """crux_joint_drive_parameters."""

    _fields_ = [("motor", MotorParameters), ("gear", GearParameters)]


class GripperDriveParameters(ctypes.Structure):
    """crux_gripper_drive_parameters."""

    _fields_ = [("motor", MotorParameters), ("screw", ScrewParameters), ("coarse_travel_m", ctypes.c_float)]


def _motor(
    robot: Robot, motor: Machine, peak_current_A: float, bandwidth_rad_s: float, temperature_limit_degC: float
) -> MotorParameters:
    return MotorParameters(
        pole_pairs=motor.pole_pairs,
        resistance_ohm=motor.resistance_ohm,
        inductance_H=motor.inductance_H,
        flux_Wb=flux_Wb(motor),
        peak_current_A=peak_current_A,
        continuous_current_A=min(motor.continuous_current_A, peak_current_A),
        heating_time_s=motor.heating_time_s,
        bandwidth_rad_s=bandwidth_rad_s,
        max_speed_rad_s=motor.max_speed_rad_s,
        encoder_counts=robot.drive.encoder_counts,
        supply_V=robot.drive.supply_V,
        temperature_limit_degC=temperature_limit_degC,
    )


def joint_drive_parameters(robot: Robot) -> list[JointDriveParameters]:
    """Of the 28 slots of joints, limb-major: the peak current makes the joint's peak torque."""
    motor, servo = robot.motor, robot.servo
    bandwidth_rad_s = 1 / servo.torque_time_constant_s
    return [
        JointDriveParameters(
            motor=_motor(
                robot, motor, joint_current_A(motor, effort_Nm), bandwidth_rad_s, servo.temperature_limit_degC
            ),
            gear=GearParameters(ratio=motor.gear_ratio, efficiency=motor.gear_efficiency),
        )
        for limb in robot.limbs
        for effort_Nm in of_slots(limb.actuators.torque_Nm.tolist())
    ]


def gripper_drive_parameters(robot: Robot) -> list[GripperDriveParameters]:
    """Of the four grippers: the peak current builds the greatest finger force."""
    gripper, motor = robot.gripper, robot.gripper_motor
    peak_current_A = finger_current_A(motor, gripper.max_finger_force_N)
    # The fingers' mass swings on the stiffness of the loop above, and each millisecond of delay undamps it.
    bandwidth_rad_s = BANDWIDTH_OF_SWING * math.sqrt(gripper.stiffness_N_m / gripper.moving_mass_kg)
    return [
        GripperDriveParameters(
            motor=_motor(robot, motor, peak_current_A, bandwidth_rad_s, gripper.temperature_limit_degC),
            screw=ScrewParameters(
                lead_m=motor.screw_lead_m,
                efficiency=motor.screw_efficiency,
                release_torque=motor.screw_release_torque,
                inertia_kg_m2=of_both_fingers(motor, gripper.moving_mass_kg),
                drag_Nms_rad=of_both_fingers(motor, gripper.screw_damping_Ns_m),
            ),
            coarse_travel_m=motor.coarse_travel_m,
        )
        for _ in robot.limbs
    ]
