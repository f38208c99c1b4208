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
from crux_contracts import LIMB_NAMES

from crux_planner.model.arrays import Flags, Indices
from crux_planner.model.schedule import Contacts, Stance, stance_after
from crux_planner.reach.body_grid import parts
from crux_planner.search.footing import Footing
from crux_planner.search.pose_masks import Gripper, PoseMasks, gripper, grown
from crux_planner.search.stances import MOVE_COST, STANCE_KNOTS, move_cost
from crux_planner.solvers import clock
from crux_planner.swing.swing import least_intervals
from crux_planner.swing.swing_cache import SwingCache

GREED = 2.0  # knots to go count so much against those made
_FAR_M = 1.2  # between contacts of one limb, beyond which no pose has both in reach
_LOST = 1000.0  # knots to go from a contact that no hops lead on from: such stances come last
AMPLE, STRAIN_KNOTS = 200, 3.0  # poses on a stance that are enough, and what half as many cost
_SAME = 1e-6
_NEAR_M = 0.4  # of grippers that may be in each other's way
LEAST_SAMPLES = 6  # intervals of a swing that are looked at
_GOALS = 40  # stances at the goal that are looked at for one that is held

Node = tuple[Stance, int]
Step = tuple[Stance, int, Stance]
"""The stance before, the limb, the stance after."""
Left = tuple[Stance, int, Stance | None]
"""A step that is left out, or all of a limb from a stance."""


