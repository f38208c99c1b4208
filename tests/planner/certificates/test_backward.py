"""No proof denies, and no bound exceeds, what walls built backwards from a motion have (`backward`)."""

from __future__ import annotations

import itertools
import os
from unittest.mock import patch

import numpy as np
import pytest
from backward import ROBOT, Backward, backward_wall
from crux_planner.certificates.bound import climb
from crux_planner.certificates.infeasibility.infeasible import Proof
from crux_planner.checker.no_way import NotShownError, NoWay
from crux_planner.model.build import build_problem
from crux_planner.pipeline.bound_certificate import certify_bound
from crux_planner.pipeline.certificates import _Asked
from crux_planner.solvers import clock
from walls import scenario

MANY = int(os.environ.get("CRUX_BACKWARD_WALLS", "10000"))  # of the sweep: three take about a second of computing
CERTIFIED, BOUNDED = 10, 200  # of so many walls, one is searched by the checker, and one has its bound certified
PROGRAMS, EFFORT = 40, 0.1


def ratio(found: Backward, seed: int, *, certified: bool, bound_certified: bool) -> float | None:
    """Of a wall's bound to its motion's cost; None where it has no bound, for grasps off the middle."""
    read = scenario(found.wall)
    problem = build_problem(read, ROBOT)
    proof, until = Proof(read, ROBOT, problem), clock.now() + 5
    reason = proof.quick() or proof.goal_equilibrium(PROGRAMS, until) or proof.disconnected(PROGRAMS, until)
    assert reason is None, (seed, str(reason))
    if certified:
        search = NoWay(read, ROBOT)
        search.ask = _Asked(proof, search, clock.now() + 1.0)
        with pytest.raises(NotShownError):
            search.prove()
    if bound_certified:
        document = certify_bound(read, ROBOT, read.horizon.steps, np.inf)
        assert 0.0 < document["bound"] <= found.cost, seed
    if not found.centred:
        return None
    bounds = []
    for largest in (climb.LARGEST, 0):  # over sets of grasps, and limb by limb
        with patch.object(climb, "LARGEST", largest):
            bound = climb.lower_bound(problem, 2.0 * found.cost, 5.0, effort=EFFORT)
        assert bound is not None
        assert bound <= found.cost, (seed, largest, bound, found.cost)
        bounds.append(bound)
    return max(bounds) / found.cost


def check(seeds: range, walls: int, *, certified: bool) -> tuple[int, list[float]]:
    """So many walls at most; how many there were, and the ratios of bounds to costs of those with a bound."""
    drawn = ((seed, found) for seed in seeds if (found := backward_wall(seed)) is not None)
    results = [
        ratio(found, seed, certified=certified and i % CERTIFIED == 0, bound_certified=certified and i % BOUNDED == 0)
        for i, (seed, found) in enumerate(itertools.islice(drawn, walls))
    ]
    return len(results), [each for each in results if each is not None]


@pytest.mark.parametrize("part", range(20))
def test_a_hundred_walls_with_a_motion_are_neither_denied_nor_overrated(part: int) -> None:
    walls, ratios = check(range(5000 * part, 5000 * (part + 1)), 5, certified=False)
    assert walls == 5
    assert ratios


def test_the_checkers_search_denies_none_either() -> None:
    assert check(range(100_000, 200_000), 1, certified=True)[0] == 1


@pytest.mark.sweep
@pytest.mark.parametrize("part", range(10))
def test_many_walls_with_a_motion_are_neither_denied_nor_overrated(part: int) -> None:
    first = 1_000_000 * (part + 1)
    walls, ratios = check(range(first, first + 1_000_000), MANY // 10, certified=True)
    print(f"{walls} walls, {len(ratios)} with a bound, of the motion's cost at most {max(ratios, default=0.0):.4f}")
    assert walls == MANY // 10
