"""Which limb moves to which hold, searched with all of what the limbs reach: A* over stances and poses of the body.

A node is a stance with one connected part of the level poses from which all four limbs hold on, their links off each
other. A limb may go on where the other three hold and balance the body; while it swings, the body goes along with it,
from one set of poses to a neighbouring one. A move is looked at closely (its swing, its samples, links, torques) only
when it is next in line.
"""

from __future__ import annotations

import heapq
import itertools
from collections.abc import Collection
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from crux_planner.model.arrays import Flags, Indices
from crux_planner.model.schedule import Contacts, Stance, stance_after
from crux_planner.reach.body_grid import parts
from crux_planner.search.pose_masks import Footing, PoseMasks, gripper, grown
from crux_planner.solvers import clock
from crux_planner.swing.swing_cache import SwingCache

GREED = 3.0  # moves to go count so much against those made
HOP_M = 0.7  # no move is longer, as the estimate of the moves to go sees it
WAY_SHARE = 0.5  # of a move's cost that its way is, were it so long
_NEAR_M = 0.4  # of grippers that may be in each other's way
SAMPLES, LINKS_AT = 7, (1, 2, 3, 4, 5)  # of a swing, and at which of these limbs are looked at against each other

Node = tuple[Stance, int]
Step = tuple[Stance, int, Stance]
"""The stance before, the limb, the stance after."""


@dataclass(frozen=True)
class Swing:
    """A limb that may go to a contact: not looked at closely yet."""

    before: Node
    limb: int
    end: int
    lift: Flags  # where the body may be when it lifts off
    free: Flags  # and meanwhile, as far as the other limbs are concerned

    @property
    def after(self) -> Stance:
        return stance_after(self.before[0], (self.limb,), (self.end,))


