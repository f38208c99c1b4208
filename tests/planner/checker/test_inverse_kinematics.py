"""Numeric inverse kinematics: finds every pose the limb can take, and says so when there is none."""

from dataclasses import replace

import numpy as np
import pytest
from crux_contracts.robot import load_robot
from crux_planner.checker import inverse_kinematics
from crux_planner.checker.geometry import Array, rotation_about_z, rotation_from_rpy
from crux_planner.checker.inverse_kinematics import arm_of
from crux_planner.checker.limb_model import Limb, load_model
from hypothesis import given, settings
from hypothesis import strategies as st

MODEL = load_model(load_robot("scaler"))
SIGNS = np.array([[1, 1, 1], [1, -1, 1], [-1, 1, 1], [-1, -1, 1]])


@given(
    st.integers(0, 3),
    st.tuples(st.floats(-0.13, 0.13), st.floats(-0.07, 0.07), st.floats(-0.065, 0.065)),
    st.floats(-1.7, 1.7),
    st.tuples(st.floats(-0.05, 0.05), st.floats(-0.05, 0.05)),
)
@settings(max_examples=80, deadline=None)
def test_the_known_workspace_is_reached(
    index: int, offset: tuple[float, float, float], yaw: float, tilt: tuple[float, float]
) -> None:
    """Around (0.14, 0.36, -0.13) m, half-box (0.135, 0.072, 0.068) m, yaw within 1.75 rad, body tilted a little."""
    limb = MODEL.limbs[index]
    position = (np.array([0.14, 0.36, -0.13]) + offset) * SIGNS[index]
    rotation = rotation_from_rpy(np.array([*tilt, 0.0])).T @ rotation_about_z(np.array(yaw))
    (solution,) = inverse_kinematics.solve([limb], [position[None]], [rotation[None]])
    state = limb.forward(solution.q_rad)
    np.testing.assert_allclose(state.link_position_m[limb.gripper][0], position, atol=1e-6)
    np.testing.assert_allclose(state.link_rotation[limb.gripper][0], rotation, atol=1e-5)
    assert (solution.q_rad >= limb.lower_rad).all()
    assert (solution.q_rad <= limb.upper_rad).all()


@pytest.mark.parametrize("index", range(4))
def test_a_path_is_followed_without_jumps(index: int) -> None:
    s = np.linspace(0.0, 1.0, 400)
    swing = np.stack([0.12 * np.sin(6 * s), 0.07 * np.cos(5 * s), 0.06 * np.sin(9 * s)], axis=1)
    position = (np.array([0.14, 0.36, -0.13]) + swing) * SIGNS[index]
    rotation = rotation_about_z(1.7 * np.sin(7 * s))
    (solution,) = inverse_kinematics.solve([MODEL.limbs[index]], [position], [rotation])
    assert solution.position_error_m.max() < 1e-6
    assert np.abs(np.diff(solution.q_rad, axis=0)).max() < 0.05


def turned_wrist() -> Limb:
    """LF with the axes of an industrial arm: its last three joints roll, pitch and roll, and have two solutions."""
    limb = MODEL.limbs[0]
    axes = dict(zip((joint.name for joint in limb.joints[3:]), np.eye(3)[[0, 1, 0]], strict=True))
    chain, joints = (
        tuple(
            replace(joint, axis=axes[joint.name], lower=-3.1, upper=3.1) if joint.name in axes else joint
            for joint in each
        )
        for each in (limb.chain, limb.joints)
    )
    return replace(limb, chain=chain, joints=joints)


def poses_of(limb: Limb, q_rad: Array) -> tuple[Array, Array]:
    state = limb.forward(q_rad)
    return state.link_position_m[limb.gripper], state.link_rotation[limb.gripper]


@pytest.mark.parametrize("seed", range(6))
def test_a_wrist_does_not_turn_around_on_the_way(seed: int) -> None:
    """Its joint 5 comes near 0, where the other solution, in which 4 and 6 are half a turn off, is near, too."""
    limb, random, s = turned_wrist(), np.random.default_rng(seed), np.linspace(0.0, 2 * np.pi, 400)
    swings = np.append(random.uniform(0.1, 0.5, 3), random.uniform(0.2, 1.6, 3))
    q_rad = swings * np.sin(random.integers(1, 3, 6) * s[:, None] + random.uniform(0.0, 6.0, 6))
    q_rad[:, 4] = random.uniform(0.03, 0.08) + random.uniform(0.03, 0.3) * (1.0 + np.cos(s))
    q_rad += (limb.lower_rad + limb.upper_rad) / 2
    place, turn = poses_of(limb, q_rad)
    (solution,) = inverse_kinematics.solve([limb], [place], [turn])
    assert np.abs(solution.q_rad - q_rad).max() < 1e-4


def test_of_two_solutions_within_the_limits_the_one_nearest_to_their_middle_comes_first() -> None:
    limb, random = turned_wrist(), np.random.default_rng(1)
    middle, half = (limb.lower_rad + limb.upper_rad) / 2, (limb.upper_rad - limb.lower_rad) / 2
    near = middle + random.uniform(-0.3, 0.3, (60, 6)) * half
    found = [inverse_kinematics.solve([limb], *([each] for each in poses_of(limb, q[None])))[0].q_rad[0] for q in near]
    assert np.abs(np.array(found) - near).max() < 1e-4


def test_limbs_solved_together_are_solved_as_alone() -> None:
    """Two limbs with the same arm, and one whose elbow does not bend as far, in one call."""
    elbow = MODEL.limbs[1].joints[2]
    stiff = replace(elbow, upper=1.9)
    other = replace(
        MODEL.limbs[1],
        chain=tuple(stiff if joint is elbow else joint for joint in MODEL.limbs[1].chain),
        joints=tuple(stiff if joint is elbow else joint for joint in MODEL.limbs[1].joints),
    )
    limbs = [MODEL.limbs[3], other, MODEL.limbs[0]]
    assert len({arm_of(limb)[0].alike for limb in limbs}) == 2
    s = np.linspace(0.0, 1.0, 30)
    swing = np.stack([0.10 * np.sin(2 * s), 0.06 * np.cos(3 * s), 0.05 * s], axis=1)
    positions = [(np.array([0.14, 0.36, -0.13]) + swing) * SIGNS[i] for i in (3, 1, 0)]
    rotations = [rotation_about_z(yaw * s) for yaw in (0.3, -0.5, 0.9)]
    for limb, position, rotation, together in zip(
        limbs, positions, rotations, inverse_kinematics.solve(limbs, positions, rotations), strict=True
    ):
        (alone,) = inverse_kinematics.solve([limb], [position], [rotation])
        np.testing.assert_allclose(together.q_rad, alone.q_rad, atol=1e-6)
        np.testing.assert_allclose(limb.forward(together.q_rad).link_position_m[limb.gripper], position, atol=1e-6)


def test_out_of_reach_is_the_distance_that_is_missing() -> None:
    limb = MODEL.limbs[0]
    shoulder = limb.chain[0].origin_m
    target = shoulder + np.array([0.0, 0.6, -0.12])
    (solution,) = inverse_kinematics.solve([limb], [target[None]], [np.eye(3)[None]])
    assert solution.position_error_m[0] == pytest.approx(0.6 - 0.35, abs=0.03)
