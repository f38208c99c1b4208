"""Sets of body poses in which limbs hold and swing: what the search over stances and the path of the
body over the knots have in common.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import replace
from functools import cached_property

import numpy as np
from crux_contracts.robot import Robot

from crux_planner.model.arrays import Array, Flags, Indices
from crux_planner.model.hands import hands_of
from crux_planner.model.kinematics import rotation_z
from crux_planner.model.problem import Pose, Problem
from crux_planner.model.schedule import Contacts
from crux_planner.model.workspace import Reach
from crux_planner.reach import between, body_grid
from crux_planner.reach.arm import CLEAR_M, reaches_of
from crux_planner.reach.body_grid import BodyGrid
from crux_planner.reach.poses import GripperPoses
from crux_planner.reach.protocol import Reach as LimbMap
from crux_planner.reach.solids import Links
from crux_planner.reach.trunk_clearance import links_off_slabs, off_slabs

_HULL_STEP_M = 0.01
_SAME = 1e-9
_NEARBY = (0.15, np.inf, np.inf, 0.05, 0.06, 0.06)  # yaw, roll, pitch [rad], z, x, y [m]
TURN_M = 0.3  # of way that a radian counts as
LEANING_RAD = 0.28  # beyond tilts of start and goal where grasps lean farther
LEVEL_RAD = 0.03  # tilts of start and goal up to which a level body stands for them

Gripper = tuple[float, ...]
"""A hand in H, see model.hands."""
MomentKey = tuple[Gripper | Contacts, ...]
"""Where all grippers are at a moment, and the contacts that limbs hold on to."""


def grid_about(problem: Problem, step_m: float, step_rad: float, pad_m: float, pad_rad: float) -> BodyGrid:
    """Poses around start and goal, the goal's on a node, and the start's heading, if it is a step off it; tilts from
    the start's to the goal's, see `tilts_of`, with both on nodes. Where the body `follows` surfaces, heights go around
    those of start and goal by half of `pad_m`, and tilts beyond as far as those of grasps, by `LEANING_RAD` at most.
    """
    start, goal = problem.start, problem.goal.body
    yaw = float(goal.rpy_rad[2])
    turn = yaw / np.ceil(abs(yaw) / step_rad) if abs(yaw) > step_rad else step_rad

    def axis(through: float, other: float, step: float, pad: float) -> Array:
        low, high = min(through, other) - pad, max(through, other) + pad
        first, last = int(np.floor((low - through) / step)), int(np.ceil((high - through) / step))
        return np.asarray(through + step * np.arange(first, last + 1), dtype=np.float64)

    pads_m = pad_m, pad_m, pad_m / 2 if problem.follows else 0.0
    ends = zip(goal.position_m.tolist(), start.position_m.tolist(), pads_m, strict=True)
    x, y, z = (axis(to, begin, step_m, pad) for to, begin, pad in ends)
    roll, pitch = _tilts(problem, step_rad)
    return BodyGrid(axis(yaw, 0.0, abs(turn), pad_rad), roll, pitch, z, x, y)


def _tilts(problem: Problem, step_rad: float) -> list[Array]:
    """Rolls and pitches of a grid."""
    ends, axes, ups = tilts_of(problem), list[Array](), np.array([contact.up for contact in problem.contacts])
    along = np.column_stack([np.arcsin(np.clip(-ups[:, 1], -1.0, 1.0)), np.arctan2(ups[:, 0], ups[:, 2])])
    most_rad = LEANING_RAD if problem.follows else 0.0
    for least, most, grasps in zip(ends.min(axis=0), ends.max(axis=0), along.T, strict=True):
        count = int(np.ceil((most - least) / step_rad - _SAME))
        step = (most - least) / count if count else step_rad
        below, above = (
            int(np.clip(off, 0.0, most_rad) / step + _SAME) for off in (least - grasps.min(), grasps.max() - most)
        )
        axes.append(least + step * np.arange(-below, count + above + 1))
    return axes


def tilts_of(problem: Problem) -> Array:
    """(2, 2) roll and pitch of start and goal; 0 where both are all but level."""
    tilts = np.array([problem.start.rpy_rad[:2], problem.goal.body.rpy_rad[:2]])
    return tilts if np.abs(tilts).max() > LEVEL_RAD else np.zeros((2, 2))


class PoseMasks:
    """Masks of one problem over one grid, each made once; joints keep `margin_rad` off their limits, links `clear_m`
    off the trunk and other limbs', and both off solids.
    """

    def __init__(
        self, problem: Problem, robot: Robot, grid: BodyGrid, margin_rad: float, clear_m: float = CLEAR_M
    ) -> None:
        self.problem, self.grid, self.clear_m = problem, grid, clear_m
        self.reaches = reaches_of(robot, margin_rad, clear_m)
        self._solid = bool(len(problem.solids.yaw_rad))
        self._span_m = [_span_m(reach) + clear_m for reach in self.reaches]
        self.at_moments: dict[MomentKey, Flags] = {}  # of the last schedule that was looked at
        self._held: dict[tuple[int, Gripper], Flags] = {}
        self._apart: dict[tuple[Gripper | int | None, ...], tuple[Flags, Flags]] = {}

    @cached_property
    def goal(self) -> Flags:
        """Where the body ends."""
        return self._near(self.problem.goal.body, tilts_of(self.problem)[1], 0)

    @cached_property
    def start(self) -> Flags:
        """Cells about the body's first pose."""
        return self._near(self.problem.start, tilts_of(self.problem)[0], 1)

    @cached_property
    def _trunk_clear(self) -> Flags:
        """Where the trunk keeps off solids."""
        return off_slabs(self.grid, self.reaches[0].keep_off.trunk, self.problem.solids, self.clear_m)

    def at(self, contact: int) -> Gripper:
        """A gripper that holds on."""
        return gripper(self.problem.contacts[contact].pose)

    def held(self, limb: int, there: Gripper) -> Flags:
        """From where a limb has its gripper there, links off the trunk, and both off solids."""
        key = limb, there
        if key not in self._held:
            mask = np.broadcast_to(self._reached(limb, self.grid.seen(np.array(there))), self.grid.shape)
            if self._solid:
                mask = mask & self._trunk_clear
                cells = np.flatnonzero(mask)
                mask.reshape(-1)[cells] = self._links_off(limb, there, cells)
            self._held[key] = mask
        return self._held[key]

    def _links_off(self, limb: int, there: Gripper, cells: Indices) -> Flags:
        """(n,) cells at which a limb keeps off solids."""
        near = self.problem.solids.near(np.array(there[:3]), self._span_m[limb])
        if not len(near.yaw_rad) or not len(cells):
            return np.ones(len(cells), dtype=bool)
        links = self.reaches[limb].links(self.grid.seen(np.array(there), cells))
        return links_off_slabs(self.grid.poses(cells), links, near, self.clear_m)

    def held_within(self, mask: Flags, limb: int, there: Gripper) -> Flags:
        """The part of a mask from which a limb has its gripper there: on its way, where others leave few poses."""
        if (limb, there) in self._held or 2 * np.count_nonzero(mask) > mask.size:
            return np.asarray(mask & self.held(limb, there))
        cells, found = np.flatnonzero(mask), np.zeros(mask.shape, dtype=bool)
        cells = cells[self._reached(limb, self.grid.seen(np.array(there), cells))]
        if self._solid:
            cells = cells[self._links_off(limb, there, cells)]
        found.reshape(-1)[cells] = True
        return found

    def _reached(self, limb: int, seen: GripperPoses) -> Flags:
        low, high = self.problem.gripper_yaw_rad
        return self.reaches[limb].reaches(seen) & (seen.yaw_rad >= low) & (seen.yaw_rad <= high)

    def hold(self, contacts: Contacts) -> Flags:
        """From where limbs hold on to their contacts; those in the air are left out."""
        masks = [self.held(limb, self.at(c)) for limb, c in enumerate(contacts) if c is not None]
        return body_grid.stance(masks)

    def apart(self, mask: Flags, grippers: Sequence[Gripper | None], moving: Sequence[int] = (0, 1, 2, 3)) -> Flags:
        """The part of a mask in which `moving` limbs keep off all others; those without a gripper are left out."""
        key: tuple[Gripper | int | None, ...] = (*grippers, *moving)
        known, ok = self._apart.setdefault(key, (np.zeros(mask.shape, bool), np.zeros(mask.shape, bool)))
        where = {limb: np.array(there) for limb, there in enumerate(grippers) if there is not None}
        unknown = mask & ~known
        if unknown.any():
            ok |= self.grid.apart(unknown, where, self.reaches, self.clear_m, moving, hands=False)
            known |= unknown
        return np.asarray(mask & ok)

    def clear_near(self, pose: Array, hands: Array) -> Array | None:
        """The nearest pose (6,) to one from which limbs have hands (4, 4) in reach and are off each other; None
        where there is none within `_NEARBY`.
        """
        grippers, grid = [gripper(hand) for hand in hands], self.grid
        at, mask = pose[[5, 3, 4, 2, 0, 1]], np.zeros(grid.shape, dtype=bool)
        mask[np.ix_(*(np.abs(axis - p) <= near for axis, p, near in zip(grid.axes, at, _NEARBY, strict=True)))] = True
        if self._solid:
            mask &= self._trunk_clear
        for limb, there in enumerate(grippers):
            mask = self.held_within(mask, limb, there)
        mask = self.apart(mask, grippers)
        cells = np.argwhere(mask)
        if not len(cells):
            return None
        off = np.array([axis[i] for axis, i in zip(grid.axes, cells.T, strict=True)]).T - at
        tilts = [TURN_M * (len(axis) > 1) for axis in grid.axes[1:3]]
        place, rpy = grid.pose(cells[int(np.argmin((off * [TURN_M, *tilts, 1, 1, 1]) ** 2 @ np.ones(6)))])
        return np.concatenate([place, rpy])

    def apart_at_goal(self, one: tuple[int, list[int]], two: tuple[int, list[int]]) -> Flags:
        """(n, m) for a limb and n contacts and another limb and m: whether they are on different holds, and their
        links off each other, with the body at the goal.
        """
        (first, mine), (second, theirs) = (
            (self._goal_links(limb, contacts), np.array([self.problem.contacts[c].hold for c in contacts]))
            for limb, contacts in (one, two)
        )
        i, j = (index.ravel() for index in np.indices((len(mine), len(theirs))))
        clear = between.apart(first.where(i), second.where(j), self.clear_m, hands=False)
        return np.asarray((clear & (mine[i] != theirs[j])).reshape(len(mine), len(theirs)))

    def held_at_goal(self, limb: int, contacts: list[int]) -> list[int]:
        """Those of the contacts that a limb holds with the body at the goal, its links off the trunk and both off
        solids.
        """
        if not contacts:
            return []
        held = self._reached(limb, self._seen_at_goal(contacts))
        found = [c for c, ok in zip(contacts, held, strict=True) if ok]
        if self._solid:
            found = [c for c in found if (self.held(limb, self.at(c)) & self.goal).any()]
        return found

    def _goal_links(self, limb: int, contacts: list[int]) -> Links:
        """Of one limb on each of the contacts."""
        return self.reaches[limb].links(self._seen_at_goal(contacts))

    def _seen_at_goal(self, contacts: list[int]) -> GripperPoses:
        """Grippers on these contacts as a body at the goal has them."""
        body, tilt = self.problem.goal.body, tilts_of(self.problem)[1]
        there = BodyGrid(*(np.array([at]) for at in (body.rpy_rad[2], *tilt, *body.position_m[[2, 0, 1]])))
        seen = [there.seen(np.array(self.at(c))).arrays for c in contacts]
        arrays = np.array([[np.ravel(each)[0] for each in poses] for poses in seen]).reshape(-1, 6).T
        return GripperPoses(*arrays)

    def _near(self, body: Pose, tilt: Array, cells: int) -> Flags:
        """The cell of a pose with another tilt, and so many around it."""
        pose = (body.rpy_rad[2], *tilt, *body.position_m[[2, 0, 1]])
        cell = [int(np.argmin(np.abs(axis - at))) for axis, at in zip(self.grid.axes, pose, strict=True)]
        found = np.zeros(self.grid.shape, dtype=bool)
        found[tuple(slice(max(0, i - cells), i + cells + 1) for i in cell)] = True
        return found


