"""(7): the polytopes of body and gripper states, from the robot description."""

import numpy as np
from crux_contracts.robot import Robot

from crux_planner.checker import tolerances
from crux_planner.checker.geometry import rotation_about_z
from crux_planner.checker.plan_arrays import PlanArrays
from crux_planner.checker.report import Findings


def check_bounds(
    plan: PlanArrays, robot: Robot, point_model: bool, paced: bool, findings: Findings, *, endless: bool = True
) -> None:
    """Body speed and rate at the knots; opening, yaw against the body and mean speed of grippers over every interval;
    heights of body and grippers and the body's tilt, which count from the plane z = 0 of W, where the wall is
    `endless`.

    Speeds are bounded component by component: along, across and off the wall with respect to the heading of the first
    pose, so that turning a whole scene about W's z changes nothing; rates about the body's own axes. A plan that is
    `paced` has the robot's pace for its limits.
    """
    grasp, walking, pace = robot.grasp, robot.walking, robot.pace
    if point_model:
        body_speed, body_rate, yaw_range = walking.max_speed_m_s, walking.max_rate_rad_s, walking.foot_yaw_rad
        limb_speed, yaw_rate = walking.foot_speed_m_s, walking.foot_yaw_rate_rad_s
    elif paced:
        body_speed, body_rate, yaw_range = pace.body_speed_m_s, pace.body_rate_rad_s, grasp.gripper_yaw_rad
        limb_speed, yaw_rate = pace.swing_speed_m_s, pace.yaw_rate_rad_s
    else:
        body_speed, body_rate, yaw_range = robot.body.max_speed_m_s, robot.body.max_rate_rad_s, grasp.gripper_yaw_rad
        limb_speed, yaw_rate = grasp.approach_speed_m_s, grasp.yaw_rate_rad_s
    times, between = plan.time_s, plan.time_s[:-1]
    if endless:
        low, high = robot.body.height_m
        height = plan.body_position[:, 2]
        findings.add_series("body_height", np.maximum(low - height, height - high), times, "m")
        tilt = np.abs(plan.body_rpy[:, :2]).max(axis=1)
        findings.add_series("body_tilt", tilt - robot.body.max_tilt_rad, times, "rad")
    heading = rotation_about_z(plan.body_rpy[0, 2])
    speed = np.abs(plan.body_velocity @ heading).max(axis=1)
    findings.add_series("body_speed", speed - body_speed, times, "m/s")
    rate = np.abs(plan.body_rate).max(axis=1)
    findings.add_series("body_rate", rate - body_rate, times, "rad/s")
    above = plan.max_normal_N - robot.gripper.max_finger_force_N
    findings.add("normal_force_bound", above, "N", tolerance=tolerances.MATCH_REL, detail="above the gripper's")

    for limb in range(4):
        opening = 0.5 * plan.separation[:, limb]
        low, high = robot.gripper.opening_m
        applies = ~plan.on_wall[:, limb]  # of feet among grips, too
        beyond = np.where(applies, np.maximum(low - opening, opening - high), -np.inf)
        findings.add_series("finger_opening", beyond, times, "m", limb=limb)
        yaw = (plan.gripper_yaw[:, limb] - plan.body_rpy[:, 2] + np.pi) % (2.0 * np.pi) - np.pi
        low, high = yaw_range
        findings.add_series("gripper_yaw", np.maximum(low - yaw, yaw - high), times, "rad", limb=limb)
        if endless:
            height = plan.gripper_position[:, limb, 2] - grasp.max_swing_height_m
            findings.add_series("swing_height", height, times, "m", limb=limb)
        mean_speed = np.linalg.norm(np.diff(plan.gripper_position[:, limb], axis=0), axis=1) / plan.step_s
        findings.add_series("swing_speed", mean_speed - limb_speed, between, "m/s", limb=limb)
        tilting = np.linalg.norm(np.diff(plan.gripper_tilt[:, limb], axis=0), axis=1)
        mean_rate = (np.abs(np.diff(plan.gripper_yaw[:, limb])) + tilting) / plan.step_s
        findings.add_series("swing_yaw_rate", mean_rate - yaw_rate, between, "rad/s", limb=limb)
