"""One contact sequence for all limbs: the projection of P3 for the discrete part z, which (17) cannot average.

Each limb's MIP gives prices of its contacts and swings; taken alone their cheapest paths may leave the robot without
balance, let two grippers meet or put them on one hold. Conflict-based search finds the cheapest paths that agree:
where limbs are in conflict, it is resolved in turn at the expense of each of them, best first.
"""

from __future__ import annotations

import heapq
import itertools
import time
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from crux_planner.admm.limb_paths import LimbPaths, Path
from crux_planner.admm.stages import Stages, Swinging
from crux_planner.arrays import Array, Flags
from crux_planner.errors import InfeasibleError
from crux_planner.problem import LIMBS
from crux_planner.search.balance import Balance

_MOST_AT_ONCE = 2


@dataclass(frozen=True)
class Prices:
    """Of one limb: each contact through each stage (S, C), each arc (A,)."""

    held: Array
    arcs: Array


@dataclass(frozen=True)
class Fact:
    """What a limb does: takes arc `arc`; or else, through stage `stage`, holds `contact` or (None) is in the air."""

    limb: int
    stage: int = -1
    contact: int | None = None
    arc: int | None = None


@dataclass(frozen=True)
class _Stand:
    """A limb on a contact from stage `first` until it lets go in stage `last`, by `leaving` if not for good."""

    contact: int
    first: int
    last: int
    leaving: int | None


Sound = Callable[[list[Swinging]], bool]
"""Whether swings that agree stage by stage leave a motion over all knots."""


