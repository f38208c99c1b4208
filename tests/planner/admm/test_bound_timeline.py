"""The dynamic programme against all timelines there are, on a case small enough to try them all."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from crux_planner.bound.timeline import Timeline

KNOTS = 5
LEAST_AIR = [np.array([2, 3]), np.array([2]), np.array([1, 2]), np.array([3])]
CHANGE = 0.3


def timelines(least_air: np.ndarray) -> list[tuple[int, ...]]:
    """Options of one limb at knots 0..KNOTS, from contact 0, ending on a contact; the air comes last."""
    many, found = len(least_air), []
    for options in itertools.product(range(many + 1), repeat=KNOTS):
        whole, legal, k = (0, *options), True, 1
        while k <= KNOTS and legal:
            if whole[k] == many:
                end = k
                while end <= KNOTS and whole[end] == many:
                    end += 1
                legal = end <= KNOTS and end - k >= least_air[whole[end]]
                k = end
            else:
                legal = whole[k] == whole[k - 1] or whole[k - 1] == many
                k += 1
        if legal:
            found.append(whole)
    return found


def test_the_cheapest_way_is_the_cheapest_of_all() -> None:
    random = np.random.default_rng(3)
    shape = tuple(len(air) + 1 for air in LEAST_AIR)
    stages = [random.uniform(0.0, 1.0, shape) for _ in range(KNOTS)]
    ends = [np.array([1]), np.array([0]), np.array([0, 1]), np.array([0])]
    best = np.inf
    for ways in itertools.product(*[timelines(air) for air in LEAST_AIR]):
        if any(way[-1] not in end for way, end in zip(ways, ends, strict=True)):
            continue
        changes = sum(
            (way[k] == len(air)) != (way[k + 1] == len(air))
            for way, air in zip(ways, LEAST_AIR, strict=True)
            for k in range(KNOTS)
        )
        cost = CHANGE * changes + sum(stages[k][tuple(way[k] for way in ways)] for k in range(KNOTS))
        best = min(best, cost)
    timeline = Timeline(LEAST_AIR, CHANGE)
    before = timeline.forward((0, 0, 0, 0), KNOTS, lambda k: stages[k])
    assert before is not None
    after = timeline.backward(ends, KNOTS, lambda k: stages[k])
    assert before[-1][np.ix_(*ends)].min() == pytest.approx(best)
    for a, b in zip(before, after, strict=False):
        assert (a + b).min() == pytest.approx(best)
    by_options = timeline.by_options(before[2] + after[2])
    assert by_options.shape == shape
    assert by_options.min() == pytest.approx(best)
