"""From a solved walk to the plan message, turned back from the heading frame to W (msgs/PLAN.md, point feet)."""

from __future__ import annotations

from typing import Any

import crux_msgs
import numpy as np
from crux_contracts.plan_file import plan_id
from crux_contracts.robot import Robot
from crux_contracts.scenario import Scenario

from crux_planner.model.gait import Gait
from crux_planner.model.kinematics import rotation_z
from crux_planner.model.walk_problem import WalkProblem
from crux_planner.pipeline.message import plan_header
from crux_planner.trajectory.solution import WalkSolution


def walk_message(
    scenario: Scenario, robot: Robot, problem: WalkProblem, gait: Gait, solution: WalkSolution, method: str = "auto"
) -> Any:
    """The plan, complete with its plan_id."""
    plan = plan_header(scenario, robot, solution.cost, method)
    plan.patch_k_m, plan.spine_shear_n, plan.spine_twist_nm = 0.0, 0.0, 0.0
    plan.max_normal_n = problem.max_normal_N
    to_w, heading = rotation_z(problem.heading_rad), problem.heading_rad
    xy, z = gait.blend @ solution.footholds, problem.step_height_m * gait.height
    feet = np.concatenate([xy, z[..., None]], axis=2) @ to_w.T
    yaws, stance = gait.yaw(float(problem.goal.body.rpy_rad[2])) + heading, gait.stance
    forces = np.concatenate([solution.forces, solution.forces[-1:]]) @ to_w.T  # the last knot repeats the one before
    for k, state in enumerate(solution.body):
        knot = crux_msgs.plan_knot_t()
        knot.time_s = k * problem.dt_s
        knot.body_position_w_m = list(to_w @ state[0:3])
        knot.body_rpy_rad = list(state[3:6] + np.array([0.0, 0.0, heading]))
        knot.body_velocity_w_m_s = list(to_w @ state[6:9])
        knot.body_angular_velocity_b_rad_s = list(state[9:12])
        for limb in range(4):
            foot = crux_msgs.limb_knot_t()
            standing = bool(stance[k, limb])
            foot.phase = foot.STANCE if standing else foot.AIR
            foot.hold = -1
            foot.finger1_face = foot.FACE_WALL if standing else foot.FACE_NONE
            foot.friction = problem.wall_friction if standing else 0.0
            foot.gripper_position_w_m = list(feet[k, limb])
            foot.gripper_yaw_w_rad = float(yaws[k, limb])
            foot.finger_separation_m = 2 * problem.opening_m
            foot.finger_force_w_n = [*(forces[k, limb] / 2)] * 2 if standing else [0.0] * 6
            foot.finger_moment_w_nm = [0.0] * 6
            knot.limbs[limb] = foot
        plan.knots.append(knot)
    plan.n_knots = len(plan.knots)
    plan.plan_id = plan_id(plan)
    return plan
