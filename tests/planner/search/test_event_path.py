"""The compiled program over the body's places finds what PIQP finds."""

from __future__ import annotations

import numpy as np
import pytest
from crux_contracts.robot import Robot
from crux_planner.model.arrays import Array
from crux_planner.model.build import build_problem
from crux_planner.search import event_path
from crux_planner.search.event_cost import Estimate, EventCost, Timed
from crux_planner.search.stances import Oracles, search
from crux_planner.solvers import clock
from crux_planner.solvers.path import Grip, Grips, PathProblem, least_cost
from walls import ladder, scenario


def timings(robot: Robot) -> tuple[Oracles, list[Timed]]:
    """A ladder's moves with the time to spare in drawn stances."""
    oracles = Oracles.of(build_problem(scenario(ladder(5)), robot))
    moves, _ = search(oracles, at_once=1, greed=1.0, deadline=clock.now() + 30)
    assert moves
    swings = np.array([max(oracles.swings.intervals(m.before[i], m.after[i]) for i in m.limbs) for m in moves])
    random = np.random.default_rng(1)
    drawn = []
    for _ in range(6):
        stances = np.array(1 + random.integers(0, 5, len(moves) + 1), dtype=int)
        stances[-1] += 1
        drawn.append(Timed(moves, stances, swings + random.integers(0, 3, len(moves))))
    return oracles, drawn


def test_estimates_are_those_by_piqp(robot: Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    oracles, drawn = timings(robot)
    answered: list[bool] = []

    def counted(grips: Grips, problem: PathProblem) -> tuple[Array, Array] | None:
        found = least_cost(grips, problem)
        answered.append(found is not None)
        return found

    def estimates() -> list[Estimate]:
        costs = EventCost(oracles)
        found = [costs.estimate(timed) for timed in drawn]
        assert all(found)
        return [each for each in found if each is not None]

    monkeypatch.setattr(event_path, "least_cost", counted)
    compiled = estimates()
    assert len(answered) > len(drawn)
    assert all(answered)
    monkeypatch.setattr(event_path, "least_cost", lambda _grips, _problem: None)
    for one, other in zip(compiled, estimates(), strict=True):
        assert one.cost == pytest.approx(other.cost, rel=1e-5)
        np.testing.assert_allclose(one.body, other.body, atol=1e-3)
        np.testing.assert_allclose(one.efforts, other.efforts, rtol=1e-3, atol=1e-3 * other.efforts.max())


def test_neither_finds_a_path_that_is_too_fast(robot: Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    oracles, drawn = timings(robot)
    answers: list[tuple[Array, Array] | None] = []

    def kept(grips: Grips, problem: PathProblem) -> tuple[Array, Array] | None:
        answers.append(least_cost(grips, problem) if len(problem.low) > 1 else None)
        return answers[-1]

    monkeypatch.setattr(event_path, "least_cost", kept)
    costs = EventCost(oracles)
    costs.step_m *= 1e-3
    costs._path.step_m = costs.step_m
    assert costs.estimate(drawn[0]) is None
    assert answers[-1] is None


def without_grips(step_m: float) -> PathProblem:
    """Three nodes, the first and the last where they are, without anything to carry."""
    low, high = np.full((3, 3), -1.0), np.full((3, 3), 1.0)
    low[0] = high[0] = 0.0
    low[2] = high[2] = (0.3, 0.0, 0.0)
    return PathProblem(
        directions=np.eye(3),
        low=low,
        high=high,
        target=np.zeros(3),
        pull=np.zeros(3),
        speed=np.array([1.0, 2.0]),
        step=np.full(2, step_m),
        carried=np.zeros(3),
        body=np.zeros((3, 6, 3)),
        weight=np.zeros((3, 6)),
        on=[[], [], []],
    )


def no_grip(contact: int) -> Grip:
    raise AssertionError(contact)


def test_a_place_between_two_others_is_where_springs_hold_it() -> None:
    for step_m, x_m in ((1.0, 0.2), (0.17, 0.17)):  # by the stiffer spring, or as far as it gets
        found = least_cost(Grips(no_grip), without_grips(step_m))
        assert found is not None
        np.testing.assert_allclose(found[0], [[0.0, 0.0, 0.0], [x_m, 0.0, 0.0], [0.3, 0.0, 0.0]], atol=1e-6)
    assert least_cost(Grips(no_grip), without_grips(0.14)) is None
