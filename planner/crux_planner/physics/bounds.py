"""Equation (7): bounds of body states, wrenches and footholds; start, goal and ranges of yaw are bounds too."""

import numpy as np

from crux_planner.model.arrays import Array
from crux_planner.model.contacts import Contact
from crux_planner.model.gait import Gait, Step, longest_step
from crux_planner.model.kinematics import rotation_from_rpy
from crux_planner.model.problem import CentroidalProblem, Problem
from crux_planner.model.schedule import Schedule
from crux_planner.model.walk_problem import FINAL_FOOT_M, WalkProblem
from crux_planner.physics.speed_limits import speeds
from crux_planner.solvers.sparse_blocks import Rows

LEAST_NORMAL_N = 1.0  # a finger in stance keeps touching
FEET_APART_M = 0.16  # along the body, of a front foot from the rear one of its side: palms and fingers keep clear
_CORNERS = 8  # of the polygon that bounds a step
_SHARE = 0.999  # of speeds and tilt: space for the solver's tolerance
_GOAL_SHARE = 0.3  # of what the goal allows that the last pose of a walk may use up: the rest is the robot's


def body_bounds(problem: Problem, schedule: Schedule | None, tilt_rad: float | None = None) -> tuple[Array, Array]:
    """Lower and upper bounds (N + 1, 12) of r, theta, dr/dt, omega; without a schedule, of any gripper yaws. The body
    tilts as far as its reach in `boxes` holds, or so far.
    """
    yaws, limits = (None, {}) if schedule is None else (schedule.poses[..., 3], problem.speed_limits)
    near = np.array([problem.goal.aim_m] * 3 + [problem.goal.aim_rad] * 3)
    tilt_rad = problem.boxes.max_tilt_rad if tilt_rad is None else tilt_rad
    low, high = _state_bounds(problem, yaws, problem.gripper_yaw_rad, near, tilt_rad)
    if schedule is not None and limits:
        slow = speeds(limits, schedule.contacts, _SHARE * problem.body.max_speed_m_s)[1:-1, None]
        low[1:-1, 6:9], high[1:-1, 6:9] = -slow, slow
    return low, high


def walk_bounds(problem: WalkProblem, gait: Gait | None) -> tuple[Array, Array]:
    """The same of a walk; without a gait, of any."""
    yaws = None if gait is None else gait.yaw(float(problem.goal.body.rpy_rad[2]))
    near = _GOAL_SHARE * _goal_slack(problem)
    return _state_bounds(problem, yaws, problem.foot_yaw_rad, near, problem.boxes.max_tilt_rad)


def _goal_slack(problem: CentroidalProblem) -> Array:
    return np.array([problem.goal.position_slack_m] * 3 + [problem.goal.rotation_slack_rad] * 3)


def _state_bounds(
    problem: CentroidalProblem, yaws: Array | None, relative: tuple[float, float], near: Array, tilt_rad: float
) -> tuple[Array, Array]:
    """For limbs at `yaws` (N + 1, 4), each within a range of the body's, and a last pose `near` (6,) the goal."""
    body, n = problem.body, problem.steps
    speed, rate, tilt = _SHARE * body.max_speed_m_s, _SHARE * body.max_rate_rad_s, _SHARE * tilt_rad
    high = np.tile([np.inf, np.inf, body.height_m[1], tilt, tilt, np.inf, *[speed] * 3, *[rate] * 3], (n + 1, 1))
    low = -high
    low[:, 2] = body.height_m[0]
    if yaws is not None:
        low[:, 5], high[:, 5] = yaws.max(axis=1) - relative[1], yaws.min(axis=1) - relative[0]
    low[0] = high[0] = np.concatenate([problem.start.position_m, problem.start.rpy_rad, np.zeros(6)])
    pose, slack = np.concatenate([problem.goal.body.position_m, problem.goal.body.rpy_rad]), _goal_slack(problem)
    aim = np.clip(pose, low[-1, :6], high[-1, :6])
    low[-1] = np.concatenate([np.max([low[-1, :6], pose - slack, aim - near], axis=0), np.zeros(6)])
    high[-1] = np.concatenate([np.min([high[-1, :6], pose + slack, aim + near], axis=0), np.zeros(6)])
    return low, high


def reach_bounds(problem: Problem, schedule: Schedule) -> tuple[Array, Array]:
    """Lower and upper bounds (N, 4 m) of (9a) at knots 1..N: where each gripper is in the body's frame.

    A body that starts with a gripper outside its box, as one may in mid-climb, has until the first lift-off to bring it
    inside: limbs count as reaching that far until then.
    """
    middle, extent = problem.boxes.middle_m, problem.boxes.extent_m
    low, high = (np.tile(middle + sign * extent, (problem.steps, 1, 1)) for sign in (-1, 1))
    near, box = [tuple(held) in problem.near for held in schedule.contacts[1:]], problem.limb_reach.box
    low[near, :, :3] = np.maximum(low[near, :, :3], box.middle_m - box.extent_m)
    high[near, :, :3] = np.minimum(high[near, :, :3], box.middle_m + box.extent_m)
    low, high = low.reshape(problem.steps, -1), high.reshape(problem.steps, -1)
    away = schedule.poses[0, :, :3] - problem.start.position_m
    begin = (away @ rotation_from_rpy(problem.start.rpy_rad) @ problem.boxes.directions.T).ravel()
    moved = (schedule.poses[:, :, :3] != schedule.poses[0, :, :3]).any(axis=(1, 2))
    lift_off = int(np.argmax(moved)) - 1 if moved.any() else problem.steps
    begun = slice(lift_off - 1)
    low[begun], high[begun] = np.minimum(low[begun], begin), np.maximum(high[begun], begin)
    return low, high


