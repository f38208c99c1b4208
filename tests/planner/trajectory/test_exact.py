"""The exact P1: derivatives against finite differences, the stagewise method against ipopt, torques kept."""

from __future__ import annotations

from dataclasses import replace
from functools import cache, lru_cache
from typing import Any

import casadi as ca
import climb_by_ipopt
import numpy as np
import pytest
from crux_contracts.robot import load_robot
from crux_planner.model.build import build_problem
from crux_planner.model.mass import centres_of_mass
from crux_planner.model.problem import Problem
from crux_planner.model.schedule import Schedule
from crux_planner.physics import dynamics
from crux_planner.search.body_path import SPEED_SHARE, BodyPath, knot_path, smooth_events
from crux_planner.search.schedule import scheduled
from crux_planner.search.stances import Oracles, search
from crux_planner.solvers import clock
from crux_planner.trajectory import exact, stage_functions, windows
from crux_planner.trajectory.exact import solve_within_torques
from crux_planner.trajectory.interior_point import Outcome, Point, first_point, minimise
from crux_planner.trajectory.solution import start_from_path
from crux_planner.trajectory.stage_functions import Between, StageFunctions
from crux_planner.trajectory.stage_problem import StageProblem
from walls import scenario, two_rows

SLIPPERY = {"+x": 0.05, "-x": 2.2, "+y": 2.2, "-y": 2.2, "top": 2.2}
UNLIKE = {"+x": 0.7, "-x": 2.2, "+y": 2.2, "-y": 1.0, "top": 2.2}
WALLS: dict[str, dict[str, Any]] = {
    "rough": {},
    "steep": {"slope_deg": 90.0},
    "polytope": {"planner": {"limit_surface": "inner"}},
    "one hold by its spines": {"slippery": "RF-high"},
    "unlike faces": {"faces": {"friction": UNLIKE}},
    "spines on the smooth face": {
        "steps": 36,
        "faces": {"friction": SLIPPERY, "spines": {"+x": True, "-x": False}},
        "contact": {"spine_shear_N": 30, "spine_twist_Nm": 0.5},
    },
}


@lru_cache
def instance(name: str) -> tuple[Problem, Schedule, BodyPath]:
    options = WALLS[name]
    wall = two_rows(slope_deg=options.get("slope_deg", 45.0), steps=options.get("steps", 32))
    wall.update({key: options[key] for key in ("planner",) if key in options})
    if "slippery" in options:
        wall["contact"]["spine_shear_N"] = 30
        next(part for part in wall["holds"] if part["name"] == options["slippery"])["friction"] = SLIPPERY
    for part in wall["holds"] if "faces" in options else []:
        part.update(options["faces"])
        wall["contact"].update(options.get("contact", {}))
    problem = build_problem(scenario(wall), load_robot("scaler"))
    oracles = Oracles.of(problem)
    equilibrium, swings = oracles.equilibrium, oracles.swings
    moves, _ = search(oracles, at_once=1, greed=1.0, deadline=clock.now() + 60)
    assert moves is not None
    moves = smooth_events(oracles, moves)
    schedule = scheduled(problem, swings, moves, SPEED_SHARE * problem.body.max_speed_m_s * problem.dt_s)
    path = knot_path(problem, equilibrium, schedule)
    assert path is not None
    return problem, schedule, path


class LookingBetween(StageFunctions):
    """With rows of reach at some moments between the knots."""

    def between(self) -> Between:
        random, count = np.random.default_rng(8), len(self.problem.boxes.directions)
        bound = np.ones((3, 4 * count))
        given = random.uniform(-0.01, 0.01, (3, 6)), random.uniform(-0.2, 0.2, (3, 12)), -bound, bound
        return Between(np.array([3, 3, 8]), np.array([0.2, 0.7, 0.5]), *given)


def stages_at_random(seed: int) -> tuple[StageProblem, Point]:
    problem, schedule, path = instance("rough")
    some_torques = frozenset(
        (k, limb) for k in range(0, 30, 7) for limb in range(4) if schedule.contacts[k][limb] is not None
    )
    stages = StageProblem(LookingBetween(problem), problem, schedule).limiting(some_torques, problem)
    random = np.random.default_rng(seed)
    body = start_from_path(problem, path).body
    body += 0.005 * random.standard_normal(body.shape)
    columns = 0.3 * random.standard_normal((problem.steps, 4, 8)) * stages.stance[..., None]
    columns[..., 3:5] += 2.0 * stages.stance[..., None]
    point = first_point(stages, body, columns)
    point.multipliers = random.standard_normal(point.multipliers.shape)
    return stages, point


