"""Sequences of contacts that limbs agree on, against enumeration and a check by another way."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from crux_planner.admm.agreement import Agreement, ContactCosts
from crux_planner.admm.limb_paths import Path
from crux_planner.admm.windows import Windows, clash
from crux_planner.errors import InfeasibleError
from crux_planner.solvers import clock
from scenes import Scene, scene


def random_prices(windows: Windows, seed: int) -> list[ContactCosts]:
    rng = np.random.default_rng(seed)
    contacts = len(windows.problem.contacts)
    return [
        ContactCosts(rng.normal(size=(windows.count, contacts)), rng.normal(size=len(windows.arcs[limb])))
        for limb in range(4)
    ]


def all_paths(agreement: Agreement, limb: int, costs: ContactCosts) -> list[Path]:
    """Those with at most one swing, cheapest first."""
    windows = agreement.windows
    start = windows.problem.start_contacts[limb]
    found = []
    for taken in [(), *((i,) for i, arc in enumerate(windows.arcs[limb]) if arc.start == start)]:
        contacts = windows.held(limb, agreement.paths[limb].swings(Path(0.0, taken)))
        if contacts[-1] in windows.goals[limb]:
            cost = sum(costs.held[t, c] for t, c in enumerate(contacts) if c is not None)
            found.append(Path(float(cost + sum(costs.arcs[i] for i in taken)), taken))
    return sorted(found, key=lambda path: path.cost)


def agree(small: Scene, agreement: Agreement, paths: tuple[Path, ...], at_once: int) -> bool:
    windows, problem = small.windows, small.problem
    swings = agreement.swings(list(paths))
    if clash(windows, swings) is not None:
        return False
    held = [windows.held(limb, swings) for limb in range(4)]
    low_slack, high_slack = windows.body_range()
    for t in range(windows.count):
        standing = [(limb, c) for limb in range(4) if (c := held[limb][t]) is not None]
        if len({problem.contacts[c].hold for _, c in standing}) < len(standing) or len(standing) < 4 - at_once:
            return False
        low, high = low_slack, high_slack
        grippers: list[int] = []
        for limb in range(4):
            over = [s for s in swings if s.limb == limb and held[limb][t] is None and s.first // windows.knots <= t]
            contact = held[limb][t]
            ends = [over[-1].start, over[-1].goal] if contact is None else [contact]
            grippers += 2 * ends if len(ends) == 1 else ends
            low = np.maximum(low, small.reach.low[limb, ends].min(axis=0))
            high = np.minimum(high, small.reach.high[limb, ends].max(axis=0))
        support = tuple(c for _, c in standing)
        middle = (low + high) / 2
        if (low > high).any() or small.equilibrium.position(support, low, high, middle, tuple(grippers)) is None:
            return False
    return True


@pytest.mark.parametrize("seed", range(6))
def test_no_sequence_that_agrees_is_cheaper(seed: int) -> None:
    small = scene(25, goal_m=0.06)
    agreement = Agreement(small.windows, small.equilibrium)
    costs = random_prices(small.windows, seed)
    options = [all_paths(agreement, limb, costs[limb])[:7] for limb in range(4)]
    combinations = sorted(itertools.product(*options), key=lambda paths: sum(p.cost for p in paths))
    # Enumerated are the cheapest few paths of each limb; a cheaper sequence may exist beyond them.
    cheapest = next((paths for paths in combinations if agree(small, agreement, paths, 1)), None)
    found = agreement.cheapest(costs, lambda _swings: True, clock.now() + 30.0)
    assert agree(small, agreement, tuple(found), agreement.at_once)
    assert cheapest is not None
    assert agreement.at_once == 1
    assert sum(p.cost for p in found) <= sum(p.cost for p in cheapest) + 1e-9


def test_an_unsound_sequence_is_left_for_the_next_best() -> None:
    small = scene(25, goal_m=0.06)
    costs = random_prices(small.windows, 3)
    agreement = Agreement(small.windows, small.equilibrium)
    best = agreement.cheapest(costs, lambda _swings: True, clock.now() + 30.0)
    other = Agreement(small.windows, small.equilibrium)
    refused = agreement.swings(best)
    next_best = other.cheapest(costs, lambda swings: swings != refused, clock.now() + 30.0)
    assert other.swings(next_best) != refused
    assert sum(p.cost for p in next_best) >= sum(p.cost for p in best)


def test_limbs_that_cannot_agree_say_so() -> None:
    small = scene(25, goal_m=0.06)
    agreement = Agreement(small.windows, small.equilibrium)
    costs = random_prices(small.windows, 0)
    none = [ContactCosts(np.full_like(p.held, np.inf), p.arcs) if limb == 2 else p for limb, p in enumerate(costs)]
    with pytest.raises(InfeasibleError, match="LR finds no chain"):
        agreement.cheapest(none, lambda _swings: True, clock.now() + 30.0)
    with pytest.raises(InfeasibleError, match="time allowed"):
        agreement.cheapest(costs, lambda _swings: False, clock.now() - 1.0)
