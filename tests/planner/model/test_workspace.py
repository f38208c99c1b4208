"""Acceptance boxes hold what they promise, and are about as large as the limb allows."""

from __future__ import annotations

import numpy as np
import pytest
from crux_contracts.robot import Robot
from crux_planner.model.kinematics import inverse, limit_margin, rotation_from_rpy, rotation_z
from crux_planner.model.workspace import WorkspaceError, WorkspaceRange, acceptance_boxes, largest_rectangle
from hypothesis import given
from hypothesis import strategies as st


@pytest.fixture(scope="module")
def wanted(robot: Robot) -> WorkspaceRange:
    grasp = robot.grasp
    return WorkspaceRange(
        robot.body.height_m,
        grasp.pad_height_m,
        0.086,
        grasp.max_swing_height_m,
        robot.body.max_tilt_rad,
        grasp.gripper_yaw_rad,
    )


def test_boxes_stand_where_the_physics_study_found_the_workspace(robot: Robot, wanted: WorkspaceRange) -> None:
    boxes = acceptance_boxes(robot.limbs, wanted)
    np.testing.assert_allclose(np.abs(boxes.centre_b_m[:, :2]), np.tile([0.14, 0.36], (4, 1)), atol=0.02)
    np.testing.assert_allclose(boxes.centre_b_m[:, 2], -0.13, atol=0.01)
    assert (boxes.half_m >= [0.13, 0.07, 0.05]).all()
    assert [tuple(np.sign(c[:2])) for c in boxes.centre_b_m] == [(1, 1), (1, -1), (-1, 1), (-1, -1)]


def test_every_pose_in_a_box_has_inverse_kinematics(robot: Robot, wanted: WorkspaceRange) -> None:
    boxes, random = acceptance_boxes(robot.limbs, wanted), np.random.default_rng(0)
    for limb, centre in zip(robot.limbs, boxes.centre_b_m, strict=True):
        n = 4000
        positions = centre + random.uniform(-1, 1, (n, 3)) * boxes.half_m
        tilts = np.column_stack([random.uniform(-1, 1, (n, 2)) * wanted.max_tilt_rad, np.zeros(n)])
        yaw = rotation_z(random.uniform(*wanted.gripper_yaw_rad, n))
        q, reached = inverse(limb, positions, np.swapaxes(rotation_from_rpy(tilts), -1, -2) @ yaw)
        assert reached.all()
        assert limit_margin(limb, q).min() > 0.0


def test_a_range_no_limb_can_serve_is_an_error(robot: Robot, wanted: WorkspaceRange) -> None:
    high = WorkspaceRange((0.6, 0.7), *list(vars(wanted).values())[1:])
    with pytest.raises(WorkspaceError, match="no acceptance box"):
        acceptance_boxes(robot.limbs, high)


@given(st.integers(2, 7), st.integers(2, 7), st.integers(0, 2**32 - 1))
def test_largest_rectangle_is_what_trying_all_finds(rows: int, columns: int, seed: int) -> None:
    mask = np.random.default_rng(seed).random((rows, columns)) < 0.8
    area, (i0, i1, j0, j1) = largest_rectangle(mask)
    best = max(
        (
            (b - a) * (d - c)
            for a in range(rows)
            for b in range(a + 1, rows)
            for c in range(columns)
            for d in range(c + 1, columns)
            if mask[a : b + 1, c : d + 1].all()
        ),
        default=0,
    )
    assert area == best
    if best:
        assert mask[i0 : i1 + 1, j0 : j1 + 1].all()
        assert (i1 - i0) * (j1 - j0) == best
