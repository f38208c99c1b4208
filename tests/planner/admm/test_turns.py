"""P3b: sequences in which limbs take turns, against enumeration."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest
from crux_planner.admm.turns import Turn, cheapest_turns, in_turn
from crux_planner.trajectory.consensus import Eta, Scales
from scenes import square

EDGES = np.array([0, 2, 5, 8, 11, 14])
SCALES = Scales(force=0.3, moment=0.2, flag=1.5)


def all_turns(lengths: list[list[int]], count: int) -> list[list[Turn]]:
    """Every way to place the swings, one at a time."""
    swings = [(limb, long) for limb, own in enumerate(lengths) for long in own]
    found = []
    for firsts in itertools.product(range(1, count - 1), repeat=len(swings)):
        turns = [(limb, first, first + long) for (limb, long), first in zip(swings, firsts, strict=True)]
        ordered = sorted(turns, key=lambda turn: turn[1])
        inside = all(end <= count - 1 for _, _, end in turns)
        apart = all(one[2] + (one[0] == two[0]) <= two[1] for one, two in itertools.pairwise(ordered))
        kept = all([t for t in ordered if t[0] == limb] == [t for t in turns if t[0] == limb] for limb in range(4))
        if inside and apart and kept:
            found.append(ordered)
    return found


@pytest.mark.parametrize("lengths", [[[1], [1], [1], [1]], [[1, 2], [1], [], [1]], [[2], [], [1, 1], []]])
def test_the_cheapest_turns_are_those_of_enumeration(lengths: list[list[int]]) -> None:
    random = np.random.default_rng(len(lengths[0]))
    for _ in range(4):
        prices = random.normal(size=(4, 8))

        def price(turn: Turn, prices: np.ndarray = prices) -> float:
            return float(prices[turn[0], turn[1] : turn[2]].sum())

        found = cheapest_turns(lengths, 8, price)
        options = all_turns(lengths, 8)
        assert found in options
        assert sum(map(price, found)) == pytest.approx(min(sum(map(price, turns)) for turns in options))


def test_what_has_no_time_is_left_out() -> None:
    found = cheapest_turns([[2], [2], [2], [2]], 6, lambda turn: float(turn[0]))
    assert found == [(0, 1, 3), (1, 3, 5)]


def copies(seed: int) -> tuple[Eta, np.ndarray]:
    """A copy with all limbs away together, more or less, and what the limbs have."""
    random = np.random.default_rng(seed)
    copy = Eta.zeros(14)
    copy.forces[:], copy.moments[:] = random.normal(size=copy.forces.shape), random.normal(size=copy.moments.shape)
    away = np.zeros((5, 4))
    away[1, :3] = 1.0
    return replace(copy, away=random.normal(size=away.shape)), away


def test_the_copy_is_the_nearest_one_in_turn() -> None:
    copy, away = copies(3)
    got = in_turn(copy, away, np.full(away.shape, 0.5), EDGES, 1, SCALES)
    far = square(got - copy, SCALES)
    for turns in all_turns([[1], [1], [1], []], 5):
        other, flags = replace(copy, forces=copy.forces.copy(), moments=copy.moments.copy()), np.zeros(away.shape)
        for limb, first, end in turns:
            flags[first:end, limb] = 1.0
            air = slice(EDGES[first] + 1, EDGES[end])
            other.forces[air, 2 * limb : 2 * limb + 2] = other.moments[air, 2 * limb : 2 * limb + 2] = 0.0
        assert far <= square(replace(other, away=flags) - copy, SCALES) + 1e-9


def test_who_bears_nothing_goes_first() -> None:
    """All wish for the same window: the one that the NLP has bear nothing there gets it, the others wait."""
    copy, away = copies(4)
    copy = replace(copy, away=away)
    copy.forces[:], copy.moments[:] = 10.0, 0.0
    copy.forces[EDGES[1] : EDGES[2], 2:4] = 0.0
    got = in_turn(copy, away, np.full(away.shape, 0.5), EDGES, 1, SCALES)
    assert got.away[1].tolist() == [0.0, 1.0, 0.0, 0.0]
    assert got.away.sum(axis=0).tolist() == [1.0, 1.0, 1.0, 0.0]
    again = in_turn(got, got.away, got.away, EDGES, 1, SCALES)
    np.testing.assert_array_equal(again.away, got.away)
    np.testing.assert_array_equal(again.forces, got.forces)


def test_of_sequences_as_near_the_one_before_stays() -> None:
    copy, away = copies(6)
    copy = replace(copy, away=away)
    copy.forces[:] = copy.moments[:] = 0.0
    for turns in all_turns([[1], [1], [1], []], 5):
        before = np.zeros(away.shape)
        for limb, first, end in turns:
            before[first:end, limb] = 1.0
        assert in_turn(copy, away, before, EDGES, 1, SCALES).away.tolist() == before.tolist()
