"""Where the bound has the centre of mass, against the one of the limbs' kinematics in poses drawn at random."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from crux_contracts.robot import load_robot
from crux_contracts.scenario import parse_scenario
from crux_planner.certificates.bound.centre_of_mass import FOLLOW, CentreOfMass
from crux_planner.certificates.bound.climb import EFFORT, lower_bound
from crux_planner.certificates.bound.grasps import by_faces, grasps
from crux_planner.certificates.bound.places import orientations, shoulder_to_wrist
from crux_planner.certificates.bound.swings import airborne
from crux_planner.model.build import build_problem
from crux_planner.model.kinematics import rotation_from_rpy
from crux_planner.model.mass import centres_of_mass
from scenes import scene, wall
from shared_plans import unproven


@pytest.mark.parametrize("heavy", [False, True])
def test_no_pose_has_the_centre_of_mass_elsewhere(heavy: bool) -> None:
    """`heavy`: with links whose centres of mass are on no line between joints."""
    problem, random = scene(20).problem, np.random.default_rng(2)
    if heavy:
        aside = np.array([0.02, -0.01, 0.015, 0.0]) * random.uniform(0, 1, (7, 1))
        limbs = [replace(m, numbers=m.numbers + np.append(np.zeros(8), aside)) for m in problem.limb_masses]
        problem = replace(problem, limb_masses=tuple(limbs))
    about = orientations(problem, -0.6, 0.6)
    nodes = grasps(problem, about, np.array([-0.2, -0.2, 0.165]), np.array([0.3, 0.2, 0.21]), by_faces(problem))
    assert nodes is not None
    ends = [airborne(problem, np.concatenate(groups)) for groups in nodes.groups]
    masses, tried, closest = CentreOfMass(problem, about), 0, np.inf
    for _ in range(1500):
        pair, t = int(random.integers(len(nodes.node))), int(random.integers(len(about.shift_m)))
        shift = np.array([about.shift_m[t], about.shift_m[t], 0.0])
        r = random.uniform(nodes.low[pair] - shift, np.maximum(nodes.high[pair] + shift, nodes.low[pair] - shift))
        tilt, cell = problem.body.max_tilt_rad * (t + 1) / len(about.shift_m), nodes.cell[pair]
        turned = random.choice([-1.0, 0.0, 1.0], 2) * random.uniform(0.5, 1.0) * tilt
        rpy = np.array([*turned, random.uniform(about.yaw_low[cell], about.yaw_high[cell])])
        hands = np.zeros((4, 4))
        for limb, (option, groups) in enumerate(zip(nodes.options[nodes.node[pair]], nodes.groups, strict=True)):
            held = None if option == len(groups) else problem.contacts[random.choice(groups[option])]
            hands[limb] = [*random.uniform(*ends[limb]), 0.3] if held is None else [*held.centre_h_m, held.yaw_rad]
        for own, hand in zip(problem.limb_masses, hands, strict=True):
            wrist = hand[:3] + np.array([0.0, 0.0, own.limb.wrist_to_gripper_m]) - r
            length = np.linalg.norm(rotation_from_rpy(rpy).T @ wrist - own.limb.shoulder_b_m)
            if not shoulder_to_wrist(own.limb)[0] <= length <= shoulder_to_wrist(own.limb)[1] * 0.998:
                break
        else:
            rest = masses.of(nodes, np.array([pair]))[0, t]
            centre = centres_of_mass(problem, np.array([[*r, *rpy]]), hands[None])[0]
            off = centre - r - FOLLOW * (hands[:, :3] - r).sum(axis=0)
            assert (rest[0] <= off).all()
            assert (off <= rest[1]).all()
            assert (masses.anywhere[t, 0] <= rest[0] + 1e-12).all()
            assert (rest[1] <= masses.anywhere[t, 1] + 1e-12).all()
            tried, closest = tried + 1, min(closest, (off - rest[0])[2])
    assert tried > 20
    assert closest < 0.03  # nor is much left open


def test_a_vertical_wall_asks_for_what_holds_the_body_off_it() -> None:
    """The weight pulls at the height above the wall that the limbs give it: standing there is known within a quarter;
    to half, where it may be at any height between wall and limbs.
    """
    text = wall(20, goal_m=0.0).replace("slope_deg: 45", "slope_deg: 90")
    scenario, robot = parse_scenario(text), load_robot("scaler")
    result = unproven(scenario, robot)
    bound = lower_bound(replace(build_problem(scenario, robot), steps=result.steps), 1.2 * result.cost, effort=EFFORT)
    assert bound is not None
    assert 0.75 * result.cost <= bound <= result.cost
