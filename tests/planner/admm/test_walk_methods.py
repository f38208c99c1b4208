"""Walks by the paper's methods, and their contact block against the exact problem."""

from __future__ import annotations

import itertools
from dataclasses import replace
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import walk_by_ipopt
from crux_contracts.robot import load_robot
from crux_contracts.scenario import ScenarioError, load_scenario, parse_scenario
from crux_planner import plan
from crux_planner.admm.contact_block import WalkSteps
from crux_planner.admm.motion_block import MotionBlock
from crux_planner.admm.walk_mip import WalkMip
from crux_planner.model.gait import longest_step
from crux_planner.model.slots import Slots
from crux_planner.model.walk_problem import FINAL_FOOT_M, WalkProblem, build_walk
from crux_planner.physics.cost import walk_cost
from crux_planner.pipeline.walk_contacts import WalkContacts
from crux_planner.search.gait_search import FlatSearch
from crux_planner.solvers import clock
from crux_planner.trajectory import walk_qp as exact
from crux_planner.trajectory.consensus import Eta, Scales
from crux_planner.trajectory.walk_qp import ContactQp
from straight_walk import straight_motion

SCENES = Path(__file__).resolve().parents[3] / "msgs" / "scenarios"
ROBOT = load_robot("scaler")
SLOPE = (SCENES / "walk-slope.yaml").read_text()


@pytest.fixture(scope="module")
def problem() -> WalkProblem:
    return build_walk(parse_scenario(SLOPE), ROBOT)


@pytest.mark.sweep
def test_a_walk_converges_and_passes_the_check() -> None:
    lines: list[str] = []
    method, flat = "two_block", load_scenario(SCENES / "walk-flat.yaml")
    result = plan(flat, ROBOT, method=method, log=lines.append)
    shown: dict[str, Any] = result.to_json()
    assert result.check.ok
    assert result.plan.method == method
    assert shown["residuals"]["position_m"] <= 0.03
    assert shown["residuals"]["force_N"] <= 0.5
    others = [line for line in lines if not line.startswith("iteration ")]
    assert shown["iterations"] == len(shown["history"]) == len(lines) - len(others)
    assert all(line.startswith("refused without its waits: ") for line in others)
    assert shown["method_report"]["converged"]
    assert sorted(shown["method_report"]["gait"]) == sorted(result.gait)


def test_a_method_that_walks_do_not_have_is_named() -> None:
    with pytest.raises(ScenarioError, match="expected auto, two_block, multi_block, benchmark"):
        plan(parse_scenario(SLOPE), ROBOT, method="paper_form")


def test_the_qp_about_its_own_answer_is_the_exact_problem(problem: WalkProblem) -> None:
    """Same gait: J and the motion are those that ipopt finds, (8b) holds by hand. Of feet between the knots ipopt knows
    nothing: what they ask for costs a little.
    """
    asked, problem = problem, replace(problem, profile=replace(problem.profile, between_share=-np.inf))
    gait = FlatSearch(problem).begin(np.inf).gait
    first = ContactQp(problem, Scales()).solve(straight_motion(problem, gait))
    assert first is not None
    again, by_ipopt = exact.solve(problem, first, clock.now() + 10.0), walk_by_ipopt.solve(problem, first, 10.0)
    assert again.solved
    assert by_ipopt.solved
    assert again.cost == pytest.approx(by_ipopt.cost, rel=1e-3)
    assert 1.001 * again.cost < exact.solve(asked, first, clock.now() + 10.0).cost < 1.01 * again.cost
    assert again.cost == pytest.approx(walk_cost(problem, gait, again.body, again.forces))
    np.testing.assert_allclose(again.body[:, :3], by_ipopt.body[:, :3], atol=0.01)
    # Moments by hand: what the forces do about the centre of mass is what the body's rotation needs.
    feet = np.concatenate([gait.blend @ again.footholds, problem.step_height_m * gait.height[..., None]], axis=2)[:-1]
    yaws = gait.yaw(float(problem.goal.body.rpy_rad[2]))[:-1]
    centre = problem.centres_of_mass(again.body[:-1, :6], feet, yaws)
    moment = np.cross(feet - centre[:, None], again.forces).sum(axis=1)
    wanted = np.diff(again.body[:, 9:12], axis=0) / problem.dt_s @ problem.inertia_b.T
    np.testing.assert_allclose(moment, wanted, atol=0.05)  # body frame, and tilt is small


def test_the_local_search_improves_on_regular_gaits(problem: WalkProblem) -> None:
    later = clock.now() + 60.0
    first = next(WalkContacts(problem).search(later))
    assert first.cost < FlatSearch(problem).begin(np.inf).cost - 0.01
    assert exact.solve(problem, first, later).solved


