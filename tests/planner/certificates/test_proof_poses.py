"""The joint reach of all limbs: its bounds hold for every pose, and what it denies, sampling denies."""

from __future__ import annotations

import itertools
from dataclasses import replace

import numpy as np
import pytest
from crux_contracts.robot import load_robot
from crux_contracts.scenario import parse_scenario
from crux_planner.certificates.infeasibility import poses
from crux_planner.certificates.infeasibility.infeasible import Proof
from crux_planner.certificates.infeasibility.poses import GoalPoses
from crux_planner.checker.plan_arrays import read_plan
from crux_planner.checker.report import Findings
from crux_planner.model.arrays import Array
from crux_planner.model.build import build_problem
from crux_planner.model.kinematics import rotation_from_rpy
from crux_planner.model.problem import Pose, Problem
from crux_simulation.benchmarks.random_fields import random_field
from crux_simulation.benchmarks.random_walls import random_wall
from hypothesis import given, settings
from hypothesis import strategies as st
from shared_plans import unproven

from certificates.test_proof import proof_of_two_rows

ROBOT = load_robot("scaler")
share = st.floats(-1.0, 1.0)


@given(st.tuples(*[share] * 3), st.tuples(*[st.floats(0.0, 0.06)] * 3), st.tuples(*[share] * 3), share)
@settings(max_examples=300, deadline=None)
def test_linear_reach_is_off_by_no_more_than_its_room(
    away: tuple[float, ...], half: tuple[float, ...], change: tuple[float, ...], yaw: float
) -> None:
    q, halves = 0.7 * np.array(away), np.array(half)
    middle = np.array([0.03, -0.02, yaw])
    tilt = float(np.sin(np.abs(middle[:2]) + halves[:2]).max())
    change_rad = halves * change
    before, after = (rotation_from_rpy(rpy).T @ q for rpy in (middle, middle + change_rad))
    rest = np.abs(after - before - poses._slopes(middle, q) @ change_rad)
    assert (rest <= poses._second_order(poses._largest(q, yaw, halves[2]), halves, tilt) + 1e-12).all()
    assert (
        np.abs(after - before) <= poses._first_order(poses._largest(q, None, halves[2]), halves, tilt) + 1e-12
    ).all()


def within_goal(problem: Problem, random: np.random.Generator) -> tuple[Array, Array]:
    """A body pose at the very rim of the goal's tolerances: place and rotation (W <- B)."""
    way, axis = random.normal(size=(2, 3))
    turned = np.array([[0, -axis[2], axis[1]], [axis[2], 0, -axis[0]], [-axis[1], axis[0], 0]]) / np.linalg.norm(axis)
    angle, goal = problem.goal.tolerance_rad, problem.goal.body
    turn = np.eye(3) + np.sin(angle) * turned + (1 - np.cos(angle)) * turned @ turned
    place = goal.position_m + problem.goal.tolerance_m * way / np.linalg.norm(way)
    return place, rotation_from_rpy(goal.rpy_rad) @ turn


@given(st.integers(0, 2**32 - 1), st.lists(st.booleans(), min_size=4, max_size=4), st.tuples(*[share] * 3))
@settings(max_examples=60, deadline=None)
def test_grasps_in_the_boxes_of_some_pose_at_the_goal_are_not_denied(
    seed: int, at_rim: list[bool], tilted: tuple[float, ...]
) -> None:
    """Grasps are put where a random pose has them in its boxes, often at their faces, off the middles."""
    random, proof = np.random.default_rng(seed), proof_of_two_rows()
    body = Pose(np.array([0.1, 0.0, 0.185]), np.array([0.05, 0.05, 0.4]) * tilted)
    problem = replace(proof.problem, goal=replace(proof.problem.goal, body=body))
    place, rotation = within_goal(problem, random)
    rpy = np.array([np.arctan2(rotation[2, 1], rotation[2, 2]), -np.arcsin(rotation[2, 0])])
    if np.abs(rpy).max() > problem.body.max_tilt_rad:
        return
    boxes, grips = problem.boxes, {}
    for limb, rim in enumerate(at_rim):
        grip = proof.grips[int(random.integers(len(proof.grips)))]
        off = random.uniform(-1, 1, 3)
        off[:2] = np.sign(off[:2]) if rim else off[:2]
        along = (off * boxes.half_m) @ boxes.directions.T  # as far this way as the edges that slant let it
        middle = boxes.centre_b_m[limb] @ boxes.directions.T - boxes.middle_m[limb]
        off *= min(1.0, ((boxes.extent_m[limb] - np.sign(along) * middle) / np.maximum(np.abs(along), 1e-9)).min())
        centre = place + rotation @ (boxes.centre_b_m[limb] + off * boxes.half_m)
        centre -= random.uniform(-1, 1) * grip.aside_m * grip.contact.tangent
        height = (centre[2] - 0.005, centre[2] + 0.005)
        grips[limb] = replace(grip, contact=replace(grip.contact, centre_h_m=centre), height_m=height)
    assert GoalPoses(problem).lacking(grips) <= 0.0


