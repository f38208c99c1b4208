"""The dynamic program against all timelines there are, on a case small enough to try them all."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from crux_planner.certificates.bound.timeline import Timeline

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


@pytest.mark.parametrize("kept", [2, 40])
def test_the_cheapest_way_is_the_cheapest_of_all(kept: int, monkeypatch: pytest.MonkeyPatch) -> None:
    random = np.random.default_rng(3)
    shape = tuple(len(air) + 1 for air in LEAST_AIR)
    options = np.array(list(np.ndindex(*shape)))
    stages = [random.uniform(0.0, 1.0, shape) for _ in range(KNOTS)]
    for stage in stages:
        stage[0, 0, 1, 0] = stage[2, 1, 1, 0] = np.inf  # nodes that the program is not told of
    options = options[np.isfinite(stages[0][tuple(options.T)])]
    ends = [np.array([1]), np.array([0]), np.array([0, 1]), np.array([0])]
    best, on_node = np.inf, np.full((KNOTS, *shape), np.inf)
    for swings in itertools.product(*[timelines(air) for air in LEAST_AIR]):
        if any(way[-1] not in end for way, end in zip(swings, ends, strict=True)):
            continue
        changes = sum(
            (way[k] == len(air)) != (way[k + 1] == len(air))
            for way, air in zip(swings, LEAST_AIR, strict=True)
            for k in range(KNOTS)
        )
        nodes = [tuple(way[k] for way in swings) for k in range(KNOTS)]
        cost = CHANGE * changes + sum(stages[k][node] for k, node in enumerate(nodes))
        best = min(best, cost)
        for k, node in enumerate(nodes):
            on_node[k][node] = min(on_node[k][node], cost)
    monkeypatch.setattr("crux_planner.certificates.bound.timeline._KEPT", kept)
    timeline = Timeline(options, LEAST_AIR, CHANGE)
    last = np.flatnonzero([all(o in end for o, end in zip(option, ends, strict=True)) for option in options])
    stage_of_node = [stage[tuple(options.T)] for stage in stages]
    start = int(np.flatnonzero((options == 0).all(axis=1))[0])
    way = timeline.forward(start, last, KNOTS, lambda k: stage_of_node[k])
    assert way.least == pytest.approx(best)
    through = timeline.through(way, last, lambda k: stage_of_node[k])
    for k in range(KNOTS):
        np.testing.assert_allclose(through[k], on_node[k][tuple(options.T)])
