"""What follows from the motors of a robot description."""

from __future__ import annotations

import math

from crux_msgs.robot_keys import GripperMotor, Machine, Motor


def flux_Wb(motor: Machine) -> float:
    """Peak flux of the magnets through a phase: torque = 3/2 pole pairs flux current."""
    return motor.torque_constant_Nm_A / (1.5 * motor.pole_pairs)


def joint_current_A(motor: Motor, torque_Nm: float) -> float:
    """Amplitude that makes a torque of the joint."""
    return torque_Nm / (motor.gear_ratio * motor.gear_efficiency * motor.torque_constant_Nm_A)


def joint_continuous_torque_Nm(motor: Motor) -> float:
    """Torque of the joint that the winding bears continuously."""
    return motor.continuous_current_A * motor.gear_ratio * motor.gear_efficiency * motor.torque_constant_Nm_A


def finger_current_A(motor: GripperMotor, force_N: float) -> float:
    """Amplitude that builds a squeeze of both fingers."""
    rotor_torque_Nm = 2 * force_N * motor.screw_lead_m / (2 * math.pi * motor.screw_efficiency)
    return rotor_torque_Nm / motor.torque_constant_Nm_A


def of_both_fingers(motor: GripperMotor, at_finger: float) -> float:
    """Mass [kg] or damping [Ns/m] of a finger as inertia [kg m2] or drag [Nms/rad] of the rotor."""
    return 2 * at_finger * (motor.screw_lead_m / (2 * math.pi)) ** 2
