"""Proofs of infeasibility: what they relax holds for every pose and grasp, and they never deny what exists."""

from __future__ import annotations

import re
from dataclasses import replace
from functools import lru_cache
from itertools import permutations
from typing import Any

import numpy as np
import pytest
from crux_contracts.robot import load_robot
from crux_contracts.scenario import Scenario
from crux_planner.certificates.infeasibility.infeasible import Proof
from crux_planner.errors import InfeasibleError, LevelGoalError
from crux_planner.model.build import build_problem
from crux_planner.model.kinematics import rotation_from_rpy
from crux_planner.model.mass import centres_of_mass
from crux_planner.physics.reachable_set import ReachableSet, goal_contacts
from crux_planner.search.equilibrium import StaticEquilibrium
from crux_planner.solvers import clock
from crux_simulation.benchmarks.random_walls import random_wall
from hypothesis import given, settings
from hypothesis import strategies as st
from search.test_search import balanced
from walls import FEET, hold, ladder, scenario, two_rows

ROBOT = load_robot("scaler")
share = st.floats(-1.0, 1.0)


@lru_cache
def proof_of_two_rows() -> Proof:
    read = scenario(two_rows())
    return Proof(read, ROBOT, build_problem(read, ROBOT))


@given(st.integers(0, 3), st.integers(0, 15), st.tuples(*[share] * 8))
@settings(max_examples=200, deadline=None)
def test_every_grasp_in_an_acceptance_box_is_in_the_relaxed_reach(
    limb: int, grip: int, shares: tuple[float, ...]
) -> None:
    """Any heading, tilt and place on the face: the true body position is within the bounds of some bin."""
    proof = proof_of_two_rows()
    problem, which = proof.problem, proof.reach.grips[grip]
    place = problem.boxes.centre_b_m[limb] + np.array(shares[:3]) * problem.boxes.half_m
    tilt = problem.body.max_tilt_rad
    turned = rotation_from_rpy(np.array([tilt * shares[3], tilt * shares[4], 0.8 * shares[5]]))
    centre = which.contact.centre_h_m + shares[6] * which.aside_m * which.contact.tangent
    centre[2] = np.interp(shares[7], [-1.0, 1.0], which.height_m)
    body = centre - turned @ place
    if not problem.body.height_m[0] <= body[2] <= problem.body.height_m[1]:
        return
    stance = tuple(grip if other == limb else -1 for other in range(4))
    bounds = proof.reach.hull(stance)
    assert bounds is not None
    assert (bounds[0] <= body).all()
    assert (body <= bounds[1]).all()


@given(st.lists(st.integers(0, 15), min_size=2, max_size=4, unique=True), *[share] * 3, st.integers(0, 2**32 - 1))
@settings(max_examples=40, deadline=None)
def test_relaxed_balance_lacks_nothing_where_a_linear_program_balances(
    support: list[int], x: float, y: float, z: float, seed: int
) -> None:
    """The program works on an inscribed polytope, for grasps anywhere on their faces."""
    proof = proof_of_two_rows()
    random, grips = np.random.default_rng(seed), proof.reach.grips
    moved = []
    for grip in grips:
        centre = grip.contact.centre_h_m + random.uniform(-1, 1) * grip.aside_m * grip.contact.tangent
        centre[2] = random.uniform(*grip.height_m)
        moved.append(replace(grip.contact, centre_h_m=centre))
    position = np.array([0.1 + 0.2 * x, 0.2 * y, 0.185 + 0.02 * z])
    if balanced(replace(proof.problem, contacts=moved), tuple(support), position, 1.0):
        assert proof.equilibrium.missing_force(tuple(support), position, position + 1e-4) <= 0.0


def test_no_posture_has_its_centre_of_mass_outside_the_bounds() -> None:
    """Wrists anywhere in the outer set, at any tilt and heading, with grippers at the heights of grips."""
    proof, random, many = proof_of_two_rows(), np.random.default_rng(4), 4000
    problem = proof.problem
    low, high = proof.equilibrium.offset
    reach, heights = problem.boxes, problem.limb_reach.grip_height_m
    tilt = problem.body.max_tilt_rad
    poses = np.zeros((many, 6))
    poses[:, 3:] = random.choice([-1.0, 0.0, 1.0], (many, 3)) * [tilt, tilt, 0.3]
    rotation = rotation_from_rpy(poses[:, 3:])
    hands, grips = np.zeros((many, 4, 4)), np.ones(many, dtype=bool)
    for limb, model in enumerate(ROBOT.limbs):
        wrist = reach.centre_b_m[limb] + random.uniform(-1, 1, (many, 3)) * reach.half_m
        hands[:, limb, :3] = np.einsum("nij,nj->ni", rotation, wrist)
        hands[:, limb, 2] = random.uniform(*heights, many)
        wrist = np.einsum("nji,nj->ni", rotation, hands[:, limb, :3] + [0.0, 0.0, reach.above_m])
        away = np.linalg.norm(wrist - model.shoulder_b_m, axis=1)
        links = (away < model.upper_link_m + model.lower_link_m) & (away > abs(model.upper_link_m - model.lower_link_m))
        grips &= (reach.beyond(limb, wrist) <= 0.0).all(axis=1) & links
    centre = centres_of_mass(problem, poses[grips], hands[grips])
    assert grips.sum() > 100
    assert (centre >= low).all()
    assert (centre <= high).all()
    assert (np.abs(centre).max(axis=0) > 0.2 * high).any()


