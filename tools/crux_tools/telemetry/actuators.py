"""Joints where logs have actuators: what nodes speak is what /control_input and /control_output have."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
from crux_contracts.robot import Robot
from crux_contracts.transmissions import Transmission

Floats = np.ndarray


def joints_rad(robot: Robot, actuators_rad: Floats) -> Floats:
    """(..., 4 S) angles of the joints for the actuators'."""
    return _by_limb(robot, Transmission.joints_rad, actuators_rad)


def actuators_rad(robot: Robot, joints_rad: Floats) -> Floats:
    """(..., 4 S) the other way round."""
    return _by_limb(robot, Transmission.actuators_rad, joints_rad)


def joint_speeds_rad_s(robot: Robot, actuators_rad: Floats, actuators_rad_s: Floats) -> Floats:
    """(..., 4 S) speeds of the joints for the actuators', where these are at `actuators_rad`."""

    def change(by: Transmission, at: Floats, speeds: Floats) -> Floats:
        return np.asarray((np.linalg.inv(by.slope(by.joints_rad(at))) @ speeds[..., None])[..., 0])

    return _by_limb(robot, change, actuators_rad, actuators_rad_s)


def joint_torques_Nm(robot: Robot, actuators_rad: Floats, actuators_Nm: Floats) -> Floats:
    """(..., 4 S) torques that the actuators' make of the joints', likewise."""
    return _by_limb(robot, lambda by, at, Nm: by.joint_torque_Nm(by.joints_rad(at), Nm), actuators_rad, actuators_Nm)


def _by_limb(robot: Robot, change: Callable[..., Floats], *values: Floats) -> Floats:
    if all(limb.transmission.direct for limb in robot.limbs):
        return values[-1]
    made = np.array(values[-1], dtype=np.float64)
    for number, limb in enumerate(robot.limbs):
        own = slice(robot.slots * number, robot.slots * number + len(limb.joints))
        made[..., own] = change(limb.transmission, *(each[..., own] for each in values))
    return made
