"""The variants of the limit surface, and (12) with its binary against rows without it."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from crux_planner.physics.limit_surface import paper_directions, polytope_directions, surface_slack
from hypothesis import given
from hypothesis import strategies as st

K_M = 0.0134
coordinate = st.floats(-1.5, 1.5)


def equation_12(f: np.ndarray, m: float, load: float, gamma: int) -> bool:
    """(12) for one value of gamma: m = m_plus - m_minus, one of them zero."""
    plus, minus = (m, 0.0) if gamma else (0.0, -m)
    if plus < 0 or minus < 0:
        return False
    return bool((np.abs(f) <= load - (plus + minus) / K_M).all() and plus + minus <= K_M * load)


@given(coordinate, coordinate, coordinate, st.floats(0.01, 1.0))
def test_rows_without_gamma_are_equation_12(f1: float, f2: float, m: float, load: float) -> None:
    directions, reach = paper_directions(K_M)
    slack = reach * load - directions @ np.array([f1, f2, m * K_M])
    if np.abs(slack).min() < 1e-9:
        return
    with_binary = any(equation_12(np.array([f1, f2]), m * K_M, load, gamma) for gamma in (0, 1))
    assert bool((slack >= 0).all()) == with_binary


def room_of(variant: str, wrench: np.ndarray, load: float) -> float:
    return float(ca.mmin(surface_slack(variant, ca.DM(wrench), ca.DM.zeros(3), load, K_M)))


@given(coordinate, coordinate, coordinate)
def test_the_inner_polytope_is_inside_the_cone(a: float, b: float, c: float) -> None:
    point = np.array([a, b, c * K_M])
    if room_of("inner", point, 1.0) >= 0:
        assert a * a + b * b + c * c <= 1.0 + 1e-12


def test_the_papers_rows_let_more_pass_than_the_cone() -> None:
    corner = np.array([0.99, 0.99, 0.0])
    assert room_of("paper", corner, 1.0) > 0
    assert room_of("cone", corner, 1.0) < -0.3


@pytest.mark.parametrize("variant", ["cone", "inner", "paper"])
def test_spines_carry_their_share(variant: str) -> None:
    wrench = ca.DM([3.0, 0.0, 0.0])
    assert float(ca.mmin(surface_slack(variant, wrench, wrench, 0.0, K_M))) >= -0.06
    assert float(ca.mmin(surface_slack(variant, wrench, ca.DM.zeros(3), 0.0, K_M))) < -2.0


def test_the_inner_polytopes_rows_are_those_of_the_search() -> None:
    directions, reach = polytope_directions(K_M)
    wrench = np.array([0.3, -0.2, 0.1 * K_M])
    assert room_of("inner", wrench, 1.0) == pytest.approx(float((reach - directions @ wrench).min()))