def _span_m(reach: LimbMap) -> float:
    """No link is farther from its gripper, its thickness included."""
    limb, links = reach.limb, reach.keep_off.links
    thick_m = 2 * max((capsule.radius_m for capsule in links), default=0.0)
    return limb.upper_link_m + limb.lower_link_m + limb.wrist_to_gripper_m + thick_m


def gripper(pose: Array) -> Gripper:
    """Of a pose or a hand."""
    return tuple(hands_of(pose).tolist())


def grown(mask: Flags) -> Flags:
    """A mask and the cells around it, edges and corners too."""
    for axis, count in enumerate(mask.shape):
        if count > 1:
            mask, given = mask.copy(), mask
            first, last = (tuple([slice(None)] * axis + [part]) for part in (slice(1, None), slice(None, -1)))
            mask[first] |= given[last]
            mask[last] |= given[first]
    return mask


def hulls_of(reaches: Sequence[LimbMap], problem: Problem, turn_rad: float) -> Reach:
    """The convex hulls, with the inner polytope's directions, of where a body's limbs reach contacts at headings up to
    a turn and tilted as at start and goal: more than the limbs reach, for estimates.
    """
    inner, yaws = problem.limb_reach.inner, np.array([c.yaw_rad for c in problem.contacts])
    low, high = problem.gripper_yaw_rad
    yaws = np.unique(np.round(yaws[(yaws >= low) & (yaws <= high)], 2))
    heights = np.array([c.centre_h_m[2] for c in problem.contacts]) - problem.goal.body.position_m[2]
    middle, extent = inner.middle_m.copy(), inner.extent_m.copy()
    plan = np.abs(inner.directions[:, 2]) < 0.5
    for i, reach in enumerate(reaches):
        limb = reach.limb
        steps = int(np.ceil((limb.upper_link_m + limb.lower_link_m) / _HULL_STEP_M))
        about = np.arange(-steps, steps) * _HULL_STEP_M  # with the shoulder: four joints may reach straight ahead alone
        x, y = (limb.shoulder_b_m[axis] + about for axis in (0, 1))
        east, north, up, yaw = np.ix_(x, y, np.unique(np.round(heights, 2)), yaws)
        reached = []
        turns, tilts = sorted({-turn_rad, 0.0, turn_rad}), np.unique(tilts_of(problem), axis=0)
        for turn, (roll, pitch) in itertools.product(turns, tilts):
            ok = reach.reaches(GripperPoses(east, north, up, yaw - turn, roll, pitch)).any(axis=(2, 3))
            places = np.argwhere(ok) * _HULL_STEP_M + [x[0], y[0]]
            reached.append(places @ rotation_z(turn)[:2, :2].T @ inner.directions[plan, :2].T)
        along = np.vstack(reached)
        least, most = along.min(axis=0), along.max(axis=0)
        middle[i, plan], extent[i, plan] = (least + most) / 2, (most - least) / 2
    return replace(inner, middle_m=middle, extent_m=extent)
