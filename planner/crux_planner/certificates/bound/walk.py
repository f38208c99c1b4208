"""A proven lower bound of J (6) of a walk: the better one of two.

The first is of crawls, one foot in the air at a time as the planner has them, and knows that the feet balance the body
(bound.equilibrium_dual). What the heading costs is added.

The second is of any number of feet in the air, each part of J at its own best:
1. Forces. A walk begins and ends at rest, so that by (8a) the forces of all knots sum to -N M g. Shared by the feet in
   stance, their squares are least when every foot carries the same all the time: R N^2 (M g)^2 / 2 over the number of
   feet standing, summed over the knots. That is convex in the knots in the air: any of its tangents is below it.
2. Steps. A foot whose place at the goal is farther off than (7) allows takes a step or more; each costs two changes of
   contact, the knots in the air that the foot's speed needs for the way, and earns its height at most.
3. The body's way from start to goal at bounded speed, axis by axis, by weak duality.

Both hold for the planner's steps (walk.gait.Step): their shape, the least knots in the air, the places of the last
ones; the first also for the accelerations that the walk's margins allow.
"""

from dataclasses import replace

import numpy as np

from crux_planner.certificates.bound.centre_of_pressure import heading_share
from crux_planner.certificates.bound.equilibrium_dual import crawl_bound
from crux_planner.model.arrays import Array
from crux_planner.model.gait import LEAST_AIR, Step, longest_step
from crux_planner.model.walk_problem import FINAL_FOOT_M, WalkProblem
from crux_planner.physics.cost import FORCE_SHARE
from crux_planner.solvers.qp import Qp


def lower_bound(problem: WalkProblem) -> float:
    """A number that J of no crawl is below."""
    crawls = crawl_bound(problem) + _heading(problem, heading_share(problem))
    return max(_forces_and_steps(problem) + _body(problem), crawls)


def _forces_and_steps(problem: WalkProblem) -> float:
    """The best of the tangents at each number of knots in the air."""
    weights, n = problem.weights, problem.steps
    whole = FORCE_SHARE * weights.wrench * float(problem.mass_kg**2 * problem.gravity_h @ problem.gravity_h) * n**2
    swings = np.abs(problem.goal_feet_h_m - problem.start_feet_h_m) - FINAL_FOOT_M
    lengths = np.linalg.norm(np.maximum(swings, 0.0), axis=1)
    air = np.arange(LEAST_AIR, n)
    by_air = [Step(0, 0, int(k)) for k in air]
    quickest = replace(problem, paces=(1.0, 1.0, 1.0, 1.0))
    longest = np.array([longest_step(quickest, one) for one in by_air])
    height = np.array([one.shares()[1].sum() for one in by_air])
    best = -np.inf
    for aloft in range(2 * n):
        slope = whole / (4 * n - aloft) ** 2
        step = 2 * weights.switching + slope * air + weights.lift * problem.step_height_m * height
        steps = sum(_cheapest(float(length), step, longest) for length in lengths if length > 0.0)
        idle = 4 * n * float(step.min(initial=0.0))  # were a step to earn more than it costs
        best = max(best, whole / (4 * n - aloft) - slope * aloft + steps + idle)
    return best


def _cheapest(length: float, step: Array, longest: Array) -> float:
    """Least cost of one, two, or more steps that lead so far; of three or more, only that they are steps."""
    one = step[longest >= length]
    both = step[:, None] + step
    two = both[longest[:, None] + longest >= length]
    return float(min(one.min(initial=np.inf), two.min(initial=np.inf), 3 * step.min(initial=np.inf)))


def _body(problem: WalkProblem) -> float:
    """Q on position, heading and their rates. Roll and pitch may be what the goal asks."""
    weights, start, goal, body = problem.weights, problem.start, problem.goal, problem.body
    total = 0.0
    for axis in range(3):
        way = float(start.position_m[axis] - goal.body.position_m[axis])
        pulls = (weights.position, weights.velocity)
        total += _way(way, goal.position_slack_m, pulls, body.max_speed_m_s * problem.dt_s, problem)
    return total + _heading(problem, float(np.cos(body.max_tilt_rad) ** 2))  # yaw' <= |omega| / cos(pitch)


def _heading(problem: WalkProblem, share: float) -> float:
    """Q on the heading, and on its rate with a share of the weight."""
    weights, slack = problem.weights, problem.goal.rotation_slack_rad
    turn = float(problem.start.rpy_rad[2] - problem.goal.body.rpy_rad[2])
    pulls = (weights.orientation, share * weights.velocity)
    return _way(turn, slack, pulls, problem.body.fastest_yaw_rad_s * problem.dt_s, problem)


def _way(start: float, slack: float, pulls: tuple[float, float], step: float, problem: WalkProblem) -> float:
    """Least of sum_k a x_k^2 + b (d_k / dt)^2 for x_{k+1} = x_k + d_k from `start` to within `slack`, |d_k| <= `step`.

    d_0 = d_N = 0: at rest at the beginning and the end. The QP proposes multipliers, the dual function is what counts.
    """
    n = problem.steps
    far = abs(start) + step * n
    low, high = np.full(2 * n + 1, -far), np.full(2 * n + 1, far)  # x_0..x_N, d_0..d_{N-1}
    low[0] = high[0] = start
    low[n], high[n] = max(-slack, -far), min(slack, far)
    low[n + 1 :], high[n + 1 :] = -step, step
    low[n + 1] = high[n + 1] = 0.0
    square = np.concatenate([np.full(n + 1, pulls[0]), np.full(n, pulls[1] / problem.dt_s**2)])
    rows = np.zeros((n, 2 * n + 1))
    k = np.arange(n)
    rows[k, k + 1], rows[k, k], rows[k, n + 1 + k] = 1.0, -1.0, -1.0
    qp = Qp(np.diag(2 * square + 1e-9), np.zeros(2 * n + 1), (rows, np.zeros(n)), None, low, high)
    multipliers = np.nan_to_num(qp.solve().multipliers)
    slope = rows.T @ multipliers
    x = np.clip(np.where(square > 0, -slope / np.maximum(2 * square, 1e-12), -np.sign(slope) * far), low, high)
    return max(float((square * x**2 + slope * x).sum()), 0.0)