def test_numbers_that_are_no_longer_finite_end_it() -> None:
    stages, point = stages_at_random(5)
    point.body[7, :3] = np.nan
    assert not minimise(stages, point, clock.now() + 60).solved


def test_a_window_beside_the_moments_between_knots_is_solved_without_them() -> None:
    stages, point = stages_at_random(6)
    window = stages.window(10, 20, point.body)
    assert window.between.low.shape == (0, stages.between.low.shape[1])
    begin = point.body[10:21], point.columns[10:20]
    at = window.derivatives(*begin, point.multipliers[10:20], np.zeros_like(window.low))
    assert np.isfinite(window.dual_residual(at, point.multipliers[10:20], np.zeros_like(window.low)))
    assert len(window.change(at, *begin)) == len(window.low)


def test_slopes_and_hessians_are_those_of_finite_differences(monkeypatch: pytest.MonkeyPatch) -> None:
    stages, point = stages_at_random(3)
    random = np.random.default_rng(4)
    step_body, step_columns = random.standard_normal(point.body.shape), random.standard_normal(point.columns.shape)
    step_body[0] = 0.0
    step_columns *= stages.stance[..., None] & ~stages.fixed
    duals = random.uniform(0.0, 1.0, len(stages.low))
    h = 1e-6
    at = stages.derivatives(point.body, point.columns, point.multipliers, duals)
    above, below = (
        stages.derivatives(point.body + s * step_body, point.columns + s * step_columns, point.multipliers, duals)
        for s in (h, -h)
    )
    slope = float((at.body_slope * step_body).sum() + (at.column_slope * step_columns).sum())
    assert (above.cost - below.cost) / (2 * h) == pytest.approx(slope, rel=1e-6)
    np.testing.assert_allclose(
        (above.rows - below.rows) / (2 * h), stages.change(at, step_body, step_columns), atol=2e-5, rtol=1e-5
    )
    ahead = np.einsum("kij,kj->ki", at.state_map, step_body[:-1])
    ahead += np.einsum("klij,klj->ki", at.into_state, step_columns)
    np.testing.assert_allclose((above.next_states - below.next_states) / (2 * h), ahead, atol=1e-6)

    follows = ca.DM(np.hstack([0.4 * np.eye(3), 0.1 * random.standard_normal((3, 3))]))  # without curvature: it is left

    def straight(_problem: Problem, x: Any, hands: Any, _numbers: Any) -> Any:  # out of the Hessian, too
        return follows @ x[:6] + 0.15 * sum(hand[:3] for hand in hands)

    monkeypatch.setattr(stage_functions, "centre_of_mass", straight)
    monkeypatch.setattr(dynamics, "euler_rates", lambda _theta, omega: omega)  # so is that of the next pose in torques
    monkeypatch.setattr(stage_functions, "_torque_values", cache(stage_functions._make_torque_values))  # of that pose
    monkeypatch.setattr(stage_functions, "_torques", cache(stage_functions._make_torques))
    monkeypatch.setattr(StageFunctions, "_step", property(StageFunctions._make_step))
    stages, _ = stages_at_random(3)
    at, above, below = (
        stages.derivatives(
            point.body + s * step_body, point.columns + s * step_columns, point.multipliers, duals, near=True
        )
        for s in (0.0, h, -h)
    )

    def lagrangian_slope(d: Any) -> tuple[np.ndarray, np.ndarray]:
        body, columns = (part.copy() for part in stages.slopes(d, duals))
        body[:-1] += np.einsum("kij,ki->kj", d.state_map, point.multipliers)
        columns += np.einsum("klij,ki->klj", d.into_state, point.multipliers)
        return body, columns

    (body_above, columns_above), (body_below, columns_below) = lagrangian_slope(above), lagrangian_slope(below)
    body = np.einsum("kij,kj->ki", at.body_hessian, step_body)
    body[:-1] += np.einsum("klij,klj->ki", at.cross, step_columns)
    columns = np.einsum("klij,klj->kli", at.column_hessian, step_columns)
    columns += np.einsum("klij,ki->klj", at.cross, step_body[:-1])
    np.testing.assert_allclose((body_above - body_below) / (2 * h), body, atol=2e-4)
    free = ~stages.fixed & stages.stance[..., None]
    np.testing.assert_allclose(((columns_above - columns_below) / (2 * h))[free], columns[free], atol=2e-4)


