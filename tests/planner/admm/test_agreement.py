"""Sequences of contacts that limbs agree on, against enumeration and a check by another way."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from crux_planner.admm.agreement import Agreement, Prices
from crux_planner.admm.limb_paths import Path
from crux_planner.admm.stages import Stages, clash
from crux_planner.errors import InfeasibleError
from crux_planner.solvers import clock
from scenes import Scene, scene


def random_prices(stages: Stages, seed: int) -> list[Prices]:
    rng = np.random.default_rng(seed)
    contacts = len(stages.problem.contacts)
    return [
        Prices(rng.normal(size=(stages.count, contacts)), rng.normal(size=len(stages.arcs[limb]))) for limb in range(4)
    ]


def all_paths(agreement: Agreement, limb: int, prices: Prices) -> list[Path]:
    """Those with at most one swing, cheapest first."""
    stages = agreement.stages
    start = stages.problem.start_contacts[limb]
    found = []
    for taken in [(), *((i,) for i, arc in enumerate(stages.arcs[limb]) if arc.start == start)]:
        contacts = stages.held(limb, agreement.paths[limb].swings(Path(0.0, taken)))
        if contacts[-1] in stages.goals[limb]:
            cost = sum(prices.held[t, c] for t, c in enumerate(contacts) if c is not None)
            found.append(Path(float(cost + sum(prices.arcs[i] for i in taken)), taken))
    return sorted(found, key=lambda path: path.cost)


def agree(small: Scene, agreement: Agreement, paths: tuple[Path, ...], at_once: int) -> bool:
    stages, problem = small.stages, small.problem
    swings = agreement.swings(list(paths))
    if clash(stages, swings) is not None:
        return False
    held = [stages.held(limb, swings) for limb in range(4)]
    low_room, high_room = stages.body_room()
    for t in range(stages.count):
        standing = [(limb, c) for limb in range(4) if (c := held[limb][t]) is not None]
        if len({problem.contacts[c].hold for _, c in standing}) < len(standing) or len(standing) < 4 - at_once:
            return False
        low, high = low_room, high_room
        for limb in range(4):
            over = [s for s in swings if s.limb == limb and held[limb][t] is None and s.first // stages.knots <= t]
            contact = held[limb][t]
            ends = [over[-1].start, over[-1].goal] if contact is None else [contact]
            low = np.maximum(low, small.reach.low[limb, ends].min(axis=0))
            high = np.minimum(high, small.reach.high[limb, ends].max(axis=0))
        support = tuple(c for _, c in standing)
        if (low > high).any() or small.balance.position(support, low, high, (low + high) / 2) is None:
            return False
    return True


@pytest.mark.parametrize("seed", range(6))
def test_no_sequence_that_agrees_is_cheaper(seed: int) -> None:
    small = scene(25, goal_m=0.06)
    agreement = Agreement(small.stages, small.balance)
    prices = random_prices(small.stages, seed)
    options = [all_paths(agreement, limb, prices[limb])[:7] for limb in range(4)]
    combinations = sorted(itertools.product(*options), key=lambda paths: sum(p.cost for p in paths))
    # Enumerated are the cheapest few paths of each limb; a cheaper sequence may exist beyond them.
    cheapest = next((paths for paths in combinations if agree(small, agreement, paths, 1)), None)
    found = agreement.cheapest(prices, lambda _swings: True, clock.now() + 30.0)
    assert agree(small, agreement, tuple(found), agreement.at_once)
    assert cheapest is not None
    assert agreement.at_once == 1
    assert sum(p.cost for p in found) <= sum(p.cost for p in cheapest) + 1e-9


def test_an_unsound_sequence_is_left_for_the_next_best() -> None:
    small = scene(25, goal_m=0.06)
    prices = random_prices(small.stages, 3)
    agreement = Agreement(small.stages, small.balance)
    best = agreement.cheapest(prices, lambda _swings: True, clock.now() + 30.0)
    other = Agreement(small.stages, small.balance)
    refused = agreement.swings(best)
    next_best = other.cheapest(prices, lambda swings: swings != refused, clock.now() + 30.0)
    assert other.swings(next_best) != refused
    assert sum(p.cost for p in next_best) >= sum(p.cost for p in best)


def test_limbs_that_cannot_agree_say_so() -> None:
    small = scene(25, goal_m=0.06)
    agreement = Agreement(small.stages, small.balance)
    prices = random_prices(small.stages, 0)
    none = [Prices(np.full_like(p.held, np.inf), p.arcs) if limb == 2 else p for limb, p in enumerate(prices)]
    with pytest.raises(InfeasibleError, match="LR finds no chain"):
        agreement.cheapest(none, lambda _swings: True, clock.now() + 30.0)
    with pytest.raises(InfeasibleError, match="time allowed"):
        agreement.cheapest(prices, lambda _swings: False, clock.now() - 1.0)
