"""Intervals have every value that numbers within them give, and no more than they must."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from crux_planner.model.arrays import Array
from crux_planner.reach.interval import Interval, cosine, direction, sine
from crux_planner.reach.outer import triangle
from hypothesis import given, settings
from hypothesis import strategies as st

SAMPLES = 41
seeds = st.integers(0, 2**32 - 1)
One = tuple[Callable[[Interval], Interval], Callable[[Array], Array]]
Two = tuple[Callable[[Interval, Interval], Interval], Callable[[Array, Array], Array]]
OF_ONE: dict[str, One] = {
    "minus": (lambda a: -a, lambda x: -x),
    "times": (lambda a: a * -3.0, lambda x: -3.0 * x),
    "size": (lambda a: a.size, np.abs),
    "squared": (lambda a: a.squared, np.square),
    "cosine": (cosine, np.cos),
    "sine": (sine, np.sin),
    "clipped": (lambda a: a.clipped(-1.0, 0.5), lambda x: np.clip(x, -1.0, 0.5)),
}
OF_TWO: dict[str, Two] = {
    "sum": (lambda a, b: a + b, lambda x, y: x + y),
    "difference": (lambda a, b: a - b, lambda x, y: x - y),
    "product": (lambda a, b: a * b, lambda x, y: x * y),
}


def drawn(seed: int, count: int) -> list[tuple[Interval, Array]]:
    """Intervals about 0, and numbers within them, their ends too."""
    random = np.random.default_rng(seed)
    ends = np.sort(random.uniform(-4.0, 4.0, (count, 2)) * random.uniform(0.0, 1.0, (count, 1)), axis=1)
    return [(Interval(np.array(low), np.array(high)), np.linspace(low, high, SAMPLES)) for low, high in ends]


@pytest.mark.parametrize("name", OF_ONE)
@given(seeds)
@settings(max_examples=50)
def test_of_one_number(name: str, seed: int) -> None:
    ((interval, numbers),) = drawn(seed, 1)
    bound, exact = OF_ONE[name]
    found, values = bound(interval), exact(numbers)
    assert found.low - 1e-12 <= values.min() <= found.low + 0.2
    assert found.high - 0.2 <= values.max() <= found.high + 1e-12


@pytest.mark.parametrize("name", OF_TWO)
@given(seeds)
@settings(max_examples=50)
def test_of_two_numbers(name: str, seed: int) -> None:
    (one, numbers), (two, others) = drawn(seed, 2)
    bound, exact = OF_TWO[name]
    found, values = bound(one, two), exact(numbers[:, None], others)
    np.testing.assert_allclose([found.low, found.high], [values.min(), values.max()], atol=1e-12)


@given(seeds)
@settings(max_examples=100)
def test_directions_of_a_rectangle(seed: int) -> None:
    """Whole turns apart they are the same; a rectangle about 0 has all."""
    (x, xs), (y, ys) = drawn(seed, 2)
    found, angles = direction(x, y), np.arctan2(ys, xs[:, None])
    middle = (found.low + found.high) / 2
    off = np.remainder(angles - middle + np.pi, 2 * np.pi) - np.pi
    half = (found.high - found.low) / 2
    assert np.abs(off).max() <= half + 1e-9
    assert half <= max(np.abs(off).max(), np.pi * (half > np.pi - 1e-9)) + 1e-9


@given(seeds, st.floats(-3.0, 3.0), st.floats(0.0, 6.0))
@settings(max_examples=100)
def test_meeting_bounds_after_whole_turns(seed: int, low: float, width: float) -> None:
    ((interval, numbers),) = drawn(seed, 1)
    turned = numbers[:, None] + 2 * np.pi * np.arange(-3, 4)
    inside = turned[(turned >= low) & (turned <= low + width)]
    meets, common = interval.meets_turned(low, low + width)
    assert meets or not len(inside)
    if len(inside):
        assert common.low - 1e-9 <= inside.min()
        assert inside.max() <= common.high + 1e-9
    assert low - 1e-9 <= common.low <= common.high <= low + width + 1e-9


@pytest.mark.parametrize(("near", "far"), [(0.15, 0.2), (0.2, 0.15), (0.1, 0.1)])
@given(seeds)
@settings(max_examples=50)
def test_angles_of_a_triangle(near: float, far: float, seed: int) -> None:
    """The widest angle is not at an end where `far` is the shorter."""
    elbow = np.sort(np.random.default_rng(seed).uniform(0.0, 3.1, 2))
    found = triangle(Interval(*elbow), near, far)
    q = np.linspace(elbow[0], elbow[1], 2001)
    angles = np.arctan2(far * np.sin(q), near + far * np.cos(q))
    np.testing.assert_allclose([found.low, found.high], [angles.min(), angles.max()], atol=1e-5)
    assert found.high >= angles.max() - 1e-12
