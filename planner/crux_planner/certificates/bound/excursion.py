"""How far a plan that costs no more than a given J can take the body: excursions cost, for the body is slow.

A plan that is D away from the goal (or turned by D) at some knot is at least D - j step away j knots later, and j knots
earlier as long as that is farther than the start. Whatever else a plan costs comes on top.
"""

import numpy as np

from crux_planner.certificates.bound.grasps import Grasps
from crux_planner.certificates.bound.places import Orientations
from crux_planner.model.arrays import Array
from crux_planner.model.problem import Problem


def farthest(spare: float, weight: float, step: float, start: float) -> float:
    """The farthest that `spare` of J pays for, one coordinate, `start` and the result as distances from the goal."""
    if not np.isfinite(spare) or weight <= 0.0:
        return np.inf
    low, high = start, start + 1.0
    while excursion(np.array(high), step, start) * weight < spare:
        high *= 2
    for _ in range(30):
        middle = (low + high) / 2
        low, high = (middle, high) if excursion(np.array(middle), step, start) * weight < spare else (low, middle)
    return high


def excursion(far: Array, step: float, start: float) -> Array:
    """Sum of squared distances from the goal over all knots of having been `far` from it (any shape)."""
    total = np.zeros(np.shape(far))
    for j in range(int(np.ceil(float(np.max(far, initial=0.0)) / step)) + 1):
        there = np.maximum(far - step * j, 0.0)
        total += there**2 * (1.0 + ((j > 0) & (there > start)))
    return total


def body_range(problem: Problem, spare: float) -> tuple[Array, Array]:
    """Bounds (3,) of the body's position at any knot of a plan that has `spare` of J to pay for it."""
    start, goal = problem.start.position_m, problem.goal.body.position_m
    step = problem.body.max_speed_m_s * problem.dt_s
    way = (step * problem.steps - np.abs(goal - start)) / 2 + problem.goal.tolerance_m
    low, high = np.minimum(start, goal) - way, np.maximum(start, goal) + way
    for axis in range(3):
        far = farthest(spare, problem.weights.position, step, float(abs(start[axis] - goal[axis])))
        far += problem.goal.tolerance_m
        low[axis], high[axis] = max(low[axis], goal[axis] - far), min(high[axis], goal[axis] + far)
    low[2], high[2] = problem.body.height_m
    return low, high


def range_at(problem: Problem, knot: int, box: tuple[Array, Array]) -> tuple[Array, Array]:
    """Where in `box` the body can be at a knot: it rests in the first interval, and is never faster than (7) allows."""
    step = problem.body.max_speed_m_s * problem.dt_s
    before, after = step * max(knot - 1, 0), step * (problem.steps - knot) + problem.goal.tolerance_m
    start, goal = problem.start.position_m, problem.goal.body.position_m
    low = np.maximum(np.maximum(start - before, goal - after), box[0])
    high = np.minimum(np.minimum(start + before, goal + after), box[1])
    return low, np.maximum(low, high)


def yaw_range(problem: Problem, spare: float) -> tuple[float, float]:
    """The same for its yaw."""
    start, goal = float(problem.start.rpy_rad[2]), float(problem.goal.body.rpy_rad[2])
    step = problem.body.fastest_yaw_rad_s * problem.dt_s
    way = (step * problem.steps - abs(goal - start)) / 2 + problem.goal.tolerance_rad
    yaws = np.array([c.yaw_rad for c in problem.contacts])
    far = farthest(spare, problem.weights.orientation, step, abs(goal - start)) + problem.goal.tolerance_rad
    low, high = problem.gripper_yaw_rad
    least = max(min(start, goal) - way, goal - far, float(yaws.min()) - high)
    return least, min(max(start, goal) + way, goal + far, float(yaws.max()) - low)


def quickest_way(problem: Problem) -> float:
    """Least of Q on the body's position for the way from start to goal: at full speed from the second knot on."""
    step = problem.body.max_speed_m_s * problem.dt_s
    away = np.abs(problem.start.position_m - problem.goal.body.position_m)
    left = away - step * np.maximum(np.arange(problem.steps) - 1, 0)[:, None]
    return float(problem.weights.position * (np.maximum(left, 0.0) ** 2).sum())


def excursion_cost(problem: Problem, about: Orientations, nodes: Grasps) -> Array:
    """Least that J asks (n,) at all other knots for having been where a node's bodies are at one."""
    start, goal = problem.start, problem.goal
    step, weights = problem.body.max_speed_m_s * problem.dt_s, problem.weights
    shift = np.array([about.shift_m[-1], about.shift_m[-1], 0.0])
    away = np.maximum(nodes.low - shift - goal.body.position_m, goal.body.position_m - nodes.high - shift)
    away -= goal.tolerance_m
    total = np.zeros(len(away))
    for axis in range(2):
        far = float(abs(start.position_m[axis] - goal.body.position_m[axis]))
        total += weights.position * _others(away[:, axis], step, far)
    turned = float(start.rpy_rad[2] - goal.body.rpy_rad[2])
    yaw = float(goal.body.rpy_rad[2])
    beyond = np.maximum(about.yaw_low - yaw, yaw - about.yaw_high) - goal.tolerance_rad
    turn_step = problem.body.fastest_yaw_rad_s * problem.dt_s
    total += weights.orientation * _others(beyond, turn_step, abs(turned))[nodes.cell]
    return np.asarray(np.minimum.reduceat(total, nodes.first))


def _others(far: Array, step: float, start: float) -> Array:
    """An excursion less the knot at which it is farthest."""
    return np.asarray(excursion(far, step, start) - np.maximum(far, 0.0) ** 2)
