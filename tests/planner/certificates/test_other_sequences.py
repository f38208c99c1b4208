"""What the MIP over stances says of a sequence, against all orders of its moves, one by one."""

from __future__ import annotations

from functools import lru_cache
from itertools import permutations

import numpy as np
import pytest
from crux_contracts.places import MSGS
from crux_contracts.robot import load_robot
from crux_contracts.scenario import load_scenario
from crux_planner.certificates.other_sequences import GAP, look_at_others
from crux_planner.certificates.stance_mip import Loads, Sequence, StanceMip
from crux_planner.model.build import build_problem
from crux_planner.pipeline.solve_and_check import path_to_goal
from crux_planner.search.event_cost import EventCost, Timed
from crux_planner.search.improve import improve, retimed
from crux_planner.search.schedule import at_knots
from crux_planner.search.stances import Oracles, search
from crux_planner.solvers import clock
from crux_planner.trajectory.exact import solve_within_torques
from crux_planner.trajectory.solution import start_from_path

LATER = np.inf


def sequence_of(timed: Timed) -> Sequence:
    return tuple((m.limbs[0], (m.before[m.limbs[0]], m.after[m.limbs[0]])) for m in timed.moves)


@lru_cache
def orders(name: str) -> tuple[EventCost, list[Timed]]:
    """The search's moves in every order in which they can be made, the cheapest by the estimate first."""
    problem = build_problem(load_scenario(MSGS / "scenarios" / f"{name}.yaml"), load_robot("scaler"))
    oracles = Oracles.of(problem)
    moves, _ = search(oracles, at_once=1, greed=1.0, deadline=clock.now() + 300)
    assert moves is not None
    costs = EventCost(oracles)
    timed = improve(costs, moves, clock.now() + 300)
    assert timed is not None
    steps = [((move.limbs[0],), (move.after[move.limbs[0]],)) for move in timed.moves]
    others = [retimed(costs, several, timed) for several in permutations(steps)]
    priced = [(found.cost, i) for i, other in enumerate(others) if other and (found := costs.estimate(other))]
    return costs, [other for _, i in sorted(priced) if (other := others[i]) is not None]


@lru_cache
def from_below(name: str, which: int) -> float:
    """What the program says one order costs at least."""
    costs, every = orders(name)
    sequence = sequence_of(every[which])
    swings = [sorted({swing for at, swing in sequence if at == limb}) for limb in range(4)]
    program = StanceMip(costs, Loads(costs), len(sequence), swings)
    program.fix(sequence)
    for _ in range(8):
        relaxed = program.solve(relaxed=True)
        assert relaxed.values is not None
        program.cut(relaxed.values, 0.0)
    return relaxed.objective


def exact_cost(name: str, which: int) -> float:
    """J of the exact program, of all knots."""
    costs, every = orders(name)
    timed, problem = every[which], costs.problem
    schedule = at_knots(problem, costs.swings, timed.moves, timed.stances, timed.swings)
    aimed, path = path_to_goal(problem, costs.equilibrium, schedule)
    assert path is not None
    solution = solve_within_torques(aimed, schedule, start_from_path(aimed, path), clock.now() + 300)
    assert solution.solved
    return solution.cost


@pytest.mark.parametrize("name", ["climb-slippery", pytest.param("climb-vertical", marks=pytest.mark.sweep)])
def test_the_program_is_below_the_exact_cost(name: str) -> None:
    for which in range(2):
        exact = exact_cost(name, which)
        assert 0.5 * exact < from_below(name, which) < exact


@pytest.mark.parametrize("name", ["climb-slippery", pytest.param("climb-vertical", marks=pytest.mark.sweep)])
@pytest.mark.parametrize("which", [pytest.param(0, marks=pytest.mark.sweep), -1])
def test_no_order_is_cheaper_than_it_says(name: str, which: int) -> None:
    costs, every = orders(name)
    said = look_at_others(costs, every[which], LATER)
    assert said is not None
    assert said.found == (which != 0)
    assert said.least > 0.5
    others = range(len(every))[1:] if which == 0 else range(len(every))[:-1]
    below = sorted(from_below(name, other) for other in others)
    assert which != 0 or said.judged < len(below)  # some are left to compare
    assert all(said.least * from_below(name, which) <= 1.01 * rest for rest in below[said.judged :])


def test_of_a_dear_order_it_finds_the_cheapest() -> None:
    costs, every = orders("climb-slippery")
    cheapest, dearest = costs.estimate(every[0]), costs.estimate(every[-1])
    assert cheapest is not None
    assert dearest is not None
    assert dearest.cost > 1.05 * cheapest.cost
    said = look_at_others(costs, every[-1], LATER)
    assert said is not None
    assert said.found
    found = costs.estimate(said.timed)
    assert found is not None
    assert found.cost < (1.0 + GAP) * cheapest.cost


def test_a_needless_move_is_left_out() -> None:
    costs, every = orders("climb-slippery")
    steps = [((limb,), (end,)) for limb, (_, end) in sequence_of(every[0])]
    limb, start = steps[0][0][0], costs.problem.start_contacts[steps[0][0][0]]
    ways = (retimed(costs, (((limb,), (int(via),)), *steps), every[0]) for via in costs.reach.neighbours(limb, start))
    detour = next(timed for timed in ways if timed is not None and costs.estimate(timed) is not None)
    said = look_at_others(costs, detour, LATER)
    assert said is not None
    assert said.found
    assert len(said.timed.moves) == len(detour.moves) - 1


def test_where_the_time_is_over_it_is_not_asked() -> None:
    costs, every = orders("climb-slippery")
    assert look_at_others(costs, every[0], clock.now() - 1.0) is None
