"""Every set of grasps that the limbs may hold at once, with the boxes of the body's position that it leaves.

A limb's options are groups of contacts: all that a face pair offers; a group costs what the cheapest of its contacts
does.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from crux_contracts.compiled import doubles, integers

from crux_planner.certificates.bound import native
from crux_planner.certificates.bound.places import Orientations, body_boxes, shoulder_to_wrist, shoulders
from crux_planner.certificates.bound.swings import distinct, ends
from crux_planner.model.arrays import Array, Flags, Indices
from crux_planner.model.problem import Problem

_PAIRS = 25  # of a node, where memory allows
MOST_IN_AIR = 3  # with nothing in hand, nothing carries the robot

Groups = list[list[Indices]]
"""Per limb the groups of contacts, that of the start first; a group is on one hold."""


@dataclass(frozen=True)
class Grasps:
    """Sets of grasps, called nodes: one option a limb, a group of contacts or, as the last one, the air.

    Boxes are those of (9a), one for each pair of a node and a cell of yaw in which it can be held; the pairs of a node
    follow one another.
    """

    groups: Groups
    options: Indices  # (n, 4) into `groups`, len(groups[limb]) is the air
    first: Indices  # (n,) first pair of a node
    node: Indices  # (P,) of a pair
    cell: Indices  # (P,)
    low: Array  # (P, 3)
    high: Array
    rest: Array | None = None  # (P, T, 2, 3) of the centre of mass by bound.centre_of_mass, where `known` (P,)
    known: Flags | None = None

    @property
    def in_air(self) -> Indices:
        """Number of limbs in the air (n,)."""
        many = np.array([len(own) for own in self.groups])
        return np.asarray((self.options == many).sum(axis=1))

    @property
    def start(self) -> int | None:
        """The node of the start's grasps, None where it is left out."""
        found = np.flatnonzero((self.options == 0).all(axis=1))
        return int(found[0]) if len(found) else None

    def ending(self, problem: Problem) -> Indices:
        """The nodes a climb may end on."""
        ok = np.ones(len(self.options), dtype=bool)
        for limb, own in enumerate(self.groups):
            last = [i for i, group in enumerate(own) if len(ends(problem, limb, group))]
            ok &= np.isin(self.options[:, limb], last)
        return np.flatnonzero(ok)

    def reduced(self, kept: Flags, pairs: Flags | None = None) -> Grasps:
        """Only these nodes, of the `pairs` (P,) only these, and of the groups only those that some of them hold, the
        first of each limb always.
        """
        options, lists = self.options[kept], []
        columns = []
        for limb, groups in enumerate(self.groups):
            used = np.union1d([0, len(groups)], options[:, limb])
            lists.append([groups[i] for i in used[:-1]])
            columns.append(np.searchsorted(used, options[:, limb]))
        of_kept = kept[self.node] if pairs is None else kept[self.node] & pairs
        node = np.cumsum(kept)[self.node[of_kept]] - 1
        first = np.searchsorted(node, np.arange(len(options)))
        low, high = self.low[of_kept], self.high[of_kept]
        rest, known = (
            None if self.rest is None else self.rest[of_kept],
            None if self.known is None else self.known[of_kept],
        )
        return Grasps(lists, np.column_stack(columns), first, node, self.cell[of_kept], low, high, rest, known)

    def held(self, node: int) -> dict[int, int]:
        """Limb -> the first contact of its group."""
        options = enumerate(self.options[node])
        return {limb: int(self.groups[limb][i][0]) for limb, i in options if i < len(self.groups[limb])}

    def cheapest(self, limb: int, of_contacts: Array) -> Array:
        """The least of a group's contacts, by options; 0 for the air."""
        own = self.groups[limb]
        first = np.cumsum([0, *(len(group) for group in own[:-1])])
        return np.append(np.minimum.reduceat(of_contacts[np.concatenate(own)], first), 0.0)


def by_faces(problem: Problem) -> Groups:
    """What each face pair of each hold offers a group: one grasp in the middle, or several along it."""
    groups: Groups = []
    for limb in range(4):
        alike: dict[tuple[int, int], list[int]] = {}
        for c in distinct(problem, limb):
            contact = problem.contacts[c]
            alike.setdefault((contact.hold, contact.pair), []).append(int(c))
        groups.append([np.array(own) for own in alike.values()])
    return groups


