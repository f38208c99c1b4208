"""The lower bound of J: below every plan, and its parts against closed forms."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from crux_planner.admm import bound
from crux_planner.admm.bound import gap, lower_bound
from crux_planner.admm.consensus import Scales
from crux_planner.admm.knot_qp import solve_knots

from .scenes import Scene, scene


@pytest.fixture(scope="module")
def small() -> Scene:
    return scene(20, width_m=0.2, goal_m=0.06)


def test_no_plan_of_the_contact_block_costs_less(small: Scene) -> None:
    problem, stages = small.problem, small.stages
    floor = lower_bound(problem, small.reach, small.ways, 30.0)
    assert floor is not None
    path = np.linspace(problem.start.position_m, problem.goal.body.position_m, problem.steps + 1)
    costs = []
    first = [[stages.swinging(limb, stages.arcs[limb][0])] for limb in range(4)]
    for swings in ([], *first):
        knots = solve_knots(problem, small.balance, stages.schedule(swings), 0.0, None, Scales(), path, True)
        if knots is not None:
            costs.append(knots.cost)
    assert costs
    assert 0.2 * min(costs) < floor <= min(costs)


def test_wrenches_cost_at_least_what_the_weight_asks(small: Scene) -> None:
    """Shear shared by eight fingers and the same normal force of both is the cheapest way to hold a weight."""
    effort = bound._least_effort(small.problem, 4, small.later)
    assert effort is not None
    assert effort >= 0.99 * float(np.sum((small.problem.weight_N / 8) ** 2) * 8 * 0.9)
    fewer = bound._least_effort(small.problem, 3, small.later)
    assert fewer is not None
    assert fewer > effort


def test_more_friction_never_raises_the_bound(small: Scene) -> None:
    rough = replace(small.problem, contacts=[replace(c, friction=3.0) for c in small.problem.contacts])
    slippery = replace(small.problem, contacts=[replace(c, friction=0.6) for c in small.problem.contacts])
    values = [bound._least_effort(p, 4, small.later) for p in (rough, small.problem, slippery)]
    assert None not in values
    assert values[0] * 0.995 <= values[1] <= values[2] * 1.005  # type: ignore[operator]


def test_the_best_mix_is_on_the_lower_hull() -> None:
    values = np.array([1.0, 2.0, 2.5, 9.0])
    grid = np.linspace(0, 1, 201)
    for flying in (0.0, 0.3, 1.0, 1.7):
        mixes = [
            (1 - s) * values[a] + s * values[b]
            for a in range(4)
            for b in range(4)
            for s in grid
            if (1 - s) * a + s * b >= flying - 1e-12
        ]
        assert bound._best_mix(values, flying) == pytest.approx(min(mixes), abs=0.02)


def test_a_gap_is_a_share_of_the_cost_or_nothing() -> None:
    assert gap(10.0, 9.0) == pytest.approx(0.1)
    assert gap(10.0, None) is None
    assert gap(10.0, -np.inf) is None


def test_the_papers_surface_has_no_bound(small: Scene) -> None:
    problem = replace(small.problem, limit_surface="paper")
    assert lower_bound(problem, small.reach, small.ways) is None