def wrench_bounds(problem: Problem, contact: Contact) -> tuple[Array, Array]:
    """Bounds (5,) of (s1, s2, m, n1, n2) of a gripper that holds on to `contact`.

    What a finger keeps in reserve of its limit surface it presses more: the cone's apex stays out of reach of solvers.
    """
    press, free = problem.friction_share * problem.patch.max_normal_N, np.full(3, np.inf)
    if contact.foot:
        return foot_bounds(contact, press, problem.surface_reserve_N / problem.friction_share)
    friction = problem.friction_share * contact.grip_friction
    reserve = np.divide(problem.surface_reserve_N, friction, out=np.zeros(2), where=friction > 0.0)
    low, high = (LEAST_NORMAL_N + reserve) * contact.may_press, press * contact.may_press
    return np.concatenate([-free, low]), np.concatenate([free, high])


def foot_bounds(contact: Contact, most_N: float, reserve_N: float) -> tuple[Array, Array]:
    """The same of a foot, whose pads have half of its normal force each and no twist, and may be drawn either way along
    the opening axis.
    """
    least_N = (LEAST_NORMAL_N + reserve_N / float(contact.friction.min())) / 2
    return np.array([-np.inf, least_N, 0.0, -most_N, -most_N]), np.array([np.inf, most_N / 2, 0.0, most_N, most_N])


def rate_steps(problem: WalkProblem) -> Array:
    """(6,): by how much dr/dt and omega may change from knot to knot."""
    return problem.dt_s * np.repeat(problem.profile.acceleration, 3)


def foothold_bounds(problem: WalkProblem, gait: Gait) -> tuple[Array, Array] | None:
    """Lower and upper bounds (S, 2) of the footholds: beside obstacles, and each foot's last one near its goal.

    None where a foot that takes no step begins too far from there, or one too few past an obstacle.
    """
    limbs = np.array([step.limb for step in gait.steps], dtype=int)
    low, high = (np.zeros((len(limbs), 2)) for _ in range(2))
    for limb in range(4):
        own = np.flatnonzero(limbs == limb)
        if len(own) or problem.foothold_ranges_h_m.fewest[limb] > 1:
            ranges = problem.foothold_ranges_h_m.of_steps(limb, len(own))
            if ranges is None:
                return None
            low[own], high[own] = ranges
    last = {step.limb: i for i, step in enumerate(gait.steps)}
    for limb in range(4):
        wanted = problem.goal_feet_h_m[limb]
        if limb in last:
            low[last[limb]] = np.maximum(low[last[limb]], wanted - FINAL_FOOT_M)
            high[last[limb]] = np.minimum(high[last[limb]], wanted + FINAL_FOOT_M)
        elif np.abs(problem.start_feet_h_m[limb] - wanted).max() > FINAL_FOOT_M:
            return None
    return None if (low > high).any() else (low, high)


def least_load_N(problem: WalkProblem) -> float:
    """Normal force of a foot in stance."""
    return -problem.profile.least_share * problem.mass_kg * float(problem.gravity_h[2])


def step_polygon(problem: WalkProblem, step: Step, begin: Array, end: Array) -> tuple[Array, Array]:
    """Normals (C, 2) and largest ways (C,) of a polygon in the circle of a step's longest way, a corner ahead."""
    ahead = float(np.arctan2(*(end - begin)[::-1]))
    angles = ahead + (2 * np.arange(_CORNERS) + 1) * np.pi / _CORNERS
    most = np.cos(np.pi / _CORNERS) * longest_step(problem, step)
    return np.column_stack([np.cos(angles), np.sin(angles)]), np.full(_CORNERS, most)


def step_rows(rows: Rows, problem: WalkProblem, gait: Gait, footholds: Array, at_h: int) -> None:
    """Lengths of steps, about `footholds` (4 + S, 2); those of steps are variables from `at_h` on."""
    last = list(range(4))
    for j, step in enumerate(gait.steps):
        before = last[step.limb]
        normals, most = step_polygon(problem, step, footholds[before], footholds[4 + j])
        rows.dense(0, at_h + 2 * j + np.arange(2), normals)
        if before < 4:
            most = most + normals @ problem.start_feet_h_m[before]
        else:
            rows.dense(0, at_h + 2 * (before - 4) + np.arange(2), -normals)
        last[step.limb] = 4 + j
        rows.close(-np.inf, most)


def apart_rows(rows: Rows, blend: Array, fixed: Array, at_h: int) -> None:
    """Feet of a side apart: they are at `blend` (N + 1, 4, S) times the footholds and `fixed` (N + 1, 4, 2)."""
    for front, rear in ((0, 2), (1, 3)):
        difference = blend[:, front] - blend[:, rear]
        knots, of_step = np.nonzero(difference)
        rows.entries(knots, at_h + 2 * of_step, difference[knots, of_step])
        rows.close(FEET_APART_M - (fixed[:, front, 0] - fixed[:, rear, 0]), np.inf, len(blend))