@pytest.mark.parametrize("friction", [0.1, 0.62, 1.3])
def test_balance_at_the_goal_lacks_nothing_where_the_true_centre_of_mass_balances(friction: float) -> None:
    wall = two_rows(slope_deg=90.0)
    wall["contact"].update(spine_shear_N=0, spine_twist_Nm=0)
    for part in wall["holds"]:
        part["friction"] = friction
    read = scenario(wall)
    proof, random = Proof(read, ROBOT, build_problem(read, ROBOT)), np.random.default_rng(0)
    problem, grips = proof.problem, proof.grips
    stance = tuple(proof.number[problem.goal.grasps[limb]] for limb in range(4))
    contacts = [grips[g].contact for g in stance]
    hands = np.array([[*c.centre_h_m, c.yaw_rad] for c in contacts])
    point = replace(
        problem, contacts=contacts, start_contacts=(0, 1, 2, 3), limb_masses=(), body_moment_kg_m=np.zeros(3)
    )
    for _ in range(10):
        place = problem.goal.body.position_m + random.uniform(-0.01, 0.01, 3)
        turned = random.uniform(-1, 1, 3) * [*2 * [problem.body.max_tilt_rad], problem.goal.tolerance_rad]
        mass = centres_of_mass(problem, np.append(place, turned)[None], hands[None])[0]
        held = balanced(point, (0, 1, 2, 3), mass, 1.0)
        if held:
            assert proof.equilibrium.missing_at_goal(stance, place, place + 1e-4) <= 0.0
        assert held == (friction > 0.6)


def proven(read: Scenario) -> InfeasibleError | None:
    proof, until = Proof(read, ROBOT, build_problem(read, ROBOT)), clock.now() + 20
    return proof.quick() or proof.goal_equilibrium(10**6, until) or proof.disconnected(10**6, until)


def tiny_wall(seed: int) -> dict[str, Any]:
    """The start's holds, two more at random, and a goal near by; friction from too little to enough."""
    random = np.random.default_rng(seed)
    wall = two_rows(slope_deg=float(random.uniform(0, 180)), all_limbs=False)
    wall["holds"] = wall["holds"][:4]
    while len(wall["holds"]) < 6:
        x, y = np.array(list(FEET.values())[random.integers(4)]) + random.uniform([0.1, -0.08], [0.22, 0.08])
        away = [np.hypot(x - part["position_m"][0], y - part["position_m"][1]) for part in wall["holds"]]
        if min(away) > 0.15:
            wall["holds"].append(hold(f"further-{len(away)}", round(float(x), 3), round(float(y), 3)))
    for part in wall["holds"]:
        part["friction"] = float(random.uniform(0.3, 2.2))
    wall["goal"] = {"body": {"position_m": [round(float(random.uniform(0.0, 0.35)), 3), 0.0, 0.185]}}
    return wall


def brute_force_finds_a_way(read: Scenario) -> bool:
    """Every full stance of a level body, centred grasps and one limb at a time: is the goal connected to the start?"""
    problem = build_problem(read, ROBOT)
    reach, equilibrium = ReachableSet(problem), StaticEquilibrium(problem, 1.0)
    nodes = [
        stance
        for stance in permutations(range(len(problem.contacts)), 4)
        if len({problem.contacts[c].hold for c in stance}) == 4 and reach.of(stance) is not None
    ]
    seen, queue = {problem.start_contacts}, [problem.start_contacts]
    while queue:
        stance = queue.pop()
        for other in nodes:
            moved = [limb for limb in range(4) if stance[limb] != other[limb]]
            if len(moved) != 1 or other in seen:
                continue
            support = tuple(c for limb, c in enumerate(stance) if limb != moved[0])
            ends = [(on, reach.of(on)) for on in (stance, other)]
            if all(b is not None and equilibrium.position(support, *b, b[0], on) is not None for on, b in ends):
                seen.add(other)
                queue.append(other)
    at_goal, goal, slack = goal_contacts(problem, reach), problem.goal.body.position_m, problem.goal.position_slack_m
    return any(
        all(c in at_goal[limb] for limb, c in enumerate(stance))
        and equilibrium.position(stance, goal - slack, goal + slack, goal) is not None
        for stance in seen
    )


