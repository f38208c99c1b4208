"""Limbs of four, five and seven joints: numeric kinematics against the checker's, which shares no code with them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from crux_contracts import LIMB_NAMES
from crux_contracts.robot import Limb, Robot, RobotError, load_robot
from crux_contracts.robot_bounds import STILL_RAD
from crux_contracts.scenario import ScenarioError, parse_scenario
from crux_planner.checker.inverse_kinematics import solve
from crux_planner.checker.limb_model import load_model
from crux_planner.model import chain_native
from crux_planner.model.build import build_problem
from crux_planner.model.chain import chain_inverse, forward
from crux_planner.model.kinematics import limit_margin
from crux_planner.pipeline.explanation import check_start
from crux_planner.pipeline.first_wall import FirstWall
from crux_planner.reach import chain_native as reach_native
from crux_planner.reach.arm import reaches_of
from crux_planner.reach.chain_reach import ChainReach
from crux_planner.reach.poses import GripperPoses
from crux_planner.search.equilibrium import StaticEquilibrium
from other_counts import with_joints

COUNTS = (4, 5, 7)


@pytest.fixture(scope="module", params=COUNTS)
def robot(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Robot:
    return load_robot(with_joints(request.param, tmp_path_factory.mktemp("robot")))


def test_a_pose_that_the_joints_make_is_found_and_no_turn_is_missing(robot: Robot) -> None:
    limb, model = robot.limbs[1], load_model(robot).limbs[1]
    own, random = len(limb.joints), np.random.default_rng(3)
    low, high = limb.lower_rad, limb.upper_rad
    q = (low + high) / 2 + random.uniform(-0.15, 0.15, (200, len(low))) * (high - low)
    q[:, own:] = 0.0
    placed = forward(limb.at_zero, q)
    place, turn = placed.gripper_m.T, np.moveaxis(placed.rotation, -1, 0)
    found, reached = chain_inverse(limb).inverse(place, turn)
    upright = placed.rotation[2, 2] > 0.9  # the lattice is of such
    assert reached[upright].mean() > 0.6
    assert np.abs(found[reached, own:]).max(initial=0.0) < 1e-6
    (others,) = solve([model], [place[reached]], [turn[reached]])
    same = np.abs(others.q_rad - found[reached, :own]).max(axis=1) < 1e-4
    assert others.position_error_m.max() < 1e-5
    assert same.mean() > 0.95  # the rest took another branch on the way


def test_the_compiled_part_finds_what_numpy_finds(robot: Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    assert chain_native.library() is not None
    for limb in robot.limbs:
        own, random = len(limb.joints), np.random.default_rng(4)
        low, high = limb.lower_rad, limb.upper_rad
        q = low + random.uniform(-0.2, 1.2, (2000, len(low))) * (high - low)  # also beyond its limits, and turned off
        q[:, own:] = random.uniform(-0.3, 0.3, q[:, own:].shape)
        placed = forward(limb.at_zero, q)
        poses = placed.gripper_m.T, np.moveaxis(placed.rotation, -1, 0)
        found, reached = chain_inverse(limb).inverse(*poses)
        with monkeypatch.context() as without:
            without.setattr(chain_native, "library", lambda: None)
            expected, exists = chain_inverse(limb).inverse(*poses)
        assert 0.02 < exists.mean() < 0.98
        assert (reached == exists).mean() > 0.999  # the error of the last step is about what counts as none
        both = reached & exists
        np.testing.assert_allclose(found[both], expected[both], atol=1e-7)


def test_the_compiled_reach_is_numpys(robot: Robot, monkeypatch: pytest.MonkeyPatch) -> None:
    """Maps, links whether reached or not, and inverse Jacobians."""
    assert reach_native.library() is not None
    for reach in reaches_of(robot)[1:3]:
        assert isinstance(reach, ChainReach)
        limb, random = reach.limb, np.random.default_rng(6)
        poses = _made_and_near(limb, random)
        found, expected = reach.reaches(poses), reach.reaches_by_numpy(poses)
        assert 0.02 < expected.mean() < 0.98
        np.testing.assert_array_equal(found, expected)
        q, reached = chain_inverse(limb).inverse(*poses.in_body())
        seeds = chain_inverse(limb).seeds(q, reached)
        near = poses.where(np.flatnonzero(reached))
        one, other = reach.links(near), reach.links_by_numpy(near)
        for ends, wanted in ((one.start_m, other.start_m), (one.end_m, other.end_m)):
            np.testing.assert_allclose(ends, wanted, atol=1e-7)
        monkeypatch.setattr(chain_native, "library", lambda: None)
        np.testing.assert_allclose(seeds, chain_inverse(limb).seeds(q, reached), rtol=1e-6, atol=1e-6)
        monkeypatch.undo()


def _made_and_near(limb: Limb, random: np.random.Generator) -> GripperPoses:
    """Of grippers, half as joints make them, also beyond their limits; and as many off those, which fewer than six
    joints hardly ever reach.
    """
    low, high = limb.lower_rad, limb.upper_rad
    q = low + random.uniform(-0.05, 1.05, (2000, len(low))) * (high - low)
    q[:, len(limb.joints) :] = 0.0
    placed = forward(limb.at_zero, q)
    place, turned = placed.gripper_m.T, np.moveaxis(placed.rotation, -1, 0)
    near = place + random.uniform(-0.02, 0.02, place.shape)
    return GripperPoses.of(np.concatenate([place, near]), np.concatenate([turned, turned]))


def test_a_turn_that_no_joint_makes_is_no_reach(tmp_path: Path) -> None:
    robot = load_robot(with_joints(4, tmp_path))
    limb = robot.limbs[0]
    ahead, aside = (limb.shoulder_b_m + np.array([0.24, y, -0.15]) for y in (0.0, 0.05))
    for place, expected in ((ahead, True), (aside, False)):
        q, reached = chain_inverse(limb).inverse(place, np.eye(3))
        assert reached
        assert (limit_margin(limb, q) > 0.0) == expected
        assert (np.abs(q[4:]).max() < STILL_RAD) == expected
        (others,) = solve(load_model(robot).limbs[:1], [place[None]], [np.eye(3)[None]])
        assert (others.rotation_error_rad[0] < 1e-6) == expected


def test_a_grip_that_the_joints_do_not_make_is_told_of(tmp_path: Path) -> None:
    robot = load_robot(with_joints(4, tmp_path))
    at = np.array([[x, y, -0.153, 0.0] for x in (0.3755, -0.3755) for y in (0.144, -0.144)])
    for aside_m in (0.0, 0.05):
        grippers = at + np.array([[0.0, aside_m, 0.0, 0.0], *[[0.0] * 4] * 3])
        wall = FirstWall(robot, grippers, 0.12, 0.188, *np.zeros((3, 4)))
        scenario = parse_scenario(wall.document(0.0, 2.2), any_robot=True)
        problem = build_problem(scenario, robot)
        equilibrium = StaticEquilibrium(problem, problem.friction_share)
        if not aside_m:
            check_start(scenario, problem, equilibrium)
            continue
        with pytest.raises(ScenarioError, match="the 4 joints of LF cannot turn the gripper so: it would stand"):
            check_start(scenario, problem, equilibrium)


def test_limbs_of_one_robot_may_differ(tmp_path: Path) -> None:
    robot = load_robot(with_joints(4, tmp_path, LIMB_NAMES[:2], six=True))
    assert [len(limb.joints) for limb in robot.limbs] == [4, 4, 6, 6]
    assert [limb.still for limb in robot.limbs] == [2, 2, 0, 0]


def test_joints_that_do_not_move_the_gripper_in_all_directions_are_refused(tmp_path: Path) -> None:
    folder = with_joints(4, tmp_path)
    urdf = folder / "scaler.urdf"
    urdf.write_text(urdf.read_text().replace('xyz="0 0 1"', 'xyz="0 1 0"'))
    with pytest.raises(RobotError, match=r"limb LF: expected joints that move the gripper in all three directions"):
        load_robot(folder)
