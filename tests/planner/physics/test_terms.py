"""Each term of P1 against a closed form, a finite difference or another library."""

from __future__ import annotations

from types import SimpleNamespace
from typing import Any

import casadi as ca
import numpy as np
import pinocchio as pin
import pytest
from crux_contracts.robot import Robot
from crux_planner.model.cuboids import Cuboids
from crux_planner.model.kinematics import inverse, rotation_from_rpy, rotation_z
from crux_planner.model.limb import limb_masses
from crux_planner.model.workspace import Reach, box
from crux_planner.physics.dynamics import euler_rates, euler_step, gripper_wrench, static_map
from crux_planner.physics.limit_surface import (
    SMOOTHING_N,
    cone_demand,
    finger_forces,
    finger_inputs,
    polytope_directions,
)
from crux_planner.physics.reach import between, offset_in_body, turned
from crux_planner.physics.torque import joint_torques
from hypothesis import given, settings
from hypothesis import strategies as st

K_M = 0.0134
seeds = st.integers(0, 2**32 - 1)


def beyond_limit_surface(load: np.ndarray, friction_force: float, spines: np.ndarray) -> float:
    """Newtons beyond (1): the spines take what they can of each component, the rest must lie in the ellipsoid (2)."""
    rest = np.maximum(np.abs(load) - spines, 0.0) / [1.0, 1.0, K_M]
    return float(np.linalg.norm(rest)) - friction_force


@given(seeds)
def test_the_polytope_lies_inside_the_limit_surface_and_fills_most_of_it(seed: int) -> None:
    random = np.random.default_rng(seed)
    directions, reach = polytope_directions(K_M)
    friction_force, spines = random.uniform(0, 100), random.uniform(0, [10, 10, 0.1])
    load = random.normal(size=3) * [1, 1, K_M]
    slack = reach * friction_force + np.abs(directions) @ spines
    edge = load / (directions @ load / slack).max()  # the load scaled to the polytope's surface
    assert beyond_limit_surface(edge, friction_force, spines) <= 1e-9
    assert beyond_limit_surface(edge / 0.79, friction_force, spines) >= -1e-9


@given(seeds)
def test_the_cone_asks_for_the_norm_of_what_spines_leave_and_never_for_less(seed: int) -> None:
    random = np.random.default_rng(seed)
    load, share = random.normal(size=3) * [30, 30, 0.4], random.normal(size=3) * [5, 5, 0.05]
    exact = float(np.linalg.norm((load - share) / [1, 1, K_M]))
    demand = float(cone_demand(load, share, K_M))
    assert exact <= demand <= exact + SMOOTHING_N


@given(seeds)
def test_a_grippers_wrench_is_the_sum_over_its_fingers_whatever_the_opening(seed: int) -> None:
    random = np.random.default_rng(seed)
    yaw, centre, q = random.uniform(-3, 3), random.normal(size=3), random.normal(size=5) * [20, 20, 0.3, 30, 30]
    axis, tangent = np.array([np.cos(yaw), np.sin(yaw), 0]), np.array([-np.sin(yaw), np.cos(yaw), 0])
    forces, moments = finger_forces(q, axis, tangent)
    opening = random.uniform(0.01, 0.06)
    places = centre + np.outer([opening, -opening], axis)
    expected = np.concatenate([forces.sum(axis=0), (np.cross(places, forces) + moments).sum(axis=0)])
    force, moment = gripper_wrench(ca.DM(q), ca.DM(centre), ca.DM(axis), ca.DM(tangent))
    np.testing.assert_allclose(np.concatenate([np.array(force), np.array(moment)]).ravel(), expected, atol=1e-9)
    reduced = np.array([*q[:3], q[3] - q[4]])
    np.testing.assert_allclose(static_map(centre, axis, tangent) @ reduced, expected, atol=1e-9)


