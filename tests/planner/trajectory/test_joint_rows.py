"""Joint limits as rows of the exact P1, against Pinocchio and finite differences."""

from __future__ import annotations

from dataclasses import replace
from functools import lru_cache

import numpy as np
import pytest
from crux_contracts.robot import Robot, load_robot
from crux_contracts.robot_bounds import JOINTS
from crux_planner.model.arrays import Array, Indices
from crux_planner.model.build import build_problem
from crux_planner.model.kinematics import rotation_from_rpy, rotation_z
from crux_planner.model.problem import BODY_STATES
from crux_planner.model.schedule import Schedule
from crux_planner.reach.arm import reaches_of
from crux_planner.reach.poses import GripperPoses
from crux_planner.reach.solids import gap_m
from crux_planner.trajectory.joint_limits import JointLimits
from crux_planner.trajectory.joint_rows import JointFunctions
from crux_planner.trajectory.link_planes import OFF_M, Planes, _off_trunk, planes_about
from reach.pinocchio_limb import PinocchioLimb
from walls import scenario, two_rows

TILT_RAD = 0.15


@lru_cache
def functions() -> JointFunctions:
    robot = load_robot("scaler")
    problem = build_problem(scenario(two_rows()), robot)
    return JointFunctions(problem, reaches_of(robot), JointLimits.about(np.zeros((2, BODY_STATES)), 0.0))


@lru_cache
def pinocchio(limb: int) -> PinocchioLimb:
    return PinocchioLimb(load_robot("scaler"), limb)


def drawn(robot: Robot, random: np.random.Generator) -> tuple[Array, Array, Array]:
    """A body state, hands (16,) and joint angles (4, 6) that belong to each other."""
    state = np.zeros(BODY_STATES)
    state[:6] = random.uniform(-1.0, 1.0, 6) * [0.5, 0.5, 0.05, TILT_RAD, TILT_RAD, 0.6]
    hands, angles = [], []
    for limb in range(4):
        other, part = pinocchio(limb), robot.limbs[limb]
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


def rows_at(state: Array, hands: Array, planes: Planes) -> Array:
    """(24 + R,)"""
    f, given = functions(), np.concatenate([hands[None], planes.packed], axis=1)
    count = 4 * JOINTS + planes.least.shape[1]
    return np.asarray(f.reach_at(state[None], given, np.zeros((1, count)))[0][0])


def planes(normals: Array, one: Indices, other: Indices) -> Planes:
    """Of one knot."""
    return Planes(normals[None], one[None], other[None], np.zeros((1, len(one))))


def test_rows_are_the_angles_by_which_pinocchio_has_the_grippers_there(robot: Robot) -> None:
    random, none = np.random.default_rng(0), np.zeros(0, dtype=int)
    for _ in range(25):
        state, hands, angles = drawn(robot, random)
        found = rows_at(state, hands, planes(np.zeros((0, 3)), none, none)).reshape(4, JOINTS)
        wanted = angles.copy()
        wanted[:, 2], wanted[:, 4] = np.cos(angles[:, 2]), np.sin(angles[:, 4])
        np.testing.assert_allclose(found, wanted, atol=1e-6)


def test_planes_have_the_ends_of_the_links_as_pinocchio_does(robot: Robot) -> None:
    """Of a limb with a normal each along x, y and z: the capsules' ends, from the first link to the palm."""
    random, ends = np.random.default_rng(1), functions().ends
    state, hands, angles = drawn(robot, random)
    number, origin = np.arange(ends.count), np.full(ends.count, ends.count)
    along = [
        rows_at(state, hands, planes(np.tile(axis, (ends.count, 1)), number, origin))[4 * JOINTS :]
        for axis in np.eye(3)
    ]
    found = np.stack(along, axis=-1)
    for limb in range(4):
        capsules = pinocchio(limb).links_m(angles[limb])
        mine = found[[number for each in ends.numbers[limb] for number in each]]
        for start, end, _ in (*capsules[:2], capsules[-1]):
            for wanted in (start, end):
                assert np.linalg.norm(mine - wanted, axis=1).min() < 1e-6


def test_derivatives_are_those_of_finite_differences(robot: Robot) -> None:
    random, f, step = np.random.default_rng(2), functions(), 1e-6
    state, hands, _ = drawn(robot, random)
    pairs = [random.integers(f.ends.count + 1, size=40) for _ in range(2)]
    some = planes(random.normal(size=(40, 3)), pairs[0], pairs[1])
    given, multiplier = np.concatenate([hands[None], some.packed], axis=1), random.normal(size=4 * JOINTS + 40)
    _, slope, hessian = f.reach_at(state[None], given, multiplier[None])
    for axis in range(6):
        off = step * np.eye(BODY_STATES)[axis]
        ahead, behind = (f.reach_at((state + sign * off)[None], given, multiplier[None]) for sign in (1, -1))
        np.testing.assert_allclose(slope[0, :, axis], (ahead[0] - behind[0])[0] / (2 * step), atol=1e-5)
        bent = multiplier @ (ahead[1] - behind[1])[0] / (2 * step)
        np.testing.assert_allclose(hessian[0, axis], bent, atol=1e-4 * max(1.0, np.abs(bent).max()))


