"""The path of the body over the knots of a schedule, by dynamic programming over poses from which all limbs are
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
from crux_planner.search.footing import Footing
from crux_planner.search.pose_masks import Gripper, MomentKey, PoseMasks, gripper, grown, tilts_of
from crux_planner.search.schedule import TURN_SHARE

Cell = tuple[int, ...]

_SAME = 1e-9
_ROUNDS = 40  # of looking for a path and at its links
_EDGE_CELLS, _EDGE_COST = 3, 0.004  # poses so near the edge of a mask cost so much for each cell


@dataclass(frozen=True)
class Moments:
    """The knots of a schedule, and what lies halfway between two, after the first two, where a limb is in the air: when
    it is, in knots, and the grippers and contacts then.
    """

    times: list[float]
    grippers: list[list[Gripper]]
    contacts: list[Contacts]

    @classmethod
    def of(cls, schedule: Schedule) -> Moments:
        """All of a schedule's."""
        found = cls([], [], [])
        for k, knot in enumerate(schedule.contacts):
            found._add(float(k), schedule.poses[k], tuple(knot))
            if None in knot and 0 < k < len(schedule.contacts) - 1:
                found._add(k + 0.5, (schedule.poses[k] + schedule.poses[k + 1]) / 2, tuple(knot))
        return found

    def _add(self, time: float, poses: Array, contacts: Contacts) -> None:
        self.times.append(time)
        self.grippers.append([gripper(pose) for pose in poses])
        self.contacts.append(contacts)

    def masks(self, masks: PoseMasks, footing: Footing) -> list[Flags]:
        """Poses at each from which all limbs are in reach and the body balances. Those of the schedule before are kept
        in `masks`: the next one differs in few moments.
        """
        found, series = dict[MomentKey, Flags](), []
        for grippers, held in zip(self.grippers, self.contacts, strict=True):
            key: MomentKey = (*grippers, held)
            if key not in found:
                known = masks.at_moments.get(key)
                found[key] = self._mask(masks, footing, grippers, held) if known is None else known
            series.append(found[key])
        masks.at_moments = found
        return series

    @staticmethod
    def _mask(masks: PoseMasks, footing: Footing, grippers: list[Gripper], held: Contacts) -> Flags:
        mask = np.ones(masks.grid.shape, dtype=bool)
        if None in held:
            stands = footing.stands(held, np.mean([there[:3] for there in grippers], axis=0))
            mask &= False if stands is None else stands
        stay = [limb for limb, contact in enumerate(held) if contact is not None]
        for limb in stay:
            mask &= masks.held(limb, grippers[limb])
        for limb in {*range(4)} - {*stay}:
            mask = masks.held_within(mask, limb, grippers[limb])
        return mask


@dataclass(frozen=True)
class Ended:
    """The knot at which there is no way on, and whether the grippers' places alone are to blame for it: turned
    otherwise, limbs would be as weak, or as far beyond the limits of their first three joints; `weak`: motors leave
    poses there, too few to go on.
    """

    knot: int
    by_places: bool
    weak: bool = False


def clear_path(problem: Problem, masks: PoseMasks, footing: Footing, schedule: Schedule) -> Array | Ended:
    """As `pose_path`, (N + 1, 6) places and roll, pitch and yaw, limbs off each other and motors strong enough: looked
    at where the path comes by, until it is clear.
    """
    moments = Moments.of(schedule)
    series, grippers = moments.masks(masks, footing), moments.grippers
    stances = _nearest_stances(schedule)
    at = [(held, stances[int(time)]) for held, time in zip(moments.contacts, moments.times, strict=True)]
    carried = {each: footing.carried(each[0], footing.oracle.mean_place(each[1])) for each in set(at)}
    strong: dict[tuple[Contacts, Stance, int], Flags] = {}
    asked = [(*each, i * masks.grid.tilts) for i, each in enumerate(at)]  # where the body tilts, moment by moment
    for _ in range(_ROUNDS):
        cells, last = pose_path(problem, masks, series, [carried[each] for each in at], moments.times)
        if cells is None:
            weak = not strong.keys().isdisjoint(asked[last : last + 2])
            return Ended(int(moments.times[last]), asked[last] in strong and not series[last].any(), weak)
        met = False
        for i, cell in enumerate(cells, start=2):
            here = np.zeros_like(series[i])
            here[cell] = True
            if not masks.apart(here, grippers[i]).any():
                series[i] = masks.apart(series[i], grippers[i])
            elif not footing.strong_at(*at[i], cell):
                if asked[i] not in strong:
                    strong[asked[i]] = footing.strong(*at[i], series[i], cell)
                series[i] = series[i] & strong[asked[i]]
                series[i] &= ~footing.weak_about(*at[i], series[i], cell)
            else:
                continue
            met = True
        if not met:
            at_knots = [cell for cell, time in zip(cells, moments.times[2:], strict=True) if time.is_integer()]
            begin = np.array([*problem.start.position_m, *tilts_of(problem)[0], 0.0])
            return np.array([begin, begin, *(np.concatenate(masks.grid.pose(cell)) for cell in at_knots)])
    return Ended(int(moments.times[last]), by_places=False)


def _nearest_stances(schedule: Schedule) -> list[Stance]:
    """Of each knot, the stance that is nearest in time."""
    at = [k for k, knot in enumerate(schedule.contacts) if None not in knot]
    stances = [
        stance_after((0, 0, 0, 0), (0, 1, 2, 3), tuple(c for c in schedule.contacts[k] if c is not None)) for k in at
    ]
    return [stances[int(np.argmin(np.abs(np.array(at) - k)))] for k in range(len(schedule.contacts))]


