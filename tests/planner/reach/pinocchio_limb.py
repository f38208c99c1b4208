"""One limb as Pinocchio and Coal have it, from the same URDF: gripper poses, and how far links are off the trunk."""

from __future__ import annotations

import coal
import numpy as np
import pinocchio as pin
from crux_contracts.robot import Robot
from crux_planner.model.arrays import Array
from crux_planner.reach.poses import GripperPoses


class PinocchioLimb:
    """Fingers are as wide open as they go; cylinders are the capsules that touch their faces, as in the check."""

    def __init__(self, robot: Robot, limb: int) -> None:
        self.limb = robot.limbs[limb]
        self.model = pin.buildModelFromUrdf(str(robot.urdf_path))
        self.data = self.model.createData()
        self.full = pin.neutral(self.model)
        self._at = [self.model.joints[self.model.getJointId(name)].idx_q for name in self.limb.joint_names]
        for name in self.limb.finger_joints:
            index = self.model.joints[self.model.getJointId(name)].idx_q
            self.full[index] = self.model.upperPositionLimit[index]
        shapes = pin.buildGeomFromUrdf(self.model, str(robot.urdf_path), pin.GeometryType.VISUAL).geometryObjects
        own = [self.model.getJointId(name) for name in (*self.limb.joint_names, *self.limb.finger_joints)]
        self._first = [shape for shape in shapes if shape.parentJoint == own[0]]
        self._links = [shape for shape in shapes if shape.parentJoint in own[1:]]
        self._trunk = [shape for shape in shapes if shape.parentJoint == 0]
        assert len(self._links) == 7  # link 5 has no shape
        assert len(self._trunk) == 1

    def pose(self, q_rad: Array) -> tuple[Array, Array]:
        """Place (3,) and rotation (3, 3) of the gripper in the body frame."""
        self.full[self._at] = q_rad
        pin.framesForwardKinematics(self.model, self.data, self.full)
        place = self.data.oMf[self.model.getFrameId(self.limb.gripper_link)]
        return place.translation.copy(), place.rotation.copy()

    def wrist(self, q_rad: Array) -> tuple[Array, Array]:
        """Place of the wrist and rotation of the forearm in the body frame."""
        self.pose(q_rad)
        third, fourth = (self.data.oMi[self.model.getJointId(self.limb.joint_names[i])] for i in (2, 3))
        return fourth.translation.copy(), third.rotation.copy()

    def off_trunk_m(self, q_rad: Array, links: int | None = None) -> float:
        """Least distance of a link, or of the first so many, to the trunk; 0 or less where it is in it."""
        self.pose(q_rad)
        trunk = [_placed(shape, shape.placement) for shape in self._trunk]
        return min(_distance(self._shape(link), other) for link in self._links[:links] for other in trunk)

    def apart_m(self, q_rad: Array, other: PinocchioLimb, other_q_rad: Array) -> float:
        """Least distance between links of two limbs; 0 or less where they are in each other."""
        self.pose(q_rad)
        other.pose(other_q_rad)
        mine, theirs = ([each._shape(link) for link in (*each._first, *each._links)] for each in (self, other))
        return min(_distance(one, two) for one in mine for two in theirs)

    def links_m(self, q_rad: Array) -> list[tuple[Array, Array, float]]:
        """Ends and radius of the capsules, the palm's box left out; the first link last."""
        self.pose(q_rad)
        found = []
        for shape, at in (self._shape(link) for link in (*self._links, *self._first)):
            if not isinstance(shape, coal.Box):
                half = shape.halfLength if isinstance(shape, coal.Capsule) else 0.0
                way = at.getRotation() @ np.array([0.0, 0.0, half])
                found.append((at.getTranslation() - way, at.getTranslation() + way, shape.radius))
        return found

    def upright(self, q_rad: Array, tilt_rad: Array) -> Array:
        """The angles with joints 4 and 5 such that the gripper is upright under a body with this roll and pitch."""
        _, forearm = self.wrist(q_rad)
        up = forearm.T @ pin.rpy.rpyToMatrix(tilt_rad[0], tilt_rad[1], 0.0).T @ [0.0, 0.0, 1.0]
        q = q_rad.copy()
        q[3], q[4] = np.arctan2(up[0], up[2]), -np.arcsin(up[1])
        return q

    def seen(self, q_rad: Array, tilt_rad: Array) -> tuple[float, ...]:
        """x, y, z, yaw, roll and pitch of `GripperPoses`; the yaw continuous with joint 6."""
        place, rotation = self.pose(q_rad)
        tilt = pin.rpy.rpyToMatrix(tilt_rad[0], tilt_rad[1], 0.0)
        level = tilt @ rotation
        assert np.abs(level[:, 2] - [0.0, 0.0, 1.0]).max() < 1e-9
        near = q_rad[0] + q_rad[5] + self.limb.mount_rad + self.limb.gripper_mount_rad
        yaw = np.arctan2(level[1, 0], level[0, 0])
        return (*(tilt @ place), yaw + 2 * np.pi * np.round((near - yaw) / (2 * np.pi)), *tilt_rad)

    def _shape(self, link: pin.GeometryObject) -> Placed:
        return _placed(link, self.data.oMi[link.parentJoint] * link.placement)


Placed = tuple[coal.CollisionGeometry, coal.Transform3s]


def _placed(link: pin.GeometryObject, at: pin.SE3) -> Placed:
    shape = link.geometry
    if isinstance(shape, coal.Cylinder):
        shape = coal.Capsule(shape.radius, max(2 * shape.halfLength - 2 * shape.radius, 0.0))
    return shape, coal.Transform3s(at.rotation, at.translation)


def _distance(one: Placed, other: Placed) -> float:
    return float(coal.distance(*one, *other, coal.DistanceRequest(), coal.DistanceResult()))


def poses_of(rows: list[tuple[float, ...]]) -> GripperPoses:
    """Of (x, y, z, yaw, roll, pitch) each."""
    return GripperPoses(*np.array(rows).reshape(-1, 6).T)


def drawn(
    other: PinocchioLimb, random: np.random.Generator, count: int, margin_rad: float, tilt_rad: float
) -> tuple[Array, GripperPoses]:
    """Angles (n, 6) within limits by a margin, at which grippers are upright, and their poses."""
    limb = other.limb
    kept: list[Array] = []
    rows: list[tuple[float, ...]] = []
    while len(kept) < count:
        tilt = random.uniform(-tilt_rad, tilt_rad, 2)
        q = other.upright(random.uniform(limb.lower_rad + margin_rad, limb.upper_rad - margin_rad), tilt)
        if np.minimum(q - limb.lower_rad, limb.upper_rad - q).min() >= margin_rad:
            kept.append(q)
            rows.append(other.seen(q, tilt))
    return np.array(kept), poses_of(rows)
