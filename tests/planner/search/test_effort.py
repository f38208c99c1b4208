"""How the planner's work grows with the wall, counted in evaluations: no clock is asked."""

from __future__ import annotations

from functools import lru_cache

import pytest
from crux_contracts.robot import load_robot
from crux_planner.model.arrays import Array
from crux_planner.model.build import build_problem
from crux_planner.pipeline.solve_and_check import path_to_goal
from crux_planner.search.equilibrium import Query
from crux_planner.search.event_cost import EventCost
from crux_planner.search.improve import WORK, improve
from crux_planner.search.schedule import at_knots
from crux_planner.search.stances import Oracles, search
from crux_planner.search.torque_limits import TorqueLimits
from crux_planner.solvers import clock
from crux_planner.trajectory.exact import solve_within_torques
from crux_planner.trajectory.solution import start_from_path
from walls import ladder, scenario

LESS = WORK // 4  # than a plan's, so that the test takes less time


class Counted(TorqueLimits):
    """Counts the queries that it has no answer to yet."""

    queries = 0

    def _held(self, query: Query) -> Array | None:
        self.queries += 1
        return super()._held(query)


@lru_cache
def effort(rows: int, steps: int) -> dict[str, float]:
    """Moves, and what they took: stances expanded, balance queries, work on J, iterations of the exact P1."""
    problem = build_problem(scenario(ladder(rows, steps=steps)), load_robot("scaler"))
    equilibrium = Counted(problem, problem.friction_share)
    oracles = Oracles.of(problem, equilibrium)
    swings = oracles.swings
    later = clock.now() + 300
    moves, seen = search(oracles, at_once=1, greed=1.0, deadline=later)
    assert moves is not None
    queries, costs = equilibrium.queries, EventCost(oracles)
    timed = improve(costs, moves, later, work=LESS)
    assert timed is not None
    schedule = at_knots(problem, swings, timed.moves, timed.stances, timed.swings)
    aimed, path = path_to_goal(problem, equilibrium, schedule)
    assert path is not None
    solution = solve_within_torques(aimed, schedule, start_from_path(aimed, path), later)
    return {
        "moves": len(moves),
        "expanded": seen.expanded,
        "queries": queries,
        "improving": costs.work,
        "iterations": solution.iterations,
    }


def test_work_grows_with_the_number_of_moves_and_no_faster() -> None:
    few, many = effort(4, 40), effort(7, 110)
    assert many["moves"] >= 4 * few["moves"]
    for what in ("expanded", "queries"):
        assert many[what] / many["moves"] <= 3.0 * few[what] / few["moves"], what


@pytest.mark.parametrize(("rows", "steps"), [(4, 40), (7, 110)])
def test_work_on_the_cost_and_newton_steps_are_bounded(rows: int, steps: int) -> None:
    found = effort(rows, steps)
    assert found["improving"] <= 1.05 * LESS  # it ends after the estimate that is too much
    assert found["iterations"] <= 40
