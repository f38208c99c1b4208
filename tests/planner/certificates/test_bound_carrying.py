"""The least cost of a evaluated grasp against a general solver."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.optimize as so
from crux_planner.certificates.bound.carrying import Carriers
from crux_planner.model.arrays import Array
from scenes import scene


def by_general_solver(carriers: Carriers, contact: int, multipliers: Array, start: Array) -> float:
    """min R |q|^2 + multipliers . wrench over (s1, s2, m / k, n1, n2) and the spines' shares."""
    slope, weight = carriers.maps[contact].T @ multipliers, carriers.weight

    def cost(x: Array) -> float:
        effort = 2 * (x[:3] ** 2).sum() + (x[3:5] ** 2).sum()
        return float(weight * effort + slope[:3] @ x[:3] + slope[3] * (x[3] - x[4]))

    rooms = [
        {"type": "ineq", "fun": lambda x, i=i: carriers.friction[contact] * x[3 + i] - np.linalg.norm(x[:3] - x[5:])}
        for i in (0, 1)
    ]
    bounds = [(-200.0, 200.0)] * 3 + [(0.0, carriers.most_N)] * 2
    bounds += [(-a, a) for a in carriers.spines[contact]]
    found = so.minimize(cost, start, bounds=bounds, constraints=rooms, options={"maxiter": 500, "ftol": 1e-12})
    return float(found.fun)


@pytest.mark.parametrize("seed", range(5))
def test_the_closed_form_is_what_a_general_solver_finds(seed: int) -> None:
    random = np.random.default_rng(seed)
    carriers = Carriers.of(scene(20).problem)
    multipliers = random.normal(size=6) * np.array([3e-3] * 3 + [12e-3] * 3)
    contact = int(random.integers(len(carriers.friction)))
    starts = [np.concatenate([random.normal(size=3), random.uniform(5, 20, 2), np.zeros(3)]) for _ in range(2)]
    best = min(by_general_solver(carriers, contact, multipliers, start) for start in starts)
    assert carriers.least(multipliers)[contact] == pytest.approx(best, abs=1e-6)
