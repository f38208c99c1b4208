"""Joints where logs have actuators: what nodes speak is what /control_input and /control_output have."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np
from crux_contracts.robot import Robot
from crux_contracts.transmissions import Transmission

Floats = np.ndarray


def joints_rad(robot: Robot, actuators_rad: Floats) -> Floats:
    """(..., 4 S) angles of the joints for the actuators'."""
    return _by_limb(robot, [each.joints_rad for each in _transmissions(robot)], actuators_rad)


def actuators_rad(robot: Robot, joints_rad: Floats) -> Floats:
    """(..., 4 S) the other way round."""
    return _by_limb(robot, [each.actuators_rad for each in _transmissions(robot)], joints_rad)


def joint_speeds_rad_s(robot: Robot, actuators_rad_s: Floats) -> Floats:
    """(..., 4 S) speeds of the joints for the actuators'."""
    each = [lambda speeds, t=t: speeds @ np.linalg.inv(t.matrix).T for t in _transmissions(robot)]
    return _by_limb(robot, each, actuators_rad_s)


def joint_torques_Nm(robot: Robot, actuators_Nm: Floats) -> Floats:
    """(..., 4 S) torques that the actuators' make of the joints'."""
    each = [lambda torques, t=t: t.joint_torque_Nm(torques, torques) for t in _transmissions(robot)]
    return _by_limb(robot, each, actuators_Nm)


def _transmissions(robot: Robot) -> list[Transmission]:
    return [limb.transmission for limb in robot.limbs]


def _by_limb(robot: Robot, each: Sequence[Callable[[Floats], Floats]], values: Floats) -> Floats:
    if all(limb.transmission.direct for limb in robot.limbs):
        return values
    made = np.array(values, dtype=np.float64)
    for number, (limb, change) in enumerate(zip(robot.limbs, each, strict=True)):
        own = slice(robot.slots * number, robot.slots * number + len(limb.joints))
        made[..., own] = change(made[..., own])
    return made
