"""The bound of crawls from multipliers on balance: each relaxation against motions, loads and gaits found in other
ways.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import scipy.optimize as so
from crux_contracts.robot import load_robot
from crux_contracts.scenario import parse_scenario
from crux_planner.certificates.bound.centre_of_pressure import (
    _TILTING_SHARE,
    _TURNING_SHARE,
    MOST_MULTIPLIER,
    CentreOfPressure,
)
from crux_planner.certificates.bound.crawls import BETWEEN, Crawls
from crux_planner.certificates.bound.equilibrium_dual import EquilibriumDual
from crux_planner.certificates.bound.loads import least_loads
from crux_planner.model.arrays import Array
from crux_planner.model.gait import LEAST_AIR, Gait
from crux_planner.model.kinematics import rotation_from_rpy
from crux_planner.model.slots import FIRST_LIFT, LAST_LAND, Slots
from crux_planner.model.walk_problem import WalkProblem, build_walk
from crux_planner.physics.cost import FORCE_SHARE, gait_cost, walk_cost
from crux_planner.pipeline.walk_contacts import WalkContacts
from crux_planner.trajectory.walk_qp import ContactQp, WalkKnots, solve
from straight_walk import straight_motion

SCENE = (Path(__file__).resolve().parents[3] / "msgs" / "scenarios" / "walk-slope.yaml").read_text()
STAY = SCENE.replace("steps: 40", "steps: 14").replace("[0.1, 0.0, 0.185]", "[0.0, 0.0, 0.185]")
ROBOT = load_robot("scaler")


@pytest.fixture(scope="module")
def problem() -> WalkProblem:
    return build_walk(parse_scenario(SCENE), ROBOT)


@pytest.fixture
def rng() -> np.random.Generator:
    return np.random.default_rng(5)


def _near(problem: WalkProblem, gait: Gait) -> WalkKnots:
    """A walk by a gait, about the straight way."""
    knots = ContactQp(problem, None).solve(straight_motion(problem, gait))
    assert knots is not None
    return knots


def _prices(problem: WalkProblem, rng: np.random.Generator) -> Array:
    """Smooth ones, as large as they may be here and there."""
    n, k = problem.steps, np.arange(problem.steps)
    waves = [rng.uniform(-1, 1) * np.sin(k / rng.uniform(2, 9) + rng.uniform(0, 6)) for _ in range(3)]
    multipliers = np.array([0.7 * MOST_MULTIPLIER, 0.7 * MOST_MULTIPLIER, 0.001])[:, None] * waves
    multipliers[2] += 2 * FORCE_SHARE * problem.weights.wrench * problem.mass_kg**2 * 9.8 * 0.29
    return np.asarray(multipliers.reshape(3 * n))


def test_a_walk_costs_more_than_any_prices_say_of_its_own_motion(
    problem: WalkProblem, rng: np.random.Generator
) -> None:
    """An exact walk's body with all that is kept back, and its feet's centre of pressure as (8b) has it."""
    pressure = CentreOfPressure(problem)
    knots = next(WalkContacts(problem, many=0).search(np.inf))
    walk = solve(problem, knots, np.inf)
    n, body = problem.steps, walk.body
    normal = walk.forces[..., 2]
    q = np.einsum("ki,kia->ka", normal, knots.gait.blend[:n] @ walk.footholds) / normal.sum(axis=1)[:, None]
    rising = normal.sum(axis=1) / problem.mass_kg + problem.gravity_h[2]
    weights = problem.weights
    lateral = FORCE_SHARE * weights.wrench * (walk.forces[..., :2] ** 2).sum()
    own = walk_cost(problem, knots.gait, body, 0 * walk.forces) - gait_cost(problem, knots.gait) + lateral
    sharpest = np.inf
    for _ in range(20):
        multipliers = _prices(problem, rng)
        linear, square = pressure.remainder(multipliers[: 2 * n].reshape(2, n).T)
        spent = float(linear @ np.abs(rising) + square @ rising**2)
        agreed = multipliers @ np.concatenate([q[:, 0], q[:, 1], rising])
        left = own + agreed + spent - pressure.least(multipliers)
        assert left >= 0.0
        sharpest = min(sharpest, left)
    assert sharpest < 0.5  # of some 6: what is proven is about the walk, not far below it


def test_no_motion_of_the_body_is_better_than_the_least_for_prices(rng: np.random.Generator) -> None:
    """The least is found by descent over accelerations of a walk of few knots, q as it is for a body that does not
    turn: nothing is linear there.
    """
    problem = build_walk(parse_scenario(SCENE.replace("steps: 40", "steps: 9")), ROBOT)
    pressure, n, dt = CentreOfPressure(problem), problem.steps, problem.dt_s
    weights, gravity, goal = problem.weights, problem.gravity_h, problem.goal.body.position_m
    effort = FORCE_SHARE * weights.wrench * problem.mass_kg**2 / 4  # of all four feet
    assert pressure.paid is not None

    def cost(a: Array, multipliers: Array) -> float:
        a = a.reshape(n, 3)
        v = np.vstack([np.zeros(3), dt * np.cumsum(a, axis=0)])
        r = problem.start.position_m + np.vstack([np.zeros(3), dt * np.cumsum(v[:-1], axis=0)])
        q = r[:n, :2] - r[:n, 2:] * (a - gravity)[:, :2] / (a - gravity)[:, 2:]
        linear, square = pressure.remainder(multipliers[: 2 * n].reshape(2, n).T)
        own = weights.position * ((r - goal) ** 2).sum() + weights.velocity * (v**2).sum()
        own += effort * ((a - gravity)[:, :2] ** 2).sum() + linear @ np.abs(a[:, 2]) + square @ a[:, 2] ** 2
        return float(own + multipliers @ np.concatenate([q[:, 0], q[:, 1], a[:, 2]]))

    rest = {"type": "eq", "fun": lambda a: a.reshape(n, 3).sum(axis=0)}
    bounds = [(None, None), (None, None), (-1.0, 1.0)] * n
    for _ in range(3):
        multipliers = _prices(problem, rng)
        multipliers[2 * n :] = 0.0
        found = so.minimize(cost, np.zeros(3 * n), args=(multipliers,), bounds=bounds, constraints=[rest])
        least, multiplier = pressure.least(multipliers), multipliers[: 2 * n].reshape(2, n)
        squares = float(np.trace(multiplier @ pressure.paid @ multiplier.T))
        assert least <= found.fun < least + 3 * squares + 0.005


def test_what_is_kept_back_pays_for_tilting(problem: WalkProblem) -> None:
    """multiplier . moment / (M gamma) of turning as it helps most, by (8b) in explicit Euler, against what pays."""
    pressure, n, dt = CentreOfPressure(problem), problem.steps, problem.dt_s
    assert pressure.paid is not None
    inertia, shares = problem.inertia_b, np.array([_TILTING_SHARE, _TILTING_SHARE, _TURNING_SHARE])
    paid = problem.weights.velocity * shares
    of_changes = pressure.paid - pressure.paid.sum() / n * np.eye(
        n
    )  # less what is for multipliers that stay as they are
    for along, share in itertools.product((0.0, 0.9, 1.5), (0.5, 1.0)):
        multiplier = 0.6 * MOST_MULTIPLIER * np.sign(np.sin(np.arange(n)[:, None] / 2 + np.array([along, 0.0])))
        mu = np.column_stack([multiplier[:, 1], -multiplier[:, 0], np.zeros(n)]) / (problem.mass_kg * pressure.gamma)
        omega = np.zeros((n + 1, 3))
        omega[1:n] = share * (mu[:-1] - mu[1:]) @ inertia / (2 * dt * paid)
        theta = np.vstack([np.zeros(3), dt * np.cumsum(omega[:-1], axis=0)])
        rate = (omega[1:] - omega[:-1]) @ inertia.T / dt + np.cross(omega[:-1], omega[:-1] @ inertia.T)
        moment = np.einsum("kab,kb->ka", rotation_from_rpy(theta[:n]), rate)
        squares = float(np.trace(multiplier.T @ of_changes @ multiplier))
        spent = float((omega**2 @ paid).sum())
        assert 0.3 * spent < float((mu * moment).sum()) <= spent + squares


def test_loads_of_any_kind_cost_no_less(problem: WalkProblem, rng: np.random.Generator) -> None:
    pressure, n = CentreOfPressure(problem), problem.steps
    low, high = rng.uniform(-0.3, 0.3, (2, 6, 4, 2))
    low, high = np.minimum(low, high), np.maximum(low, high)
    on = np.array([[limb != aloft for limb in range(4)] for aloft in (0, 1, 2, 3, 4, 4)])
    multipliers = np.repeat(_prices(problem, rng).reshape(3, n).T[:, None], 6, axis=1)
    least, outputs = least_loads(pressure, multipliers, low, high, on)
    linear, square = pressure.remainder(multipliers[..., :2])
    nearest = np.full(least.shape, np.inf)
    for _ in range(3000):
        shares = rng.dirichlet([1.5] * 4, least.shape) * on
        shares /= shares.sum(axis=-1, keepdims=True)
        rise = rng.uniform(-pressure.most_rising, pressure.most_rising, least.shape)
        places = low + rng.integers(0, 2, low.shape) * (high - low)
        q = np.einsum("kpi,pia->kpa", shares, places)
        cost = pressure.effort * (pressure.gamma + rise) ** 2 * (shares**2).sum(axis=-1) - multipliers[..., 2] * rise
        cost -= square * rise**2 + linear * np.abs(rise) + (multipliers[..., :2] * q).sum(axis=-1)
        assert (cost >= least - 1e-12).all()
        nearest = np.minimum(nearest, cost - least)
    assert np.median(nearest) < 0.02  # random loads come near: of some 0.1 a knot
    assert outputs.shape == (n, 6, 3)


def test_the_cheapest_crawl_is_that_of_all(rng: np.random.Generator) -> None:
    """For random costs of the knots, against all crawls of feet that may step and need not, written down one by one."""
    problem = build_walk(parse_scenario(STAY), ROBOT)
    crawls, n = Crawls(problem, None), problem.steps
    knots = rng.uniform(0.0, 1.0, (n, len(crawls.on) + 2))
    cost, phases = crawls.cheapest(knots)
    costs = [_cost(crawls, knots, steps) for steps in _all_crawls(n, FIRST_LIFT, ())]
    assert len(costs) > 500
    assert cost == pytest.approx(min(costs))
    own = knots[np.arange(n), phases].sum()
    assert crawls.step_cost < cost - own < 3 * crawls.step_cost  # some steps


def _all_crawls(n: int, begin: int, done: tuple[int, ...]) -> Iterator[list[tuple[int, int, int]]]:
    """(limb, lift, land) of all steps from knot `begin` on, of limbs that have not stepped."""
    yield []
    for limb in set(range(4)) - set(done):
        for lift in range(begin, n):
            for land in range(lift + LEAST_AIR, n - LAST_LAND + 1):
                for more in _all_crawls(n, land + 1, (*done, limb)):
                    yield [(limb, lift, land), *more]


def _cost(crawls: Crawls, knots: Array, steps: list[tuple[int, int, int]]) -> float:
    total, at, k = 0.0, [0, 0, 0, 0], 0
    for limb, lift, land in steps:
        total += knots[k:lift, crawls.phases[tuple(at), None]].sum()
        total += (knots[lift:land, crawls.phases[tuple(at), limb]] + crawls.air_cost).sum() + crawls.step_cost
        at[limb], k = 1, land
    return float(total + knots[k:, crawls.phases[tuple(at), None]].sum())


@pytest.mark.parametrize("twice", [(), (0, 3)])
def test_no_prices_are_above_a_walk(problem: WalkProblem, twice: tuple[int, ...]) -> None:
    """With feet that step once, and with two that step twice."""
    slots, k = [[], [], [], []], FIRST_LIFT  # type: ignore[var-annotated]
    for limb in (0, 1, 2, 3, *twice):
        slots[limb].append((k, k + 5))
        k += 6
    gait = Slots(tuple(tuple(own) for own in slots)).gait(problem.steps + 1)
    light = replace(problem, profile=replace(problem.profile, least_share=0.0, true_share=0.0))  # any walk will do
    walk = solve(light, _near(light, gait), np.inf)
    assert walk.solved
    pressure, n = CentreOfPressure(problem), problem.steps
    every = EquilibriumDual(pressure, Crawls(problem, BETWEEN))
    multipliers = np.zeros(3 * n)
    multipliers[2 * n :] = 2 * pressure.effort * pressure.gamma * 0.29
    for _ in range(4):
        bound, _, agreed = every.at(multipliers)
        assert bound <= walk.cost
        multipliers = multipliers + np.repeat([0.5, 0.5, 3e-5], n) * (
            pressure.outputs - pressure.yielding @ multipliers - agreed
        )


def test_the_quadratic_over_all_phases_is_over_the_bodys(problem: WalkProblem) -> None:
    pressure = CentreOfPressure(problem)
    over = EquilibriumDual(pressure, Crawls(problem, None))._over
    assert np.linalg.eigvalsh(np.diag(over[:, 0].T.ravel()) - pressure.yielding)[0] > 0.0
