"""The convex hulls of what limbs reach, which estimates of the cost are about."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from crux_contracts.robot import load_robot
from crux_contracts.scenario import parse_scenario
from crux_planner.model.build import build_problem
from crux_planner.pipeline.first_wall import FirstWall
from crux_planner.reach.arm import reaches_of
from crux_planner.search.pose_masks import hulls_of
from other_counts import with_joints


def test_limbs_that_reach_straight_ahead_alone_have_hulls(tmp_path: Path) -> None:
    """Of four joints, and of lengths that are no whole steps of the places looked at."""
    folder = with_joints(4, tmp_path)
    urdf = folder / "scaler.urdf"
    longer = urdf.read_text().replace('xyz="0.15 0 0"', 'xyz="0.1537 0 0"')
    assert longer != urdf.read_text()
    urdf.write_text(longer)
    robot = load_robot(folder)
    grippers = np.array([[x, y, -0.153, 0.0] for x in (0.3755, -0.3755) for y in (0.144, -0.144)])
    wall = FirstWall(robot, grippers, 0.12, 0.188, *np.zeros((3, 4)))
    problem = build_problem(parse_scenario(wall.document(0.0, 2.2), any_robot=True), robot)
    hulls = hulls_of(reaches_of(robot), problem, 0.0)
    assert (hulls.extent_m[:, 0] > 0.05).all()
    for limb, middle, extent in zip(robot.limbs, hulls.middle_m, hulls.extent_m, strict=True):
        assert (middle[1], extent[1]) == pytest.approx((limb.shoulder_b_m[1], 0.0), abs=1e-9)
