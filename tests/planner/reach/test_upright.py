"""Where limbs have their grippers upright, against the checker's inverse kinematics, which is another one."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from crux_contracts.robot import load_robot
from crux_planner.checker import geometry
from crux_planner.checker.inverse_kinematics import solve
from crux_planner.checker.limb_model import Limb, load_model
from crux_planner.reach.upright import STEP_M, upright_reach
from other_counts import with_joints

YAWS = 25
EXACT = 1e-6


@pytest.mark.parametrize("joints", [4, 6])
def test_cells_are_those_where_the_checker_has_the_limb(joints: int, tmp_path: Path) -> None:
    """Of a plane of cells: none is held that the checker does not reach, few that it reaches with more than the map's
    margin are not held.
    """
    robot = load_robot("scaler" if joints == 6 else with_joints(joints, tmp_path))
    limb = load_model(robot).limbs[0]
    reach = upright_reach(robot, 0)
    height = int(np.round((-0.15 - reach.first_m[2]) / STEP_M))
    held = reach.held[::2, ::2, height].ravel()
    grid = np.stack(np.meshgrid(*(np.arange(0, n, 2) for n in reach.held.shape[:2]), [height], indexing="ij"), axis=-1)
    places = reach.first_m + STEP_M * grid.reshape(-1, 3)
    margin = np.full(len(places), -np.inf)
    low, high = robot.grasp.gripper_yaw_rad
    for yaw in np.linspace(low, high, YAWS):
        ways = np.full(len(places), yaw)
        if joints == 4:  # the one yaw that yaw, pitch, pitch, pitch make
            off = places - limb.forward(np.zeros((1, joints))).joint_origin_m[0, 0]
            ways = np.arctan2(off[:, 1], off[:, 0]) + yaw_at_zero(limb)
            ways = np.arctan2(np.sin(ways), np.cos(ways))
        (found,) = solve([limb], [places], [geometry.rotation_about_z(ways)])
        inside = np.minimum(found.q_rad - limb.lower_rad, limb.upper_rad - found.q_rad).min(axis=1)
        good = (found.position_error_m < EXACT) & (found.rotation_error_rad < EXACT) & (ways >= low) & (ways <= high)
        margin = np.maximum(margin, np.where(good, inside, -np.inf))
    assert held.any()
    assert (margin[held] > 0).all()
    outside = np.abs(places[:, 1]) > 0.25  # of the trunk, which the map keeps off
    missed = (margin > 0.1) & ~held & outside
    assert missed.sum() < 0.02 * (held & outside).sum()


def yaw_at_zero(limb: Limb) -> float:
    """Of the gripper against the limb's own plane: the stretched limb is its x axis, turned by the mount."""
    state = limb.forward(np.zeros((1, 4)))
    turn = state.link_rotation[limb.gripper][0]
    way = state.link_position_m[limb.gripper][0] - state.joint_origin_m[0, 0]
    return float(np.arctan2(turn[1, 0], turn[0, 0]) - np.arctan2(way[1], way[0]))