def test_the_motion_block_projects_onto_the_dynamics(problem: WalkProblem) -> None:
    gait = FlatSearch(problem).begin(np.inf).gait
    knots = ContactQp(problem, Scales()).solve(straight_motion(problem, gait))
    assert knots is not None
    eta = Eta.of_points(knots.body, knots.feet(problem.step_height_m), knots.forces)
    spoilt = eta + eta.times(0.0)
    spoilt.forces[10, 0, 2] += 20.0
    motion = MotionBlock(problem, scales=Scales(force=0.03))
    delta = motion.project(spoilt, 1.5)
    assert motion.solved
    force = delta.forces.sum(axis=1)
    wanted = problem.mass_kg * (np.diff(delta.body[:, 6:9], axis=0) / problem.dt_s - problem.gravity_h)
    np.testing.assert_allclose(force, wanted, atol=1e-3)
    np.testing.assert_allclose(np.diff(delta.body[:, :3], axis=0), problem.dt_s * delta.body[:-1, 6:9], atol=1e-6)


@pytest.fixture(scope="module")
def short(problem: WalkProblem) -> WalkProblem:
    """The walk in so few knots that a foot has five steps to choose from."""
    return replace(problem, steps=13)


def test_a_foots_mip_finds_the_best_of_all_its_steps(short: WalkProblem) -> None:
    mip, limb, random = WalkMip(short, alone=True), 2, np.random.default_rng(4)
    assert len(mip.steps) == 5
    needed = np.abs(short.goal_feet_h_m - short.start_feet_h_m)[limb].max() - FINAL_FOOT_M
    costs = random.uniform(-1.0, 1.0, len(mip.steps))
    best = np.inf
    for many in range(4):
        for chosen in itertools.combinations(range(len(mip.steps)), many):
            spans = sorted((mip.steps[a].lift, mip.steps[a].land) for a in chosen)
            apart = all(land < lift for (_, land), (lift, _) in pairwise(spans))
            far = sum(longest_step(short, replace(mip.steps[a], limb=limb)) for a in chosen)
            if apart and far * np.cos(np.pi / 8) >= needed:
                best = min(best, costs[list(chosen)].sum())
    vector = np.zeros(mip.milp.size)
    vector[mip.taken[limb]] = costs
    found = mip.milp.solve(vector, gap=1e-9, time_limit_s=20.0)
    assert found.objective == pytest.approx(best)


def test_moments_are_not_in_the_mip_of_a_walk(problem: WalkProblem) -> None:
    """Where steps are all that counts, feet leave the ground together with which the robot would tip over."""
    short = replace(problem, steps=22)
    mip = WalkMip(short)
    vector = np.zeros(mip.milp.size)
    vector[mip.taken] = -1.0
    found = mip.milp.solve(vector, gap=1e-6, time_limit_s=20.0)
    assert found.values is not None
    motion = mip.motion(found.values)
    forces, standing = motion.forces.sum(axis=1), motion.gait.stance[:-1].sum(axis=1)
    assert standing.min() == 2
    inertia = short.mass_kg * np.diff(motion.body[mip.ends, 6:9], axis=0) / (short.dt_s * mip.knots[:, None])
    np.testing.assert_allclose(forces[mip.ends[:-1]], inertia - short.mass_kg * short.gravity_h, atol=1e-3)


def test_the_contact_block_of_a_walk_honours_the_consensus_term(problem: WalkProblem) -> None:
    later = clock.now() + 60.0
    block = WalkSteps(problem, Scales(force=0.0))
    first = block.minimise(1.5, None, later)
    feet = first.eta.fingers[-1]
    assert (np.abs(feet[:, :2] - problem.goal_feet_h_m) <= FINAL_FOOT_M + 1e-6).all()
    assert feet[:, 2] == pytest.approx(np.zeros(4))
    target = first.eta + first.eta.times(0.0)
    target.body[5:-5, 1] += 0.01
    pulled = block.minimise(1000.0, target, later)
    assert np.abs(pulled.eta.body[5:-5, 1] - target.body[5:-5, 1]).mean() < 0.005


def test_neighbours_change_few_binaries_and_keep_every_foot_walking() -> None:
    slots = Slots((((3, 7),), ((9, 13),), ((15, 19),), ((21, 25),)))
    alpha = slots.alpha(40)
    assert alpha.sum() == 4 * 40 - 16
    assert Slots.of(slots.gait(41)) == slots
    seen = {other for _, other in slots.neighbours()}
    assert slots not in seen
    assert all(len(each) == 1 for other in seen for each in other.of_limb)
    assert any((other.alpha(40) != alpha).sum() == 1 for other in seen)
