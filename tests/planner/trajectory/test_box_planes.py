"""Planes that keep trunk and links off bounded surfaces, against MuJoCo's distance of boxes, Pinocchio and finite
differences.
"""

from __future__ import annotations

from functools import lru_cache

import mujoco
import numpy as np
import pytest
from crux_contracts.robot import Robot, load_robot
from crux_contracts.robot_bounds import JOINTS
from crux_contracts.scenario import parse_scenario
from crux_planner.model.arrays import Array
from crux_planner.model.build import build_problem
from crux_planner.model.kinematics import rotation_from_rpy
from crux_planner.model.problem import BODY_STATES
from crux_planner.reach.arm import reaches_of
from crux_planner.reach.solids import Box
from crux_planner.reach.trunk_clearance import boxes_of, links_off_slabs
from crux_planner.trajectory.box_planes import CORNERS, places, trunk_clear, trunk_off
from crux_planner.trajectory.joint_limits import JointLimits
from crux_planner.trajectory.joint_rows import JointFunctions
from crux_planner.trajectory.link_planes import OFF_M, OFF_SURFACES_M, Planes, planes_about
from edges import CONVEX_60, edge
from scipy.spatial.transform import Rotation

from trajectory.test_joint_rows import drawn, pinocchio, seen

TRUNK = Box(np.array([0.01, 0.0, 0.005]), np.eye(3), np.array([0.15, 0.11, 0.03]))
SLAB = Box(
    np.array([0.1, 0.05, -0.03]), Rotation.from_euler("ZYX", (0.4, -0.5, 0.2)).as_matrix(), np.array([0.2, 0.3, 0.025])
)
APART_M = np.array([OFF_M])


@lru_cache
def functions() -> JointFunctions:
    robot = load_robot("scaler")
    problem = build_problem(parse_scenario(edge(*CONVEX_60)), robot)
    return JointFunctions(problem, reaches_of(robot), JointLimits.about(np.zeros((2, BODY_STATES)), 0.0))


def distance_m(pose: Array) -> float:
    """Of the trunk and the slab, by MuJoCo."""
    spec, turn = mujoco.MjSpec(), Rotation.from_euler("xyz", pose[3:])
    for box, at, turned in (
        (TRUNK, pose[:3] + turn.apply(TRUNK.centre_m), turn),
        (SLAB, SLAB.centre_m, Rotation.from_matrix(SLAB.rotation)),
    ):
        spec.worldbody.add_geom(
            type=mujoco.mjtGeom.mjGEOM_BOX, size=box.half_m, pos=at, quat=np.roll(turned.as_quat(), 1)
        )
    model = spec.compile()
    data = mujoco.MjData(model)
    mujoco.mj_forward(model, data)
    return float(mujoco.mj_geomDistance(model, data, 0, 1, 1.0, None))


def test_a_trunk_on_its_side_of_the_planes_is_off_the_slab() -> None:
    """Planes of one pose; poses about it that keep to them, and some that bring the trunk into the slab."""
    random, corners = np.random.default_rng(3), TRUNK.centre_m + CORNERS * TRUNK.half_m
    kept = met = 0
    while kept < 100 or met < 20:
        pose = random.uniform(-1.0, 1.0, 6) * [0.4, 0.4, 0.3, 0.4, 0.4, 0.6] + [0.1, 0.05, 0.1, 0.0, 0.0, 0.0]
        if not trunk_clear([TRUNK], [SLAB], pose[None], OFF_M).all() or distance_m(pose) > 0.1:
            continue
        normals, least = trunk_off(TRUNK, SLAB, pose[None], APART_M, OFF_M)
        assert np.isfinite(least).sum() == 4
        for _ in range(10):
            moved = pose + random.uniform(-1.0, 1.0, 6) * [0.1, 0.1, 0.1, 0.15, 0.15, 0.15]
            behind, gap_m = (places(moved[None], corners)[0] @ normals[0] >= least[0]).all(), distance_m(moved)
            assert not behind or gap_m >= OFF_M - 1e-4
            kept, met = kept + behind, met + (gap_m <= 0.0)


def rows_at(state: Array, hands: Array, planes: Planes) -> Array:
    """(R,) of the planes."""
    given = np.concatenate([np.insert(hands.reshape(4, 4), [4, 4], 0.0, axis=1).reshape(1, -1), planes.packed], axis=1)
    count = 4 * JOINTS + planes.least.shape[1]
    return np.asarray(functions().reach_at(state[None], given, np.zeros((1, count)))[0][0])[4 * JOINTS :]


