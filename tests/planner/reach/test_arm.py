"""The closed-form map of a limb's reach against Pinocchio and Coal: no false "reaches", no false "cannot"."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from crux_contracts.robot import Robot
from crux_planner.model.kinematics import limit_margin, rotation_from_rpy, rotation_z
from crux_planner.reach.arm import CLEAR_M, LEAST_RADIUS_M, MARGIN_RAD, ArmReach, reaches_of
from crux_planner.reach.poses import GripperPoses
from hypothesis import given, settings
from hypothesis import strategies as st

from .pinocchio_limb import PinocchioLimb, drawn

TILT_RAD = 0.3
PALM_MORE_M = 0.017  # of the capsule around a palm than of the palm, at most: across its corners
EXTENT = np.array([0.1, 0.1, 0.1, 0.3, 0.3, 0.3])[:, None]  # of the largest boxes to either side [m, rad]
limbs = pytest.mark.parametrize("limb", range(4))


def random_poses(robot: Robot, limb: int, random: np.random.Generator, count: int) -> GripperPoses:
    """About a limb's shoulder, for all yaws and tilts."""
    place = robot.limbs[limb].shoulder_b_m + random.uniform(-0.4, 0.4, (count, 3))
    yaw, roll, pitch = random.uniform(-1.0, 1.0, (3, count)) * np.array([[3.0], [TILT_RAD], [TILT_RAD]])
    return GripperPoses(place[:, 0], place[:, 1], place[:, 2], yaw, roll, pitch)


def around(poses: GripperPoses) -> tuple[GripperPoses, GripperPoses]:
    """Small boxes."""
    low, high = (GripperPoses(*(each + by for each in poses.arrays)) for by in (-0.002, 0.002))
    return low, high


@limbs
def test_what_is_reached_pinocchio_reaches_within_limits_off_the_trunk(robot: Robot, limb: int) -> None:
    other, reach = PinocchioLimb(robot, limb), reaches_of(robot)[limb]
    poses = random_poses(robot, limb, np.random.default_rng(limb), 10_000)
    poses = poses.where(np.flatnonzero(reach.reaches(poses)))
    assert len(poses.x_m) > 800
    q, (places, rotations) = reach.angles(poses), poses.in_body()
    assert limit_margin(robot.limbs[limb], q).min() >= MARGIN_RAD - 1e-9
    for angles, place, rotation in zip(q, places, rotations, strict=True):
        found = other.pose(angles)
        assert max(np.abs(found[0] - place).max(), np.abs(found[1] - rotation).max()) < 1e-9
        assert other.off_trunk_m(angles) >= CLEAR_M - 1e-6


@limbs
def test_what_pinocchio_reaches_with_more_margin_is_reached(robot: Robot, limb: int) -> None:
    other, reach = PinocchioLimb(robot, limb), reaches_of(robot)[limb]
    q, poses = drawn(other, np.random.default_rng(limb), 1000, MARGIN_RAD + 1e-6, TILT_RAD)
    shoulder = robot.limbs[limb].shoulder_b_m
    ahead = np.array([other.wrist(angles)[0] - shoulder for angles in q])
    first = q[:, 0] + robot.limbs[limb].mount_rad
    some = np.cos(first) * ahead[:, 0] + np.sin(first) * ahead[:, 1] >= LEAST_RADIUS_M + 1e-6
    assert some.mean() > 0.5
    np.testing.assert_allclose(reach.angles(poses)[some], q[some], atol=1e-6)
    assert ArmReach(robot.limbs[limb]).reaches(poses)[some].all()
    gaps = np.array([other.off_trunk_m(angles) for angles in q])
    assert (gaps < 0.0).any()
    found = reach.reaches(poses)
    assert found[some & (gaps >= CLEAR_M + PALM_MORE_M)].all()
    assert not found[gaps < CLEAR_M - 1e-6].any()


