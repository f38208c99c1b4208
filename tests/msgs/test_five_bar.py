"""Five-bars against circles that meet, differences and the work of forces; and the ranges that they leave."""

from __future__ import annotations

from dataclasses import replace
from itertools import pairwise

import numpy as np
import pytest
from crux_contracts.five_bar import FiveBar, geometry
from crux_contracts.robot_bounds import FIVE_BAR_STEPS
from crux_contracts.transmissions import UNLIMITED, Limits, Transmission, five_bar_problems, own_limits
from crux_msgs.robot_keys import Transmissions
from five_bars import drawn
from hypothesis import given, settings
from hypothesis import strategies as st

SEEDS = st.integers(0, 10**6)
FREE = (-20.0, 20.0)
LEAST_SINE = 0.1


def held(bar: FiveBar, random: np.random.Generator) -> np.ndarray:
    """(n, 2) joints up to 1 rad off the middle to which the linkage is not near to singular on the way."""
    q = bar.middle_rad + random.uniform(-1.0, 1.0, (200, 2))
    way = bar.middle_rad + np.linspace(0.0, 1.0, 60)[:, None, None] * (q - bar.middle_rad)
    return q[(bar.sine(way) > LEAST_SINE).all(axis=0)]


def meeting(one: complex, radius: float, other: complex, across: float) -> tuple[complex, complex]:
    """Where two circles meet: left of the way from one to the other, and right of it."""
    far = abs(other - one)
    along = (far**2 + radius**2 - across**2) / (2 * far)
    aside = np.sqrt(radius**2 - along**2)
    way = (other - one) / far
    return one + way * complex(along, aside), one + way * complex(along, -aside)


def crank_end(bar: FiveBar, q: np.ndarray) -> tuple[complex, complex, complex]:
    """By complex numbers: the crank's axis, its end, and the pin."""
    keys = bar.section
    axis, arm = complex(keys.crank_x_m, keys.crank_y_m), complex(keys.pin_x_m, keys.pin_y_m)
    pin = np.exp(1j * q[0]) * (bar.link_m + np.exp(1j * bar.sense * q[1]) * arm)
    left, right = meeting(axis, keys.crank_m, pin, keys.rod_m)
    return axis, left if keys.bends > 0 else right, pin


@given(SEEDS)
@settings(max_examples=100, deadline=None)
def test_the_crank_ends_where_circles_meet_and_comes_back(seed: int) -> None:
    random = np.random.default_rng(seed)
    bar = drawn(random)
    q = held(bar, random)
    crank = bar.crank_rad(q)
    for each, angle in zip(q, crank, strict=True):
        axis, end, _ = crank_end(bar, each)
        assert np.exp(1j * angle) == pytest.approx((end - axis) / bar.section.crank_m, abs=1e-9)
    np.testing.assert_allclose(bar.next_rad(q[:, 0], crank), q[:, 1], atol=1e-9)
    for one, other in pairwise(np.linspace(bar.middle_rad, q[0], 50) if len(q) else []):
        assert abs(bar.crank_rad(one) - bar.crank_rad(other)) < 1.0  # no jump by a turn on the way


@given(SEEDS)
@settings(max_examples=100, deadline=None)
def test_slopes_are_differences_and_forces_do_no_work(seed: int) -> None:
    random = np.random.default_rng(seed)
    bar = drawn(random)
    q = held(bar, random)
    step = 1e-6
    for joint, slope in enumerate(bar.slopes(q)):
        way = step * np.eye(2)[joint]
        differences = (bar.crank_rad(q + way) - bar.crank_rad(q - way)) / (2 * step)
        np.testing.assert_allclose(slope, differences, atol=1e-4, rtol=1e-5)
    by = Transmission(np.eye(4), np.zeros(4), bar)
    joints = random.uniform(-1, 1, (len(q), 4))
    joints[:, 1:3] = q
    np.testing.assert_allclose(by.joints_rad(by.actuators_rad(joints)), joints, atol=1e-9)
    actuators_Nm, ways = random.uniform(-5, 5, (2, len(q), 4))
    speeds = (by.actuators_rad(joints + step * ways) - by.actuators_rad(joints - step * ways)) / (2 * step)
    joints_Nm = by.joint_torque_Nm(joints, actuators_Nm)
    worked = (actuators_Nm * speeds).sum(axis=1)
    np.testing.assert_allclose((joints_Nm * ways).sum(axis=1), worked, atol=1e-3, rtol=1e-4)
    np.testing.assert_allclose(by.actuator_torque_Nm(joints, joints_Nm), actuators_Nm, atol=1e-8)


@given(SEEDS)
@settings(max_examples=60, deadline=None)
def test_it_is_singular_where_rod_and_crank_or_pin_are_in_line(seed: int) -> None:
    random = np.random.default_rng(seed)
    bar = drawn(random)
    q = held(bar, random)
    for each, sine in zip(q, bar.sine(q), strict=True):
        axis, end, pin = crank_end(bar, each)
        lever = np.exp(1j * each[0]) * bar.link_m - pin
        angles = np.angle((end - axis) / (end - pin)), np.angle(lever / (end - pin))
        assert min(abs(np.sin(angles))) == pytest.approx(sine, abs=1e-9)
    long = replace(bar, section=replace(bar.section, rod_m=3.0))
    assert float(long.sine(bar.middle_rad)) < 0
    assert np.isfinite(long.crank_rad(bar.middle_rad))
    assert np.isfinite(long.slopes(bar.middle_rad)).all()


