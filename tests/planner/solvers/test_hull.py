"""Hulls in the plane against Qhull."""

import numpy as np
import pytest
from crux_planner.solvers.hull import sides_of
from scipy.spatial import ConvexHull


@pytest.mark.parametrize("seed", range(20))
def test_sides_enclose_the_same_places_as_qhulls(seed: int) -> None:
    random = np.random.default_rng(seed)
    points = random.normal(size=(random.integers(3, 20), 2))
    if seed % 2:
        points = np.array([*points.round(0), [0.0, 0.0], [2.0, 1.0], [0.0, 3.0], [0.0, 0.0]])  # corners and sides twice
    sides, others = sides_of(points), ConvexHull(points).equations
    assert sides is not None
    places = random.normal(size=(500, 2), scale=2.0)
    inside, expected = ((places @ each[:, :2].T + each[:, 2]).max(axis=1) for each in (sides, others))
    np.testing.assert_allclose(inside, expected, atol=1e-12)


@pytest.mark.parametrize("points", [[[1.0, 2.0]] * 4, [[0.0, 0.0], [1.0, 1.0]], [[0.1 * i, 0.3 * i] for i in range(9)]])
def test_points_on_a_line_have_no_sides(points: list[list[float]]) -> None:
    assert sides_of(np.array(points)) is None
