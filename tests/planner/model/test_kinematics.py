"""Closed-form kinematics against Pinocchio, which reads the same URDF."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import casadi as ca
import numpy as np
import pinocchio as pin
import pytest
from crux_contracts.robot import Robot
from crux_planner.model.kinematics import inverse, limit_margin, rotation_from_rpy, rotation_z, wrap_near
from crux_planner.model.limb import limb_masses
from crux_planner.model.mass import body_moment, centres_of_mass, composite_inertia
from crux_planner.physics.dynamics import centre_of_mass as symbolic_centre
from hypothesis import given, settings
from hypothesis import strategies as st
from limb_forward import forward

limbs = st.integers(0, 3)
seeds = st.integers(0, 2**32 - 1)
shares = st.lists(st.floats(0.02, 0.98), min_size=6, max_size=6).map(np.array)
angles = st.floats(-np.pi, np.pi)


@pytest.fixture(scope="module")
def model(robot: Robot) -> pin.Model:
    return pin.buildModelFromUrdf(str(robot.urdf_path))


def pinocchio_pose(robot: Robot, model: pin.Model, limb: int, q: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Gripper position and rotation in the body frame."""
    data, full = model.createData(), pin.neutral(model)
    for name, angle in zip(robot.limbs[limb].joint_names, q, strict=True):
        full[model.joints[model.getJointId(name)].idx_q] = angle
    pin.framesForwardKinematics(model, data, full)
    place = data.oMf[model.getFrameId(robot.limbs[limb].gripper_link)]
    return place.translation, place.rotation


@given(limbs, shares)
@settings(max_examples=60, deadline=None)
def test_forward_is_what_pinocchio_says(robot: Robot, model: pin.Model, limb: int, share: np.ndarray) -> None:
    part = robot.limbs[limb]
    q = part.lower_rad + share * (part.upper_rad - part.lower_rad)
    position, rotation = forward(part, q)
    expected_position, expected_rotation = pinocchio_pose(robot, model, limb, q)
    np.testing.assert_allclose(position, expected_position, atol=1e-12)
    np.testing.assert_allclose(rotation, expected_rotation, atol=1e-12)


@given(limbs, shares)
@settings(max_examples=100, deadline=None)
def test_inverse_reaches_the_pose_it_is_asked_for(robot: Robot, model: pin.Model, limb: int, share: np.ndarray) -> None:
    part = robot.limbs[limb]
    pose = forward(part, part.lower_rad + share * (part.upper_rad - part.lower_rad))
    q, reached = inverse(part, *pose)
    if not reached:
        return
    position, rotation = pinocchio_pose(robot, model, limb, q)
    np.testing.assert_allclose(position, pose[0], atol=1e-9)
    np.testing.assert_allclose(rotation, pose[1], atol=1e-9)


def test_inverse_works_on_arrays_as_on_single_poses(robot: Robot) -> None:
    part = robot.limbs[2]
    positions = np.array([[[-0.1, 0.3, -0.1], [-0.2, 0.36, -0.15]], [[-0.14, 0.4, -0.12], [-3.0, 0.3, 0.0]]])
    rotations = np.broadcast_to(rotation_z(0.3), (2, 2, 3, 3))
    q, reached = inverse(part, positions, rotations)
    assert q.shape == (2, 2, 6)
    assert reached.tolist() == [[True, True], [True, False]]
    np.testing.assert_array_equal(q[1, 0], inverse(part, positions[1, 0], rotations[1, 0])[0])


def test_limit_margin_names_the_tightest_joint(robot: Robot) -> None:
    part = robot.limbs[0]
    middle = (part.lower_rad + part.upper_rad) / 2
    assert limit_margin(part, middle) == pytest.approx(((part.upper_rad - part.lower_rad) / 2).min())
    beyond = middle.copy()
    beyond[4] = part.upper_rad[4] + 0.1
    assert limit_margin(part, beyond) == pytest.approx(-0.1)


@given(angles, st.floats(-10, 10))
def test_wrapping_moves_by_whole_turns_to_the_nearest(angle: float, centre: float) -> None:
    wrapped = float(wrap_near(angle, centre))
    assert abs(wrapped - centre) <= np.pi + 1e-9
    assert (wrapped - angle) / (2 * np.pi) == pytest.approx(round((wrapped - angle) / (2 * np.pi)), abs=1e-9)


@given(angles, st.floats(-1.5, 1.5), angles)
def test_roll_pitch_yaw_are_intrinsic_z_y_x(roll: float, pitch: float, yaw: float) -> None:
    expected = pin.rpy.rpyToMatrix(roll, pitch, yaw)
    np.testing.assert_allclose(rotation_from_rpy(np.array([roll, pitch, yaw])), expected, atol=1e-12)


@given(shares)
@settings(max_examples=20, deadline=None)
def test_composite_inertia_is_that_of_pinocchio(robot: Robot, share: np.ndarray) -> None:
    free = pin.buildModelFromUrdf(str(robot.urdf_path), pin.JointModelFreeFlyer())
    data, full = free.createData(), pin.neutral(free)
    positions: dict[str, float] = {}
    for i, limb in enumerate(robot.limbs):
        q = limb.lower_rad + np.roll(share, i) * (limb.upper_rad - limb.lower_rad)
        positions.update(zip(limb.joint_names, q, strict=True))
        positions.update(dict.fromkeys(limb.finger_joints, 0.03))
    for name, value in positions.items():
        full[free.joints[free.getJointId(name)].idx_q] = value
    pin.ccrba(free, data, full, np.zeros(free.nv))
    np.testing.assert_allclose(composite_inertia(robot, positions), data.Ig.inertia, atol=1e-9)


@given(seeds)
@settings(max_examples=20, deadline=None)
def test_centres_of_mass_from_gripper_poses_are_those_of_pinocchio(robot: Robot, seed: int) -> None:
    """And their slopes are what small moves of the body make of them."""
    random = np.random.default_rng(seed)
    free = pin.buildModelFromUrdf(str(robot.urdf_path), pin.JointModelFreeFlyer())
    data, full = free.createData(), pin.neutral(free)
    pose = np.array([0.3, -0.2, 0.18, *random.uniform(-0.06, 0.06, 3)])
    turn = rotation_from_rpy(pose[3:])
    full[:7] = pin.SE3ToXYZQUAT(pin.SE3(turn, pose[:3]))
    hands = []
    for limb in robot.limbs:
        place = limb.shoulder_b_m + np.sign(limb.shoulder_b_m) * random.uniform(0.12, 0.22, 3) * [0.3, 1.0, 0.0]
        place[2] = -0.13
        yaw = random.uniform(-0.4, 0.4)
        q, reached = inverse(limb, place, turn.T @ rotation_z(yaw))
        assert reached
        hands.append([*(pose[:3] + turn @ place), yaw])
        for name, value in zip([*limb.joint_names, *limb.finger_joints], [*q, 0.03, 0.03], strict=True):
            full[free.joints[free.getJointId(name)].idx_q] = value
    masses: Any = SimpleNamespace(
        mass_kg=robot.total_mass_kg,
        limb_masses=[limb_masses(robot, limb) for limb in robot.limbs],
        body_moment_kg_m=body_moment(robot),
    )
    expected = pin.centerOfMass(free, data, full)
    np.testing.assert_allclose(centres_of_mass(masses, pose[None], np.array([hands]))[0], expected, atol=1e-9)
    symbolic = symbolic_centre(masses, ca.SX(pose), [ca.SX(hand) for hand in np.array(hands)])
    np.testing.assert_allclose(np.array(ca.evalf(symbolic)).ravel(), expected, atol=1e-9)