def pose_path(
    problem: Problem,
    masks: PoseMasks,
    series: list[Flags],
    carried: Sequence[Array | float] | None = None,
    times: Sequence[float] | None = None,
) -> tuple[list[Cell] | None, int]:
    """The cells at the moments from the third on, on the cheapest way by J through a mask at each, the body at the
    start until the second; or None and the number of that at which there is no way on. `times` of the moments are in
    knots, the knots themselves where there are none; `carried` is what wrenches add to J at each knot, broadcast to the
    grid's shape.
    """
    grid, weights, last = masks.grid, problem.weights, len(series) - 1
    lengths = np.diff(range(len(series)) if times is None else times)  # in knots
    at_knot = np.append(0, np.cumsum(lengths)) % 1 == 0
    step = SPEED_SHARE * problem.body.max_speed_m_s * problem.dt_s
    fastest = np.array([*[TURN_SHARE * problem.body.max_rate_rad_s * problem.dt_s] * 3, step, step, step])
    cells = np.array([axis[1] - axis[0] if len(axis) > 1 else 1.0 for axis in grid.axes])
    first = cells * np.ceil(
        (fastest + _SAME) // cells / 2
    )  # half the way in whole cells, rounded up; and what is left of it
    within = np.where(lengths[:, None] == 1, fastest, np.where(at_knot[:-1, None], first, fastest - first))
    price = weights.velocity / problem.dt_s**2
    place, goal = np.ix_(*grid.axes), problem.goal.body
    off = [(place[i + 3] - goal.position_m[j]) ** 2 for i, j in ((0, 2), (1, 0), (2, 1))]
    (begin, end), yaw = tilts_of(problem), goal.rpy_rad[2]
    turned = (place[0] - yaw) ** 2 + (place[1] - end[0]) ** 2 + (place[2] - end[1]) ** 2
    here = weights.orientation * turned + weights.position * (off[0] + off[1] + off[2])
    windows = [_window(each) for each in series]
    values = [np.where(masks.goal & series[last], 0.0, np.inf)[windows[last]]]
    for k in range(last - 1, 1, -1):
        best, window = values[-1], windows[k]
        for axis, (given, wanted) in enumerate(zip(windows[k + 1], window, strict=True)):
            best = _best_neighbour(best, axis, cells[axis], within[k, axis], price / lengths[k], given, wanted)
        if at_knot[k]:
            best = best + _within(here, window) + (0.0 if carried is None else _within(carried[k], window))
        mask = series[k][window]
        value, outside = np.where(mask, best, np.inf), ~mask
        for _ in range(_EDGE_CELLS):
            outside = grown(outside)
            value[outside] += _EDGE_COST
        values.append(value)
        if not np.isfinite(value).any():
            return None, k
    at, path = (0.0, *begin, *problem.start.position_m[[2, 0, 1]]), list[Cell]()
    for length, most, value, window in zip(lengths[1:], within[1:], reversed(values), windows[2:], strict=True):
        axes = [axis[part] for axis, part in zip(grid.axes, window, strict=True)]
        near = [np.flatnonzero(np.abs(axis - p) <= m + _SAME) for axis, p, m in zip(axes, at, most, strict=True)]
        if not all(len(each) for each in near):
            return None, 1
        ways = np.ix_(*[price / length * (axis[i] - p) ** 2 for axis, i, p in zip(axes, near, at, strict=True)])
        local = value[np.ix_(*near)] + sum(ways)
        if not np.isfinite(local).any():
            return None, 1
        found = np.unravel_index(int(np.argmin(local)), local.shape)
        path.append(tuple(int(part.start + n[i]) for part, n, i in zip(window, near, found, strict=True)))
        at = tuple(float(axis[i]) for axis, i in zip(grid.axes, path[-1], strict=True))
    return path, last


def _window(mask: Flags) -> tuple[slice, ...]:
    """The part of a grid that holds all of a mask, and what is near its edge: a whole grid is large for one knot."""
    cells = np.unravel_index(np.flatnonzero(mask), mask.shape)
    ends = ((int(at.min()), int(at.max())) if len(at) else (0, 0) for at in cells)
    return tuple(
        slice(max(low - _EDGE_CELLS, 0), min(high + _EDGE_CELLS + 1, count))
        for (low, high), count in zip(ends, mask.shape, strict=True)
    )


def _within(cost: Array | float, window: tuple[slice, ...]) -> Array | float:
    """The part of a cost that broadcasts to the grid's shape."""
    shape = np.shape(cost)
    kept = (part if count > 1 else slice(None) for part, count in zip(window[-len(shape) :], shape, strict=False))
    return np.asarray(cost)[tuple(kept)] if shape else cost


def _best_neighbour(
    value: Array, axis: int, gap: float, most: float, price: float, given: slice, wanted: slice
) -> Array:
    """The least of the wanted cells' neighbours along an axis among those that are given, up to `most` off, `price`
    times the square of their distance added.
    """
    shape = [*value.shape]
    shape[axis] = wanted.stop - wanted.start
    out, far = np.full(shape, np.inf), int(np.floor((most + _SAME) / gap))
    to, of = ([slice(None)] * value.ndim for _ in range(2))
    for away in range(-far, far + 1):
        low, high = max(wanted.start, given.start - away), min(wanted.stop, given.stop - away)
        if low < high:
            to[axis] = slice(low - wanted.start, high - wanted.start)
            of[axis] = slice(low + away - given.start, high + away - given.start)
            reached = out[tuple(to)]
            np.minimum(reached, value[tuple(of)] + price * (away * gap) ** 2, out=reached)
    return out
