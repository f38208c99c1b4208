"""The face to PIQP."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
import scipy.sparse as sp
from crux_planner.solvers.qp import Constraints, Qp
from scipy.optimize import linprog


@pytest.mark.parametrize("form", [np.asarray, sp.csc_matrix])
@pytest.mark.parametrize("least", [None, np.array([-np.inf, -1.0, -np.inf])])
def test_rows_without_bounds_are_left_out_without_a_word(
    form: type, least: np.ndarray | None, capfd: pytest.CaptureFixture[str]
) -> None:
    """min |x - (3, -3)|^2 under x0 <= 1, a row that is free, and x0 + x1 >= -1 where it is given."""
    rows = form(np.array([[1.0, 0.0], [1.0, 1.0], [0.0, 1.0]]))
    most, wide = np.array([1.0, np.inf, np.inf]), np.full(2, 10.0)
    found = Qp(form(2.0 * np.eye(2)), np.array([-6.0, 6.0]), None, (rows, least, most), -wide, wide).solve()
    assert found.solved
    assert found.x == pytest.approx([1.0, -3.0] if least is None else [1.0, -2.0], abs=1e-6)
    assert capfd.readouterr() == ("", "")


def badly_scaled(random: np.random.Generator, feasible: bool) -> tuple[Any, ...]:
    """A program whose rows and columns differ by up to twelve and six powers of ten, and a point that it had before."""
    size, rows, equations = (int(random.integers(low, high)) for low, high in ((5, 20), (4, 25), (0, 4)))
    point = random.normal(size=size)
    matrix, equal = random.normal(size=(rows, size)), random.normal(size=(equations, size))
    most, right = matrix @ point + random.uniform(0.0, 1.0, rows) * random.integers(0, 2, rows), equal @ point
    if not feasible:  # a mixture of rows that asks for less than the mixture of the others leaves
        share = random.uniform(0.1, 1.0, rows - 1)
        matrix[-1], most[-1] = -share @ matrix[:-1], -share @ most[:-1] - random.uniform(0.01, 1.0)
    row, of_equation = 10.0 ** random.uniform(-6.0, 6.0, rows), 10.0 ** random.uniform(-6.0, 6.0, equations)
    column = 10.0 ** random.uniform(-3.0, 3.0, size)
    ends = np.full(size, 1e6) / column
    cost, linear = np.diag(random.uniform(0.1, 1.0, size) * column**2), random.normal(size=size) * column
    both = (of_equation[:, None] * equal * column, of_equation * right)
    below = (row[:, None] * matrix * column, None, row * most)
    return (cost, linear, both, below, -ends, ends), row, of_equation


def test_badly_scaled_programs_are_not_called_infeasible() -> None:
    """PIQP by itself solves 29 of them, and calls 6 infeasible."""
    random = np.random.default_rng(5)
    for _ in range(100):
        program, row, of_equation = badly_scaled(random, feasible=True)
        found = Qp(*program, eps_abs=1e-6, max_iter=60).solve()
        assert found.solved
        (equal, right), (rows, _, most), low, high = program[2:]
        assert ((rows @ found.x - most) / row).max() < 1e-4
        assert np.abs((equal @ found.x - right) / of_equation).max(initial=0.0) < 1e-4
        assert ((found.x - low) / (high - low)).min() > -1e-6


def test_what_is_infeasible_is_shown_to_be() -> None:
    """And what is shown is so, by another solver."""
    random = np.random.default_rng(6)
    shown = 0
    for _ in range(60):
        qp = Qp(*badly_scaled(random, feasible=False)[0], eps_abs=1e-6, max_iter=60)
        found = qp.solve()
        assert not found.solved
        shown += qp.constraints.shown_empty(found.multipliers, found.of_rows)
    assert shown > 50


def test_multipliers_show_no_more_than_there_is() -> None:
    """A linear program's least, by any multipliers and by the best; what has a solution is never shown to have none."""
    random = np.random.default_rng(7)
    for _ in range(60):
        size, rows, equations = 6, 9, 2
        point = random.uniform(-1.0, 1.0, size)
        matrix, equal = random.normal(size=(rows, size)), random.normal(size=(equations, size))
        spare = random.uniform(0.0, 1.0, (2, rows))
        least, most, right = matrix @ point - spare[0], matrix @ point + spare[1], equal @ point
        given = Constraints(sp.csc_matrix(equal), right, matrix, least, most, np.full(size, -2.0), np.full(size, 2.0))
        linear = random.normal(size=size)
        best = linprog(linear, np.vstack([matrix, -matrix]), np.concatenate([most, -least]), equal, right, (-2.0, 2.0))
        of_equal, of_rows = random.normal(size=equations), random.normal(size=rows)
        assert given.shown_least(linear, of_equal, of_rows) <= best.fun
        assert not given.shown_empty(of_equal, of_rows)
        ends = best.ineqlin.marginals
        shown = given.shown_least(linear, -best.eqlin.marginals, ends[rows:] - ends[:rows])
        assert shown == pytest.approx(best.fun, abs=1e-6)