LONG = {"one hold by its spines", "spines on the smooth face"}


@pytest.mark.parametrize("name", [pytest.param(name, marks=[pytest.mark.sweep] * (name in LONG)) for name in WALLS])
def test_the_stagewise_method_finds_what_ipopt_finds(name: str) -> None:
    problem, schedule, path = instance(name)
    problem = replace(problem, torque_limits_Nm=10 * problem.torque_limits_Nm)  # so that none binds
    exactly = {**climb_by_ipopt.ONCE, "ipopt.tol": 1e-7, "ipopt.compl_inf_tol": 1e-6}
    other = climb_by_ipopt.solve(problem, schedule, start_from_path(problem, path), options=exactly)
    solution = solve_within_torques(problem, schedule, start_from_path(problem, path), clock.now() + 30)
    assert solution.solved
    assert other.solved
    assert solution.position_residual_m < 1e-8
    assert solution.force_residual_N < 1e-4
    assert solution.cost == pytest.approx(other.cost, abs=1e-3)
    if problem.limit_surface == "cone":
        assert largest_excess_N(problem, schedule, solution.wrenches) < 1e-4


def largest_excess_N(problem: Problem, schedule: Schedule, wrenches: list[dict[int, np.ndarray]]) -> float:
    """Of any finger beyond the share of (1) that a plan may use: what spines leave, in the ellipsoid (2)."""
    share, found = problem.friction_share, []
    for k, knot in enumerate(wrenches):
        for limb, (s1, s2, m, *normal) in knot.items():
            held = schedule.contacts[k][limb]
            assert held is not None
            contact = problem.contacts[held]
            for finger in (0, 1):
                friction = share * contact.friction[finger] * contact.may_press[finger]
                rest = np.maximum(np.abs([s1, s2, m]) - share * contact.spines[finger], 0.0)
                rest[2] /= problem.patch.k_m
                found.append(float(np.linalg.norm(rest)) - friction * normal[finger])
    return float(max(found))


@pytest.mark.sweep
def test_joint_torques_stay_within_their_limits_on_a_steep_wall() -> None:
    problem, schedule, path = instance("steep")
    weaker = problem.torque_limits_Nm * 0.85
    problem = replace(problem, torque_limits_Nm=weaker)
    start = start_from_path(problem, path)
    unlimited = climb_by_ipopt.solve(problem, schedule, start)
    assert max(unlimited.torque_shares.values()) > 1.05
    solution = solve_within_torques(problem, schedule, start_from_path(problem, path), clock.now() + 30)
    assert solution.solved
    assert max(solution.torque_shares.values()) <= 1.0 + 1e-3
    everywhere = frozenset(unlimited.torque_shares)
    by_ipopt = climb_by_ipopt.solve(problem, schedule, start, everywhere)
    assert max(by_ipopt.torque_shares.values()) <= 1.0 + 1e-3
    assert solution.cost == pytest.approx(by_ipopt.cost, abs=2e-3)


@pytest.mark.sweep
def test_joints_that_lack_much_are_held_as_cheaply_as_by_ipopt() -> None:
    """Here a Hessian without the torques' curvature leads from the solution again."""
    problem, schedule, path = instance("steep")
    weaker = problem.torque_limits_Nm * 0.8
    problem = replace(problem, torque_limits_Nm=weaker, last_torques_Nm=weaker)
    start = start_from_path(problem, path)
    solution = solve_within_torques(problem, schedule, start, clock.now() + 30)
    assert solution.solved
    assert max(solution.torque_shares.values()) <= 1.0 + 1e-3
    everywhere = frozenset(solution.torque_shares)
    by_ipopt = climb_by_ipopt.solve(problem, schedule, start, everywhere)
    assert by_ipopt.solved
    assert solution.cost <= by_ipopt.cost + 2e-3


