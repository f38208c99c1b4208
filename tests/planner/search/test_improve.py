"""The local search on J and its quick estimate of J."""

from __future__ import annotations

import itertools
from dataclasses import dataclass, replace

import numpy as np
import pytest
from crux_contracts.robot import Robot
from crux_planner.model.build import build_problem
from crux_planner.model.problem import Problem
from crux_planner.model.schedule import Move
from crux_planner.search.body_path import knot_path
from crux_planner.search.event_cost import EventCost, Timed
from crux_planner.search.improve import WORK, improve
from crux_planner.search.schedule import at_knots
from crux_planner.search.stances import Oracles, search
from crux_planner.solvers import clock
from crux_planner.trajectory.exact import solve_within_torques
from crux_planner.trajectory.solution import start_from_path
from walls import ladder, scenario, two_rows


@dataclass(frozen=True)
class Wall:
    problem: Problem
    moves: list[Move]
    costs: EventCost

    @property
    def quickest(self) -> Timed:
        """The moves as quick as can be after waiting."""
        problem, swings = self.problem, self.costs.swings
        in_air = np.array([swings.intervals(m.before[m.limbs[0]], m.after[m.limbs[0]]) for m in self.moves])
        stances = np.ones(len(self.moves) + 1, dtype=int)
        stances[-1] = 2
        stances[0] += problem.steps - stances.sum() - in_air.sum()
        return Timed(self.moves, stances, in_air)

    def exact_cost(self, timed: Timed) -> float:
        """J of the exact NLP."""
        problem, costs = self.problem, self.costs
        schedule = at_knots(problem, costs.swings, timed.moves, timed.stances, timed.swings)
        path = knot_path(problem, costs.equilibrium, schedule)
        assert path is not None
        solution = solve_within_torques(problem, schedule, start_from_path(problem, path), clock.now() + 30)
        assert solution.solved
        return solution.cost


def wall_of(robot: Robot, weights: dict[str, float] | None = None, *, all_limbs: bool = True) -> Wall:
    content = two_rows(all_limbs=all_limbs)
    content["planner"] = {"weights": weights or {}}
    problem = build_problem(scenario(content), robot)
    oracles = Oracles.of(problem)
    later = clock.now() + 30
    moves, _ = search(oracles, at_once=1, greed=1.0, deadline=later)
    assert moves is not None
    return Wall(problem, moves, EventCost(oracles))


@pytest.fixture(scope="module")
def wall(robot: Robot) -> Wall:
    return wall_of(robot)


def improved(wall: Wall) -> Timed:
    timed = improve(wall.costs, wall.moves, clock.now() + 30)
    assert timed is not None
    return timed


def test_the_other_order_at_another_time_is_found(robot: Robot) -> None:
    """Two front limbs go up; either first, on either faces, with the time to spare in any stance."""
    free = wall_of(robot, all_limbs=False)
    problem, costs = free.problem, free.costs
    assert [move.limbs for move in free.moves] == [(0,), (1,)]
    held = free.moves[-1].after
    found = costs.estimate(improved(free))
    assert found is not None
    holds = {limb: problem.contacts[held[limb]].hold for limb in (0, 1)}
    ends = {
        limb: [c for c in problem.limb_contacts[limb] if problem.contacts[c].hold == holds[limb]] for limb in (0, 1)
    }
    nowhere = np.zeros(3)
    for order, left, right in itertools.product(((0, 1), (1, 0)), ends[0], ends[1]):
        stance, moves = problem.start_contacts, []
        for limb in order:
            after = (*stance[:limb], (left, right)[limb], *stance[limb + 1 :])
            moves.append(Move(stance, (after[0], after[1], after[2], after[3]), (limb,), nowhere, nowhere))
            stance = moves[-1].after
        if not all(costs.swings.free([(m.before[m.limbs[0]], m.after[m.limbs[0]])], m.support) for m in moves):
            continue
        late = replace(free, moves=moves).quickest
        spare = late.stances[0] - 1
        for where in range(3):
            stances = np.array([1, 1, 2])
            stances[where] += spare
            other = costs.estimate(replace(late, stances=stances))
            assert other is None or other.cost > 0.999 * found.cost


def test_the_estimate_is_near_the_exact_cost(wall: Wall) -> None:
    late = wall.quickest
    early = replace(late, stances=np.array([1, 1, 1, 1, late.stances[0] + 1]))
    for timed in (late, early):
        estimate = wall.costs.estimate(timed)
        assert estimate is not None
        assert estimate.cost == pytest.approx(wall.exact_cost(timed), rel=0.03)


