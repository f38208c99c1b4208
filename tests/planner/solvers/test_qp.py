"""The face to PIQP."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse as sp
from crux_planner.solvers.qp import Qp


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
