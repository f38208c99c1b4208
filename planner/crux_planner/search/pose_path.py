"""The path of the body over the knots of a schedule, by dynamic programming over level poses from which all limbs are
in reach where they are at each knot.

All costs are sums of squares along axes, so the best of all neighbours of every pose is found axis by axis.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from crux_planner.model.arrays import Array, Flags
from crux_planner.model.problem import Problem
from crux_planner.model.schedule import Contacts, Schedule, Stance, stance_after
from crux_planner.search.body_path import SPEED_SHARE
from crux_planner.search.pose_masks import Footing, PoseMasks, gripper, grown
from crux_planner.search.schedule import TURN_SHARE

Cell = tuple[int, ...]

_SAME = 1e-9
_ROUNDS = 40  # of looking for a path and at its links
_EDGE_CELLS, _EDGE_COST = 3, 0.004  # poses so near the edge of a mask cost so much for each cell


def knot_masks(masks: PoseMasks, footing: Footing, schedule: Schedule) -> list[Flags]:
    """Poses of knots 0..N from which all limbs are in reach and the body balances."""
    found: dict[tuple[object, ...], Flags] = {}
    series = []
    for poses, contacts in zip(schedule.poses, schedule.contacts, strict=True):
        grippers, held = [gripper(pose) for pose in poses], tuple(contacts)
        key = (*grippers, held)
        if key not in found:
            mask = np.logical_and.reduce([masks.held(limb, there) for limb, there in enumerate(grippers)])
            if None in held:
                stands = footing.stands(held, poses[:, :3].mean(axis=0))
                mask = mask & stands if stands is not None else np.zeros_like(mask)
            found[key] = mask
        series.append(found[key])
    return series


@dataclass(frozen=True)
class Ended:
    """The knot at which there is no way on, and whether the grippers' places alone are to blame for it: turned
    otherwise, limbs would be as weak, or as far beyond the limits of their first three joints.
    """

    knot: int
    by_places: bool


def clear_path(problem: Problem, masks: PoseMasks, footing: Footing, schedule: Schedule) -> Array | Ended:
    """As `pose_path`, (N + 1, 4) x, y, z and yaw, limbs off each other and motors strong enough: looked at where the
    path comes by, until it is clear.
    """
    knots = knot_masks(masks, footing, schedule)
    grippers = [[gripper(pose) for pose in knot] for knot in schedule.poses]
    at = list(zip([tuple(knot) for knot in schedule.contacts], _nearest_stances(schedule), strict=True))
    carried = {each: footing.carried(each[0], footing.oracle.mean_place(each[1])) for each in set(at)}
    strong: dict[tuple[Contacts, Stance], Flags] = {}
    for _ in range(_ROUNDS):
        cells, last = pose_path(problem, masks, knots, [carried[each] for each in at])
        if cells is None:
            return Ended(last, at[last] in strong and not knots[last].any())
        met = False
        for k, cell in enumerate(cells, start=2):
            here = np.zeros_like(knots[k])
            here[cell] = True
            if not masks.apart(here, grippers[k]).any():
                knots[k] = masks.apart(knots[k], grippers[k])
            elif not footing.strong_at(*at[k], cell):
                if at[k] not in strong:
                    strong[at[k]] = footing.strong(*at[k], knots[k], cell[0])
                knots[k] = knots[k] & strong[at[k]] & ~grown(here)
            else:
                continue
            met = True
        if not met:
            poses = [(*masks.grid.pose(cell)[0], masks.grid.pose(cell)[1][2]) for cell in cells]
            begin = (*problem.start.position_m, 0.0)
            return np.array([begin, begin, *poses])
    return Ended(last, by_places=False)


def _nearest_stances(schedule: Schedule) -> list[Stance]:
    """Of each knot, the stance that is nearest in time."""
    at = [k for k, knot in enumerate(schedule.contacts) if None not in knot]
    stances = [
        stance_after((0, 0, 0, 0), (0, 1, 2, 3), tuple(c for c in schedule.contacts[k] if c is not None)) for k in at
    ]
    return [stances[int(np.argmin(np.abs(np.array(at) - k)))] for k in range(len(schedule.contacts))]


def pose_path(
    problem: Problem, masks: PoseMasks, knots: list[Flags], carried: Sequence[Array | float] | None = None
) -> tuple[list[Cell] | None, int]:
    """The cells of knots 2..N on the cheapest way by J, the body at the start until knot 1; or None and the knot at
    which there is no way on. `carried` is what wrenches add to J at each knot, broadcast to the grid's shape.
    """
    grid, weights, last = masks.grid, problem.weights, len(knots) - 1
    step = SPEED_SHARE * problem.body.max_speed_m_s * problem.dt_s
    most = (TURN_SHARE * problem.body.max_rate_rad_s * problem.dt_s, 0.0, 0.0, step, step, step)
    price = weights.velocity / problem.dt_s**2
    place, goal = np.ix_(*grid.axes), problem.goal.body
    off = [(place[i + 3] - goal.position_m[j]) ** 2 for i, j in ((0, 2), (1, 0), (2, 1))]
    here = weights.orientation * (place[0] - goal.rpy_rad[2]) ** 2 + weights.position * (off[0] + off[1] + off[2])
    values = [np.where(masks.goal & knots[last], 0.0, np.inf)]
    for k in range(last - 1, 1, -1):
        best = values[-1]
        for axis, nodes in enumerate(grid.axes):
            best = _best_neighbour(best, axis, nodes, most[axis], price)
        value, outside = np.where(knots[k], best + here + (0.0 if carried is None else carried[k]), np.inf), ~knots[k]
        for _ in range(_EDGE_CELLS):
            outside = grown(outside)
            value[outside] += _EDGE_COST
        values.append(value)
        if not np.isfinite(value).any():
            return None, k
    at, path = (0.0, 0.0, 0.0, *problem.start.position_m[[2, 0, 1]]), list[Cell]()
    for value in reversed(values):
        near = [np.flatnonzero(np.abs(axis - p) <= m + _SAME) for axis, p, m in zip(grid.axes, at, most, strict=True)]
        if not all(len(each) for each in near):
            return None, 1
        ways = np.ix_(*[price * (axis[i] - p) ** 2 for axis, i, p in zip(grid.axes, near, at, strict=True)])
        local = value[np.ix_(*near)] + sum(ways)
        if not np.isfinite(local).any():
            return None, 1
        found = np.unravel_index(int(np.argmin(local)), local.shape)
        path.append(tuple(int(each[i]) for each, i in zip(near, found, strict=True)))
        at = tuple(float(axis[i]) for axis, i in zip(grid.axes, path[-1], strict=True))
    return path, last


def _best_neighbour(value: Array, axis: int, nodes: Array, most: float, price: float) -> Array:
    """The least of each cell's neighbours along an axis, up to `most` off, `price` times the square of their distance
    added.
    """
    if len(nodes) == 1:
        return value
    out, gap = value.copy(), float(nodes[1] - nodes[0])
    for away in range(1, int(np.floor((most + _SAME) / gap)) + 1):
        near, far = ([slice(None)] * value.ndim for _ in range(2))
        near[axis], far[axis] = slice(None, -away), slice(away, None)
        for to, of in ((tuple(near), tuple(far)), (tuple(far), tuple(near))):
            np.minimum(out[to], value[of] + price * (away * gap) ** 2, out=out[to])
    return out