@pytest.mark.parametrize("seed", [0, 2, *(pytest.param(seed, marks=pytest.mark.sweep) for seed in (1, 3, 4, 5))])
def test_what_brute_force_reaches_is_not_denied(seed: int) -> None:
    read = scenario(tiny_wall(seed))
    if brute_force_finds_a_way(read):
        assert proven(read) is None


@pytest.mark.parametrize("seed", [1, *(pytest.param(seed, marks=pytest.mark.sweep) for seed in (2, 3))])
def test_walls_that_are_climbed_are_not_denied(seed: int) -> None:
    from crux_contracts.scenario import parse_scenario

    assert proven(parse_scenario(random_wall(seed, all_limbs=True))) is None


def test_a_goal_at_the_start_of_few_steps_is_not_denied() -> None:
    """From knot to knot the body may turn by more than half of what it can turn in all."""
    wall = two_rows()
    wall["goal"]["grasps"] = dict(wall["start"]["grasps"])
    wall["goal"]["body"] = {**wall["start"]["body"], "tolerance_m": 0.001, "tolerance_deg": 0.1}
    wall["horizon"]["steps"] = 2
    assert proven(scenario(wall)) is None


def test_a_gap_between_the_holds_is_proven_by_search() -> None:
    """Wider than from a stretched front limb to a stretched rear one on the other side."""
    wall = two_rows()
    wall["holds"] += [hold(f"top-{x}-{y}", x, y) for x in (1.86, 2.14) for y in (0.36, -0.36)]
    wall["goal"] = {"body": {"position_m": [2.0, 0.0, 0.185]}}
    reason = proven(scenario(wall))
    assert reason is not None
    assert reason.proven
    assert "none of them leads on" in str(reason)


@pytest.mark.parametrize(("side", "limb"), [("left", "LF"), ("right", "RF")])
def test_missing_rungs_are_named_where_a_level_body_does_not_reach_the_goal(side: str, limb: str) -> None:
    """Rungs 4 to 8 are gone: 3 is at 0.37 m, 9 at 1.39 m, and a front gripper is from 0.22 m behind a body that heads
    up to 0.49 m ahead of it, and 0.1 m farther of one that is turned.
    """
    wall = ladder(12)
    wall["holds"] = [part for part in wall["holds"] if part["name"] not in {f"{side}-{rung}" for rung in range(4, 9)}]
    read = scenario(wall)
    proof = Proof(read, ROBOT, build_problem(read, ROBOT))
    assert proof.quick() is None
    reason = str(proof.instead_of(LevelGoalError("reach", "of a level body")))
    named = re.match(rf"no hold within reach of {limb} for a body between \[(0\.\d+), .*\] m and \[(0\.\d+), ", reason)
    assert named is not None
    assert 0.37 + 0.22 < float(named[1]) < float(named[2]) < 1.39 - 0.49
    other = InfeasibleError("passage", "another reason")
    assert proof.instead_of(other) is other


def test_too_little_friction_at_the_goal_is_proven_with_the_force_that_lacks() -> None:
    wall = two_rows(slope_deg=90.0)
    wall["contact"].update(spine_shear_N=0, spine_twist_Nm=0)
    for part in wall["holds"][4:]:
        part["friction"] = 0.05
    reason = proven(scenario(wall))
    assert reason is not None
    assert reason.constraint == "equilibrium"
    assert "short by" in str(reason)


def test_palms_in_each_other_at_the_start_are_proven_and_wider_holds_leave_room_aside() -> None:
    wall = two_rows(all_limbs=False)
    del wall["holds"][6]
    for i, x in ((0, 0.065), (2, -0.065)):  # 140 mm palms, end to end
        wall["holds"][i] = hold(wall["holds"][i]["name"], x, 0.36)
    reason = proven(scenario(wall))
    assert reason is not None
    assert "palms of LF on LF-low and LR on LR-low keep 0.0 mm apart" in str(reason)
    for i in (0, 2):
        wall["holds"][i]["size_m"] = [0.06, 0.1, 0.06]
    assert proven(scenario(wall)) is None
