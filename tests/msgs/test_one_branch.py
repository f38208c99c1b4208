"""Limits that keep a limb on one solution of its inverse kinematics, against the planner's Jacobian."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from crux_contracts.one_branch import BAND, on_one_branch
from crux_contracts.robot import load_robot
from crux_contracts.robot_types import Limb
from crux_planner.model.chain import forward
from other_counts import with_joints
from other_limbs import other_limbs

ELBOW = {4: 2, 5: 2, 7: 3}


def with_elbow(count: int, low: float, high: float, folder: Path) -> Limb:
    """The front left limb of so many joints, its elbow between these angles; straight at 0."""
    limb = load_robot(with_joints(count, folder)).limbs[0]
    joints = list(limb.joints)
    joints[ELBOW[count]] = replace(joints[ELBOW[count]], lower=low, upper=high)
    return on_one_branch(replace(limb, joints=tuple(joints), branch_rad=None))


@pytest.mark.parametrize("count", ELBOW)
def test_an_elbow_bends_to_one_side_of_straight(count: int, tmp_path: Path) -> None:
    elbow = ELBOW[count]
    limb = with_elbow(count, -0.4, 2.75, tmp_path)
    others = np.delete(np.arange(count), elbow)
    reach_m = np.sqrt(0.15**2 + 0.2**2 + 2 * 0.15 * 0.2 * np.cos(limb.lower_rad[elbow]))
    assert 0.35 - reach_m == pytest.approx(BAND, rel=0.05)
    assert limb.upper_rad[elbow] == 2.75
    assert limb.middle_rad[elbow] == pytest.approx((2.75 - 0.4) / 2)  # that of all programs
    assert limb.branch_rad is not None
    assert np.isinf(limb.branch_rad[:, others]).all()
    q = np.random.default_rng(2).uniform(limb.lower_rad, limb.upper_rad, (20, len(limb.lower_rad)))
    q[:, count:] = 0.0
    q[:, elbow] = 0.0
    least = np.linalg.svd(forward(limb.at_zero, q).jacobian()[..., :count], compute_uv=False)[:, -1]
    assert least.max() < 1e-7


def test_a_range_about_the_other_side_is_kept_there(tmp_path: Path) -> None:
    limb = with_elbow(4, -2.75, 0.4, tmp_path)
    assert limb.lower_rad[2] == -2.75
    assert -0.35 < limb.upper_rad[2] < -0.2


def test_where_nothing_would_be_left_nothing_is_taken(tmp_path: Path) -> None:
    limb = with_elbow(4, -0.1, 0.2, tmp_path)
    assert (limb.lower_rad[2], limb.upper_rad[2]) == (-0.1, 0.2)


def test_limbs_that_are_singular_nowhere_within_their_limits_keep_them(tmp_path: Path) -> None:
    for robot in (load_robot("scaler"), load_robot(other_limbs("all of them", tmp_path))):
        for limb in robot.limbs:
            assert limb.branch_rad is None or np.isinf(limb.branch_rad).all()
            assert [(joint.lower, joint.upper) for joint in limb.joints] == [
                (sense * low, sense * high) if sense > 0 else (sense * high, sense * low)
                for low, high, sense in zip(limb.lower_rad, limb.upper_rad, limb.senses, strict=False)
            ][: len(limb.joints)]


def test_a_wrist_with_axes_in_a_line_ends_no_reach(tmp_path: Path) -> None:
    """Joint 4 about the same axis as the last one where joint 5 is at 0: pitch, roll, pitch."""
    robot = load_robot(other_limbs("wrist offset", tmp_path))
    limb = robot.limbs[0]
    zero, axes = limb.at_zero, limb.at_zero.axes.copy()
    points = zero.points_m.copy()
    axes[5], points[4:] = axes[3], points[3]
    in_line = on_one_branch(replace(limb, at_zero=replace(zero, axes=axes, points_m=points), branch_rad=None))
    q = np.zeros((1, 6))
    q[:, 1:4] = 0.3, 0.9, 0.4
    assert np.linalg.svd(forward(in_line.at_zero, q).jacobian(), compute_uv=False)[0, -1] < 1e-7
    assert in_line.lower_rad[4] < 0 < in_line.upper_rad[4]
