"""What turns a limb's joints where these are not actuators themselves: section `transmissions` of robot.yaml."""

from dataclasses import dataclass

import numpy as np
from crux_msgs.robot_keys import Transmissions

from crux_planner.checker.geometry import Array


@dataclass(frozen=True, eq=False)
class Actuators:
    """J actuators of a limb of J joints: their angles are `turns` (J, J) times the joints' and `offset_rad` (J,).

    Peak torque and speed are at most what the joints' own limits ask of them.
    """

    names: tuple[str, ...]
    turns: Array
    offset_rad: Array
    low_rad: Array
    high_rad: Array
    speed_rad_s: Array
    torque_Nm: Array

    def angles_rad(self, q_rad: Array) -> Array:
        """Where the joints are at (T, J)."""
        return np.asarray(np.einsum("ij,tj->ti", self.turns, q_rad) + self.offset_rad)

    def torques_Nm(self, joints_Nm: Array) -> Array:
        """That make the joints' (T, J): power is the same on both sides, turns^T actuators = joints."""
        return np.asarray(np.linalg.solve(self.turns.T, joints_Nm.T).T)


def read_actuators(
    section: Transmissions | None, joints: tuple[str, ...], speed_rad_s: Array, effort_Nm: Array
) -> Actuators | None:
    """Of a limb with these joints, their speeds and efforts; None where each actuator is its joint. Raises ValueError
    where there is no such joint, or one that nothing moves.
    """
    if section is None or section == Transmissions():
        return None
    n = len(joints)
    turns = np.zeros((n, n))
    for i in range(n):
        turns[i, i] = section.ratio[i]
        other = int(section.coupled_to[i])
        if other > n:
            raise ValueError(f"transmissions.coupled_to: no joint {other} of {n}")
        if other:
            turns[i, other - 1] = section.coupling[i]
    asked = np.abs(turns) @ speed_rad_s, np.abs(np.linalg.solve(turns.T, np.eye(n))) @ effort_Nm
    speed, torque = np.minimum(section.speed_rad_s[:n], asked[0]), np.minimum(section.torque_Nm[:n], asked[1])
    low, high, offset = (np.array(each[:n]) for each in (section.low_rad, section.high_rad, section.offset_rad))
    return Actuators(tuple(f"{name} (actuator)" for name in joints), turns, offset, low, high, speed, torque)
