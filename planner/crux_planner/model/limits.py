"""What of a robot bounds swings and joint torques."""

from __future__ import annotations

from dataclasses import dataclass

from crux_contracts.robot import Limb, Robot
from crux_contracts.urdf import Link


@dataclass(frozen=True)
class SwingLimits:
    """What bounds a swing."""

    dt_s: float
    speed_m_s: float
    yaw_rate_rad_s: float
    clearance_m: float  # of the middle of a finger to cuboids
    body_clearance_m: float  # of palms and fingers among grippers and beside tall cuboids
    max_height_m: float  # of a pad above the wall


@dataclass(frozen=True)
class LimbMasses:
    """Links 1..6 in their own frames; gripper and fingers together in the gripper frame."""

    limb: Limb
    links: tuple[Link, ...]


def limb_masses(robot: Robot, limb: Limb) -> LimbMasses:
    """The masses of a limb from the robot description."""
    return LimbMasses(limb, tuple(robot.urdf.links[joint.child] for joint in limb.joints))
