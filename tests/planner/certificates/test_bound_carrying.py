"""The least cost of a evaluated grasp against a general solver."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import scipy.optimize as so
from crux_planner.certificates.bound.carrying import Carriers
from crux_planner.model.arrays import Array
from scenes import scene


def by_general_solver(carriers: Carriers, spines: Array, multipliers: Array, start: Array) -> float:
    """min R |q|^2 + multipliers . wrench over (s1, s2, m / k, n1, n2) and the shares (2, 3) of both fingers' spines."""
    slope, weight = carriers.maps[0].T @ multipliers, carriers.weight

    def cost(x: Array) -> float:
        effort = 2 * (x[:3] ** 2).sum() + (x[3:5] ** 2).sum()
        return float(weight * effort + slope[:3] @ x[:3] + slope[3] * (x[3] - x[4]))

    rooms = [
        {
            "type": "ineq",
            "fun": lambda x, i=i: carriers.friction[0, i] * x[3 + i] - np.linalg.norm(x[:3] - x[5 + 3 * i : 8 + 3 * i]),
        }
        for i in (0, 1)
    ]
    bounds = [(-200.0, 200.0)] * 3 + [(0.0, carriers.most_N)] * 2
    bounds += [(-a, a) for a in spines.ravel()]
    found = so.minimize(cost, start, bounds=bounds, constraints=rooms, options={"maxiter": 500, "ftol": 1e-12})
    return float(found.fun)


def least_and_best(seed: int, friction: Array | None, spiny: Array) -> tuple[float, float]:
    """Of a contact with friction (2,) and spines where `spiny` (2,), some multipliers: closed form, general solver."""
    random = np.random.default_rng(seed)
    problem = scene(20).problem
    multipliers = random.normal(size=6) * np.array([3e-3] * 3 + [12e-3] * 3)
    contact = int(random.integers(len(problem.contacts)))
    given = problem.contacts[contact]
    spines = given.spines * spiny[:, None]
    own = replace(given, friction=given.friction if friction is None else friction, spines=spines)
    carriers = Carriers.of(replace(problem, contacts=[own]))
    starts = [np.concatenate([random.normal(size=3), random.uniform(5, 20, 2), np.zeros(6)]) for _ in range(2)]
    share = problem.friction_share * spines / [1.0, 1.0, problem.patch.k_m]
    best = min(by_general_solver(carriers, share, multipliers, start) for start in starts)
    return float(carriers.least(multipliers)[0]), best


SEEDS = pytest.mark.parametrize(
    "seed", [0, 1, 3, *(pytest.param(seed, marks=pytest.mark.sweep) for seed in range(12) if seed not in (0, 1, 3))]
)


@pytest.mark.parametrize("seed", range(5))
def test_the_closed_form_is_what_a_general_solver_finds(seed: int) -> None:
    least, best = least_and_best(seed, None, np.ones(2))
    assert least == pytest.approx(best, abs=1e-6)


@SEEDS
def test_so_it_is_for_fingers_of_unlike_friction(seed: int) -> None:
    friction = np.random.default_rng(100 + seed).uniform(0.1, 2.5, 2)
    least, best = least_and_best(seed, friction, np.ones(2) * (seed % 2))
    assert least == pytest.approx(best, abs=1e-6)


@SEEDS
def test_spines_on_one_finger_cost_no_less_than_is_said_and_no_less_than_on_both(seed: int) -> None:
    friction = np.random.default_rng(100 + seed).uniform(0.1, 2.5, 2)
    least, best = least_and_best(seed, friction, np.roll([1.0, 0.0], seed))
    assert least <= best + 1e-6
    assert least >= least_and_best(seed, friction, np.ones(2))[0]
