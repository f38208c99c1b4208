"""Whether the start's set of grips is connected to one at the goal, in the graph of all that the relaxed P1 allows.

A node is a set of grips (one for every limb, or none) with the headings at which the body may have come to be there.
Edges are single limbs that release or take hold; limbs that do so together do it one after the other here, with nothing
lost, since the smaller set bears the load alone. A limb that releases is still at its hold at the first knot in the
air, so the body reaches its grip there and is borne by the others; when it has taken hold, the body is one step
further. A part of the graph that holds the start but not the goal, or the goal but not the start, and has no way out is
a proof.
"""

import itertools
from collections import deque
from dataclasses import dataclass, field

import numpy as np

from crux_planner.certificates.infeasibility.relaxed import RelaxedBalance, RelaxedReach
from crux_planner.model.arrays import Array, Flags
from crux_planner.model.contacts import Grip
from crux_planner.model.shapes import PalmShape
from crux_planner.solvers import clock
from crux_planner.swing.swing import palm_gap

AIR = -1
MOST_GOALS = 1000  # stances at the goal from which the graph is searched back, too
CLEARANCE_M = 0.0025  # of palms: the check asks for 3 mm, also while no limb moves, and forgives a little
WINDOW_RAD = 0.2  # headings whose body positions are asked for balance at once
Grips = tuple[int, ...]
"""A grip for every limb, or AIR."""


class _NotShownError(Exception):
    """The work or the time for the proof is over."""


@dataclass
class _Support:
    """What is known of the balance on one set of grips."""

    places: list[Array] = field(default_factory=list)  # body positions in balance
    lacking: list[tuple[Array, Array]] = field(default_factory=list)  # boxes without one


@dataclass
class Part:
    """The nodes known on one side, each with the headings (B,) reached, and those still to look at."""

    forward: bool  # from the start; else from the goal back
    headings: dict[Grips, Flags] = field(default_factory=dict)
    queue: deque[Grips] = field(default_factory=deque)
    waiting: set[Grips] = field(default_factory=set)

    def add(self, node: Grips, reached: Flags) -> bool:
        """Note headings of a node; whether some are new."""
        known = self.headings.get(node)
        if known is not None and not (reached & ~known).any():
            return False
        self.headings[node] = reached if known is None else known | reached
        if node not in self.waiting:
            self.queue.append(node)
            self.waiting.add(node)
        return True

    def take(self) -> Grips:
        """The next node to look at."""
        node = self.queue.popleft()
        self.waiting.discard(node)
        return node