def test_fingers_push_off_their_faces_and_share_shear_and_twist() -> None:
    axis, tangent = np.array([0.0, 1.0, 0.0]), np.array([-1.0, 0.0, 0.0])
    forces, moments = finger_forces(np.array([1.0, 2.0, 0.3, 10.0, 20.0]), axis, tangent)
    np.testing.assert_allclose(forces, [[-1, 10, 2], [-1, -20, 2]])  # finger 1 stands at +e and is pushed to +e
    np.testing.assert_allclose(moments, [[0, 0.3, 0], [0, 0.3, 0]])


@given(seeds)
def test_euler_rates_turn_the_body_as_its_angular_velocity_does(seed: int) -> None:
    random = np.random.default_rng(seed)
    theta, omega, step = random.uniform(-1, 1, 3), random.normal(size=3), 1e-6
    rates = np.array(euler_rates(ca.DM(theta), ca.DM(omega))).ravel()
    turned = rotation_from_rpy(theta).T @ rotation_from_rpy(theta + step * rates)
    np.testing.assert_allclose(pin.log3(turned) / step, omega, atol=1e-4)


@given(seeds)
def test_a_step_of_the_body_obeys_newton_and_euler(seed: int) -> None:
    random = np.random.default_rng(seed)
    x, force, moment = random.normal(size=12) * 0.3, random.normal(size=3) * 50, random.normal(size=3) * 20
    mass, gravity, dt = 9.6, np.array([-6.9, 0.0, -6.9]), 0.01
    root, centre = random.normal(size=(3, 3)), random.normal(size=3)
    inertia = root @ root.T + np.eye(3)
    body: Any = SimpleNamespace(mass_kg=mass, inertia_b=inertia, gravity_h=gravity, dt_s=dt)
    after = np.array(euler_step(ca.DM(x), ca.DM(force), ca.DM(moment), ca.DM(centre), body)).ravel()
    r, theta, v, omega = x[:3], x[3:6], x[6:9], x[9:]
    np.testing.assert_allclose(mass * (after[6:9] - v) / dt, force + mass * gravity, atol=1e-6)
    about_centre = rotation_from_rpy(theta).T @ (moment - np.cross(centre, force))
    np.testing.assert_allclose(
        inertia @ (after[9:] - omega) / dt + np.cross(omega, inertia @ omega), about_centre, atol=1e-6
    )
    np.testing.assert_allclose(after[:3], r + dt * v)


@given(seeds)
def test_a_box_shrunk_for_turning_lies_inside_the_turned_box(seed: int) -> None:
    random = np.random.default_rng(seed)
    centre, half, angle = np.array([[0.15, 0.35, -0.13]]), np.array([0.15, 0.07, 0.06]), 0.08
    offset = centre[0] + random.uniform(-1, 1, 3) * turned(box(centre, half, 0.0), angle).half_m
    r, theta = random.normal(size=3), np.array([0.0, 0.0, random.uniform(-angle, angle)])
    place = np.array(offset_in_body(ca.DM(r), ca.DM(theta), ca.DM(r + offset))).ravel()
    assert (np.abs(place - centre[0]) <= half + 1e-9).all()


@given(seeds)
def test_what_is_in_reach_of_a_level_body_between_two_tilts_is_in_reach_at_each(seed: int) -> None:
    random, heights = np.random.default_rng(seed), (-0.19, -0.03)
    reach = Reach(
        np.array([*np.eye(3), [np.cos(0.5), np.sin(0.5), 0.0]]),
        np.array([[0.15, 0.35, -0.12, 0.3]]),
        np.array([[0.17, 0.09, 0.12, 0.19]]),
        0.2,
    )
    rpy = random.uniform(-0.2, 0.2, (2, 3)) * [1.0, 1.0, 0.0]
    start, goal = SimpleNamespace(rpy_rad=rpy[0]), SimpleNamespace(body=SimpleNamespace(rpy_rad=rpy[1]))
    problem: Any = SimpleNamespace(boxes=reach, start=start, goal=goal, gripper_height_m=heights)
    for _ in range(20):
        offset = reach.centre_b_m[0] + 1.2 * random.uniform(-1, 1, 3) * reach.half_m
        offset[2] = np.clip(offset[2], *heights)
        if (between(problem, 0.0).beyond(0, offset) <= 0.0).all():
            tilt = random.uniform() * rpy[random.integers(2)]
            assert reach.beyond(0, offset @ rotation_from_rpy(tilt)).max() <= 1e-9