@pytest.mark.parametrize("seed", [241, 287])
def test_a_goal_that_no_single_pose_reaches_is_denied_as_sampling_denies_it(seed: int) -> None:
    """Bounds of each limb alone let these pass; of many poses at the goal none has all four in reach."""
    read = parse_scenario(random_field(seed))
    problem = build_problem(read, ROBOT)
    proof = Proof(read, ROBOT, problem)
    reason = proof.quick()
    assert reason is not None
    assert reason.proven
    assert "at once" in str(reason)
    random = np.random.default_rng(0)
    for _ in range(25):
        place, rotation = within_goal(problem, random)
        choice = []
        for limb in range(4):
            wanted = problem.goal.grasps.get(limb)
            ends = [
                i
                for key, i in proof.number.items()
                if wanted in (None, key)
                and any(
                    (problem.limb_reach.outer.beyond(limb, rotation.T @ (centre - place)) <= 0.0).all()
                    for centre in (
                        proof.reach.grips[i].contact.centre_h_m + aside * proof.grips[i].contact.tangent
                        for aside in np.linspace(-1, 1, 5) * proof.grips[i].aside_m
                    )
                )
            ]
            choice.append({proof.hold[i] for i in ends})
        assert not any(len(set(holds)) == 4 for holds in itertools.product(*choice))


def test_every_knot_of_a_plan_is_within_the_relaxation() -> None:
    """Reach, balance and the goal's pose of a plan that the check passes."""
    read = parse_scenario(random_wall(2, all_limbs=True))
    plan = read_plan(unproven(read, ROBOT).plan, Findings())
    assert plan is not None
    proof = Proof(read, ROBOT, build_problem(read, ROBOT))
    stances = [
        tuple(
            proof.number[int(plan.hold[k, limb]), int(plan.finger1_face[k, limb]) // 2] if plan.gripped[k, limb] else -1
            for limb in range(4)
        )
        for k in range(plan.n_knots)
    ]
    for stance, position, rpy in zip(stances, plan.body_position, plan.body_rpy, strict=True):
        fits, low, high = proof.reach.all.fits(stance)
        heading = np.arange(len(fits)) == np.argmin(np.abs(proof.reach.all.yaw_rad - rpy[2]))
        bounds = proof.reach.region(heading, low, high)
        assert (fits & heading).any()
        assert (bounds[0] <= position).all()
        assert (position <= bounds[1]).all()
    for k in range(0, plan.n_knots - 1, 5):
        support = tuple(sorted(g for g in stances[k] if g >= 0))
        assert proof.equilibrium.missing_force(support, plan.body_position[k], plan.body_position[k] + 1e-6) <= 0.0
    assert proof.quick() is None
    assert stances[-1] in proof.goals


@pytest.mark.parametrize("seed", [241, pytest.param(402, marks=pytest.mark.sweep)])
def test_stances_at_a_goal_that_is_held_are_narrowed_when_they_are_asked_for(seed: int) -> None:
    """Field 241 has none, which is denied then as it is at once."""
    read = parse_scenario(random_field(seed))
    problem = build_problem(read, ROBOT)
    later, at_once = Proof(read, ROBOT, problem), Proof(read, ROBOT, problem)
    denied = at_once.quick()
    assert later.quick(held=True) is None
    assert set(later.goals) > set(at_once.goals)
    reason = later.disconnected(0, 0.0)
    assert (denied is None) == (seed == 402)
    assert denied is None or str(reason) == str(denied)
    assert later.goals == at_once.goals