def test_the_improved_sequence_is_cheaper_by_the_exact_cost(wall: Wall) -> None:
    timed = improved(wall)
    assert wall.exact_cost(timed) < wall.exact_cost(wall.quickest)
    assert timed.stances.sum() + timed.swings.sum() == wall.problem.steps
    assert [move.before for move in timed.moves[1:]] == [move.after for move in timed.moves[:-1]]
    ends = [wall.problem.contacts[c] for c in timed.moves[-1].after]
    assert {limb: (c.hold, c.pair) for limb, c in enumerate(ends)} == wall.problem.goal.grasps


def test_a_detour_is_left_out(wall: Wall) -> None:
    """A limb that goes to its goal over another hold goes straight there."""
    last = wall.moves[-1]
    limb = last.limbs[0]
    others = [c for c in wall.problem.limb_contacts[limb] if wall.problem.contacts[c].hold not in held(wall, last)]
    stops = [
        c
        for c in others
        if wall.costs.swings.swing(last.before[limb], c) and wall.costs.swings.swing(c, last.after[limb])
    ]
    for stop in stops:
        a, b, c, d = (stop if i == limb else c for i, c in enumerate(last.before))
        over = (a, b, c, d)
        detour = [replace(last, after=over), replace(last, before=over)]
        timed = improve(wall.costs, [*wall.moves[:-1], *detour], clock.now() + 30, work=10**7)
        if timed is not None:
            assert len(timed.moves) == len(wall.moves)
            return
    pytest.fail("no detour to try")


def held(wall: Wall, move: Move) -> set[int]:
    return {wall.problem.contacts[c].hold for c in (*move.before, *move.after)}


def test_limbs_stay_in_the_air_where_that_pays(robot: Robot, wall: Wall) -> None:
    """zeta and xi of (6) lengthen the swings."""
    usual = int(improved(wall).swings.sum())
    assert usual == wall.quickest.swings.sum()
    for weights in ({"lift": 3.0}, {"opening": 3.0}):
        assert improved(wall_of(robot, weights)).swings.sum() > usual


@pytest.fixture(scope="module")
def route(robot: Robot) -> Wall:
    oracles = Oracles.of(build_problem(scenario(ladder(6)), robot))  # ten moves: longer routes end by WORK
    moves, _ = search(oracles, at_once=1, greed=1.0, deadline=clock.now() + 60)
    assert moves is not None
    return Wall(oracles.problem, moves, EventCost(oracles))


def test_an_estimate_near_another_is_a_bound_and_costs_as_little_on_a_long_route(route: Wall) -> None:
    """A knot moved between two stances is judged by their surroundings; the whole path can only be cheaper."""
    costs, timed = route.costs, route.quickest
    whole = costs.estimate(timed)
    assert whole is not None
    for where in range(1, len(timed.stances)):
        stances = timed.stances.copy()
        stances[[0, where]] += [-1, 1]
        other, before = replace(timed, stances=stances), costs.work
        near = costs.estimate(other, whole)
        little, before = costs.work - before, costs.work
        anew = costs.estimate(other)
        assert near is not None
        assert anew is not None
        assert little < (costs.work - before) / 2
        assert anew.cost <= near.cost + 1e-4
        assert near.cost == pytest.approx(anew.cost, rel=1e-3)
        assert (near.body == whole.body).all(axis=1).sum() > len(whole.body) / 2


@pytest.mark.sweep
def test_the_search_on_the_cost_ends_where_no_neighbour_is_better_also_on_a_long_route(route: Wall) -> None:
    fresh = replace(route, costs=EventCost(Oracles.of(route.problem)))
    much = improve(fresh.costs, route.moves, clock.now() + 300, work=10**8)
    usual = improve(route.costs, route.moves, clock.now() + 300)
    assert much is not None
    assert usual is not None
    at_most, found = fresh.costs.estimate(much), fresh.costs.estimate(usual)
    assert at_most is not None
    assert found is not None
    assert found.cost == pytest.approx(at_most.cost, rel=1e-3)


def test_a_long_route_is_improved_all_along_before_the_work_is_done(robot: Robot) -> None:
    oracles = Oracles.of(build_problem(scenario(ladder(8)), robot))
    moves, _ = search(oracles, at_once=1, greed=1.0, deadline=clock.now() + 60)
    assert moves is not None
    costs = EventCost(oracles)
    timed = improve(costs, moves, clock.now() + 300)
    assert timed is not None
    assert costs.work >= WORK
    assert len(timed.moves) <= 15
    assert not any(now.limbs == then.limbs for now, then in itertools.pairwise(timed.moves))