class MapSearch:
    """The search of one problem; what it has worked out stays for the next run."""

    def __init__(self, masks: PoseMasks, footing: Footing, swings: SwingCache) -> None:
        self.problem, self.masks, self.footing, self.swings = masks.problem, masks, footing, swings
        problem = self.problem
        self._labels: dict[Stance, Indices] = {}
        self._places = np.array([c.centre_h_m for c in problem.contacts])
        self._mine = [sorted({*problem.limb_contacts[limb], problem.start_contacts[limb]}) for limb in range(4)]
        away = np.linalg.norm(self._places[:, None] - self._places, axis=2)
        self._near = away < _NEAR_M
        self._hops = np.maximum(np.ceil(away / HOP_M), 1.0) * ~np.eye(len(away), dtype=bool)

    @cached_property
    def _usable(self) -> list[list[int]]:
        """Contacts that a limb has in reach from some pose, limb by limb."""
        held = self.masks.held
        return [[c for c in own if held(limb, self.masks.at(c)).any()] for limb, own in enumerate(self._mine)]

    def find(self, without: Collection[Step], most: int, deadline: float) -> list[Step] | None:
        """Moves to the goal, none of `without` among them; None where `most` looks at moves, or the time, find none."""
        start, count = self.problem.start_contacts, itertools.count()
        if not len(self.goals):
            return None
        best: dict[Node, float] = {}
        parent: dict[Node, tuple[Node, int]] = {}
        queue: list[tuple[float, bool, int, float, Node | Swing]] = []
        for part in set(np.unique(self._parts(start)[self.masks.start]).tolist()) - {0}:
            best[start, part] = 0
            heapq.heappush(queue, (0.0, False, next(count), 0.0, (start, part)))
        done: set[Node] = set()
        while queue and most > 0 and clock.now() < deadline:
            rank, *_, cost, each = heapq.heappop(queue)
            if isinstance(each, Swing):
                if (each.before[0], each.limb, each.after) in without:
                    continue
                most -= 1
                for part in self._landed(each):
                    node = each.after, part
                    if cost < best.get(node, np.inf):
                        best[node], parent[node] = cost, (each.before, each.limb)
                        heapq.heappush(queue, (rank, False, next(count), cost, node))
                continue
            if each in done:
                continue
            done.add(each)
            if self._ends(each):
                return _trace(parent, each)
            for swing in self._swings(each):
                then = cost + self._cost(swing)
                rank = then + GREED * self.ahead(swing.after)
                heapq.heappush(queue, (rank, True, next(count), then, swing))  # after nodes that promise as much
        return None

    def _parts(self, stance: Stance) -> Indices:
        """Numbers of the connected parts of a stance's poses."""
        if stance not in self._labels:
            grippers = [self.masks.at(c) for c in stance]
            self._labels[stance] = parts(self.masks.apart(self.masks.hold(stance), grippers))[0]
        return self._labels[stance]

    @cached_property
    def goals(self) -> Indices:
        """Stances (n, 4) of contacts on which a body at the goal may stand, every limb in reach and off the others."""
        problem, masks = self.problem, self.masks
        ends = []
        for limb, mine in enumerate(self._mine):
            ends.append(masks.held_at_goal(limb, [c for c in mine if problem.may_end(limb, problem.contacts[c])]))
        if not all(ends):
            return np.zeros((0, 4), dtype=int)
        stances = np.array(ends[0], dtype=int).reshape(-1, 1)
        for limb in range(1, 4):
            stances = np.column_stack([np.repeat(stances, len(ends[limb]), axis=0), np.tile(ends[limb], len(stances))])
            for other in range(limb):
                apart = masks.apart_at_goal((other, ends[other]), (limb, ends[limb]))
                for i, j in np.argwhere(apart & self._near[np.ix_(ends[other], ends[limb])]):
                    apart[i, j] = self.swings.apart(ends[other][i], ends[limb][j])
                rows, columns = (np.searchsorted(ends[i], stances[:, i]) for i in (other, limb))
                stances = stances[apart[rows, columns]]
        return stances

    def ahead(self, stance: Stance) -> float:
        """Moves that a stance needs to the nearest of the goal's, were they no longer than `HOP_M`."""
        hops = [self._hops[c, self.goals[:, limb]] for limb, c in enumerate(stance)]
        return float(np.sum(hops, axis=0).min())

    def _cost(self, swing: Swing) -> float:
        """Of a move: mostly its being one."""
        way = self._places[swing.end] - self._places[swing.before[0][swing.limb]]
        return 1.0 + WAY_SHARE * float(np.linalg.norm(way)) / HOP_M

    def _ends(self, node: Node) -> bool:
        stance, part = node
        if self.ahead(stance) > 0.0:
            return False
        there = (self._parts(stance) == part) & self.masks.goal
        return bool(there.any()) and self.footing.held_at(stance, stance, there)

    def _swings(self, node: Node) -> list[Swing]:
        """What may follow a node."""
        (stance, part), found = node, []
        mine = self._parts(stance) == part
        for limb in self.problem.may_move(stance):
            held: Contacts = tuple(c if other != limb else None for other, c in enumerate(stance))
            stands = self.footing.stands(held, self._places[list(stance)].mean(axis=0))
            lift = mine if stands is None else mine & stands
            if stands is None or not lift.any():
                continue
            numbers, _ = parts(self.masks.hold(held) & stands)
            free = np.isin(numbers, np.setdiff1d(np.unique(numbers[lift]), [0]))
            holds = {self.problem.contacts[c].hold for c in held if c is not None}
            for end in self._usable[limb]:
                fits = end != stance[limb] and self.problem.contacts[end].hold not in holds
                if fits and (free & self.masks.held(limb, self.masks.at(end))).any():
                    found.append(Swing(node, limb, end, lift, free))
        return found

    def _landed(self, swing: Swing) -> list[int]:
        """The parts of the stance after a swing in which the body may come to be."""
        (stance, _), limb, end, after = swing.before, swing.limb, swing.end, swing.after
        held: Contacts = tuple(c if other != limb else None for other, c in enumerate(stance))
        if not self.swings.free([(stance[limb], end)], tuple(c for c in held if c is not None)):
            return []
        if not self.footing.held_at(held, stance, swing.lift):
            return []
        way = self.swings.way(stance[limb], end)
        poses = way.poses(max(SAMPLES, way.intervals))
        there, grippers = swing.lift, [self.masks.at(c) for c in stance]
        for sample, k in enumerate(np.linspace(0, len(poses) - 1, SAMPLES).round().astype(int)):
            grippers[limb] = gripper(poses[k])
            there = grown(there) & swing.free & self.masks.held(limb, grippers[limb])
            if sample in LINKS_AT:
                there = self.masks.apart(there, grippers, (limb,))
            if not there.any():
                return []
        numbers = self._parts(after)
        new = (set(np.unique(numbers[there]).tolist()) - {0}) if there.any() else set()
        if not new or not self.footing.held_at(held, after, there & (numbers > 0)):
            return []
        return sorted(new)


def _trace(parent: dict[Node, tuple[Node, int]], node: Node) -> list[Step]:
    steps = []
    while node in parent:
        before, limb = parent[node]
        steps.append((before[0], limb, node[0]))
        node = before
    return steps[::-1]
