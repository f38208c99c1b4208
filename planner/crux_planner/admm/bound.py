"""A proven lower bound of J (6), from small hull MILPs; with it a plan's gap is proven, not guessed.

J falls into parts that are bounded by themselves, and the bounds add up:

- the body's way: at knot k no body can be nearer the goal than its largest speed allows;
- wrenches: for each number of limbs in the air, the least |u|^2 of any grasps on the wall that carry the body at any
  place within the horizon's reach, with (2) relaxed to planes around it and (8) to a band as wide as the largest
  accelerations; the best mix over the knots has at least as many knots in the air as the needed swings take;
- swings: the limbs that must change their grasps do so at least once; height and opening earn what they can at most.

It holds for the planner's grasp points and ways of swinging, at any orientation of the body.
"""

from __future__ import annotations

import time

import numpy as np

from crux_planner.admm.milp import Milp
from crux_planner.arrays import Array, Indices
from crux_planner.problem import Problem
from crux_planner.search.stances import Reach
from crux_planner.search.ways import Ways
from crux_planner.terms.dynamics import skew, static_map
from crux_planner.terms.limit_surface import polytope_directions

LIMBS = 4
TIME_LIMIT_S = 1.0
_GAP = 0.002
_TURN_RAD = 0.15  # beyond level, for what is in reach at the goal
_FORCE_BOUND_N = 300.0
_TANGENTS = (np.array([-30.0, -20, -14, -10, -6, -3, 3, 6, 10, 14, 20, 30]), np.array([2.0, 5, 8, 11, 15, 20, 28, 40]))


def lower_bound(problem: Problem, reach: Reach, ways: Ways, time_limit_s: float = TIME_LIMIT_S) -> float | None:
    """A number that J of no plan is below; None where it takes longer than `time_limit_s` or does not apply."""
    if problem.limit_surface == "paper":  # it lets pass what (2) does not
        return None
    deadline, weights, n = time.monotonic() + time_limit_s, problem.weights, problem.steps
    needed = [swing for limb in range(LIMBS) if (swing := _needed_swing(problem, reach, ways, limb)) is not None]
    earned = weights.lift * problem.swing.max_height_m + 2 * weights.opening * problem.shape.largest_opening
    values = []
    for flying in range(LIMBS):
        effort = _least_effort(problem, LIMBS - flying, deadline)
        if effort is None:
            return None
        values.append(weights.wrench * effort + min(earned, 0.0) * flying)
    swings = 2 * weights.switching * len(needed)
    return _body_way(problem) + n * _best_mix(np.array(values), sum(needed) / n) + swings


def gap(cost: float, bound: float | None) -> float | None:
    """How far above the bound a cost may be, as a share of it: (cost - bound) / cost; None without a bound."""
    if bound is None or not np.isfinite(bound) or cost <= 0.0:
        return None
    return max((cost - bound) / cost, 0.0)


def _body_way(problem: Problem) -> float:
    """sum |r - r_goal|^2 at least, axis by axis; the goal's tolerance counts as reached."""
    way = np.abs(problem.start.position_m - problem.goal.body.position_m)
    steps = np.arange(problem.steps + 1)[:, None] * problem.body.max_speed_m_s * problem.dt_s
    rest = np.maximum(way - steps, 0.0)
    return float(problem.weights.position * (rest**2).sum())


def _needed_swing(problem: Problem, reach: Reach, ways: Ways, limb: int) -> int | None:
    """Least knots in the air of a limb that cannot stay where it starts, None for one that can."""
    start, wanted = problem.contacts[problem.start_contacts[limb]], problem.goal.grasps.get(limb)
    if wanted is None:
        arm = np.abs(problem.boxes.centre_b_m).max(axis=0) + problem.boxes.half_m
        room = problem.goal.position_room_m + np.sin(_TURN_RAD) * np.linalg.norm(arm)
        goal, c = problem.goal.body.position_m, problem.start_contacts[limb]
        near = (reach.low[limb, c] - room <= goal).all() and (goal <= reach.high[limb, c] + room).all()
        if near or abs(problem.goal.body.rpy_rad).max() + problem.goal.rotation_room_rad > _TURN_RAD:
            return None
        return 1
    if (start.hold, start.pair) == wanted:
        return None
    ends = [i for i, c in enumerate(problem.contacts) if (c.hold, c.pair) == wanted]
    lengths = [
        ways.intervals(c, end)
        for end in ends
        for c in problem.limb_contacts[limb]
        if c not in ends and ways.swing(c, end) is not None
    ]
    return min(lengths, default=1)


def _best_mix(values: Array, flying: float) -> float:
    """Least mean value a knot when on average at least `flying` limbs are in the air: the lower hull of the values."""
    best = np.inf
    for a in range(len(values)):
        if a >= flying:
            best = min(best, float(values[a]))
        for b in range(a + 1, len(values)):
            if a < flying <= b:
                share = (flying - a) / (b - a)
                best = min(best, float((1 - share) * values[a] + share * values[b]))
    return best


