"""The contact MILP's cost: J (6) and the proximal term rho / 2 |eta - delta + epsilon|^2 of (19a), a window at a time.

With `target` = delta - epsilon the proximal term of a window's knots expands into squares and linear terms of the
wrench shares, and into constants of a contact held or a swing taken: exact but for the tangents of the squares.
"""

from __future__ import annotations

import numpy as np

from crux_planner.admm.hull import SHARES, SQUARED, WindowCost
from crux_planner.admm.windows import REST_KNOTS, Windows
from crux_planner.model.arrays import Array
from crux_planner.physics.cost import swing_cost
from crux_planner.trajectory.consensus import Eta, Scales, finger_positions


def window_cost(windows: Windows, rho: float, target: Eta | None, scales: Scales) -> WindowCost:
    """The cost for targets at the knots; without them J alone."""
    problem, count = windows.problem, windows.count
    weights, k_m, contacts = problem.weights, problem.patch.k_m, len(problem.contacts)
    pull = 0.0 if target is None else rho
    near, force, moment = (pull * s**2 for s in (scales.position, scales.force, scales.moment))
    each = np.array(
        [2 * weights.wrench + force] * 2 + [2 * weights.wrench + moment * k_m**2] + [weights.wrench + force / 2] * 2
    )
    square = np.zeros((count, SQUARED))
    body_square, body_linear = np.zeros((count, 3)), np.zeros((count, 3))
    linear, held = np.zeros((count, 4, contacts, SHARES)), np.zeros((count, 4, contacts))
    for t in range(count):
        first, end = windows.span(t)
        square[t] = (end - first) * each
        body_square[t] = (end - first) * (weights.position + near / 2)
        body_linear[t] = -2 * (end - first) * weights.position * problem.goal.body.position_m
        if target is None:
            continue
        body_linear[t] -= near * target.body[first:end, 0:3].sum(axis=0)
        for limb in range(4):
            fingers = slice(2 * limb, 2 * limb + 2)
            forces, moments = target.forces[first:end, fingers].sum(axis=0), target.moments[first:end, fingers]
            for c in windows.contacts[limb]:
                contact = problem.contacts[c]
                shear = -force * forces.sum(axis=0) @ np.column_stack([contact.tangent, [0.0, 0.0, 1.0]])
                twist = -moment * k_m * float(moments.sum(axis=(0, 1)) @ contact.axis)
                normal = -force * np.array([forces[0] @ contact.axis, -forces[1] @ contact.axis])
                linear[t, limb, c] = [*shear, twist, *normal, normal.sum()]
    constant = problem.steps * weights.position * float((problem.goal.body.position_m**2).sum())
    if target is not None:
        constant += near / 2 * float((target.body[: problem.steps, 0:3] ** 2).sum())
        constant += force / 2 * float((target.forces**2).sum()) + moment / 2 * float((target.moments**2).sum())
        held = np.stack([held_costs(windows, limb, target, pull, scales) for limb in range(4)], axis=1)
    arcs = [arc_costs(windows, limb, target, pull, scales) for limb in range(4)]
    return WindowCost(square, body_linear, body_square, linear, held, arcs, constant)


def held_costs(windows: Windows, limb: int, target: Eta, pull: float, scales: Scales) -> Array:
    """(S, C): the proximal term of a gripper's pose while it holds each of its contacts through a window."""
    costs = np.zeros((windows.count, len(windows.problem.contacts)))
    for t in range(windows.count):
        first, end = windows.span(t)
        for c in windows.contacts[limb]:
            poses = np.tile(windows.problem.contacts[c].pose, (end - first, 1))
            costs[t, c] = _apart(poses, target, limb, first, pull, scales)
    return costs


def arc_costs(windows: Windows, limb: int, target: Eta | None, pull: float, scales: Scales) -> Array:
    """J and the proximal term of each of a limb's swings, the knots at rest before it included."""
    costs = np.zeros(len(windows.arcs[limb]))
    for i, arc in enumerate(windows.arcs[limb]):
        swing = windows.swinging(limb, arc)
        poses = windows.swings.way(swing.start, swing.goal).poses(swing.end - swing.first)[:-1]
        costs[i] = swing_cost(windows.problem.weights, poses)
        if target is not None:
            rest = np.tile(windows.problem.contacts[swing.start].pose, (REST_KNOTS, 1))
            costs[i] += _apart(np.vstack([rest, poses]), target, limb, swing.first - REST_KNOTS, pull, scales)
            costs[i] += pull / 2 * scales.flag**2 * float((1.0 - 2.0 * target.away[arc.first : arc.end, limb]).sum())
    return costs


def _apart(poses: Array, target: Eta, limb: int, first: int, pull: float, scales: Scales) -> float:
    """The proximal term of gripper poses (n, 5) from knot `first` on."""
    knots = slice(first, first + len(poses))
    fingers = finger_positions(poses[:, None]) - target.fingers[knots, 2 * limb : 2 * limb + 2]
    yaws = poses[:, 3] - target.yaws[knots, limb]
    return float(pull / 2 * (scales.position**2 * (fingers**2).sum() + scales.orientation**2 * (yaws**2).sum()))
