"""The compiled map says what the one in numpy says, for every layout of arrays."""

from __future__ import annotations

import numpy as np
import pytest
from crux_contracts.robot import Robot
from crux_planner.reach import native
from crux_planner.reach.arm import ArmReach, reaches_of
from crux_planner.reach.body_grid import BodyGrid
from crux_planner.reach.poses import GripperPoses


def closed(robot: Robot) -> list[ArmReach]:
    return [reach for reach in reaches_of(robot) if isinstance(reach, ArmReach)]


@pytest.mark.parametrize("limb", range(4))
def test_random_poses(robot: Robot, limb: int) -> None:
    random, reach = np.random.default_rng(limb), closed(robot)[limb]
    assert native.library() is not None
    place = robot.limbs[limb].shoulder_b_m + random.uniform(-0.4, 0.4, (20_000, 3))
    angles = random.uniform(-1.0, 1.0, (3, len(place))) * np.array([[3.0], [0.4], [0.4]])
    poses = GripperPoses(*place.T, *angles)  # places lie across, angles along
    found = reach.reaches(poses)
    assert 0.05 < found.mean() < 0.95
    np.testing.assert_array_equal(found, reach.reaches_by_numpy(poses))
    backwards = GripperPoses(*(each[::-1] for each in poses.arrays))
    np.testing.assert_array_equal(reach.reaches(backwards), found[::-1])


def test_grids_and_single_poses(robot: Robot) -> None:
    steps = np.arange(-0.5, 0.5, 0.013)
    grid = BodyGrid(steps[::15], np.array([-0.1, 0.1]), np.zeros(1), np.array([0.17, 0.2]), steps, steps[:-7])
    gripper = np.array([0.05, -0.1, 0.04, 0.3])
    for reach in closed(robot):
        poses = grid.seen(gripper)
        found = reach.reaches(poses)
        assert found.any()
        np.testing.assert_array_equal(found, np.broadcast_to(reach.reaches_by_numpy(poses), grid.shape))
        place, rpy = grid.pose(np.argwhere(found)[0])
        one = BodyGrid(*(np.array([each]) for each in (rpy[2], rpy[0], rpy[1], place[2], place[0], place[1])))
        single = GripperPoses(*(each.reshape(()) for each in one.seen(gripper).arrays))
        assert reach.reaches(single).shape == ()
        assert reach.reaches(single)


def test_of_poses_that_are_all_too_far_none_is_looked_at_further(robot: Robot) -> None:
    far = GripperPoses(*np.full((6, 5), 9.0))
    for reach in closed(robot):
        assert not reach.reaches(far).any()
        assert not reach.reaches_by_numpy(far).any()


def test_links_are_where_numpy_has_them(robot: Robot) -> None:
    random = np.random.default_rng(5)
    angles = random.uniform(-1.0, 1.0, (3, 300)) * np.array([[3.0], [0.4], [0.4]])
    for reach in closed(robot):
        place = reach.limb.shoulder_b_m + random.uniform(-0.4, 0.4, (300, 3))  # out of reach, too
        poses = GripperPoses(*place.T, *angles)
        found, expected = reach.links(poses), reach.links_by_numpy(poses)
        assert found.start_m.shape == (300, len(reach.keep_off.links) + len(reach.keep_off.first), 3)
        for one, other in ((found.start_m, expected.start_m), (found.end_m, expected.end_m)):
            np.testing.assert_allclose(one, other, atol=1e-12)
        one_pose = GripperPoses(*(each[7] for each in poses.arrays))
        np.testing.assert_array_equal(reach.links(one_pose).start_m, found.start_m[7])
