"""Every set of grasps that the limbs may hold at once, with the boxes of the body's position that it leaves."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from crux_planner.arrays import Array, Flags, Indices
from crux_planner.bound.places import Orientations, body_boxes
from crux_planner.bound.swings import distinct
from crux_planner.problem import Problem

MOST_IN_AIR = 3  # with nothing in hand, nothing carries the robot


@dataclass(frozen=True)
class Grasps:
    """Sets of grasps, called nodes: one option a limb, a contact out of its list or, as the last one, the air.

    Boxes are those of (9a), one for each pair of a node and a cell of yaw in which it can be held; the pairs of a node
    follow one another.
    """

    contacts: list[Indices]  # per limb; contacts that differ by the swap of the fingers only once
    options: Indices  # (n, 4) into `contacts`, len(contacts[limb]) is the air
    first: Indices  # (n,) first pair of a node
    node: Indices  # (P,) of a pair
    cell: Indices  # (P,)
    low: Array  # (P, 3)
    high: Array

    @property
    def shape(self) -> tuple[int, ...]:
        """Options a limb."""
        return tuple(len(c) + 1 for c in self.contacts)

    @property
    def in_air(self) -> Indices:
        """Number of limbs in the air (n,)."""
        many = np.array([len(c) for c in self.contacts])
        return np.asarray((self.options == many).sum(axis=1))

    def reduced(self, kept: Flags) -> Grasps:
        """Only these nodes, and of the contacts only those that some of them hold, the first of each limb always."""
        options, lists = self.options[kept], []
        columns = []
        for limb, contacts in enumerate(self.contacts):
            used = np.union1d([0, len(contacts)], options[:, limb])
            lists.append(contacts[used[:-1]])
            columns.append(np.searchsorted(used, options[:, limb]))
        of_kept = kept[self.node]
        node = np.cumsum(kept)[self.node[of_kept]] - 1
        first = np.searchsorted(node, np.arange(len(options)))
        low, high = self.low[of_kept], self.high[of_kept]
        return Grasps(lists, np.column_stack(columns), first, node, self.cell[of_kept], low, high)

    def held(self, node: int) -> dict[int, int]:
        """Limb -> contact."""
        return {
            limb: int(self.contacts[limb][i])
            for limb, i in enumerate(self.options[node])
            if i < len(self.contacts[limb])
        }


def grasps(problem: Problem, about: Orientations, low: Array, high: Array) -> Grasps:
    """All nodes whose limbs' boxes meet within [low, high], with at most MOST_IN_AIR limbs in the air."""
    box_low, box_high = body_boxes(problem, about)
    shift = np.array([about.shift_m[-1], about.shift_m[-1], 0.0])
    box_low, box_high = np.maximum(box_low, low - shift), np.minimum(box_high, high + shift)
    reached = (box_low <= box_high + 2 * shift).all(axis=3).any(axis=2)  # (4, C)
    contacts = []
    for limb in range(4):
        own = distinct(problem, limb)
        contacts.append(own[np.append(True, reached[limb, own[1:]])])  # the start's whatever happens
    anywhere = [np.broadcast_to(end, (1, len(about.yaw_low), 3)) for end in (low - shift, high + shift)]
    lows = [np.concatenate([box_low[limb, own], anywhere[0]]) for limb, own in enumerate(contacts)]
    highs = [np.concatenate([box_high[limb, own], anywhere[1]]) for limb, own in enumerate(contacts)]
    holds = [np.array([*(problem.contacts[c].hold for c in own), -1 - limb]) for limb, own in enumerate(contacts)]
    options, in_air = np.zeros((1, 0), dtype=int), np.zeros(1, dtype=int)
    node_low, node_high = anywhere
    for limb in range(4):
        old, own = (i.ravel() for i in np.indices((len(options), len(holds[limb]))))
        in_air = in_air[old] + (own == len(contacts[limb]))
        kept = in_air <= MOST_IN_AIR
        for other in range(limb):
            kept &= holds[other][options[old, other]] != holds[limb][own]
        old, own, in_air = old[kept], own[kept], in_air[kept]
        node_low = np.maximum(node_low[old], lows[limb][own])
        node_high = np.minimum(node_high[old], highs[limb][own])
        meet = (node_low <= node_high + 2 * shift).all(axis=2)
        kept = meet.any(axis=1)
        options = np.column_stack([options[old], own])[kept]
        in_air, node_low, node_high, meet = in_air[kept], node_low[kept], node_high[kept], meet[kept]
    node, cell = np.nonzero(meet)
    first = np.searchsorted(node, np.arange(len(options)))
    return Grasps(contacts, options, first, node, cell, node_low[meet], node_high[meet])
