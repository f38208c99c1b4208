"""Numeric kinematics of limbs of any six joints, against the closed form, the checker's chain and differences."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from crux_contracts.robot import Limb, Robot, load_robot
from crux_contracts.scenario import ScenarioError, load_scenario, parse_scenario
from crux_planner.checker.limb_model import load_model
from crux_planner.model.arrays import Array
from crux_planner.model.build import build_problem
from crux_planner.model.chain import ChainInverse, chain_inverse
from crux_planner.model.kinematics import inverse, limit_margin, rotation_from_rpy, rotation_z
from crux_planner.model.limb import limb_masses
from crux_planner.model.mass import linear_centre
from crux_planner.physics.torque import joint_torques
from crux_planner.pipeline.entry import plan
from crux_planner.reach.arm import MARGIN_RAD, ArmReach
from crux_planner.reach.chain_reach import ChainReach
from crux_planner.reach.poses import GripperPoses
from crux_planner.reach.solids import solids
from crux_tools.paths import ROOT
from other_limbs import other_limbs


def grippers(limb: Limb, count: int, seed: int, tilt_rad: float = 0.15) -> tuple[Array, Array]:
    """Grippers about where a limb works, in the body frame."""
    random = np.random.default_rng(seed)
    side = np.sign(limb.shoulder_b_m[:2])
    places = random.uniform([-0.2, 0.0, -0.25], [0.5, 0.6, 0.0], (count, 3)) * [*side, 1.0]
    tilts = np.column_stack([random.uniform(-tilt_rad, tilt_rad, (count, 2)), np.zeros(count)])
    yaws = random.uniform(-1.75, 1.75, count)
    return places, np.swapaxes(rotation_from_rpy(tilts), 1, 2) @ rotation_z(yaws)


def numeric(robot: Robot) -> Robot:
    """The same robot, its limbs taken for some without a closed form."""
    first, second, third, fourth = (replace(limb, closed_form=False) for limb in robot.limbs)
    return replace(robot, limbs=(first, second, third, fourth))


@pytest.mark.parametrize("limb", [0, 3])
def test_numeric_kinematics_are_those_of_the_closed_form(robot: Robot, limb: int) -> None:
    part = robot.limbs[limb]
    poses = grippers(part, 4000, limb)
    q, reached = ChainInverse(part).inverse(*poses)
    wanted, exists = inverse(part, *poses)
    inside, expected = (ok & (limit_margin(part, angles) >= 0.02) for ok, angles in ((reached, q), (exists, wanted)))
    assert expected.sum() > 1000
    assert (inside & ~expected).sum() == 0
    assert (expected & ~inside).mean() < 0.002
    np.testing.assert_allclose(q[inside], wanted[inside], atol=1e-6)


@pytest.fixture(scope="module")
def other(tmp_path_factory: pytest.TempPathFactory) -> Robot:
    return load_robot(other_limbs("all of them", tmp_path_factory.mktemp("other")))


def test_angles_put_the_gripper_where_it_should_be_and_do_not_jump(other: Robot) -> None:
    model = load_model(other)
    for part, limb in zip(other.limbs[:2], model.limbs[:2], strict=True):
        place, turn = grippers(part, 1500, 5)
        q, reached = chain_inverse(part).inverse(place, turn)
        inside = reached & (limit_margin(part, q) >= 0.0)
        assert inside.sum() > 400
        state = limb.forward(q[inside])
        np.testing.assert_allclose(state.link_position_m[limb.gripper], place[inside], atol=1e-7)
        np.testing.assert_allclose(state.link_rotation[limb.gripper], turn[inside], atol=1e-7)
        near, still = chain_inverse(part).inverse(place[inside] + [1e-4, -1e-4, 1e-4], turn[inside])
        assert still.mean() > 0.98
        assert np.abs(near - q[inside])[still].max() < 0.05


def test_torques_and_their_derivatives_are_those_of_the_closed_form(robot: Robot) -> None:
    part, random = robot.limbs[0], np.random.default_rng(1)
    closed, chained = (limb_masses(each, each.limbs[0]) for each in (robot, numeric(robot)))
    pose, force = np.array([0.1, -0.2, 0.18, 0.05, -0.04, 0.1]), random.normal(size=3) * 30
    to_b = rotation_from_rpy(pose[3:]).T
    place, axis = np.array([0.25, 0.15, 0.03]), rotation_z(0.4)[:, 0]
    off, up, along = to_b @ (place - pose[:3]), to_b[:, 2], to_b @ axis
    assert inverse(part, off, to_b @ rotation_z(0.4))[1]
    given = chained.at((off[0], off[1], off[2]), (up[0], up[1], up[2]), (along[0], along[1], along[2]))
    grip = (place, axis, force, np.array([0.1, 0.2, -0.1]), np.array([0.0, -6.0, -7.0]))
    found = []
    for numbers in (closed.numbers, given):
        at = ca.SX.sym("pose", 6)
        torques = joint_torques(len(numbers))(numbers, at, *grip)
        outputs = [torques, ca.jacobian(torques, at), ca.hessian(ca.dot(np.arange(1.0, 7.0), torques), at)[0]]
        found.append([np.array(each) for each in ca.Function("f", [at], outputs)(pose)])
    for one, two in zip(*found, strict=True):
        np.testing.assert_allclose(two, one, rtol=1e-5, atol=1e-4)


def test_the_map_of_reach_is_that_of_the_closed_form(robot: Robot) -> None:
    part = robot.limbs[1]
    place, turn = grippers(part, 4000, 2)
    poses = GripperPoses.of(place, turn, np.arctan2(turn[:, 1, 0], turn[:, 0, 0]))
    closed = ArmReach(part, keep_off=solids(robot, part, around=True))
    limb = numeric(robot).limbs[1]
    chained = ChainReach(limb, MARGIN_RAD, closed.clear_m, solids(robot, limb, around=True))
    one, two = closed.reaches(poses), chained.reaches(poses)
    assert 500 < one.sum() < 3500
    assert (two & ~one).mean() < 0.001  # the closed form also keeps off straight elbows
    assert (one & ~two).mean() < 0.002
    some = poses.where(np.flatnonzero(one & two)[:200])
    np.testing.assert_allclose(chained.angles(some), closed.angles(some), atol=1e-6)
    np.testing.assert_allclose(chained.links(some).end_m, closed.links(some).end_m, atol=1e-6)


def test_a_limb_out_of_reach_says_so(other: Robot, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    far = np.array([[1.0, 1.0, 0.0], [0.14, 0.15, -0.6]])
    assert not chain_inverse(other.limbs[0]).inverse(far, np.broadcast_to(np.eye(3), (2, 3, 3)))[1].any()


def test_walks_and_the_methods_of_the_paper_say_that_they_need_a_closed_form(other: Robot) -> None:
    for scene, method, said in (
        ("walk-flat", "auto", "robot: scaler"),
        ("climb-one-step", "two_block", "planner.method: "),
    ):
        text = (ROOT / "msgs/scenarios" / f"{scene}.yaml").read_text(encoding="utf-8")
        with pytest.raises(ScenarioError, match=f"{said}.*closed-form"):
            plan(parse_scenario(text), other, method=method)


def test_the_centre_of_mass_is_known_of_a_hand_that_is_always_turned(tmp_path: Path) -> None:
    """Its limits leave no upright gripper at yaw 0."""
    robot, turned = (load_robot(other_limbs("wrist offset", tmp_path / name)) for name in ("as-it-is", "turned"))
    urdf = turned.folder / "scaler.urdf"
    text = urdf.read_text(encoding="utf-8")
    start = text.index('<joint name="LF_joint6"')
    urdf.write_text(text[:start] + text[start:].replace('lower="-2.9"', 'lower="2.0"', 1), encoding="utf-8")
    problem = build_problem(load_scenario(ROOT / "msgs" / "scenarios" / "climb-four-holds.yaml"), robot)
    turned = load_robot(turned.folder)
    other = replace(problem, limb_masses=tuple(limb_masses(turned, limb) for limb in turned.limbs))
    (follow, rest), (of_other, rest_of_other) = (linear_centre(each) for each in (problem, other))
    np.testing.assert_allclose(of_other, follow, atol=0.1)
    np.testing.assert_allclose(rest_of_other, rest, atol=0.02)
