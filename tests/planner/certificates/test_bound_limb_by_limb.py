"""The bound from limbs and body each by themselves: its ways against every way there is, its sum against plans."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import numpy as np
import pytest
from crux_contracts.robot import load_robot
from crux_contracts.scenario import parse_scenario
from crux_planner.certificates.bound import climb
from crux_planner.certificates.bound.climb import lower_bound
from crux_planner.certificates.bound.excursion import body_range, quickest_way, yaw_range
from crux_planner.certificates.bound.limb_by_limb import LimbByLimb, ascended
from crux_planner.certificates.bound.limb_ways import LimbWays
from crux_planner.certificates.bound.places import orientations
from crux_planner.certificates.bound.swings import distinct, floor
from crux_planner.model.arrays import Array
from crux_planner.model.build import build_problem
from crux_planner.model.problem import Problem
from scenes import scene, wall
from simple_plans import staying_and_stepping, without_margin

KNOTS = 10


def every_way(ways: LimbWays, ground: Array, air: Array, knot: int = 0, on: int = 0) -> Iterator[float]:
    """What each way from a contact at a knot to an end at the last knot costs, one after the other."""
    if knot == KNOTS:
        if on in ways.ends:
            yield 0.0
        return
    if ways.allowed[knot, on]:
        yield from (ground[knot, on] + rest for rest in every_way(ways, ground, air, knot + 1, on))
    for swing in np.flatnonzero(ways.begins == on):
        for landing in range(knot + 1 + ways.knots[swing], KNOTS + 1):
            land = int(ways.lands[swing])
            if ways.allowed[landing - 1, land]:
                cost = ground[knot, on] + air[knot + 1 : landing, swing].sum() + 2 * ways.change
                yield from (cost + rest for rest in every_way(ways, ground, air, landing, land))


@pytest.fixture
def few_ways() -> tuple[LimbWays, Array, Array]:
    """Of a limb that may go to four contacts, not at any knot, with costs out of the blue."""
    problem, random = scene(KNOTS).problem, np.random.default_rng(3)
    contacts = distinct(problem, 0)[:4]
    allowed = random.random((KNOTS + 1, len(contacts))) < 0.8
    allowed[:, 0] = allowed[-1] = True
    ways = LimbWays(problem, 0, contacts, allowed)
    ways.ends = np.array([1, 2])
    return ways, random.normal(size=(KNOTS, len(contacts))), random.normal(size=(KNOTS, len(ways.knots)))


def test_the_cheapest_way_is_that_of_all(few_ways: tuple[LimbWays, Array, Array]) -> None:
    (ways, ground, air), random = few_ways, np.random.default_rng(7)
    for _ in range(30):
        ground, air = random.normal(size=ground.shape), random.normal(size=air.shape)
        costs = np.array(list(every_way(ways, ground, air)))
        assert len(costs) > 30
        assert ways.least(ground, air) == pytest.approx(costs.min(), abs=1e-12)


def test_the_soft_least_is_of_all_ways_and_so_are_its_slopes(few_ways: tuple[LimbWays, Array, Array]) -> None:
    (ways, ground, air), heat = few_ways, 0.3

    def soft(ground: Array, air: Array) -> float:
        costs = np.array(list(every_way(ways, ground, air)))
        return float(costs.min() - heat * np.log(np.exp((costs.min() - costs) / heat).sum()))

    found = ways.soft(ground, air, heat, -1.0)
    assert found is not None
    assert found[0] == pytest.approx(soft(ground, air), abs=1e-9)
    random = np.random.default_rng(4)
    for _ in range(3):
        a, b = 1e-5 * random.normal(size=ground.shape), 1e-5 * random.normal(size=air.shape)
        change = soft(ground + a, air + b) - soft(ground - a, air - b)
        assert 2 * ((found[1] * a).sum() + (found[2] * b).sum()) == pytest.approx(change, rel=1e-5)


def by_limbs(problem: Problem) -> LimbByLimb:
    problem = replace(problem, boxes=problem.limb_reach.outer)
    return LimbByLimb(problem, orientations(problem, *yaw_range(problem, 8.0)), body_range(problem, 8.0))


def test_its_slopes_are_those_of_its_values() -> None:
    dual, random = by_limbs(scene(12).problem), np.random.default_rng(5)
    x = dual.scaled(0.003 * random.normal(size=6)) + 0.02 * random.normal(size=14 * 12)
    for _ in range(3):
        way = random.normal(size=x.size)
        ends = [dual.soft(x + side * 1e-6 * way, 0.1) for side in (-1.0, 0.0, 1.0)]
        values = [end[0] for end in ends if end is not None]
        assert ends[1] is not None
        assert values[2] - values[0] == pytest.approx(2e-6 * ends[1][1] @ way, rel=1e-3)


def test_no_multipliers_ask_more_than_a_plan_pays(monkeypatch: pytest.MonkeyPatch) -> None:
    """Multipliers near the best ones, where a false bound would show first."""
    problem = without_margin(scene(20, goal_m=0.0).problem)
    cheapest = min(staying_and_stepping(problem))
    dual, random = by_limbs(problem), np.random.default_rng(6)
    kept: list[Array] = []

    def keeping(*given: object) -> Array:
        kept.append(ascended(*given))  # type: ignore[arg-type]
        return kept[-1]

    monkeypatch.setattr(climb, "LARGEST", 0)
    monkeypatch.setattr(climb, "ascended", keeping)
    bound = lower_bound(problem, 8.0 + floor(problem), effort=0.4)
    assert bound is not None
    assert 0.6 * cheapest < bound <= cheapest
    for size in (0.01, 0.1, 1.0):
        assert dual.bound(kept[-1] + size * random.normal(size=kept[-1].size)) < cheapest


def test_a_wall_of_many_holds_has_more_than_the_weight_shared_evenly() -> None:
    text = wall(20, goal_m=0.1)
    lines = text.splitlines()
    at = lines.index("holds:") + 9
    more = [
        f"  - {{name: more-{i}-{j}, position_m: [{0.45 + 0.16 * i}, {y}], size_m: [0.06, 0.06, 0.06], friction: 2.2}}"
        for i in range(3)
        for j, y in enumerate((0.44, 0.28, -0.28, -0.44))
    ]
    problem = build_problem(parse_scenario("\n".join(lines[:at] + more + lines[at:])), load_robot("scaler"))
    problem = replace(problem, boxes=problem.limb_reach.outer, friction_share=1.0)
    bound = lower_bound(problem, 9.0, effort=0.3)
    assert bound is not None
    assert bound > 1.2 * (floor(problem) + quickest_way(problem))
