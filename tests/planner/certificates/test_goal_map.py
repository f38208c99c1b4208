"""Stances at the goal that the outer maps rule out, against poses drawn in the goal's tolerances."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from crux_contracts.robot import Robot
from crux_contracts.scenario import parse_scenario
from crux_planner.certificates.infeasibility import goal_boxes
from crux_planner.certificates.infeasibility.goal_map import GoalMap
from crux_planner.certificates.infeasibility.infeasible import Proof
from crux_planner.certificates.infeasibility.poses import GoalPoses
from crux_planner.errors import InfeasibleError
from crux_planner.model.arrays import Array
from crux_planner.model.build import build_problem
from crux_planner.model.contacts import Grip
from crux_planner.model.kinematics import rotation_from_rpy
from crux_planner.model.problem import Goal, Pose, Problem
from crux_planner.reach.arm import reaches_of
from crux_simulation.benchmarks.random_fields import random_field
from reach.pinocchio_limb import PinocchioLimb
from walls import scenario, two_rows


@pytest.mark.parametrize("seed", [405, 560])  # by coarse boxes of the goal's poses, and by finer ones
def test_a_goal_at_which_a_limb_can_hold_on_nowhere_is_refused(robot: Robot, seed: int) -> None:
    field = parse_scenario(random_field(seed))
    problem = build_problem(field, robot)
    reason = Proof(field, robot, problem).quick()
    assert isinstance(reason, InfeasibleError)
    assert reason.proven
    assert "lets LR hold: joint limits, or links that would be in the trunk" in str(reason)


@pytest.mark.parametrize("limb", range(4))
def test_no_grip_is_ruled_out_that_pinocchio_reaches_at_the_goal(robot: Robot, limb: int) -> None:
    """A hold under the gripper of a limb whose joints are drawn within their limits, its links off the trunk, for a
    body within the goal's tolerances: one that is turned and tilted.
    """
    problem, proof = turned_goal(robot)
    other, exact = PinocchioLimb(robot, limb), reaches_of(robot, 0.0, 0.0)
    random, looked = np.random.default_rng(limb), 0
    for _ in range(60):
        place, rotation, tilt = at_goal(problem, random)
        q = drawn_at(other, random, tilt)
        if other.off_trunk_m(q) < 0.0:
            continue
        under = grip_under(proof, other, q, place, rotation)
        assert GoalMap(problem, robot, [under])._may(limb, 0).any()
        assert not goal_boxes.cannot(proof.goal_poses, exact, [(limb, under)])
        looked += 1
    assert looked > 20


@pytest.mark.parametrize("limbs", [(0, 2), (3, 1)])
def test_no_two_grips_are_ruled_out_that_pinocchio_has_apart(robot: Robot, limbs: tuple[int, int]) -> None:
    """The same of two limbs whose links are as near each other as they may be, by Coal: for bodies about one that is at
    the edge of where they may be.
    """
    problem, proof = turned_goal(robot)
    exact, both = reaches_of(robot, 0.0, 0.0), [PinocchioLimb(robot, limb) for limb in limbs]
    random, looked = np.random.default_rng(limbs), 0
    while looked < 30:
        place, rotation, tilt = at_goal(problem, random)
        drawn = [drawn_at(each, random, tilt) for each in both]
        near = both[0].apart_m(drawn[0], both[1], drawn[1])
        if not 0.0 < near < 0.03 or min(each.off_trunk_m(q) for each, q in zip(both, drawn, strict=True)) < 0.0:
            continue
        under = [grip_under(proof, each, q, place, rotation) for each, q in zip(both, drawn, strict=True)]
        off = random.normal(size=3)
        rpy = np.array([*tilt, np.arctan2(rotation[1, 0], rotation[0, 0])])
        goal = Goal(Pose(place + 0.003 * off / np.linalg.norm(off), rpy), 0.003, 0.005, {})
        poses = GoalPoses(replace(proof.goal_poses.problem, goal=goal))
        assert not goal_boxes.cannot(poses, exact, list(zip(limbs, under, strict=True)), None, near - 1e-6, looks=3000)
        looked += 1


def test_two_limbs_cannot_hold_in_one_place(robot: Robot) -> None:
    """Where each by itself can."""
    problem, proof = turned_goal(robot)
    exact, random, poses = reaches_of(robot, 0.0, 0.0), np.random.default_rng(1), proof.goal_poses
    rear, both = PinocchioLimb(robot, 2), 0
    while both < 3:
        place, rotation, tilt = at_goal(problem, random)
        here = grip_under(proof, rear, drawn_at(rear, random, tilt), place, rotation)
        if all(goal_boxes.cannot(poses, exact, [(limb, here)]) is False for limb in (0, 2)):
            assert goal_boxes.cannot(poses, exact, [(0, here), (2, here)])
            both += 1


def turned_goal(robot: Robot) -> tuple[Problem, Proof]:
    """Of a body that is turned and tilted."""
    wall = two_rows(all_limbs=False)
    wall["goal"]["body"] = {"position_m": [0.15, 0.02, 0.185], "rpy_deg": [4, -3, 15]}
    read = scenario(wall)
    problem = build_problem(read, robot)
    return problem, Proof(read, robot, problem)


def at_goal(problem: Problem, random: np.random.Generator) -> tuple[Array, Array, Array]:
    """Place, rotation, and roll and pitch of a body within the goal's tolerances."""
    goal, off, turn = problem.goal, random.normal(size=3), random.normal(size=3)
    place = goal.body.position_m + goal.tolerance_m * random.random() * off / np.linalg.norm(off)
    angle = goal.tolerance_rad * random.random() * turn / np.linalg.norm(turn)
    rotation = rotation_from_rpy(goal.body.rpy_rad) @ rotation_from_rpy(angle * 0.99)
    return place, rotation, np.array([np.arctan2(rotation[2, 1], rotation[2, 2]), -np.arcsin(rotation[2, 0])])


def grip_under(proof: Proof, limb: PinocchioLimb, q_rad: Array, place: Array, rotation: Array) -> Grip:
    """Where the gripper of a limb is, for a body there."""
    hand_place, hand = limb.pose(q_rad)
    at, axis = place + rotation @ hand_place, (rotation @ hand)[:, 0]
    contact = replace(proof.grips[0].contact, centre_h_m=at, yaw_rad=float(np.arctan2(axis[1], axis[0])))
    return replace(proof.grips[0], contact=contact, aside_m=0.0, height_m=(float(at[2]), float(at[2])))


def drawn_at(other: PinocchioLimb, random: np.random.Generator, tilt_rad: Array) -> Array:
    """Joint angles within limits at which the gripper is upright under a body tilted so."""
    low, high = other.limb.lower_rad, other.limb.upper_rad
    while True:
        q = other.upright(random.uniform(low, high), tilt_rad)
        if ((q >= low) & (q <= high)).all():
            return q
