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
from crux_planner.errors import InfeasibleError
from crux_planner.model.arrays import Array
from crux_planner.model.build import build_problem
from crux_planner.model.kinematics import rotation_from_rpy
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
    wall = two_rows(all_limbs=False)
    wall["goal"]["body"] = {"position_m": [0.15, 0.02, 0.185], "rpy_deg": [4, -3, 15]}
    read = scenario(wall)
    problem, other = build_problem(read, robot), PinocchioLimb(robot, limb)
    proof, exact = Proof(read, robot, problem), reaches_of(robot, 0.0, 0.0)
    random, looked = np.random.default_rng(limb), 0
    for _ in range(60):
        goal, off, turn = problem.goal, random.normal(size=3), random.normal(size=3)
        place = goal.body.position_m + goal.tolerance_m * random.random() * off / np.linalg.norm(off)
        angle = goal.tolerance_rad * random.random() * turn / np.linalg.norm(turn)
        rotation = rotation_from_rpy(goal.body.rpy_rad) @ rotation_from_rpy(angle * 0.99)
        tilt = np.array([np.arctan2(rotation[2, 1], rotation[2, 2]), -np.arcsin(rotation[2, 0])])
        q = drawn_at(other, random, tilt)
        if other.off_trunk_m(q) < 0.0:
            continue
        hand_place, hand = other.pose(q)
        at, axis = place + rotation @ hand_place, (rotation @ hand)[:, 0]
        grip = proof.grips[0]
        yaw = float(np.arctan2(axis[1], axis[0]))
        contact = replace(grip.contact, centre_h_m=at, yaw_rad=yaw)
        under = replace(grip, contact=contact, aside_m=0.0, height_m=(float(at[2]), float(at[2])))
        assert GoalMap(problem, robot, [under])._may(limb, 0).any()
        assert not goal_boxes.cannot(proof.goal_poses, exact, limb, under)
        looked += 1
    assert looked > 20


def drawn_at(other: PinocchioLimb, random: np.random.Generator, tilt_rad: Array) -> Array:
    """Joint angles within limits at which the gripper is upright under a body tilted so."""
    low, high = other.limb.lower_rad, other.limb.upper_rad
    while True:
        q = other.upright(random.uniform(low, high), tilt_rad)
        if ((q >= low) & (q <= high)).all():
            return q
