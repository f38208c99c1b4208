"""Where grippers can stand upright on the wall while the body stays where it is, by the checker's kinematics."""

from __future__ import annotations

import numpy as np
from crux_planner.checker.inverse_kinematics import solve
from crux_planner.checker.limb_model import WholeRobot

from crux_tools.telemetry.rotations import rotation_from_rpy

STEP_M = 0.03
FURTHEST_M = 0.6  # from the gripper where it is now, along the wall
EXACT_M, EXACT_RAD = 1e-3, 1e-2


def reach_on_wall(
    robot: WholeRobot, body_w_m: np.ndarray, rotation_wb: np.ndarray, grippers_w_m: np.ndarray, yaws_w_rad: np.ndarray
) -> list[np.ndarray]:
    """Of every limb the places (m, 3) of its gripper in W, STEP_M apart, that it reaches within its joints' limits, as
    high above the wall and at the yaw that it has now. Body position (3,) and rotation (3, 3), body to W; grippers'
    positions (4, 3) and yaws (4,).
    """
    steps = np.arange(-FURTHEST_M, FURTHEST_M + STEP_M / 2, STEP_M)
    x, y = np.meshgrid(steps, steps)
    x[1::2] = x[1::2, ::-1]  # to and fro: each place is near the one before, from whose posture it is found
    grid = np.stack([x.ravel(), y.ravel(), np.zeros(x.size)], axis=1)
    places = [position + grid for position in grippers_w_m]
    rotations = [rotation_wb.T @ rotation_from_rpy([0.0, 0.0, yaw]) for yaw in yaws_w_rad]
    solutions = solve(
        robot.limbs,
        [(place - body_w_m) @ rotation_wb for place in places],
        [np.broadcast_to(rotation, (len(grid), 3, 3)) for rotation in rotations],
    )
    found = []
    for limb, place, solution in zip(robot.limbs, places, solutions, strict=True):
        exact = (solution.position_error_m < EXACT_M) & (solution.rotation_error_rad < EXACT_RAD)
        within = ((solution.q_rad >= limb.lower_rad) & (solution.q_rad <= limb.upper_rad)).all(axis=1)
        found.append(place[exact & within])
    return found
