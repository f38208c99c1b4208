"""Masks of body poses against inverse kinematics pose by pose, and what is made of them."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from crux_contracts.robot import Robot
from crux_planner.model.kinematics import inverse, limit_margin, rotation_from_rpy, rotation_z
from crux_planner.reach.arm import LEAST_RADIUS_M, MARGIN_RAD, ArmReach, reaches_of
from crux_planner.reach.body_grid import BodyGrid, parts, stance
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy import ndimage


@pytest.fixture(scope="module")
def grid() -> BodyGrid:
    """Of tilted bodies at two heights."""
    steps = np.arange(-0.6, 0.61, 0.05)
    return BodyGrid(
        yaw_rad=np.array([-0.4, -0.1, 0.2]),
        roll_rad=np.array([-0.1, 0.05]),
        pitch_rad=np.array([0.0, 0.15]),
        z_m=np.array([0.17, 0.2]),
        x_m=steps,
        y_m=steps + 0.01,
    )


@pytest.mark.parametrize("limb", range(4))
def test_masks_are_what_inverse_kinematics_allows(robot: Robot, grid: BodyGrid, limb: int) -> None:
    part, gripper = robot.limbs[limb], np.array([0.05, -0.02, 0.035, 0.3])
    mask = grid.held(ArmReach(part), gripper)
    assert mask.shape == grid.shape
    assert 0.02 < mask.mean() < 0.9
    cells = list(itertools.product(*(range(n) for n in grid.shape)))[:: 7 + limb]
    body, rpy = (np.array(each) for each in zip(*(grid.pose(cell) for cell in cells), strict=True))
    back = np.swapaxes(rotation_from_rpy(rpy), -1, -2)
    place = (back @ (gripper[:3] - body)[..., None])[..., 0]
    hand = back @ rotation_z(gripper[3])
    q, reached = inverse(part, place, hand)
    wrist = place + part.wrist_to_gripper_m * hand[..., 2] - part.shoulder_b_m
    # yaw less azimuth of the limb seen along W's z: joint 6 without whole turns taken off
    side = np.stack([-np.sin(q[:, 0] + part.mount_rad), np.cos(q[:, 0] + part.mount_rad), np.zeros(len(q))], axis=-1)
    level = (rotation_z(-rpy[:, 2]) @ np.swapaxes(back, -1, -2) @ side[..., None])[..., 0]
    lean = np.arctan2(-level[:, 0], level[:, 1]) - q[:, 0] - part.mount_rad
    lean = (lean + np.pi) % (2 * np.pi) - np.pi
    last = gripper[3] - rpy[:, 2] - q[:, 0] - part.mount_rad - lean - part.gripper_mount_rad
    expected = reached & (limit_margin(part, q) >= MARGIN_RAD) & (np.abs(last - q[:, 5]) < 1.0)
    expected &= np.hypot(wrist[:, 0], wrist[:, 1]) >= LEAST_RADIUS_M
    np.testing.assert_array_equal(mask[tuple(np.array(cells).T)], expected)


@pytest.mark.parametrize("hand", [[0.05, -0.02, 0.035, 0.3], [0.05, -0.02, 0.035, 0.3, 0.2, -0.1]])
def test_some_cells_see_a_gripper_as_all_do(grid: BodyGrid, hand: list[float]) -> None:
    cells, gripper = np.arange(3, np.prod(grid.shape), 97), np.array(hand)
    for one, other in zip(grid.seen(gripper, cells).arrays, grid.seen(gripper).arrays, strict=True):
        np.testing.assert_array_equal(one, np.broadcast_to(other, grid.shape).reshape(-1)[cells])


@given(st.integers(0, 2**32 - 1))
@settings(max_examples=20)
def test_boxes_have_the_poses_of_their_cells(grid: BodyGrid, seed: int) -> None:
    """And no pose of a cell is far from the edge of its box: boxes are not just large."""
    random = np.random.default_rng(seed)
    gripper = np.array([*random.uniform(-0.5, 0.5, 2), random.uniform(0.0, 0.1), random.uniform(-1.5, 1.5)])
    slack = random.uniform(0.0, 0.05, 4) * (seed % 2)
    low, high = grid.boxes(gripper, slack)
    cell = tuple(int(random.integers(n)) for n in grid.shape)
    half = [(axis[1] - axis[0]) / 2 for axis in grid.axes]
    middle = [axis[i] for axis, i in zip(grid.axes, cell, strict=True)]
    corners = [[m - h, m + h] for m, h in zip(middle, half, strict=True)]
    inside = BodyGrid(*(np.append(c, random.uniform(*c)) for c in corners))
    offs = [slack * off for off in itertools.product((-1.0, 1.0), repeat=4)]
    seen = [np.broadcast_arrays(*inside.seen(gripper + off).arrays) for off in offs]
    for index, (least, most) in enumerate(zip(low.arrays, high.arrays, strict=True)):
        ends = [float(np.broadcast_to(each, grid.shape)[cell]) for each in (least, most)]
        found = np.array([arrays[index] for arrays in seen])
        assert ends[0] - 1e-12 <= found.min()
        assert found.max() <= ends[1] + 1e-12
        assert ends[1] - ends[0] <= 1.5 * np.ptp(found) + 1e-12


def test_what_is_held_is_nowhere_ruled_out(robot: Robot, grid: BodyGrid) -> None:
    for limb, gripper in enumerate(np.random.default_rng(0).uniform(-0.1, 0.1, (4, 4))):
        reach = reaches_of(robot)[limb]
        held, ruled_out = grid.held(reach, gripper), grid.ruled_out(reach, gripper)
        assert not (held & ruled_out).any()
        assert ruled_out.mean() > 0.1


def test_what_is_lifted_is_held_on_the_whole_way(robot: Robot, grid: BodyGrid) -> None:
    reach, gripper = reaches_of(robot)[1], np.array([0.0, 0.0, 0.03, 0.2])
    lifted = grid.lifted(reach, gripper, 0.1)
    held = grid.held(reach, gripper)
    assert 0 < lifted.sum() < held.sum()
    for rise in np.linspace(0.0, 0.1, 11):
        on_the_way = grid.held(reach, gripper + np.array([0.0, 0.0, rise, 0.0]))
        assert not (lifted & ~on_the_way).any()


def test_a_stance_is_an_intersection_and_falls_into_connected_parts() -> None:
    """One cell joins two parts; cells that touch at a corner are not connected."""
    mask = np.zeros((1, 1, 1, 1, 4, 5), dtype=bool)
    mask[..., :, :2] = mask[..., :, 3:] = True
    other = np.ones_like(mask)
    other[..., 0, 0] = False
    both = stance([mask, other])
    np.testing.assert_array_equal(both, mask & other)
    labels, count = parts(both)
    assert count == 2
    assert (labels > 0).tolist() == both.tolist()
    both[..., 3, 2] = True
    assert parts(both)[1] == 1
    corner = np.zeros((1, 1, 1, 1, 2, 2), dtype=bool)
    corner[..., 0, 0] = corner[..., 1, 1] = True
    assert parts(corner)[1] == 2


@pytest.mark.parametrize("seed", range(20))
def test_parts_are_those_of_an_image_labelled_in_their_order(seed: int) -> None:
    random = np.random.default_rng(seed)
    mask = random.random(tuple(random.integers(1, [4, 3, 3, 6, 9, 9]).tolist())) < random.random()
    labels, count = ndimage.label(mask)
    numbers, found = parts(mask)
    assert found == count
    np.testing.assert_array_equal(numbers, labels)