@limbs
def test_no_box_is_ruled_out_that_pinocchio_has_a_pose_in(robot: Robot, limb: int) -> None:
    """Unless a link of that pose is in the trunk."""
    other, reach, random = PinocchioLimb(robot, limb), reaches_of(robot)[limb], np.random.default_rng(limb)
    q, poses = drawn(other, random, 1500, 0.0, TILT_RAD)
    proven = 0
    for size in (0.0, 0.01, 0.1, 1.0):
        below, above = size * EXTENT * random.random((2, 6, len(q)))
        low = GripperPoses(*(each - by for each, by in zip(poses.arrays, below, strict=True)))
        high = GripperPoses(*(each + by for each, by in zip(poses.arrays, above, strict=True)))
        ruled_out = np.flatnonzero(reach.cannot(low, high))
        proven += len(ruled_out)
        assert all(other.off_trunk_m(q[i]) < 1e-6 for i in ruled_out)
    assert proven > 0


@pytest.mark.parametrize("joint", range(6))
def test_small_boxes_beyond_a_limit_are_ruled_out(robot: Robot, joint: int) -> None:
    """Of a limb that has half of one joint's range, with that joint 0.1 rad beyond it and the others within theirs."""
    other, part, joints = PinocchioLimb(robot, 0), robot.limbs[0], list(robot.limbs[0].joints)
    q, poses = drawn(other, np.random.default_rng(joint), 1000, 0.0, TILT_RAD)
    most = float(np.median(q[:, joint]))
    joints[joint] = replace(joints[joint], upper=most)
    some = np.flatnonzero(q[:, joint] > most + 0.1)
    assert len(some) > 100
    low, high = around(poses.where(some))
    assert ArmReach(replace(part, joints=tuple(joints))).cannot(low, high).mean() > 0.9
    assert not ArmReach(part).cannot(low, high).any()


def test_small_boxes_with_a_link_in_the_trunk_are_ruled_out(robot: Robot) -> None:
    """The joints allow them: without a trunk they are not ruled out."""
    other, reach = PinocchioLimb(robot, 0), reaches_of(robot)[0]
    q, poses = drawn(other, np.random.default_rng(0), 1500, 0.0, TILT_RAD)
    some = np.flatnonzero([other.off_trunk_m(angles, links=2) < -0.005 for angles in q])
    assert len(some) > 20
    low, high = around(poses.where(some))
    assert reach.cannot(low, high).mean() > 0.9
    assert not ArmReach(robot.limbs[0]).cannot(low, high).any()


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=20)
def test_mirrored_limbs_reach_mirrored_places_whatever_the_tilt(robot: Robot, seed: int) -> None:
    """Left to right and front to back: roll and yaw change signs, or pitch and yaw."""
    poses = random_poses(robot, 0, np.random.default_rng(seed), 500)
    x, y, z, yaw, roll, pitch = poses.arrays
    reaches = reaches_of(robot)
    found = reaches[0].reaches(poses)
    np.testing.assert_array_equal(reaches[1].reaches(GripperPoses(x, -y, z, -yaw, -roll, pitch)), found)
    np.testing.assert_array_equal(reaches[2].reaches(GripperPoses(-x, y, z, -yaw, roll, -pitch)), found)


@given(st.integers(0, 2**32 - 1), st.floats(0.0, 0.1))
@settings(max_examples=20)
def test_what_is_reached_is_in_no_box_that_is_ruled_out(robot: Robot, seed: int, size: float) -> None:
    random = np.random.default_rng(seed)
    poses = random_poses(robot, seed % 4, random, 300)
    reach = reaches_of(robot)[seed % 4]
    low = GripperPoses(*(each - size * random.random(300) for each in poses.arrays))
    high = GripperPoses(*(each + size * random.random(300) for each in poses.arrays))
    assert not (reach.reaches(poses) & reach.cannot(low, high)).any()


