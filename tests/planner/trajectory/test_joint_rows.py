"""Joint limits as rows of the exact P1, against Pinocchio and finite differences."""

from __future__ import annotations

from functools import lru_cache

import numpy as np
import pytest
from crux_contracts.robot import Robot, load_robot
from crux_planner.model.arrays import Array
from crux_planner.model.build import build_problem
from crux_planner.model.kinematics import rotation_from_rpy, rotation_z
from crux_planner.model.problem import BODY_STATES
from crux_planner.reach.arm import reaches_of
from crux_planner.reach.poses import GripperPoses
from crux_planner.reach.solids import gap_m
from crux_planner.trajectory.joint_rows import JOINTS, JointFunctions, JointLimits
from reach.pinocchio_limb import PinocchioLimb
from walls import scenario, two_rows

TILT_RAD = 0.15


@lru_cache
def functions() -> JointFunctions:
    robot = load_robot("scaler")
    problem = build_problem(scenario(two_rows()), robot)
    return JointFunctions(problem, reaches_of(robot), JointLimits.about(np.zeros((2, BODY_STATES)), 0.0))


def drawn(robot: Robot, random: np.random.Generator) -> tuple[Array, Array, Array]:
    """A body state, hands (16,) and joint angles (4, 6) that belong to each other."""
    state = np.zeros(BODY_STATES)
    state[:6] = random.uniform(-1.0, 1.0, 6) * [0.5, 0.5, 0.05, TILT_RAD, TILT_RAD, 0.6]
    hands, angles = [], []
    for limb in range(4):
        other, part = PinocchioLimb(robot, limb), robot.limbs[limb]
        while True:
            q = other.upright(random.uniform(part.lower_rad, part.upper_rad), state[3:5])
            wrist, _ = other.wrist(q)
            first = q[0] + part.mount_rad
            ahead = (wrist - part.shoulder_b_m)[:2] @ [np.cos(first), np.sin(first)]
            if ((q > part.lower_rad) & (q < part.upper_rad)).all() and ahead > 0.05:
                break
        x, y, z, yaw, *_ = other.seen(q, state[3:5])
        place = rotation_z(state[5]) @ [x, y, z] + state[:3]
        hands.append([*place, yaw + state[5]])
        angles.append(q)
    return state, np.array(hands).ravel(), np.array(angles)


def rows_at(state: Array, hands: Array, normals: Array) -> Array:
    f = functions()
    given = np.concatenate([hands, normals])[None]
    return np.asarray(f.reach(state[None], given, np.zeros((1, f.reach_rows)))[0][0])


def normal_count() -> int:
    return 3 * sum(len(each.keep_off.links) for each in functions().reaches)


def test_rows_are_the_angles_by_which_pinocchio_has_the_grippers_there(robot: Robot) -> None:
    random, per_limb = np.random.default_rng(0), functions().reach_rows // 4
    for _ in range(25):
        state, hands, angles = drawn(robot, random)
        found = rows_at(state, hands, np.zeros(normal_count())).reshape(4, per_limb)[:, :JOINTS]
        wanted = angles.copy()
        wanted[:, 2], wanted[:, 4] = np.cos(angles[:, 2]), np.sin(angles[:, 4])
        np.testing.assert_allclose(found, wanted, atol=1e-6)


def test_planes_have_the_ends_of_the_links_as_pinocchio_does(robot: Robot) -> None:
    """Of a limb with a normal each along x, y and z: the capsules' ends, from the upper link to the palm."""
    random, per_limb = np.random.default_rng(1), functions().reach_rows // 4
    state, hands, angles = drawn(robot, random)
    along = [
        rows_at(state, hands, np.tile(axis, normal_count() // 3)).reshape(4, per_limb)[:, JOINTS:] for axis in np.eye(3)
    ]
    ends = np.stack(along, axis=-1)
    for limb in range(4):
        capsules = PinocchioLimb(robot, limb).links_m(angles[limb])
        for start, end, _ in capsules[:2]:
            for wanted in (start, end):
                assert np.linalg.norm(ends[limb] - wanted, axis=1).min() < 1e-6


def test_derivatives_are_those_of_finite_differences(robot: Robot) -> None:
    random, f = np.random.default_rng(2), functions()
    state, hands, _ = drawn(robot, random)
    normals, multiplier = random.normal(size=normal_count()), random.normal(size=f.reach_rows)
    given, step = np.concatenate([hands, normals])[None], 1e-6
    _, slope, hessian = f.reach(state[None], given, multiplier[None])
    for axis in range(6):
        off = step * np.eye(BODY_STATES)[axis]
        ahead, behind = (f.reach((state + sign * off)[None], given, multiplier[None]) for sign in (1, -1))
        np.testing.assert_allclose(slope[0, :, axis], (ahead[0] - behind[0])[0] / (2 * step), atol=1e-5)
        bent = multiplier @ (ahead[1] - behind[1])[0] / (2 * step)
        np.testing.assert_allclose(hessian[0, axis], bent, atol=1e-4 * max(1.0, np.abs(bent).max()))


@pytest.mark.parametrize("limb", range(4))
def test_links_on_their_side_of_the_planes_are_off_the_trunk(robot: Robot, limb: int) -> None:
    """Planes of one pose from which the limb is in reach; poses about it that keep to them, and some that do not."""
    random, f, reach = np.random.default_rng(limb), functions(), reaches_of(robot)[limb]
    kept = left = 0
    while kept < 200 or left < 20:
        state, hands, _ = drawn(robot, random)
        hand = hands.reshape(4, 4)[limb]
        if not reach.reaches(seen(state, hand)).all():
            continue
        normals, least = f.within(JointLimits.about(np.tile(state, (2, 1)), 0.0))._planes(hand[None], reach)
        for _ in range(20):
            moved = state + np.append(random.uniform(-1.0, 1.0, 6) * [0.08, 0.08, 0.02, 0.05, 0.05, 0.2], np.zeros(6))
            links, some = reach.links(seen(moved, hand)), np.isfinite(least[0])
            ends = np.stack([links.start_m[0], links.end_m[0]])[:, : len(some)]
            behind = ((ends * normals[0]).sum(axis=-1).min(axis=0) >= least[0])[some].all()
            gaps = gap_m(reach.keep_off.trunk, *ends[:, some]) - links.radius_m[: len(some)][some]
            assert not behind or gaps.min() >= 0.0045 - 1e-9
            kept, left = kept + behind, left + (not behind)


def seen(state: Array, hand: Array) -> GripperPoses:
    """One gripper as a body has it."""
    back = rotation_from_rpy(state[3:6]).T
    return GripperPoses.of((back @ (hand[:3] - state[:3]))[None], (back @ rotation_z(hand[3]))[None])