def _least_effort(problem: Problem, standing: int, deadline: float) -> float | None:
    """Least |u|^2 of `standing` grippers in balance (inf where there is none); None where the time is up."""
    milp = Milp()
    middle, low, high = _body_region(problem)
    body = milp.variables(3, low - middle, high - middle)
    k_m, share, pressing = problem.patch.k_m, problem.friction_share, problem.patch.max_normal_N
    directions, _, spine = polytope_directions(k_m)
    directions = directions * np.array([1.0, 1.0, k_m])  # on (s1, s2, m / k)
    around = np.linalg.norm(directions, axis=1)  # planes that touch the cone from outside
    top = np.array([*[_FORCE_BOUND_N] * 3, pressing, pressing])
    held: list[int] = []
    squares: list[Indices] = []
    columns: list[int] = []
    parts: list[Array] = []
    by_hold: dict[int, list[int]] = {}
    known: set[tuple[int, int]] = set()
    for contact in problem.contacts:
        if (contact.hold, contact.pair) in known:  # gripped the other way round it carries the same
            continue
        known.add((contact.hold, contact.pair))
        on = int(milp.variables(1, 0.0, 1.0, integer=True)[0])
        q, square = milp.variables(5, np.array([*(-top[:3]), 0.0, 0.0]), top), milp.variables(5, 0.0, np.inf)
        held.append(on)
        squares.append(square)
        by_hold.setdefault(contact.hold, []).append(on)
        box = share * np.array([contact.spine_shear_N, contact.spine_shear_N, contact.spine_twist_Nm])
        for normal in (3, 4):
            for direction, length, support in zip(directions, around, spine @ box, strict=True):
                load = share * contact.grip_friction * length
                milp.row([*q[:3], q[normal], on], [*direction, -load, -support], -np.inf, 0.0)
            milp.row([q[normal], on], [1.0, -pressing], -np.inf, 0.0)
        for i in range(5):
            for d in _TANGENTS[int(i >= 3)]:
                milp.row([square[i], q[i], on], [1.0, -2 * d, d * d], 0.0, np.inf)
        force = static_map(contact.centre_w_m - middle, contact.axis, contact.tangent)
        columns += map(int, q)
        parts.append(np.column_stack([force[:, :2], k_m * force[:, 2], force[:, 3], -force[:, 3]]))
    if len(by_hold) < standing:
        return np.inf
    for group in by_hold.values():
        milp.row(group, np.ones(len(group)), -np.inf, 1.0)
    milp.row(held, np.ones(len(held)), standing, standing)
    _band(milp, problem, np.hstack(parts), columns, body, np.abs(high - low) / 2)
    cost = np.zeros(milp.size)
    for square in squares:
        cost[square] = [2.0, 2.0, 2.0, 1.0, 1.0]
    left = deadline - time.monotonic()
    if left <= 0.0:
        return None
    result = milp.solve(cost, gap=_GAP, time_limit_s=left)
    if result.infeasible:
        return np.inf
    return max(result.bound, 0.0) if np.isfinite(result.bound) else None


def _body_region(problem: Problem) -> tuple[Array, Array, Array]:
    """Middle, lower and upper corner of where the body can be on its way from start to goal in time."""
    ends = np.stack([problem.start.position_m, problem.goal.body.position_m])
    ways = problem.body.max_speed_m_s * problem.dt_s * problem.steps - np.abs(np.diff(ends, axis=0)[0])
    aside = np.maximum(ways / 2, 0.0) + problem.goal.position_room_m
    low, high = ends.min(axis=0) - aside, ends.max(axis=0) + aside
    low[2], high[2] = problem.body.height_m
    return ends.mean(axis=0), low, high


def _band(milp: Milp, problem: Problem, total: Array, columns: list[int], body: Indices, aside: Array) -> None:
    """(8) about the region's middle, within what the largest accelerations take."""
    weight, dt = problem.weight_N, problem.dt_s
    push = problem.mass_kg * 2 * problem.body.max_speed_m_s / dt
    inertia = float(np.linalg.eigvalsh(problem.inertia_b).max())
    rate = problem.body.max_rate_rad_s
    swing = inertia * (2 * 3**0.5 * rate / dt + 3 * rate**2)
    arms = np.array([aside[1] + aside[2], aside[0] + aside[2], aside[0] + aside[1]])
    moment = skew(weight)
    for axis in range(3):
        milp.row(columns, total[axis], -weight[axis] - push, -weight[axis] + push)
        slack = swing + push * arms[axis]
        both = np.concatenate([total[3 + axis], -moment[axis]])
        milp.row([*columns, *map(int, body)], both, -slack, slack)