@pytest.mark.parametrize("limb", range(4))
def test_links_on_their_side_of_the_planes_are_off_the_trunk(robot: Robot, limb: int) -> None:
    """Planes of one pose from which the limb is in reach; poses about it that keep to them, and some that do not."""
    random, ends, reach = np.random.default_rng(limb), functions().ends, reaches_of(robot)[limb]
    kept = left = 0
    while kept < 200 or left < 20:
        state, hands, _ = drawn(robot, random)
        hand = hands.reshape(4, 4)[limb]
        if not reach.reaches(seen(state, hand)).all():
            continue
        rows = _off_trunk(ends, limb, reach.links(seen(state, hand)), np.array([OFF_M]))
        numbers, normals = [row[1] for row in rows], np.array([row[0][0] for row in rows])
        least = np.array([row[3][0] for row in rows])
        some = np.isfinite(least)
        for _ in range(20):
            moved = state + np.append(random.uniform(-1.0, 1.0, 6) * [0.08, 0.08, 0.02, 0.05, 0.05, 0.2], np.zeros(6))
            links = reach.links(seen(moved, hand))
            origin = np.full(len(rows), ends.count)
            along = rows_at(moved, hands, planes(normals, np.array(numbers), origin))[4 * JOINTS :]
            behind = (along >= least)[some].all()
            count = len(reach.keep_off.links)
            near = [
                any(np.isfinite(row[3][0]) and row[1] in ends.numbers[limb][i] for row in rows) for i in range(count)
            ]
            both = np.stack([links.start_m[0], links.end_m[0]])[:, :count][:, near]
            gaps = gap_m(reach.keep_off.trunk, *both) - links.radius_m[:count][near]
            assert not behind or gaps.min() >= OFF_M - 1e-9
            kept, left = kept + behind, left + (not behind)


@pytest.mark.parametrize("pair", [(0, 2), (1, 3)])
def test_links_on_their_sides_of_the_planes_are_off_each_other(robot: Robot, pair: tuple[int, int]) -> None:
    """Planes of one pose of two limbs with links apart but near; poses about it that keep to them, and some that bring
    links into each other.
    """
    random, f = np.random.default_rng(5), functions()
    others, reaches = [pinocchio(limb) for limb in pair], [f.reaches[limb] for limb in pair]
    kept = met = 0
    while kept < 100 or met < 7:
        state, hands, angles = drawn(robot, random)
        gap = others[0].apart_m(angles[pair[0]], others[1], angles[pair[1]])
        if not 0.006 < gap < 0.05:
            continue
        found = planes_about(f.ends, state[None, :6], hands.reshape(1, 4, 4), np.array([OFF_M]))
        for _ in range(40):
            moved = state + np.append(random.uniform(-1.0, 1.0, 6) * [0.06, 0.06, 0.02, 0.05, 0.05, 0.2], np.zeros(6))
            poses = [seen(moved, hands.reshape(4, 4)[limb]) for limb in pair]
            if not all(reach.reaches(pose).all() for reach, pose in zip(reaches, poses, strict=True)):
                continue
            one, two = (reach.angles(pose)[0] for reach, pose in zip(reaches, poses, strict=True))
            now = others[0].apart_m(one, others[1], two)
            behind = (rows_at(moved, hands, found)[4 * JOINTS :] >= found.least[0]).all()
            assert not behind or now >= min(gap, OFF_M) - 1e-6
            kept, met = kept + behind, met + (now <= 0.0)


def seen(state: Array, hand: Array) -> GripperPoses:
    """One gripper as a body has it."""
    back = rotation_from_rpy(state[3:6]).T
    return GripperPoses.of((back @ (hand[:3] - state[:3]))[None], (back @ rotation_z(hand[3]))[None])


def test_elbows_keep_off_straight_as_far_as_they_do_on_the_path(robot: Robot) -> None:
    """By 4 mm of the wrist's distance; where the path has them straighter, no straighter than there."""
    f = functions()
    problem, steps = f.problem, 12
    hands = np.tile(np.array([problem.contacts[c].pose[:5] for c in problem.start_contacts]), (steps + 1, 1, 1))
    hands[6:, 3, 2] += 0.01  # a limb has lifted off: from then on limits are those of the joints
    schedule = Schedule([], [list(problem.start_contacts)] * (steps + 1), hands)
    limb, path = robot.limbs[0], np.zeros((steps + 1, BODY_STATES))
    l1, l2, straight = limb.upper_link_m, limb.lower_link_m, np.cos(limb.lower_rad[2] + 0.02)
    most_m = np.sqrt(l1**2 + l2**2 + 2 * l1 * l2 * np.cos(limb.lower_rad[2]))
    for back_m in (0.0, 0.002, 0.02):  # of the wrist from as far as it goes
        shoulder_to_wrist = most_m - back_m
        path[:, :3] = hands[0, 0, :3] + [0, 0, limb.wrist_to_gripper_m] - limb.shoulder_b_m
        path[:, 0] -= shoulder_to_wrist * np.cos(limb.mount_rad)
        path[:, 1] -= shoulder_to_wrist * np.sin(limb.mount_rad)
        about = f.within(JointLimits.about(path, 0.02))
        _, high = about.reach_bounds(replace(problem, steps=steps), schedule)
        bound_m = np.sqrt(l1**2 + l2**2 + 2 * l1 * l2 * high[-1, 2])
        at_margin = np.sqrt(l1**2 + l2**2 + 2 * l1 * l2 * straight)
        assert bound_m == pytest.approx(min(at_margin, max(most_m - 0.004, shoulder_to_wrist)), abs=1e-6)
