"""The face to HiGHS, and what is said where it finds nothing."""

from __future__ import annotations

import itertools
from types import SimpleNamespace
from typing import Any

import highspy
import numpy as np
import pytest
from crux_planner.certificates.other_sequences import _Judge
from crux_planner.solvers.milp import Milp, MilpResult

SIZE = 6


def test_badly_scaled_programs_are_infeasible_only_where_no_choice_meets_the_rows() -> None:
    random, infeasible = np.random.default_rng(3), 0
    choices = np.array(list(itertools.product((0.0, 1.0), repeat=SIZE)))
    for _ in range(80):
        rows = random.integers(-5, 6, (5, SIZE)).astype(float)
        most = random.integers(-6, 3, 5).astype(float)
        scale = 10.0 ** random.uniform(-3.0, 6.0, 5)
        program, cost = Milp(), random.normal(size=SIZE)
        index = program.variables(SIZE, 0.0, 1.0, integer=True)
        for row, limit, by in zip(rows, most, scale, strict=True):
            program.row(index, by * row, -np.inf, by * limit)
        found = program.solve(cost, gap=0.0, time_limit_s=60.0)
        allowed = choices[(choices @ rows.T <= most).all(axis=1)]
        infeasible += found.infeasible
        assert found.infeasible == (not len(allowed))
        if not found.infeasible:
            assert found.objective == pytest.approx((allowed @ cost).min(), abs=1e-6)
    assert 10 < infeasible < 70


def test_a_first_word_of_infeasible_is_not_taken(monkeypatch: pytest.MonkeyPatch) -> None:
    """As after a presolve that is wrong."""

    class Wrong(highspy.Highs):
        asked = 0

        def getModelStatus(self) -> Any:
            Wrong.asked += 1
            return highspy.HighsModelStatus.kInfeasible if Wrong.asked == 1 else super().getModelStatus()

    monkeypatch.setattr("crux_planner.solvers.milp.highspy.Highs", Wrong)
    program = Milp()
    program.row(program.variables(2, 0.0, 1.0, integer=True), [1.0, 1.0], 1.0, np.inf)
    found = program.solve(np.array([1.0, 2.0]), gap=0.0, time_limit_s=60.0)
    assert (found.infeasible, found.objective) == (False, 1.0)


@pytest.mark.parametrize(("infeasible", "least"), [(True, 1.0), (False, 0.0)])
def test_nothing_is_said_of_sequences_whose_program_was_not_solved(infeasible: bool, least: float) -> None:
    timed: Any = SimpleNamespace(knots=3)
    judge = _Judge(SimpleNamespace(estimate=lambda _: None), timed, 5.0, np.inf)  # type: ignore[arg-type]
    unsolved = MilpResult(None, np.inf, -np.inf, infeasible, 0)
    judge.run(SimpleNamespace(solve=lambda **_: unsolved), 1)  # type: ignore[arg-type]
    assert judge.least == least
