"""What the motors of a robot description must be able to do, judged beside the loads that stand elsewhere in it."""

from __future__ import annotations

import math
from collections.abc import Iterator

from crux_msgs.robot_keys import GripperMotor, Machine, Motor

from .motors import flux_Wb, joint_continuous_torque_Nm, joint_current_A
from .robot_types import Robot
from .yaml_document import Problem


def motor_problems(robot: Robot) -> Iterator[Problem]:
    """Everything that is wrong."""
    yield from _joints(robot, robot.motor)
    yield from _gripper(robot, robot.gripper_motor)


def _joints(robot: Robot, motor: Motor) -> Iterator[Problem]:
    asked_Nm = max(robot.servo.continuous_torque_Nm)
    if joint_continuous_torque_Nm(motor) < asked_Nm:
        least_A = joint_current_A(motor, asked_Nm)
        expected = f"expected at least {least_A:.3g}, for the {asked_Nm:g} Nm of continuous_torque_Nm"
        yield Problem("motor.continuous_current_A", f"{motor.continuous_current_A:g}", expected)
    fastest = max(float(limb.actuators.speed_rad_s.max()) for limb in robot.limbs) * motor.gear_ratio
    yield from _speed("motor", motor, fastest)
    yield from _voltage(robot, "motor", motor, fastest)


def _gripper(robot: Robot, motor: GripperMotor) -> Iterator[Problem]:
    low, high = robot.gripper.opening_m
    if not low <= robot.gripper.open_opening_m <= high:
        expected = f"expected {low:g}..{high:g}, opening_m"
        yield Problem("gripper.open_opening_m", f"{robot.gripper.open_opening_m:g}", expected)
    if motor.screw_efficiency >= 0.5:
        expected = "expected below 0.5: the screw must hold a squeeze by itself"
        yield Problem("gripper_motor.screw_efficiency", f"{motor.screw_efficiency:g}", expected)
    if motor.coarse_travel_m <= high - low:
        expected = f"expected more than the travel of the fingers, {high - low:g}: the encoder must not repeat in it"
        yield Problem("gripper_motor.coarse_travel_m", f"{motor.coarse_travel_m:g}", expected)
    fastest = robot.gripper.max_finger_speed_m_s / motor.screw_lead_m * 2 * math.pi
    yield from _speed("gripper_motor", motor, fastest)
    yield from _voltage(robot, "gripper_motor", motor, fastest)


def _speed(section: str, motor: Machine, fastest_rad_s: float) -> Iterator[Problem]:
    if motor.max_speed_rad_s <= fastest_rad_s:
        expected = f"expected more than the {fastest_rad_s:.4g} that the speed limit asks of the rotor"
        yield Problem(f"{section}.max_speed_rad_s", f"{motor.max_speed_rad_s:g}", expected)


def _voltage(robot: Robot, section: str, motor: Machine, fastest_rad_s: float) -> Iterator[Problem]:
    """Continuous current at full speed must be within what the supply makes: the circle of radius supply / sqrt 3."""
    electrical_rad_s = motor.pole_pairs * fastest_rad_s
    along_V = motor.resistance_ohm * motor.continuous_current_A + electrical_rad_s * flux_Wb(motor)
    across_V = electrical_rad_s * motor.inductance_H * motor.continuous_current_A
    needed_V = math.sqrt(3) * math.hypot(along_V, across_V)
    if needed_V > robot.drive.supply_V:
        expected = f"expected at least {needed_V:.3g}, for {section}'s continuous current at full speed"
        yield Problem("drive.supply_V", f"{robot.drive.supply_V:g}", expected)