def test_ends_and_corners_are_where_they_are_in_H(robot: Robot) -> None:
    """Of links as Pinocchio has them, and of the trunk."""
    random, ends = np.random.default_rng(1), functions().ends
    state, hands, angles = drawn(robot, random)
    number = np.arange(ends.links, ends.count)
    origin, none = np.full((1, len(number)), ends.count), np.zeros((1, len(number)))
    along = [Planes(np.tile(axis, (1, len(number), 1)), number[None], origin, none) for axis in np.eye(3)]
    found = np.stack([rows_at(state, hands, each) for each in along], axis=-1)
    turn = rotation_from_rpy(state[3:6])
    np.testing.assert_allclose(found[ends.links :], state[:3] + ends.corners @ turn.T, atol=1e-9)
    for limb in range(4):
        capsules = pinocchio(limb).links_m(angles[limb])
        mine = found[[number for each in ends.numbers[limb] for number in each]]
        for start, end, _ in (*capsules[:2], capsules[-1]):
            for wanted in (start, end):
                assert np.linalg.norm(mine - (state[:3] + turn @ wanted), axis=1).min() < 1e-6


@pytest.mark.parametrize("off_m", [OFF_M, OFF_SURFACES_M])
def test_links_and_trunk_on_their_sides_are_off_the_surfaces(robot: Robot, off_m: float) -> None:
    """Poses about one at which they are so far off, that keep to its planes, and some that bring a link or the trunk
    too near.
    """
    random, f = np.random.default_rng(5), functions()
    slabs, trunk = f.problem.surfaces.slabs, f.reaches[0].keep_off.trunk

    def clear(state: Array, hands: Array) -> bool:
        pose = state[None, :6]
        links = [reach.links(seen(state, hand)) for reach, hand in zip(f.reaches, hands.reshape(4, 4), strict=True)]
        off = all(links_off_slabs(pose, each, slabs, off_m - 1e-6).all() for each in links)
        return off and bool(trunk_clear(trunk, boxes_of(slabs), pose, off_m - 1e-6).all())

    kept = met = 0
    while kept < 4 or met < 4:
        state, hands, _ = drawn(robot, random)
        lift_m = random.uniform(0.0, 0.3)
        state[2] += lift_m
        hands.reshape(4, 4)[:, 2] += lift_m
        if not clear(state, hands):
            continue
        grippers = np.insert(hands.reshape(1, 4, 4), [4, 4], 0.0, axis=2)
        found = planes_about(f.ends, state[None, :6], grippers, APART_M)
        for _ in range(20):
            moved = state + np.append(random.uniform(-1.0, 1.0, 6) * [0.08, 0.08, 0.06, 0.15, 0.15, 0.2], np.zeros(6))
            if not all(r.reaches(seen(moved, h)).all() for r, h in zip(f.reaches, hands.reshape(4, 4), strict=True)):
                continue
            behind, off = (rows_at(moved, hands, found) >= found.least[0]).all(), clear(moved, hands)
            assert not behind or off
            kept, met = kept + behind, met + (not off)


def test_derivatives_are_those_of_finite_differences(robot: Robot) -> None:
    random, f, step = np.random.default_rng(2), functions(), 1e-6
    state, hands, _ = drawn(robot, random)
    number = random.integers(f.ends.links, f.ends.count, size=(1, 40))
    some = Planes(random.normal(size=(1, 40, 3)), number, np.full((1, 40), f.ends.count), np.zeros((1, 40)))
    grippers = np.insert(hands.reshape(4, 4), [4, 4], 0.0, axis=1).reshape(1, -1)
    given, multiplier = np.concatenate([grippers, some.packed], axis=1), random.normal(size=4 * JOINTS + 40)
    _, slope, hessian = f.reach_at(state[None], given, multiplier[None])
    for axis in range(6):
        off = step * np.eye(BODY_STATES)[axis]
        ahead, behind = (f.reach_at((state + sign * off)[None], given, multiplier[None]) for sign in (1, -1))
        np.testing.assert_allclose(slope[0, :, axis], (ahead[0] - behind[0])[0] / (2 * step), atol=1e-5)
        bent = multiplier @ (ahead[1] - behind[1])[0] / (2 * step)
        np.testing.assert_allclose(hessian[0, axis], bent, atol=1e-4 * max(1.0, np.abs(bent).max()))