@given(SEEDS, st.floats(0.2, 1.5))
@settings(max_examples=60, deadline=None)
def test_ranges_hold_throughout_and_cannot_grow_by_much(seed: int, wide_rad: float) -> None:
    random = np.random.default_rng(seed)
    bar = drawn(random)
    low, high = bar.middle_rad - wide_rad, bar.middle_rad + wide_rad
    crank = float(bar.crank_rad(bar.middle_rad)) + np.array([-0.5, 0.8])
    own = (float(crank[0]), float(crank[1]))
    inner = bar.box(low, high, own)
    if not (inner[0] < inner[1]).all():
        return
    within = random.uniform(*inner, (5000, 2))
    assert bar.holds(within, own).all()
    size = (high - low) / FIVE_BAR_STEPS
    for joint in (0, 1):
        for end, sign in ((inner[0], -1.0), (inner[1], 1.0)):
            if not low[joint] < end[joint] + sign * size[joint] / 2 < high[joint]:
                continue
            steps = np.stack(np.meshgrid(*[np.linspace(0, 1, 150)] * 2), axis=-1)
            around = np.clip(inner[0] - size + steps * (inner[1] - inner[0] + 2 * size), low, high)
            around[..., joint] = end[joint] + sign * steps[..., joint] * 2 * size[joint]
            assert not bar.holds(around, own).all()


def section(**more: float) -> Transmissions:
    each = {"speed_rad_s": 6.0, "torque_Nm": 9.0, "low_rad": -12.0, "high_rad": 12.0} | more
    return Transmissions(**{key: (value,) * 7 for key, value in each.items()})


@given(SEEDS)
@settings(max_examples=60, deadline=None)
def test_actuators_keep_their_limits_whatever_the_joints_do_within_theirs(seed: int) -> None:
    random = np.random.default_rng(seed)
    bar = drawn(random)
    middle = np.zeros(6)
    middle[1:3] = bar.middle_rad
    ratio = tuple(random.choice([-1, 1], 7) * random.uniform(0.5, 2.0, 7))
    by = Transmission.of(replace(section(), ratio=ratio), 6, bar)
    actuators = own_limits(section(), 6)
    joints = Limits(middle - 0.8, middle + 0.8, np.full(6, 5.0), np.full(6, 12.0))
    left = by.within(joints, actuators)
    if not (left.low_rad < left.high_rad).all():
        return
    q = random.uniform(left.low_rad, left.high_rad, (500, 6))
    corners = random.choice([-1.0, 1.0], (500, 6))
    speeds = (by.slope(q) @ (corners * left.speed_rad_s)[..., None])[..., 0]
    torques = by.actuator_torque_Nm(q, corners * left.torque_Nm)
    told = by.reached(left, joints, actuators)
    there = by.actuators_rad(q)
    assert (there >= told.low_rad - 1e-9).all()
    assert (there <= told.high_rad + 1e-9).all()
    assert (np.abs(speeds) <= told.speed_rad_s * 1.02).all()  # steepest between two steps of the range
    assert (np.abs(torques) <= told.torque_Nm * 1.02).all()
    assert (told.speed_rad_s <= actuators.speed_rad_s * (1 + 1e-9)).all()
    assert (told.torque_Nm <= actuators.torque_Nm * (1 + 1e-9)).all()


def test_where_nothing_is_left_low_is_above_high() -> None:
    bar = drawn(np.random.default_rng(2))
    middle = np.zeros(6)
    middle[1:3] = bar.middle_rad
    joints = Limits(middle - 0.8, middle + 0.8, np.full(6, 5.0), np.full(6, 12.0))
    crank = float(bar.crank_rad(bar.middle_rad))
    own = own_limits(section(), 6)
    own.low_rad[2], own.high_rad[2] = crank + 0.5, crank + 1.0
    left = Transmission.of(section(), 6, bar).within(joints, own)
    assert (left.low_rad[1:3] > left.high_rad[1:3]).all()


@pytest.mark.parametrize(("more", "key"), [
    ({"coupled_to": (0, 1, 0, 0, 0, 0, 0)}, "coupled_to[1]"), ({"coupled_to": (0, 0, 0, 3, 0, 0, 0)}, "coupled_to[3]"),
    ({"torque_Nm": (1, 1, UNLIMITED, 1, 1, 1, 1)}, "torque_Nm"), ({"speed_rad_s": (UNLIMITED,) * 7}, "speed_rad_s"),
])  # fmt: skip
def test_sections_that_do_not_fit_a_five_bar_are_refused(more: dict[str, tuple[float, ...]], key: str) -> None:
    bar = drawn(np.random.default_rng(1))
    assert not list(five_bar_problems(section(), bar, "LF"))
    problem = next(iter(five_bar_problems(replace(section(), **more), bar, "LF")))
    assert problem.key == f"transmissions.{key}"


def test_links_are_measured_across_their_axes() -> None:
    axes = np.array([[0.0, 0.0, 2.0], [0.0, 0.0, -2.0]]) / 2
    assert geometry(axes, np.array([[1.0, 0.0, 0.0], [1.3, 0.4, 7.0]])) == pytest.approx((0.5, -1.0))
    assert geometry(axes, np.array([[1.0, 0.0, 0.0], [1.0, 0.0, 7.0]])) is None
    assert geometry(np.eye(3)[:2], np.array([[1.0, 0.0, 0.0], [1.3, 0.4, 7.0]])) is None
