"""A robot as typed values."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TypeVar

import numpy as np
from crux_msgs.robot_keys import Sections
from numpy.typing import NDArray

from .robot_bounds import MAX_EFFORT, MOST_JOINTS, STILL_RAD
from .transmissions import Limits, Transmission
from .urdf import Joint, Urdf

Array = NDArray[np.float64]


T = TypeVar("T")


def of_slots(values: Sequence[T]) -> tuple[T, ...]:
    """Of each of the MOST_JOINTS slots that messages and nodes have for a limb: values of its joints, then the last
    one's for slots without a joint.
    """
    return (*values, *[values[-1]] * (MOST_JOINTS - len(values)))


@dataclass(frozen=True)
class AtZero:
    """A limb with all its joints at 0, in the body frame: all that kinematics needs of a chain of revolute joints.

    S is 6, or 7 where a limb of the robot has so many joints: behind a limb's own joints come turns about axes of the
    gripper, through its origin, that it has no joint for. They stay at 0.
    """

    axes: Array
    """(S, 3) unit vectors; zero where there is nothing more to turn."""
    points_m: Array
    """(S, 3), one on each axis: the origin of the link behind the joint,"""
    rotations: Array
    """(S, 3, 3) and how that link is turned."""
    gripper_m: Array
    gripper_rotation: Array


@dataclass(frozen=True)
class Limb:
    """One limb as YAML and URDF describe it together; SI units. Arrays have one value a joint, shoulder outwards, and
    one for each turn that stays at 0 (see AtZero).

    Angles are those of the closed form, about the axes of robot_bounds.JOINT_AXES; joints count them times `senses`.
    Where there is no closed form they are the joints' own, and the lengths below are only how large the limb is.
    """

    name: str
    bus: int
    joints: tuple[Joint, ...]
    gripper_link: str
    finger_joints: tuple[str, str]
    senses: Array
    """(S,) -1 for joints that turn against the axis of the closed form, else 1."""
    shoulder_b_m: Array
    """(3,) where the first three axes start, body frame."""
    mount_rad: float
    """Direction of the limb at q1 = 0, about the body's z."""
    upper_link_m: float
    lower_link_m: float
    wrist_to_gripper_m: float
    """Along the gripper's -z."""
    gripper_mount_rad: float
    """Turn of the gripper on the last joint, about its z."""
    hand_mass_kg: float
    """Of what hangs on the F/T sensor: gripper and fingers."""
    hand_com_g_m: Array
    """(3,) its centre of mass with the fingers half open, gripper frame."""
    closed_form: bool
    """Whether all limbs yaw, pitch and pitch, have a spherical wrist, and are mirror images of one another."""
    at_zero: AtZero
    transmission: Transmission
    """Between the joints, whose limits are as far as the actuators let them, and"""
    actuators: Limits
    """(J,) the actuators: what their nodes take."""
    branch_rad: Array | None = None
    """(2, J) least and most at which a joint keeps the limb on one branch, see one_branch; None: wherever it is."""

    @property
    def joint_names(self) -> tuple[str, ...]:
        return tuple(joint.name for joint in self.joints)

    @property
    def still(self) -> int:
        """How many turns stay at 0, behind the joints."""
        return len(self.at_zero.axes) - len(self.joints)

    @property
    def lower_rad(self) -> Array:
        """(S,) of what plans keep to."""
        own = self._ends_rad[0]
        own = own if self.branch_rad is None else np.maximum(own, self.branch_rad[0])
        return np.array([*own, *[-STILL_RAD] * self.still])

    @property
    def upper_rad(self) -> Array:
        """(S,)"""
        own = self._ends_rad[1]
        own = own if self.branch_rad is None else np.minimum(own, self.branch_rad[1])
        return np.array([*own, *[STILL_RAD] * self.still])

    @property
    def middle_rad(self) -> Array:
        """(S,) of the joints' whole ranges: the posture whose branch of inverse kinematics all programs take."""
        return np.array([*self._ends_rad.mean(axis=0), *[0.0] * self.still])

    @property
    def _ends_rad(self) -> Array:
        """(2, J)"""
        ends = [(joint.lower, joint.upper) for joint in self.joints]
        return np.array(
            [end if sense > 0 else (-end[1], -end[0]) for end, sense in zip(ends, self.senses, strict=False)]
        ).T

    @property
    def longest_m(self) -> float:
        """How far the gripper is from the first joint at most."""
        places = np.vstack([self.at_zero.points_m, self.at_zero.gripper_m])
        return float(np.linalg.norm(np.diff(places, axis=0), axis=1).sum())

    @property
    def effort_Nm(self) -> Array:
        """(S,) peak torque."""
        return np.array([*(joint.effort for joint in self.joints), *[MAX_EFFORT] * self.still])


@dataclass(frozen=True)
class Robot(Sections):
    name: str
    folder: Path
    urdf_path: Path
    urdf: Urdf
    body_link: str
    limbs: tuple[Limb, Limb, Limb, Limb]
    hash: str = field(repr=False)

    @property
    def closed_form(self) -> bool:
        """Whether the limbs have closed-form kinematics."""
        return all(limb.closed_form for limb in self.limbs)

    @property
    def slots(self) -> int:
        """Of each limb in logs and physics: six, or seven where a limb has so many joints."""
        return len(self.limbs[0].at_zero.axes)

    @property
    def dt_s(self) -> float:
        """Of a control cycle."""
        return 1.0 / self.can.rate_Hz

    @property
    def total_mass_kg(self) -> float:
        """kg, of the body and all limbs."""
        return self.urdf.total_mass_kg
