"""The lower bound of a walk's J: below every walk, its parts against other ways to find them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
import scipy.optimize as so
from crux_contracts.robot import load_robot
from crux_contracts.scenario import parse_scenario
from crux_planner import plan
from crux_planner.certificates.bound import walk as bound
from crux_planner.model.walk_problem import build_walk

FLAT = (Path(__file__).resolve().parents[3] / "msgs" / "scenarios" / "walk-flat.yaml").read_text()
ROBOT = load_robot("scaler")


@pytest.mark.parametrize(
    ("goal", "slope"), [("[0.06, 0.05, 0.185]", 0), pytest.param("[0.1, 0.0, 0.185]", 8, marks=pytest.mark.sweep)]
)
def test_no_walk_costs_less(goal: str, slope: int) -> None:
    text = FLAT.replace("[0.1, 0.0, 0.185]", goal).replace("slope_deg: 0", f"slope_deg: {slope}")
    scenario = parse_scenario(text)
    result = plan(scenario, ROBOT)
    floor = bound.lower_bound(replace(build_walk(scenario, ROBOT), steps=result.steps))
    assert 0.92 * result.cost < floor <= result.cost
    assert result.gap == pytest.approx(1.0 - floor / result.cost)


def test_the_bodys_way_is_the_qps() -> None:
    problem: Any = SimpleNamespace(steps=12, dt_s=0.1)
    found = bound._way(0.3, 0.01, (1.0, 0.2), 0.04, problem)

    def path(d: np.ndarray) -> np.ndarray:
        return 0.3 + np.concatenate([[0.0], np.cumsum(d)])

    def cost(d: np.ndarray) -> float:
        return float((path(d) ** 2).sum() + 0.2 * ((d / 0.1) ** 2).sum())

    ends = {"type": "ineq", "fun": lambda d: 0.01 - np.abs(path(d)[-1])}
    bounds = [(0.0, 0.0)] + [(-0.04, 0.04)] * 11
    best = so.minimize(cost, np.full(12, -0.03), bounds=bounds, constraints=[ends], options={"ftol": 1e-12})
    assert found == pytest.approx(best.fun, rel=1e-4)
    assert found <= best.fun + 1e-9


def test_steps_cost_the_cheapest_that_lead_so_far() -> None:
    """Steps of 3, 4, 5 knots that lead 0.1, 0.15, 0.2 m."""
    step, longest = np.array([1.0, 1.2, 1.5]), np.array([0.1, 0.15, 0.2])
    assert bound._cheapest(0.05, step, longest) == 1.0
    assert bound._cheapest(0.16, step, longest) == 1.5
    assert bound._cheapest(0.3, step, longest) == pytest.approx(2.4)
    assert bound._cheapest(0.9, step, longest) == pytest.approx(3.0)


def test_forces_shared_evenly_over_the_whole_walk_are_the_least() -> None:
    """Any forces of two standing patterns that sum to the weight cost no less than the bound's first part."""
    problem = build_walk(parse_scenario(FLAT.replace("[0.1, 0.0, 0.185]", "[0.0, 0.0, 0.185]")), ROBOT)
    floor = bound._forces_and_steps(problem)
    n, weight = problem.steps, problem.mass_kg * float(np.linalg.norm(problem.gravity_h))
    standing = 0.5 * problem.weights.wrench * n * weight**2 / 4
    assert floor == pytest.approx(standing, rel=1e-6)
