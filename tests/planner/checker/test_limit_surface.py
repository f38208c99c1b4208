"""The closed form of (1)-(3) against independent formulations of the Minkowski sum."""

import numpy as np
import pytest
from crux_planner.checker.limit_surface import DISC_POWER, cone_excess
from crux_planner.model.build import MOST_FRICTION
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import lsq_linear

K_M = 0.0134
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


def borne(shear: np.ndarray, twist_as_force: np.ndarray) -> np.ndarray:
    """By (2a): the load mu fz that shear and twist / k need."""
    return np.asarray((np.abs(shear) ** DISC_POWER + np.abs(twist_as_force) ** DISC_POWER) ** (1.0 / DISC_POWER))


@given(forces, forces, st.floats(0.0, 80.0), st.floats(-2.0, 2.0), friction, radius, spine, st.floats(0.0, 0.2))
@settings(max_examples=200, deadline=None)
def test_equals_the_best_split_between_friction_and_spines(
    fx: float, fy: float, fz: float, tz: float, mu: float, k: float, shear: float, twist: float
) -> None:
    """The least demand over the spine box grows with shear and with twist, each a bounded least-squares problem."""
    box = np.array([shear, shear]) + 1e-12
    rest = np.sqrt(2.0 * lsq_linear(np.eye(2), np.array([fx, fy]), bounds=(-box, box), tol=1e-13).cost)
    turn = lsq_linear(np.eye(1), np.array([tz / k]), bounds=(-twist / k - 1e-12, twist / k + 1e-12), tol=1e-13)
    demand = float(borne(rest, np.sqrt(2.0 * turn.cost)))
    assert excess(fx, fy, fz, tz, mu, k, shear, twist) == pytest.approx(demand - mu * fz, abs=1e-5)


@given(st.integers(0, 2**32 - 1), friction, radius, spine, st.floats(0.0, 0.2))
@settings(max_examples=100, deadline=None)
def test_every_sum_of_a_friction_and_a_spine_wrench_is_inside(
    seed: int, mu: float, k: float, shear: float, twist: float
) -> None:
    random = np.random.default_rng(seed)
    fz = random.uniform(0.0, 60.0, 50)
    direction = random.normal(size=(50, 3))
    direction /= borne(np.hypot(direction[:, 0], direction[:, 1]), direction[:, 2])[:, None]
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
def test_more_than_friction_and_spines_bear_is_outside(
    mu: float, k: float, shear: float, twist: float, seed: int
) -> None:
    """Friction at its limit along a direction and the spines' corner on that side: a little more is as much outside."""
    a = np.random.default_rng(seed).normal(size=3)
    a /= borne(np.hypot(a[0], a[1]), a[2])
    fz = 20.0
    corner = np.array([shear, shear, twist / k]) * np.sign(a)
    for beyond in (0.1, -0.1 * min(1.0, mu)):
        x, y, t = (mu * fz + beyond) * a + corner
        assert excess(x, y, fz, k * t, mu, k, shear, twist) == pytest.approx(beyond, abs=1e-9 * (1.0 + mu))


def disc() -> tuple[np.ndarray, np.ndarray]:
    """What a disc under even pressure bears, by integration: shear / (mu fz) and twist / (k mu fz) of every way to
    slide, a turn about a point as far off the disc's centre as given; k = 2/3 of the radius.
    """
    n = 400
    radius, angle = (np.arange(n) + 0.5) / n, (np.arange(n) + 0.5) * 2.0 * np.pi / n
    x, y = radius[:, None] * np.cos(angle), radius[:, None] * np.sin(angle)
    area = np.broadcast_to(radius[:, None], x.shape) / (radius.sum() * n)
    found = []
    for off in np.concatenate([np.linspace(0.0, 1.5, 40), np.geomspace(1.6, 1e3, 20)]):
        speed = np.hypot(x - off, y)
        push = area * (x - off) / speed, -area * y / speed
        found.append((push[0].sum(), (x * push[0] - y * push[1]).sum() / (2.0 / 3.0)))
    shear, twist = np.abs(np.array(found)).T
    return shear, twist


def test_the_checker_allows_no_more_than_a_disc_under_even_pressure_bears() -> None:
    """At most 1.7 % less; the ellipsoid (2) allows up to 7.0 % more, where shear and twist come together."""
    shear, twist = disc()
    one = np.ones_like(shear)
    none = {"spine_shear_N": 0.0 * one, "spine_twist_Nm": 0.0 * one}
    sideways = np.column_stack([0.6 * shear, -0.8 * shear])
    beyond = cone_excess(sideways, -K_M * twist, one, friction=one, patch_k_m=K_M, **none)
    assert beyond.min() > -1e-5
    assert beyond.max() == pytest.approx(0.017, abs=5e-4)
    assert 1.0 / np.hypot(shear, twist).min() == pytest.approx(1.070, abs=5e-4)


def test_the_planner_plans_on_the_safe_side_whatever_its_margin() -> None:
    """The most of (2) that a plan may use lies in what the checker allows, and hardly less would not do."""
    angle = np.linspace(0.0, np.pi / 2, 181)
    needed = borne(MOST_FRICTION * np.cos(angle), MOST_FRICTION * np.sin(angle))
    assert 0.999 < needed.max() <= 1.0


def test_published_example() -> None:
    """fx = 9 N with tz = 0.6 Nm, mu 2.2 and k = 0.67 x 20 mm needs fz = 20.8 N by (2), 21.2 N by (2a)."""
    k = 0.67 * 0.02
    assert np.hypot(9.0, 0.6 / k) / 2.2 == pytest.approx(20.8, abs=0.05)
    assert excess(9.0, 0.0, 21.3, 0.6, 2.2, k, 0.0, 0.0) < 0.0 < excess(9.0, 0.0, 21.1, 0.6, 2.2, k, 0.0, 0.0)


def test_the_linear_stand_in_is_not_good_enough() -> None:
    """fx = fy = mu fz satisfies (11) and lies outside (2) by a factor of the square root of two."""
    assert excess(22.0, 22.0, 10.0, 0.0, 2.2, 0.0134, 0.0, 0.0) == pytest.approx(22.0 * (np.sqrt(2.0) - 1.0))


def test_a_point_contact_carries_no_twist() -> None:
    assert excess(0.0, 0.0, 10.0, 0.0, 1.0, 0.0, 0.0, 0.0) == pytest.approx(-10.0)
    assert excess(0.0, 0.0, 10.0, 0.1, 1.0, 0.0, 0.0, 0.0) == np.inf


def test_a_pulling_finger_has_no_friction() -> None:
    assert excess(1.0, 0.0, -5.0, 0.0, 2.2, 0.0134, 0.0, 0.0) == pytest.approx(1.0)
