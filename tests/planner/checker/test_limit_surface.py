"""The closed form of (1)-(3) against independent formulations of the Minkowski sum."""

import numpy as np
import pytest
from crux_planner.checker.limit_surface import cone_excess
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import lsq_linear

forces = st.floats(-80.0, 80.0)
friction = st.floats(0.0, 3.0)
radius = st.floats(0.003, 0.05)
spine = st.one_of(st.just(0.0), st.floats(0.1, 20.0))


def excess(fx: float, fy: float, fz: float, tz: float, mu: float, k: float, shear: float, twist: float) -> float:
    return float(
        cone_excess(
            np.array([fx, fy]),
            np.array(tz),
            np.array(fz),
            friction=np.array(mu),
            patch_k_m=k,
            spine_shear_N=np.array(shear),
            spine_twist_Nm=np.array(twist),
        )
    )


@given(forces, forces, st.floats(0.0, 80.0), st.floats(-2.0, 2.0), friction, radius, spine, st.floats(0.0, 0.2))
@settings(max_examples=200, deadline=None)
def test_equals_the_best_split_between_friction_and_spines(
    fx: float, fy: float, fz: float, tz: float, mu: float, k: float, shear: float, twist: float
) -> None:
    """min over the spine box of the cone's demand is a bounded least-squares problem; solve it as one."""
    box = np.array([shear, shear, twist / k]) + 1e-12
    best = lsq_linear(np.eye(3), np.array([fx, fy, tz / k]), bounds=(-box, box), tol=1e-13)
    demand = np.sqrt(2.0 * best.cost)
    assert excess(fx, fy, fz, tz, mu, k, shear, twist) == pytest.approx(demand - mu * fz, abs=1e-5)


@given(st.integers(0, 2**32 - 1), friction, radius, spine, st.floats(0.0, 0.2))
@settings(max_examples=100, deadline=None)
def test_every_sum_of_a_friction_and_a_spine_wrench_is_inside(
    seed: int, mu: float, k: float, shear: float, twist: float
) -> None:
    random = np.random.default_rng(seed)
    fz = random.uniform(0.0, 60.0, 50)
    direction = random.normal(size=(50, 3))
    direction /= np.linalg.norm(direction, axis=1, keepdims=True)
    inside = direction * (random.uniform(0.0, 1.0, 50) * mu * fz)[:, None]
    spines = random.uniform(-1.0, 1.0, (50, 3)) * [shear, shear, twist]
    value = cone_excess(
        inside[:, :2] + spines[:, :2],
        k * inside[:, 2] + spines[:, 2],
        fz,
        friction=np.full(50, mu),
        patch_k_m=k,
        spine_shear_N=np.full(50, shear),
        spine_twist_Nm=np.full(50, twist),
    )
    assert value.max() <= 1e-9 * (1.0 + 60.0 * mu)


@given(friction, radius, spine, st.floats(0.0, 0.2), st.integers(0, 2**32 - 1))
@settings(max_examples=100, deadline=None)
def test_beyond_a_supporting_plane_is_outside(mu: float, k: float, shear: float, twist: float, seed: int) -> None:
    """In a direction a the sum reaches mu fz |a| + |a| . box; a little more is outside, by just that much."""
    a = np.random.default_rng(seed).normal(size=3)
    a /= np.linalg.norm(a)
    fz = 20.0
    corner = np.array([shear, shear, twist / k]) * np.sign(a)
    boundary = mu * fz * a + corner
    x, y, t = boundary + 0.1 * a
    assert excess(x, y, fz, k * t, mu, k, shear, twist) == pytest.approx(0.1, abs=1e-9 * (1.0 + mu))
    x, y, t = boundary - 0.1 * a * min(1.0, mu)
    assert excess(x, y, fz, k * t, mu, k, shear, twist) <= 1e-9


def test_published_example() -> None:
    """fx = 9 N with tz = 0.6 Nm, mu 2.2 and k = 0.67 x 20 mm needs fz = 20.8 N by (2)."""
    k = 0.67 * 0.02
    assert excess(9.0, 0.0, 20.9, 0.6, 2.2, k, 0.0, 0.0) < 0.0 < excess(9.0, 0.0, 20.7, 0.6, 2.2, k, 0.0, 0.0)


def test_the_linear_stand_in_is_not_good_enough() -> None:
    """fx = fy = mu fz satisfies (11) and lies outside (2) by a factor of the square root of two."""
    assert excess(22.0, 22.0, 10.0, 0.0, 2.2, 0.0134, 0.0, 0.0) == pytest.approx(22.0 * (np.sqrt(2.0) - 1.0))


def test_a_point_contact_carries_no_twist() -> None:
    assert excess(0.0, 0.0, 10.0, 0.0, 1.0, 0.0, 0.0, 0.0) == pytest.approx(-10.0)
    assert excess(0.0, 0.0, 10.0, 0.1, 1.0, 0.0, 0.0, 0.0) == np.inf


def test_a_pulling_finger_has_no_friction() -> None:
    assert excess(1.0, 0.0, -5.0, 0.0, 2.2, 0.0134, 0.0, 0.0) == pytest.approx(1.0)
