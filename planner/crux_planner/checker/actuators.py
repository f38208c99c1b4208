"""What turns a limb's joints where these are not actuators themselves: sections `transmissions` and `five_bar` of
robot.yaml.
"""

from dataclasses import dataclass

import numpy as np
from crux_msgs.robot_keys import Transmissions

from crux_planner.checker.geometry import Array, Flags
from crux_planner.checker.linkage import Linkage


@dataclass(frozen=True, eq=False)
class Actuators:
    """J actuators of a limb of J joints: their angles are `turns` (J, J) times the joints' and `offset_rad` (J,), with
    the crank of a `linkage` in the place of the second of its joints.

    Peak torque and speed are at most what the joints' own limits ask of them, but at a linkage.
    """

    names: tuple[str, ...]
    turns: Array
    offset_rad: Array
    low_rad: Array
    high_rad: Array
    speed_rad_s: Array
    torque_Nm: Array
    linkage: Linkage | None = None

    def angles_rad(self, q_rad: Array) -> Array:
        """Where the joints are at (T, J)."""
        if self.linkage is not None:
            i = self.linkage.first
            q_rad = np.array(q_rad)
            q_rad[:, i + 1] = self.linkage.crank_rad(q_rad[:, i : i + 2])
        return np.asarray(np.einsum("ij,tj->ti", self.turns, q_rad) + self.offset_rad)

    def torques_Nm(self, q_rad: Array, joints_Nm: Array) -> Array:
        """That make the joints' (T, J) with the joints at (T, J): power is the same on both sides, turns^T actuators =
        joints.
        """
        if self.linkage is not None:
            pair = slice(self.linkage.first, self.linkage.first + 2)
            joints_Nm = np.array(joints_Nm)
            joints_Nm[:, pair] = self.linkage.torques_Nm(q_rad[:, pair], joints_Nm[:, pair])
        return np.asarray(np.linalg.solve(self.turns.T, joints_Nm.T).T)

    def singular(self, q_rad: Array) -> Array | None:
        """(T,) by which the linkage is nearer to singular than it may be; infinite where its rod does not reach."""
        if self.linkage is None:
            return None
        i = self.linkage.first
        sine = self.linkage.sine(q_rad[:, i : i + 2])
        return np.where(np.isfinite(sine), self.linkage.bar.least_sine - sine, np.inf)

    def keeps(self, q_rad: Array) -> Flags:
        """(T,) whether all are within their angles, and no linkage too near to singular, with the joints at (T, J)."""
        angles = self.angles_rad(q_rad)
        kept = np.all((angles >= self.low_rad) & (angles <= self.high_rad), axis=1)
        singular = self.singular(q_rad)
        return np.asarray(kept if singular is None else kept & (singular <= 0.0))


def read_actuators(
    section: Transmissions | None,
    linkage: Linkage | None,
    joints: tuple[str, ...],
    speed_rad_s: Array,
    effort_Nm: Array,
) -> Actuators | None:
    """Of a limb with these joints, their speeds and efforts; None where each actuator is its joint. Raises ValueError
    where there is no such joint, or one that nothing moves.
    """
    if section is None or (section == Transmissions() and linkage is None):
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
    own_speed, own_torque = np.array(section.speed_rad_s[:n]), np.array(section.torque_Nm[:n])
    asked = np.abs(turns) @ speed_rad_s, np.abs(np.linalg.solve(turns.T, np.eye(n))) @ effort_Nm
    speed, torque = np.minimum(own_speed, asked[0]), np.minimum(own_torque, asked[1])
    if linkage is not None:
        pair = slice(linkage.first, linkage.first + 2)
        speed[pair], torque[pair] = own_speed[pair], own_torque[pair]
    low, high, offset = (np.array(each[:n]) for each in (section.low_rad, section.high_rad, section.offset_rad))
    names = tuple(f"{name} (actuator)" for name in joints)
    return Actuators(names, turns, offset, low, high, speed, torque, linkage)