@limbs
def test_links_are_where_pinocchio_has_them(robot: Robot, limb: int) -> None:
    """The palm aside, which is a box there, of 14 cm: its capsule holds it."""
    other, reach = PinocchioLimb(robot, limb), reaches_of(robot)[limb]
    q, poses = drawn(other, np.random.default_rng(limb), 40, MARGIN_RAD, TILT_RAD)
    links = reach.links(poses)
    (palm,) = np.flatnonzero(np.isclose(np.linalg.norm(links.end_m - links.start_m, axis=2)[0], 0.14))
    some = np.flatnonzero(np.abs(reach.angles(poses) - q).max(axis=1) < 1e-6)
    assert len(some) > 10
    for i in some:
        found = zip(np.delete(links.start_m[i], palm, 0), np.delete(links.end_m[i], palm, 0), strict=True)
        for ends, radius, (start, end, thick) in zip(
            found, np.delete(links.radius_m, palm), other.links_m(q[i]), strict=True
        ):
            assert radius == pytest.approx(thick)
            either = [np.abs(np.array(ends) - each).max() for each in ([start, end], [end, start])]
            assert min(either) < 1e-9


@limbs
def test_grippers_of_any_rotation(robot: Robot, limb: int) -> None:
    """At angles drawn at random, which are not the only ones for some poses."""
    other, random, part = PinocchioLimb(robot, limb), np.random.default_rng(limb), robot.limbs[limb]
    q = random.uniform(part.lower_rad, part.upper_rad, (500, 6))
    placed = [other.pose(angles) for angles in q]
    place, rotation = (np.array(each) for each in zip(*placed, strict=True))
    poses = GripperPoses.of(place, rotation)
    back = poses.in_body()
    np.testing.assert_allclose(back[0], place, atol=1e-12)
    np.testing.assert_allclose(back[1], rotation, atol=1e-12)
    reach = ArmReach(part, margin_rad=0.0)
    found = np.flatnonzero(reach.reaches(poses))
    assert len(found) > 300
    for i, angles in zip(found, reach.angles(poses)[found], strict=True):
        again = other.pose(angles)
        assert max(np.abs(again[0] - place[i]).max(), np.abs(again[1] - rotation[i]).max()) < 1e-9
    assert not reach.cannot(poses, poses).any()


@limbs
def test_a_gripper_does_not_turn_over_where_a_body_tilts_by_more_than_a_right_angle(robot: Robot, limb: int) -> None:
    """From one tilt to the next joint 6 turns little; Pinocchio has the gripper there, where joints are in range."""
    other, reach = PinocchioLimb(robot, limb), ArmReach(robot.limbs[limb], margin_rad=0.0)
    pitch, upright = np.radians(np.arange(-130.0, 131.0, 2.0)), np.zeros(131)
    rotation = rotation_from_rpy(np.column_stack([upright, pitch, upright]))
    place = robot.limbs[limb].shoulder_b_m + 0.26 * rotation_z(robot.limbs[limb].mount_rad)[:, 0] - [0.0, 0.0, 0.02]
    poses = GripperPoses.of(np.tile(place, (131, 1)), rotation)
    assert poses.yaw_rad == pytest.approx(0.0, abs=1e-9)
    q = reach.angles(poses)
    assert np.abs(np.diff(q[:, 5])).max() < np.radians(10.0)
    over = np.flatnonzero(reach.reaches(poses) & (np.abs(pitch) > np.radians(95.0)))
    assert len(over)
    for angles, turn in zip(q[over], rotation[over], strict=True):
        found = other.pose(angles)
        assert max(np.abs(found[0] - place).max(), np.abs(found[1] - turn).max()) < 1e-9


def test_a_whole_turn_of_the_gripper_is_another_pose(robot: Robot) -> None:
    """Modulo whole turns joint 6 would have an angle within its limits for all three."""
    reach, level = reaches_of(robot)[0], np.zeros(3)
    yaw = np.array([-2 * np.pi, 0.0, 2 * np.pi])
    poses = GripperPoses(level + 0.14, level + 0.36, level - 0.13, yaw, level, level)
    assert reach.reaches(poses).tolist() == [False, True, False]


def test_limbs_whose_angles_are_ambiguous_are_refused(robot: Robot) -> None:
    limb = robot.limbs[0]
    for joint, text in ((0, "joint 1"), (2, "joint 3"), (4, "joint 5")):
        joints = list(limb.joints)
        joints[joint] = replace(joints[joint], lower=-3.0, upper=3.0)
        with pytest.raises(ValueError, match=f"LF: {text} turns -3..3 rad"):
            ArmReach(replace(limb, joints=tuple(joints)))