class Agreement:
    """The limbs of one problem."""

    def __init__(self, stages: Stages, balance: Balance) -> None:
        self.stages, self.balance = stages, balance
        self.paths = [LimbPaths(stages, limb) for limb in range(len(LIMBS))]
        self.at_once = 1  # limbs in the air together; more only where the wall or the time leave no other way
        self.nodes = 0
        self._sound: dict[tuple[tuple[int, ...], ...], bool] = {}

    def cheapest(self, prices: list[Prices], sound: Sound, deadline: float) -> list[Path]:
        """The cheapest paths, one a limb, that agree and are `sound`. Raises InfeasibleError."""
        while (paths := self._cheapest(prices, sound, deadline)) is None:
            if self.at_once == _MOST_AT_ONCE:
                raise InfeasibleError("contacts", "no contact sequence on the stages of the limbs' blocks suits all")
            self.at_once += 1
        return paths

    def _cheapest(self, prices: list[Prices], sound: Sound, deadline: float) -> list[Path] | None:
        order = itertools.count()
        first = [paths.shortest(own.held, own.arcs) for paths, own in zip(self.paths, prices, strict=True)]
        for limb, path in enumerate(first):
            if not np.isfinite(path.cost):
                raise InfeasibleError("contacts", f"{LIMBS[limb]} finds no chain of holds on the stages of its block")
        none: tuple[frozenset[Fact], ...] = (frozenset(),) * len(LIMBS)
        queue = [(sum(path.cost for path in first), next(order), first, none)]
        while queue and time.monotonic() < deadline:
            self.nodes += 1
            cost, _, chosen, forbidden = heapq.heappop(queue)
            conflict = self._conflict(chosen, sound)
            if conflict is None:
                return chosen
            for fact in conflict:
                limb = fact.limb
                less = forbidden[limb] | {fact}
                path = self.paths[limb].shortest(*self._without(limb, prices[limb], less))
                if np.isfinite(path.cost):
                    paths = [path if other == limb else old for other, old in enumerate(chosen)]
                    rest = tuple(less if other == limb else old for other, old in enumerate(forbidden))
                    heapq.heappush(queue, (cost - chosen[limb].cost + path.cost, next(order), paths, rest))
        if queue:
            raise InfeasibleError("time limit", "the limbs found no contact sequence to agree on in the time allowed")
        return None

    def swings(self, paths: list[Path]) -> list[Swinging]:
        """All limbs' swings."""
        return [swing for own, path in zip(self.paths, paths, strict=True) for swing in own.swings(path)]

    def _without(self, limb: int, prices: Prices, facts: frozenset[Fact]) -> tuple[Array, Array]:
        held, arcs = prices.held.copy(), prices.arcs.copy()
        for fact in facts:
            if fact.arc is not None:
                arcs[fact.arc] = np.inf
            elif fact.contact is not None:
                held[fact.stage, fact.contact] = np.inf
            else:
                arcs[self.flying(limb, fact.stage)] = np.inf
        return held, arcs

    def flying(self, limb: int, stage: int) -> Flags:
        """(A,): the limb's arcs that are in the air through a stage."""
        flags: Flags = np.array([arc.first <= stage < arc.end for arc in self.paths[limb].arcs], dtype=bool)
        return flags

    def _conflict(self, paths: list[Path], sound: Sound) -> list[Fact] | None:
        """Facts of which one must not be, None where all agree."""
        facts = self._met(paths) or self._fallen(paths)
        if facts is not None:
            return facts
        key = tuple(path.arcs for path in paths)
        if key not in self._sound:
            self._sound[key] = sound(self.swings(paths))
        if self._sound[key]:
            return None
        taken = [Fact(limb, arc=i) for limb, path in enumerate(paths) for i in path.arcs]
        last = self.stages.count - 1
        stayed = [Fact(limb, last, self._stands(limb, path)[-1].contact) for limb, path in enumerate(paths)]
        return taken + [fact for fact, path in zip(stayed, paths, strict=True) if not path.arcs]

    def _stands(self, limb: int, path: Path) -> list[_Stand]:
        stands, contact, since = [], self.stages.problem.start_contacts[limb], 0
        for i in path.arcs:
            arc = self.paths[limb].arcs[i]
            stands.append(_Stand(contact, since, arc.first, i))
            contact, since = arc.goal, arc.end
        return [*stands, _Stand(contact, since, self.stages.count, None)]

    def _met(self, paths: list[Path]) -> list[Fact] | None:
        """Swings in each other's way or past a gripper that stands in theirs, and two limbs on one hold."""
        stands = [self._stands(limb, path) for limb, path in enumerate(paths)]
        contacts = self.stages.problem.contacts
        for limb, path in enumerate(paths):
            for i in path.arcs:
                arc = self.paths[limb].arcs[i]
                for other in range(len(LIMBS)):
                    if other == limb:
                        continue
                    for stand in stands[other]:
                        meet = stand.first < arc.end and arc.first <= stand.last
                        if meet and self.stages.blocks(limb, arc, other, stand.contact):
                            return [Fact(limb, arc=i), _standing(other, stand, max(arc.first, stand.first))]
                    for j in paths[other].arcs:
                        beside = self.paths[other].arcs[j]
                        meet = beside.first < arc.end and arc.first < beside.end
                        moves = [(arc.start, arc.goal), (beside.start, beside.goal)]
                        if meet and not self.stages.ways.free(moves, ()):
                            return [Fact(limb, arc=i), Fact(other, arc=j)]
        for limb, other in itertools.combinations(range(len(LIMBS)), 2):
            for one, two in itertools.product(stands[limb], stands[other]):
                begin, end = max(one.first, two.first), min(one.last, two.last)
                if begin <= end and contacts[one.contact].hold == contacts[two.contact].hold:
                    return [_standing(limb, one, begin), _standing(other, two, begin)]
        return None

    def _fallen(self, paths: list[Path]) -> list[Fact] | None:
        """A stage in which the limbs that stand leave the body no place, or no balance."""
        reach = self.stages.reach
        low_room, high_room = self.stages.body_room()
        for t in range(self.stages.count):
            facts, low, high = [], low_room, high_room
            for limb, path in enumerate(paths):
                over = [a for i in path.arcs if (a := self.paths[limb].arcs[i]).first <= t < a.end]
                held = [over[0].start, over[0].goal] if over else [self._held(limb, path, t)]
                low = np.maximum(low, reach.low[limb, held].min(axis=0))
                high = np.minimum(high, reach.high[limb, held].max(axis=0))
                facts.append(Fact(limb, t, None if over else held[0]))
            flying = [fact for fact in facts if fact.contact is None]
            if len(flying) > self.at_once:
                return flying
            support = tuple(fact.contact for fact in facts if fact.contact is not None)
            if (low > high).any() or self.balance.position(support, low, high, (low + high) / 2) is None:
                return facts
        return None

    def _held(self, limb: int, path: Path, stage: int) -> int:
        return next(s.contact for s in self._stands(limb, path)[::-1] if s.first <= stage)


def _standing(limb: int, stand: _Stand, stage: int) -> Fact:
    """That a limb stands where it does in `stage`; in the stage in which it lets go, that it does so."""
    if stage == stand.last and stand.leaving is not None:
        return Fact(limb, arc=stand.leaving)
    return Fact(limb, stage, stand.contact)
