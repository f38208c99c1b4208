"""Equation (7): bounds of body states and finger forces; start, goal and the grippers' range of yaw are bounds too."""

from __future__ import annotations

import numpy as np

from crux_planner.model.arrays import Array
from crux_planner.model.contacts import Contact
from crux_planner.model.kinematics import rotation_from_rpy
from crux_planner.model.problem import Problem
from crux_planner.model.schedule import Schedule
from crux_planner.physics.speed_limits import speeds

LEAST_NORMAL_N = 1.0  # a finger in stance keeps touching
_SHARE = 0.999  # of speeds and tilt: space for the solver's tolerance


def body_bounds(problem: Problem, schedule: Schedule | None) -> tuple[Array, Array]:
    """Lower and upper bounds (N + 1, 12) of r, theta, dr/dt, omega; without a schedule, of any gripper yaws."""
    body, goal, n = problem.body, problem.goal, problem.steps
    speed, rate, tilt = _SHARE * body.max_speed_m_s, _SHARE * body.max_rate_rad_s, _SHARE * body.max_tilt_rad
    top = [np.inf, np.inf, body.height_m[1], tilt, tilt, np.inf, *[speed] * 3, *[rate] * 3]
    high = np.tile(top, (n + 1, 1))
    if schedule is not None and problem.speed_limits:
        high[:, 6:9] = speeds(problem.speed_limits, schedule.contacts, speed)[:, None]
    low = -high
    low[:, 2] = body.height_m[0]
    if schedule is not None:
        yaws = schedule.poses[..., 3]
        low[:, 5] = (yaws - problem.gripper_yaw_rad[1]).max(axis=1)
        high[:, 5] = (yaws - problem.gripper_yaw_rad[0]).min(axis=1)
    low[0] = high[0] = np.concatenate([problem.start.position_m, problem.start.rpy_rad, np.zeros(6)])
    pose = np.concatenate([goal.body.position_m, goal.body.rpy_rad])
    slack = np.array([goal.position_slack_m] * 3 + [goal.rotation_slack_rad] * 3)
    aim, near = np.clip(pose, low[-1, :6], high[-1, :6]), np.array([goal.aim_m] * 3 + [goal.aim_rad] * 3)
    low[-1] = np.concatenate([np.max([low[-1, :6], pose - slack, aim - near], axis=0), np.zeros(6)])
    high[-1] = np.concatenate([np.min([high[-1, :6], pose + slack, aim + near], axis=0), np.zeros(6)])
    return low, high


def reach_bounds(problem: Problem, schedule: Schedule) -> tuple[Array, Array]:
    """Lower and upper bounds (N, 4 m) of (9a) at knots 1..N: where each gripper is in the body's frame.

    A body that starts with a gripper outside its box, as one may in mid-climb, has until the first lift-off to bring it
    inside: limbs count as reaching that far until then.
    """
    middle, extent = problem.boxes.middle_m, problem.boxes.extent_m
    low, high = (np.tile((middle + sign * extent).ravel(), (problem.steps, 1)) for sign in (-1, 1))
    away = schedule.poses[0, :, :3] - problem.start.position_m
    begin = (away @ rotation_from_rpy(problem.start.rpy_rad) @ problem.boxes.directions.T).ravel()
    lift_off = next((k for k, knot in enumerate(schedule.contacts) if None in knot), problem.steps)
    low[: lift_off - 1], high[: lift_off - 1] = np.minimum(low[0], begin), np.maximum(high[0], begin)
    return low, high


def wrench_bounds(problem: Problem, contact: Contact) -> tuple[Array, Array]:
    """Bounds (5,) of (s1, s2, m, n1, n2) of a gripper that holds on to `contact`."""
    press, free = problem.friction_share * problem.patch.max_normal_N, np.full(3, np.inf)
    low, high = LEAST_NORMAL_N * contact.may_press, press * contact.may_press
    return np.concatenate([-free, low]), np.concatenate([free, high])
