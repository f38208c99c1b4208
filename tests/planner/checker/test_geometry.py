"""Distances and rotations against coal (the collision library that pinocchio brings) and SciPy."""

from typing import Any

import coal
import numpy as np
import pytest
from crux_planner.checker import geometry
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

seeds = st.integers(0, 2**32 - 1)


def distance(a: Any, pose_a: tuple[np.ndarray, np.ndarray], b: Any, pose_b: tuple[np.ndarray, np.ndarray]) -> float:
    result = coal.DistanceResult()
    placed = [coal.Transform3s(pose[1], pose[0]) for pose in (pose_a, pose_b)]
    return float(coal.distance(a, placed[0], b, placed[1], coal.DistanceRequest(), result))


def segment_pose(start: np.ndarray, end: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    axis = (end - start) / np.linalg.norm(end - start)
    other = np.cross(axis, [1.0, 0.0, 0.0] if abs(axis[0]) < 0.9 else [0.0, 1.0, 0.0])
    other /= np.linalg.norm(other)
    return 0.5 * (start + end), np.stack([other, np.cross(axis, other), axis], axis=1)


@given(seeds)
@settings(max_examples=80, deadline=None)
def test_segment_to_box(seed: int) -> None:
    random = np.random.default_rng(seed)
    half = random.uniform(0.01, 0.2, 3)
    start, end = random.uniform(-0.4, 0.4, (2, 3))
    capsule = coal.Capsule(0.02, float(np.linalg.norm(end - start)))
    expected = distance(capsule, segment_pose(start, end), coal.Box(*(2 * half)), (np.zeros(3), np.eye(3)))
    gap = float(geometry.segment_to_box(start[None], end[None], half)[0]) - 0.02
    if gap > 0.0:
        assert gap == pytest.approx(expected, abs=1e-5)
    else:
        assert expected <= 1e-5


@given(seeds)
@settings(max_examples=80, deadline=None)
def test_segment_to_segment(seed: int) -> None:
    random = np.random.default_rng(seed)
    a0, a1, b0, b1 = random.uniform(-0.3, 0.3, (4, 3))
    if seed % 4 == 0:
        b1 = b0 + (a1 - a0) * random.uniform(-1.5, 1.5)  # parallel
    if seed % 5 == 0:
        a1 = a0.copy()  # a point
    found = float(geometry.segment_to_segment(a0[None], a1[None], b0[None], b1[None])[0])
    grid = np.linspace(0.0, 1.0, 201)
    points = a0 + grid[:, None] * (a1 - a0)
    along = b1 - b0
    t = np.clip(((points - b0) @ along) / max(along @ along, 1e-12), 0.0, 1.0)
    brute = float(np.linalg.norm(points - b0 - t[:, None] * along, axis=1).min())
    assert found <= brute + 1e-9
    assert found == pytest.approx(brute, abs=2e-3)


@given(seeds)
@settings(max_examples=80, deadline=None)
def test_box_to_box_never_promises_too_much(seed: int) -> None:
    """Overlap is seen exactly; apart, the separating axes give a lower bound, exact face to face."""
    random = np.random.default_rng(seed)
    half_a, half_b = random.uniform(0.02, 0.15, (2, 3))
    centre, rotation = random.uniform(-0.4, 0.4, 3), Rotation.random(rng=random).as_matrix()
    found = float(geometry.box_to_box(centre[None], rotation[None], half_a, half_b)[0])
    expected = distance(coal.Box(*(2 * half_a)), (centre, rotation), coal.Box(*(2 * half_b)), (np.zeros(3), np.eye(3)))
    assert (found > 1e-9) == (expected > 1e-6) or abs(expected) < 1e-5
    if expected > 0.0:
        assert found <= expected + 1e-6


def test_box_to_box_depth() -> None:
    half = np.array([0.1, 0.1, 0.1])
    found = geometry.box_to_box(np.array([[0.15, 0.02, 0.0]]), np.eye(3)[None], half, half)
    assert found[0] == pytest.approx(-0.05)


@given(st.tuples(st.floats(-3.1, 3.1), st.floats(-1.5, 1.5), st.floats(-3.1, 3.1)))
@settings(max_examples=60, deadline=None)
def test_rotations(rpy: tuple[float, float, float]) -> None:
    matrix = geometry.rotation_from_rpy(np.array(rpy))
    np.testing.assert_allclose(matrix, Rotation.from_euler("ZYX", rpy[::-1]).as_matrix(), atol=1e-12)
    vector = geometry.rotation_vector(matrix[None])[0]
    np.testing.assert_allclose(Rotation.from_rotvec(vector).as_matrix(), matrix, atol=1e-5)


def test_half_turns_are_not_lost() -> None:
    for axis in np.eye(3):
        assert np.linalg.norm(geometry.rotation_vector((2 * np.outer(axis, axis) - np.eye(3))[None])) == pytest.approx(
            np.pi
        )


@given(st.tuples(*[st.floats(-1.0, 1.0)] * 3), st.tuples(*[st.floats(-1.0, 1.0)] * 3))
@settings(max_examples=60, deadline=None)
def test_body_rate_is_the_derivative_of_the_rotation(rpy: tuple[float, ...], rate: tuple[float, ...]) -> None:
    """R^T R' = [omega_B]x, by central differences."""
    h, theta, speed = 1e-6, np.array(rpy), np.array(rate)
    r = geometry.rotation_from_rpy
    spin = r(theta).T @ (r(theta + h * speed) - r(theta - h * speed)) / (2 * h)
    omega = geometry.body_rate_matrix(theta) @ speed
    np.testing.assert_allclose([spin[2, 1], spin[0, 2], spin[1, 0]], omega, atol=1e-8)
