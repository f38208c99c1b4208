"""No proof denies, and no bound exceeds, what walls built backwards from a motion have (`backward`)."""

from __future__ import annotations

import os

import numpy as np
import pytest
from backward import ROBOT, Backward, backward_wall
from crux_planner.certificates.bound.climb import lower_bound
from crux_planner.certificates.infeasibility.infeasible import Proof
from crux_planner.checker.no_way import NotShownError, NoWay
from crux_planner.model.build import build_problem
from crux_planner.pipeline.bound_certificate import certify_bound
from crux_planner.pipeline.certificates import _Asked
from crux_planner.solvers import clock
from walls import scenario

MANY = int(os.environ.get("CRUX_BACKWARD_WALLS", "1000"))  # of the sweep: a wall takes about six seconds of computing
PROGRAMS, EFFORT = 40, 0.1


def tried(seed: int, *, certified: bool) -> tuple[Backward, bool] | None:
    """A wall, and whether it had a bound, which is below its cost; None where the seed draws no motion."""
    found = backward_wall(seed)
    if found is None:
        return None
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
        document = certify_bound(read, ROBOT, read.horizon.steps, np.inf)
        assert 0.0 < document["bound"] <= found.cost, seed
    if not found.centred:
        return found, False
    bound = lower_bound(problem, 2.0 * found.cost, 5.0, effort=EFFORT)
    assert bound is not None
    assert bound <= found.cost, seed
    return found, True


def check(seeds: range, walls: int, *, certified: bool) -> tuple[int, int]:
    """So many walls at most; how many there were, and how many of them with a bound."""
    results = (result for seed in seeds if (result := tried(seed, certified=certified)) is not None)
    bounded = [bound for _, (_, bound) in zip(range(walls), results, strict=False)]
    return len(bounded), sum(bounded)


def test_walls_with_a_motion_are_neither_denied_nor_overrated() -> None:
    walls, bounded = check(range(100_000), 25, certified=False)
    assert walls == 25
    assert bounded > 5


def test_the_checkers_search_denies_none_either() -> None:
    assert check(range(100_000, 200_000), 3, certified=True)[0] == 3


@pytest.mark.sweep
@pytest.mark.parametrize("part", range(10))
def test_many_walls_with_a_motion_are_neither_denied_nor_overrated(part: int) -> None:
    first = 1_000_000 * (part + 1)
    walls, bounded = check(range(first, first + 1_000_000), MANY // 10, certified=True)
    print(f"{walls} walls, {bounded} of them with a bound")
    assert walls == MANY // 10