def test_a_start_from_which_nothing_converges_is_said_not_to_be_solved(monkeypatch: pytest.MonkeyPatch) -> None:
    problem, schedule, path = instance("rough")

    def give_up(_stages: StageProblem, point: Point, *_more: Any) -> Outcome:
        return Outcome(point, 0, False, np.inf)

    monkeypatch.setattr(exact, "minimise", give_up)
    for left_s, status in ((30.0, "not converged"), (-1.0, "Time is over")):
        found = solve_within_torques(problem, schedule, start_from_path(problem, path), clock.now() + left_s)
        assert not found.solved
        assert found.status == status


def test_motors_too_weak_for_a_limb_are_told_from_rows_that_contradict_each_other() -> None:
    problem, schedule, path = instance("steep")
    limits = problem.torque_limits_Nm.copy()
    limits[1] *= 0.3
    weak = replace(problem, torque_limits_Nm=limits, last_torques_Nm=limits)
    found = solve_within_torques(weak, schedule, start_from_path(problem, path), clock.now() + 30)
    assert not found.solved
    assert found.status == exact.TOO_WEAK
    (_, limb), share = max(found.torque_shares.items(), key=lambda place: place[1])
    assert limb == 1
    assert share > 1.5


def test_torques_asked_for_in_a_solution_are_kept_by_knots_about_them_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    problem, schedule, path = instance("steep")
    roomy = replace(problem, torque_limits_Nm=10 * problem.torque_limits_Nm)
    free = solve_within_torques(roomy, schedule, start_from_path(problem, path), clock.now() + 30)
    (_, limb), share = max(free.torque_shares.items(), key=lambda place: place[1])
    limits = roomy.torque_limits_Nm.copy()
    limits[limb] *= 0.97 * share  # of all joints: the worst of them lacks 3 %
    tight = replace(roomy, torque_limits_Nm=limits, last_torques_Nm=limits)
    at_once = solve_within_torques(tight, schedule, free.start, clock.now() + 30)

    solved: list[int] = []

    def noting(stages: StageProblem, point: Point, deadline: float) -> Outcome:
        solved.append(stages.knots)
        return minimise(stages, point, deadline)

    monkeypatch.setattr(windows, "_LONGEST", 20)
    monkeypatch.setattr(windows, "_MARGIN", 6)
    monkeypatch.setattr(windows, "minimise", noting)
    monkeypatch.setattr(exact, "minimise", noting)
    found = solve_within_torques(tight, schedule, free.start, clock.now() + 30)
    assert found.solved
    assert 0 < max(solved) < problem.steps
    assert max(found.torque_shares.values()) <= 1.001
    assert found.columns is not None
    stages = StageProblem(StageFunctions(tight), tight, schedule).limiting(frozenset(found.torque_shares), tight)
    assert stages.lacking(found.body, found.columns).max() < 1e-5
    assert np.abs(stages.next_states(found.body, found.columns) - found.body[1:]).max() < 1e-6
    assert at_once.cost - 1e-4 < found.cost < 1.002 * at_once.cost
    assert free.cost < at_once.cost


def test_problems_with_other_starts_share_a_step_and_each_has_its_own_inertia() -> None:
    random, problem = np.random.default_rng(4), build_problem(scenario(two_rows()), load_robot("scaler"))
    posture = random.normal(size=(3, 3))
    other = replace(problem, inertia_b=problem.inertia_b + 0.1 * posture @ posture.T, gravity_h=random.normal(size=3))
    functions = StageFunctions(problem)
    assert functions._step is functions.started_elsewhere(other)._step is StageFunctions(other)._step
    body = 0.1 * random.standard_normal((1, 12)) + [*problem.start.position_m, *9 * [0.0]]
    hands = np.concatenate([problem.contacts[c].pose[:4] for c in problem.start_contacts])[None]
    total = random.normal(size=(1, 6)) * 20.0
    for each in (problem, other):
        centre = centres_of_mass(each, body[:, :6], hands.reshape(1, 4, 4))[0]
        state, force, moment, at = (ca.DM(value) for value in (body[0], total[0, :3], total[0, 3:], centre))
        after = dynamics.euler_step(state, force, moment, at, each)
        found = functions.started_elsewhere(each).step(body, total, hands, np.zeros((1, 12)))[0]
        np.testing.assert_allclose(found, np.array(after).T, rtol=1e-10, atol=1e-12)
