"""Cuboids that are turned out of the wall's plane, against points placed in them; hands that are tilted."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from crux_planner.model.cuboids import Cuboids
from crux_planner.model.hands import axes_of, hands_of, rotations
from crux_planner.reach.body_grid import BodyGrid
from scipy.spatial.transform import Rotation

RANDOM = np.random.default_rng(4)
COUNT = 40


def cuboids() -> tuple[Cuboids, Rotation, np.ndarray]:
    rpy, foot = RANDOM.uniform(-2.0, 2.0, (COUNT, 3)), RANDOM.uniform(-0.3, 0.3, (COUNT, 3))
    half = RANDOM.uniform(0.01, 0.1, (COUNT, 3))
    made = Cuboids(foot[:, :2], half, rpy[:, 2], rpy[:, :2], foot[:, 2])
    return made, Rotation.from_euler("ZYX", rpy[:, ::-1]), foot


def test_points_beyond_a_face_are_so_far_off_it_and_all_of_it_is_in_its_outline_under_its_top() -> None:
    made, turn, foot = cuboids()
    for v in range(COUNT):
        inside = RANDOM.uniform(-1.0, 1.0, (200, 3)) * made.half_m[v] + [0.0, 0.0, made.half_m[v, 2]]
        points = foot[v] + turn[v].apply(inside)
        assert (made.distance(points)[:, v] <= 0.0).all()
        assert (made.plan_distance(points)[:, v] <= 1e-12).all()
        assert (points[:, 2] <= made.top_m[v] + 1e-12).all()
        beyond = inside.copy()
        axis = v % 3
        beyond[:, axis] = made.half_m[v, axis] + 0.03 + (made.half_m[v, 2] if axis == 2 else 0.0)
        assert made.distance(foot[v] + turn[v].apply(beyond))[:, v] == pytest.approx(0.03)
        corner = foot[v] + turn[v].apply([[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (0, 2)] * made.half_m[v])
        assert made.top_m[v] == pytest.approx(corner[:, 2].max())


def test_tilted_hands_are_turned_alike_in_numbers_and_in_symbols() -> None:
    hand = np.array([0.1, 0.2, 0.03, 0.7, 0.4, -0.3])
    wanted = (Rotation.from_rotvec([0.4, -0.3, 0.0]) * Rotation.from_euler("z", 0.7)).as_matrix()
    np.testing.assert_allclose(rotations(hand), wanted, atol=1e-12)
    symbols = np.column_stack([np.array(axis).ravel() for axis in axes_of(ca.DM(hand))])
    np.testing.assert_allclose(symbols, wanted, atol=1e-12)
    np.testing.assert_array_equal(hands_of(np.array([1.0, 2, 3, 4, 9, 5, 6])), [1, 2, 3, 4, 5, 6])


def test_a_body_sees_a_tilted_gripper_where_it_is() -> None:
    hand = np.array([0.3, 0.25, 0.05, 0.6, 0.35, -0.2])
    turn = np.linspace(-0.2, 0.2, 3)
    grid = BodyGrid(turn, turn, turn, np.array([0.15, 0.2]), np.zeros(1), np.array([0.05]))
    places, turns = grid.seen(hand).in_body()
    of_hand = Rotation.from_matrix(rotations(hand))
    for cell in np.ndindex(grid.shape):
        body_m, rpy = grid.pose(cell)
        back = Rotation.from_euler("ZYX", rpy[::-1]).inv()
        np.testing.assert_allclose(places[cell], back.apply(hand[:3] - body_m), atol=1e-12)
        np.testing.assert_allclose(turns[cell], (back * of_hand).as_matrix(), atol=1e-12)