def grasps(
    problem: Problem, about: Orientations, low: Array, high: Array, groups: Groups, most: int = 2**31
) -> Grasps | None:
    """All nodes whose limbs' boxes meet within [low, high], up to MOST_IN_AIR in the air; None for more than `most`."""
    box_low, box_high = body_boxes(problem, about)
    shift = np.array([about.shift_m[-1], about.shift_m[-1], 0.0])
    box_low, box_high = np.maximum(box_low, low - shift), np.minimum(box_high, high + shift)
    cells = len(about.yaw_low)
    anywhere = [np.broadcast_to(end, (1, cells, 3)) for end in (low - shift, high + shift)]
    groups = [list(own) for own in groups]
    options, in_air = np.zeros((1, 0), dtype=int), np.zeros(1, dtype=int)
    first, count, cell = np.zeros(1, dtype=int), np.full(1, cells), np.arange(cells)  # pairs of a node, and theirs
    pair_low, pair_high = anywhere[0][0], anywhere[1][0]
    holds = []
    for limb in range(4):
        lows = np.stack([box_low[limb, own].min(axis=0) for own in groups[limb]])
        highs = np.stack([box_high[limb, own].max(axis=0) for own in groups[limb]])
        reached = (lows <= highs + 2 * shift).all(axis=2).any(axis=1)
        reached[0] = True  # the start's whatever happens
        groups[limb] = [own for own, some in zip(groups[limb], reached, strict=True) if some]
        lows, highs = np.concatenate([lows[reached], anywhere[0]]), np.concatenate([highs[reached], anywhere[1]])
        holds.append(np.array([*(problem.contacts[own[0]].hold for own in groups[limb]), -1 - limb]))
        old, own = (i.ravel() for i in np.indices((len(options), len(holds[limb]))))
        aloft = in_air[old] + (own == len(groups[limb]))
        kept = aloft <= MOST_IN_AIR
        for other in range(limb):
            kept &= holds[other][options[old, other]] != holds[limb][own]
        over_low = np.maximum(np.minimum.reduceat(pair_low, first)[old], lows.min(axis=1)[own])  # over all cells
        over_high = np.minimum(np.maximum.reduceat(pair_high, first)[old], highs.max(axis=1)[own])
        kept &= (over_low <= over_high + 2 * shift).all(axis=1)
        old, own, aloft = old[kept], own[kept], aloft[kept]
        many = count[old]
        if len(old) > most or many.sum() > _PAIRS * most:
            return None
        node = np.repeat(np.arange(len(old)), many)
        pair = np.arange(len(node)) + np.repeat(first[old] - (np.cumsum(many) - many), many)
        cell = cell[pair]
        pair_low = np.maximum(pair_low[pair], lows[own[node], cell])
        pair_high = np.minimum(pair_high[pair], highs[own[node], cell])
        meet = (pair_low <= pair_high + 2 * shift).all(axis=1)
        node, cell, pair_low, pair_high = node[meet], cell[meet], pair_low[meet], pair_high[meet]
        count = np.bincount(node, minlength=len(old))
        kept = count > 0
        count, options, in_air = count[kept], np.column_stack([options[old], own])[kept], aloft[kept]
        first = np.cumsum(count) - count
    node = np.repeat(np.arange(len(options)), count)
    return _stretched(problem, about, Grasps(groups, options, first, node, cell, pair_low, pair_high))


def _stretched(problem: Problem, about: Orientations, nodes: Grasps) -> Grasps:
    """The boxes within a stretched limb's length of all shoulders, which takes their corners off."""
    least, most = about.shift_m[0], about.shift_m[-1]  # of tilts: what a box may lose, and where bodies may be
    low, high = nodes.low.copy(), nodes.high.copy()
    places = np.stack([contact.centre_h_m[:2] for contact in problem.contacts])
    kept, limbs = [], []
    for limb, groups in enumerate(nodes.groups):
        off, wide = shoulders(problem, about, limb)
        ends = [np.array([pick(places[group], axis=0) for group in groups]) for pick in (np.min, np.max)]
        kept.append((*ends, off, (shoulder_to_wrist(problem.limb_masses[limb].limb)[1] + wide) ** 2))
        limbs.append(native.StretchedLimb(len(groups), *map(doubles, kept[-1])))
    options = np.ascontiguousarray(nodes.options)
    whole = [integers(each) for each in (nodes.node, nodes.cell, options)]
    given = float(least), float(most), len(nodes.node), *whole, doubles(low), doubles(high)
    native.needed().crux_stretched((native.StretchedLimb * 4)(*limbs), *given)
    reached = (low <= high + 2 * np.array([most, most, 0.0])).all(axis=1)
    return replace(nodes, low=low, high=high).reduced(np.logical_or.reduceat(reached, nodes.first), reached)
