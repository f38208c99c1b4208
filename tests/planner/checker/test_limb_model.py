"""Chains, torques and inertia against pinocchio, which reads the same URDF by itself."""

from typing import Any

import numpy as np
import pinocchio as pin
import pytest
from crux_contracts.robot import load_robot
from crux_planner.checker.inverse_kinematics import arm_of
from crux_planner.checker.limb_model import load_model
from hypothesis import given, settings
from hypothesis import strategies as st

ROBOT = load_robot("scaler")
MODEL = load_model(ROBOT)
ORACLE: Any = pin.buildModelFromUrdf(str(ROBOT.urdf_path))

seeds = st.integers(0, 2**32 - 1)


def posture(seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Joint angles (4, 6), openings (4,) and the same as pinocchio's configuration."""
    random = np.random.default_rng(seed)
    q = np.array([random.uniform(limb.lower_rad, limb.upper_rad) for limb in MODEL.limbs])
    opening = random.uniform(*ROBOT.gripper.opening_m, 4)
    configuration = pin.neutral(ORACLE)
    for i, limb in enumerate(ROBOT.limbs):
        for j, name in enumerate(limb.joint_names):
            configuration[ORACLE.joints[ORACLE.getJointId(name)].idx_q] = q[i, j]
        for name in limb.finger_joints:
            configuration[ORACLE.joints[ORACLE.getJointId(name)].idx_q] = opening[i]
    return q, opening, configuration


def columns(limb: int) -> list[int]:
    return [ORACLE.joints[ORACLE.getJointId(name)].idx_v for name in ROBOT.limbs[limb].joint_names]


@given(seeds)
@settings(max_examples=30, deadline=None)
def test_poses_and_jacobians(seed: int) -> None:
    q, opening, configuration = posture(seed)
    data = ORACLE.createData()
    pin.computeJointJacobians(ORACLE, data, configuration)
    pin.updateFramePlacements(ORACLE, data)
    for i, limb in enumerate(MODEL.limbs):
        state = limb.forward(q[i : i + 1], opening[i : i + 1])
        for link in limb.links:
            frame = data.oMf[ORACLE.getFrameId(link.name, pin.FrameType.BODY)]
            np.testing.assert_allclose(state.link_position_m[link.name][0], frame.translation, atol=1e-12)
            np.testing.assert_allclose(state.link_rotation[link.name][0], frame.rotation, atol=1e-12)
        gripper = ORACLE.getFrameId(limb.gripper, pin.FrameType.BODY)
        wanted = pin.getFrameJacobian(ORACLE, data, gripper, pin.ReferenceFrame.LOCAL_WORLD_ALIGNED)[:, columns(i)]
        arm, mounting = arm_of(limb)
        position, rotation, jacobian = arm.forward(q[i : i + 1])
        placed = data.oMf[gripper]
        for had, seen in zip(
            (position, rotation), mounting.seen(placed.translation[None], placed.rotation[None]), strict=True
        ):
            np.testing.assert_allclose(had, seen, atol=1e-12)
        by_angle = mounting.rotation_b @ jacobian.reshape(2, 3, 6)
        np.testing.assert_allclose(by_angle.reshape(6, 6), wanted, atol=1e-12)


@given(seeds)
@settings(max_examples=30, deadline=None)
def test_static_torques(seed: int) -> None:
    """Gravity and a wrench at the gripper, against the recursive Newton-Euler algorithm with an external force."""
    q, opening, configuration = posture(seed)
    random = np.random.default_rng(seed + 1)
    gravity, force, moment = random.uniform(-10, 10, 3), random.uniform(-50, 50, 3), random.uniform(-2, 2, 3)
    model = pin.Model(ORACLE)
    model.gravity.linear = gravity
    data = model.createData()
    pin.framesForwardKinematics(model, data, configuration)
    for i, limb in enumerate(MODEL.limbs):
        frame_id = model.getFrameId(limb.gripper, pin.FrameType.BODY)
        frame, joint = data.oMf[frame_id], model.frames[frame_id].parentJoint
        external = pin.StdVec_Force()
        external.extend([pin.Force.Zero() for _ in range(model.njoints)])
        in_frame = pin.Force(frame.rotation.T @ force, frame.rotation.T @ moment)
        external[joint] = model.frames[frame_id].placement.act(in_frame)
        zero = np.zeros(model.nv)
        expected = pin.rnea(model, model.createData(), configuration, zero, zero, external)[columns(i)]
        state = limb.forward(q[i : i + 1], opening[i : i + 1])
        torque = limb.gravity_torque(state, gravity[None]) + limb.contact_torque(state, force[None], moment[None])
        np.testing.assert_allclose(torque[0], expected, atol=1e-9)


def test_mass_and_composite_inertia() -> None:
    q, opening, configuration = posture(7)
    data = ORACLE.createData()
    assert pytest.approx(9.6) == MODEL.mass_kg
    free = pin.buildModelFromUrdf(str(ROBOT.urdf_path), pin.JointModelFreeFlyer())
    data = free.createData()
    still = np.concatenate([[0, 0, 0, 0, 0, 0, 1], configuration])
    pin.ccrba(free, data, still, np.zeros(free.nv))
    states = [limb.forward(q[i : i + 1], opening[i : i + 1]) for i, limb in enumerate(MODEL.limbs)]
    np.testing.assert_allclose(MODEL.inertia(states, 0), data.Ig.inertia, atol=1e-12)


@given(seeds)
@settings(max_examples=10, deadline=None)
def test_centre_of_mass(seed: int) -> None:
    q, opening, configuration = posture(seed)
    states = [limb.forward(q[i : i + 1], opening[i : i + 1]) for i, limb in enumerate(MODEL.limbs)]
    free = pin.buildModelFromUrdf(str(ROBOT.urdf_path), pin.JointModelFreeFlyer())  # with the base's own mass
    still = np.concatenate([[0, 0, 0, 0, 0, 0, 1], configuration])
    expected = pin.centerOfMass(free, free.createData(), still)
    np.testing.assert_allclose(MODEL.centre_of_mass(states)[0], expected, atol=1e-12)