class Connection:
    """The graph of one problem; `apart` (G, G): grips that two limbs may have at once."""

    def __init__(self, reach: RelaxedReach, equilibrium: RelaxedBalance, apart: Flags, step_m: float) -> None:
        self.reach, self.equilibrium, self.apart, self.step_m = reach, equilibrium, apart, step_m
        self._supports: dict[Grips, _Support] = {}
        self._programs, self._deadline = 0, np.inf
        self._window = max(1, round(WINDOW_RAD / reach.bin_rad))

    def separated(self, start: Grips, goals: list[Grips], programs: int, deadline: float) -> Part | None:
        """The part, from the start or from the goals back, that has no way out; None: they meet, or so many programs
        for balance or the time (clock.now) until `deadline` do not show it.
        """
        self._programs, self._deadline = programs, deadline
        try:
            return self._separated(start, goals)
        except _NotShownError:
            return None

    def _separated(self, start: Grips, goals: list[Grips]) -> Part | None:
        yaws = np.abs(self.reach.all.yaw_rad)
        forward, backward, ends = Part(True), Part(False), set(goals)
        if start in ends:
            return None
        forward.add(start, self._spread(start, yaws <= yaws.min() + self.reach.bin_rad))
        both = len(goals) <= MOST_GOALS
        for goal in goals if both else []:
            backward.add(goal, self._spread(goal, self.reach.at_goal_yaw))
        while True:
            here = backward if both and len(backward.queue) < len(forward.queue) else forward
            there = forward if here is backward else backward
            if not here.queue:
                return here
            self._look_at_the_time()
            for node, reached in self._neighbours(here, here.take()):
                meeting = there.headings.get(node)
                if (meeting is not None and (meeting & reached).any()) or (not both and node in ends):
                    return None
                here.add(node, reached)

    def _look_at_the_time(self) -> None:
        if self._programs <= 0 or clock.now() > self._deadline:
            raise _NotShownError

    def _spread(self, node: Grips, seeds: Flags) -> Flags:
        """The headings that are had from `seeds` by turning on the spot."""
        fits = self.reach.all.fits(node)[0]
        return _joined(fits, seeds & fits, self.reach.hop)

    def _neighbours(self, part: Part, node: Grips) -> list[tuple[Grips, Flags]]:
        found = []
        reached = part.headings[node]
        _, low, high = self.reach.all.fits(node)
        free = self.apart[[g for g in node if g != AIR]].all(axis=0)
        near = _widened(reached, self.reach.hop)
        for limb in range(4):
            if node[limb] != AIR:  # letting go, or seen backwards, the moment before it took hold
                fewer = (*node[:limb], AIR, *node[limb + 1 :])
                borne = self._borne(fewer, reached, low, high, 0.0 if part.forward else self.step_m)
                if borne.any():
                    found.append((fewer, self._spread(fewer, _widened(borne, self.reach.hop))))
                continue
            all_ = self.reach.all
            lows = np.maximum(low[:, None], all_.low[:, limb])  # (B, G, 2)
            highs = np.minimum(high[:, None], all_.high[:, limb])
            may = (lows <= highs).all(axis=2) & near[:, None] & free
            for grip in map(int, np.flatnonzero(may.any(axis=0))):
                more = (*node[:limb], grip, *node[limb + 1 :])
                known = part.headings.get(more)
                seeds = may[:, grip] if known is None else may[:, grip] & ~known
                if not seeds.any():
                    continue
                step = self.step_m if part.forward else 0.0
                borne = self._borne(node, seeds, lows[:, grip], highs[:, grip], step)
                if borne.any():
                    found.append((more, self._spread(more, borne)))
        return found

    def _borne(self, node: Grips, bins: Flags, low: Array, high: Array, step_m: float) -> Flags:
        """Which of these headings leave a body position within a step of soles in [low, high], borne by `node`."""
        support = tuple(sorted(g for g in node if g != AIR))
        result = np.zeros_like(bins)
        at = np.flatnonzero(bins)
        for window in np.split(at, np.flatnonzero(np.diff(at // self._window)) + 1):
            mask = np.zeros_like(bins)
            mask[window] = True
            box = self.reach.region(mask, low, high)
            if self._balanced(support, box[0] - step_m, box[1] + step_m):
                result |= mask
        return result

    def _balanced(self, support: Grips, low: Array, high: Array) -> bool:
        if not support:
            return False
        known = self._supports.setdefault(support, _Support())
        if any((low <= place).all() and (place <= high).all() for place in known.places):
            return True
        if any((box[0] <= low).all() and (high <= box[1]).all() for box in known.lacking):
            return False
        self._look_at_the_time()
        self._programs -= 1
        place = self.equilibrium.place(support, low, high)
        if place is None:
            known.lacking.append((low, high))
            return False
        known.places.append(place)
        return True


def _widened(bins: Flags, hop: int) -> Flags:
    """Bins within `hop` of some of `bins`."""
    return np.convolve(bins, np.ones(2 * hop + 1))[hop : hop + len(bins)] > 0.5


def _joined(fits: Flags, seeds: Flags, hop: int) -> Flags:
    """The bins that fit and are had from the seeds by jumps of at most `hop` bins."""
    at = np.flatnonzero(fits)
    result = np.zeros_like(fits)
    for run in np.split(at, np.flatnonzero(np.diff(at) > hop) + 1):
        result[run] = seeds[run].any()
    return result


def largest_gap(a: Grip, b: Grip, palm: PalmShape) -> float:
    """Most plan-view distance [m] of two palms: at the ends of the faces, for distance is convex in where they are."""
    ends = itertools.product((-1.0, 1.0), repeat=2)
    return max(palm_gap(_palm(a, x, palm), _palm(b, y, palm), palm.half_width) for x, y in ends)


def clashes(grips: list[Grip], palm: PalmShape | None) -> Flags:
    """(G, G) pairs of grips that no two limbs hold at once: palms would be in each other wherever on the faces."""
    count = len(grips)
    result = np.zeros((count, count), dtype=bool)
    if palm is None:
        return result
    centres = np.array([g.contact.centre_h_m[:2] for g in grips]).reshape(count, 2)
    way = np.linalg.norm(centres[:, None] - centres, axis=2)
    near = way < 2 * np.hypot(palm.half_length, palm.half_width) + CLEARANCE_M
    for i, j in np.argwhere(np.triu(near, 1)):
        a, b = grips[i], grips[j]
        over = max(a.height_m[1] - b.height_m[0], b.height_m[1] - a.height_m[0])  # one palm above the other
        if a.contact.hold == b.contact.hold or over >= palm.height + CLEARANCE_M:
            continue
        result[i, j] = result[j, i] = largest_gap(a, b, palm) < CLEARANCE_M
    return result


def _palm(grip: Grip, share: float, palm: PalmShape) -> Array:
    contact = grip.contact
    x, y, _ = contact.centre_h_m + share * grip.aside_m * contact.tangent
    return np.array([[x, y, contact.yaw_rad, palm.half_length]])