@given(seeds)
def test_distances_to_cuboids_are_those_to_their_nearest_points(seed: int) -> None:
    random = np.random.default_rng(seed)
    foot, half, yaw = random.normal(size=(2, 2)) * 0.1, random.uniform(0.02, 0.1, (2, 3)), random.uniform(-3, 3, 2)
    point = random.normal(size=3) * 0.2
    distances = Cuboids(foot, half, yaw).distance(point)
    for v in range(2):
        local = rotation_z(-yaw[v]) @ (point - [*foot[v], half[v, 2]])
        outside = np.linalg.norm(local - np.clip(local, -half[v], half[v]))
        inside = (np.abs(local) - half[v]).max()
        assert distances[v] == pytest.approx(outside if outside > 0 else inside, abs=1e-12)


def test_only_far_cuboids_are_left_out_of_the_near_ones() -> None:
    cuboids = Cuboids(np.array([[0.0, 0.0], [1.0, 0.0]]), np.full((2, 3), 0.03), np.array([0.7, 0.7]))
    assert cuboids.near(np.array([[0.1, 0.0, 0.0]]), 0.08).foot_h_m.tolist() == [[0.0, 0.0]]
    assert len(cuboids.near(np.array([[0.1, 0.0, 0.0], [0.9, 0.0, 0.0]]), 0.08).yaw_rad) == 2


@given(st.integers(0, 3), seeds)
@settings(max_examples=20, deadline=None)
def test_joint_torques_are_those_of_pinocchio(robot: Robot, limb: int, seed: int) -> None:
    random, part = np.random.default_rng(seed), robot.limbs[limb]
    r, theta = random.normal(size=3), random.uniform(-0.1, 0.1, 3)
    rotation, upright = rotation_from_rpy(theta), rotation_z(random.uniform(-1.5, 1.5))
    place = r + rotation @ (np.array([*(np.sign(part.shoulder_b_m[:2]) * [0.17, 0.36]), -0.15]))
    force, moment, gravity = random.normal(size=3) * 30, random.normal(size=3), random.normal(size=3) * 6
    q, reached = inverse(part, rotation.T @ (place - r), rotation.T @ upright)
    assert reached

    model = pin.buildModelFromUrdf(str(robot.urdf_path), pin.JointModelFreeFlyer())
    data, full = model.createData(), pin.neutral(model)
    full[:3], full[3:7] = r, pin.Quaternion(rotation).coeffs()
    for name, angle in zip(part.joint_names, q, strict=True):
        full[model.joints[model.getJointId(name)].idx_q] = angle
    for name in part.finger_joints:
        joint = robot.urdf.joints[name]
        full[model.joints[model.getJointId(name)].idx_q] = (joint.lower + joint.upper) / 2
    model.gravity.linear = gravity
    own_weight = pin.computeGeneralizedGravity(model, data, full)
    frame = model.getFrameId(part.gripper_link)
    jacobian = pin.computeFrameJacobian(model, data, full, frame, pin.LOCAL_WORLD_ALIGNED)
    expected = own_weight - jacobian.T @ np.concatenate([force, moment])

    pose, grip = np.concatenate([r, theta]), (place, upright[:, 0], force, moment)
    torques = np.array(joint_torques()(limb_masses(robot, part).numbers, pose, *grip, gravity)).ravel()
    rows = [model.joints[model.getJointId(name)].idx_v for name in part.joint_names]
    np.testing.assert_allclose(torques, expected[rows], atol=1e-9)


@given(seeds)
def test_inputs_come_back_from_the_fingers_forces(seed: int) -> None:
    random = np.random.default_rng(seed)
    q, yaw = random.normal(size=5), random.uniform(-np.pi, np.pi)
    axis, tangent = rotation_z(yaw)[:, 0], rotation_z(yaw)[:, 1]
    assert finger_inputs(*finger_forces(q, axis, tangent), axis, tangent) == pytest.approx(q)