@dataclass(frozen=True)
class Swing:
    """A limb that may go to a contact: not looked at closely yet."""

    before: Node
    limb: int
    end: int
    lift: Flags  # where the body may be when it lifts off
    free: Flags  # and meanwhile, as far as the other limbs are concerned
    spare: int  # number of these poses from which it also has its end in reach

    @property
    def after(self) -> Stance:
        return stance_after(self.before[0], (self.limb,), (self.end,))

    @property
    def held(self) -> Contacts:
        """Of the limbs that stay."""
        return tuple(c if limb != self.limb else None for limb, c in enumerate(self.before[0]))


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
        self._hop = away < _FAR_M
        self._least = least_intervals(problem.contacts, problem.swing)
        self._open: dict[tuple[Node, int], bool] = {}
        self.nearest: Node | None = None  # to the goal, of all that were stood on

    @cached_property
    def _usable(self) -> list[list[int]]:
        """Contacts that a limb has in reach from some pose, limb by limb."""
        held = self.masks.held
        return [[c for c in own if held(limb, self.masks.at(c)).any()] for limb, own in enumerate(self._mine)]

    def find(self, without: Collection[Left], most: int, deadline: float, moves: bool = False) -> list[Step] | None:
        """Moves to the goal, none of `without` among them, and with `moves` one at least; None where `most` looks at
        moves, or the time, find none.
        """
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
                lifted = each.before[0], each.limb
                if (*lifted, each.after) in without or (*lifted, None) in without:
                    continue
                way = each.before[0][each.limb], each.end
                if self.swings.swing(*way) is None:
                    continue
                then = cost + move_cost(self.swings, [way]) + _strain(each)
                promised, rank = rank, then + GREED * self.ahead(each.after)
                if rank > promised + _SAME:  # the way is longer than it seemed
                    heapq.heappush(queue, (rank, True, next(count), cost, each))
                    continue
                if not self._lifts_off(each):
                    continue
                most, cost = most - 1, then
                for part in self._landed(each):
                    node = each.after, part
                    if cost < best.get(node, np.inf):
                        best[node], parent[node] = cost, (each.before, each.limb)
                        heapq.heappush(queue, (rank, False, next(count), cost, node))
                continue
            if each in done:
                continue
            done.add(each)
            if self.nearest is None or self.ahead(each[0]) < self.ahead(self.nearest[0]):
                self.nearest = each
            if self._ends(each) and (each in parent or not moves):
                return _trace(parent, each)
            for swing in self._swings(each):
                least = self._least[swing.before[0][swing.limb], swing.end] + STANCE_KNOTS + MOVE_COST + _strain(swing)
                rank = cost + least + GREED * self.ahead(swing.after)
                heapq.heappush(queue, (rank, True, next(count), cost, swing))  # after nodes that promise as much
        return None

    def _parts(self, stance: Stance) -> Indices:
        """Numbers of the connected parts of a stance's poses."""
        if stance not in self._labels:
            grippers = [self.masks.at(c) for c in stance]
            self._labels[stance] = parts(self.masks.apart(self.masks.hold(stance), grippers))[0]
        return self._labels[stance]

    def poses(self, stance: Stance) -> Flags:
        """From which all limbs hold a stance, off each other."""
        return np.asarray(self._parts(stance) > 0)

    @cached_property
    def goals(self) -> Indices:
        """Stances (n, 4) of contacts on which a body at the goal may stand, every limb in reach and off the others."""
        ends = self._ends_at_goal
        if not all(ends):
            return np.zeros((0, 4), dtype=int)
        stances = np.array(ends[0], dtype=int).reshape(-1, 1)
        for limb in range(1, 4):
            stances = np.column_stack([np.repeat(stances, len(ends[limb]), axis=0), np.tile(ends[limb], len(stances))])
            for other in range(limb):
                rows, columns = (np.searchsorted(ends[i], stances[:, i]) for i in (other, limb))
                stances = stances[self._apart_at_goal(other, limb)[rows, columns]]
        return stances

    @cached_property
    def held_at_goal(self) -> bool:
        """Whether motors and friction hold a body at the goal on one of its stances, of some that are looked at."""
        cell = tuple(np.argwhere(self.masks.goal)[0].tolist())
        some = np.linspace(0, len(self.goals) - 1, min(_GOALS, len(self.goals))).astype(int)
        stances = [stance_after((0, 0, 0, 0), (0, 1, 2, 3), self.goals[i].tolist()) for i in some]
        return any(self.footing.strong_at(stance, stance, cell) for stance in stances)

    @cached_property
    def _ends_at_goal(self) -> list[list[int]]:
        """Contacts on which each limb may end, and which a body at the goal has in its reach."""
        problem = self.problem
        may = [[c for c in own if problem.may_end(limb, problem.contacts[c])] for limb, own in enumerate(self._mine)]
        return [self.masks.held_at_goal(limb, own) for limb, own in enumerate(may)]

    def _apart_at_goal(self, one: int, two: int) -> Flags:
        """(n, m) for the contacts of two limbs there: whether the limbs and their hands are off each other."""
        ends = self._ends_at_goal
        apart = self.masks.apart_at_goal((one, ends[one]), (two, ends[two]))
        for i, j in np.argwhere(apart & self._near[np.ix_(ends[one], ends[two])]):
            apart[i, j] = self.swings.apart(ends[one][i], ends[two][j])
        return apart

    @property
    def idle_at_goal(self) -> list[str]:
        """The limbs that have no hold in reach there."""
        return [name for name, ends in zip(LIMB_NAMES, self._ends_at_goal, strict=True) if not ends]

    def missing_at_goal(self) -> str:
        """Why there are no `goals`, in words."""
        if idle := self.idle_at_goal:
            return f"no hold for {' and '.join(idle)} with a margin to joint limits and the trunk"
        for one, two in itertools.combinations(range(4), 2):
            if not self._apart_at_goal(one, two).any():
                return f"no holds for {LIMB_NAMES[one]} and {LIMB_NAMES[two]} on which these are off each other"
        return "no four holds on which all limbs are off each other"

    @cached_property
    def _to_go(self) -> list[dict[int, float]]:
        """Of each limb, the knots from each contact to the goal in hops between contacts that some pose has both in
        reach.
        """
        return [self._hops_to_go(limb, np.unique(self.goals[:, limb]).tolist()) for limb in range(4)]

    def _hops_to_go(self, limb: int, ends: list[int]) -> dict[int, float]:
        """The swings of the shortest hops alone are worked out, those that they are not shorter than for certain."""
        usable, cost = np.array(self._usable[limb], dtype=int), dict[int, float]()
        held = np.array([np.packbits(self.masks.held(limb, self.masks.at(c))) for c in usable])
        queue = [(0.0, c, -1) for c in ends]  # -1: exactly so many knots; else least, by a hop to a contact
        while queue:
            knots, c, to = heapq.heappop(queue)
            if c in cost:
                continue
            if to >= 0 and self.swings.swing(c, to) is not None:
                heapq.heappush(queue, (cost[to] + move_cost(self.swings, [(c, to)]), c, -1))
            if to >= 0:
                continue
            cost[c] = knots
            meet = (held & held[np.searchsorted(usable, c)]).any(axis=1) & self._hop[usable, c]
            for other in usable[meet].tolist():
                if other not in cost:
                    heapq.heappush(queue, (knots + self._least[other, c] + STANCE_KNOTS + MOVE_COST, other, c))
        return cost

    def ahead(self, stance: Stance) -> float:
        """Knots from a stance to the goal's, about: each limb in hops, one after the other."""
        return sum(far.get(c, _LOST) for far, c in zip(self._to_go, stance, strict=True))

    def _ends(self, node: Node) -> bool:
        stance, part = node
        if not (self.goals == stance).all(axis=1).any():
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
                fits = self._hop[stance[limb], end] and self.problem.contacts[end].hold not in holds
                spare = int(np.count_nonzero(free & self.masks.held(limb, self.masks.at(end)))) if fits else 0
                if spare and end != stance[limb]:
                    found.append(Swing(node, limb, end, lift, free, spare))
        return found

    def stuck(self, node: Node) -> str:
        """What keeps each limb on a node, in words."""
        swings, kept = self._swings(node), list[str]()
        for limb in self.problem.may_move(node[0]):
            mine = [swing for swing in swings if swing.limb == limb]
            held: Contacts = tuple(c if other != limb else None for other, c in enumerate(node[0]))
            stands = self.footing.stands(held, self._places[list(node[0])].mean(axis=0))
            if stands is None or not (stands & (self._parts(node[0]) == node[1])).any():
                why = "has to stay for the balance"
            elif not mine:
                why = "has no other hold in reach"
            elif not any(self._lifts_off(swing) for swing in mine):
                why = "has to stay, motors are too weak without it"
            else:
                why = "gets to no hold that leads on"
            kept.append(f"{LIMB_NAMES[limb]} {why}")
        return "; ".join(kept)

    def _landed(self, swing: Swing) -> list[int]:
        """The parts of the stance after a swing in which the body may come to be."""
        (stance, _), limb, end, after = swing.before, swing.limb, swing.end, swing.after
        if not self.swings.free([(stance[limb], end)], tuple(c for c in swing.held if c is not None)):
            return []
        way = self.swings.way(stance[limb], end)
        there, grippers = swing.lift, [self.masks.at(c) for c in stance]
        others: list[Gripper | None] = [at if other != limb else None for other, at in enumerate(grippers)]
        for pose in way.poses(max(LEAST_SAMPLES, way.intervals)):
            grippers[limb] = gripper(pose)
            there = self.masks.held_within(grown(there) & swing.free, limb, grippers[limb])
            there = self.masks.apart(self.masks.apart(there, others), grippers, (limb,))
            if self.masks.grid.tilts:
                there = self.footing.strong_blocks(swing.held, stance, there)
            if not there.any():
                return []
        numbers = self._parts(after)
        new = (set(np.unique(numbers[there]).tolist()) - {0}) if there.any() else set()
        if not new or not self.footing.held_at(swing.held, after, there & (numbers > 0)):
            return []
        return sorted(new)

    def _lifts_off(self, swing: Swing) -> bool:
        """Whether motors hold the body somewhere as the limb lifts off."""
        key = swing.before, swing.limb
        if key not in self._open:
            self._open[key] = self.footing.held_at(swing.held, swing.before[0], swing.lift)
        return self._open[key]


def _strain(swing: Swing) -> float:
    """Knots that a move counts for besides: more where it leaves the body few poses."""
    return STRAIN_KNOTS * max(0.0, float(np.log2(AMPLE / swing.spare)))


def _trace(parent: dict[Node, tuple[Node, int]], node: Node) -> list[Step]:
    steps = []
    while node in parent:
        before, limb = parent[node]
        steps.append((before[0], limb, node[0]))
        node = before
    return steps[::-1]
