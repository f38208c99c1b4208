"""One contact sequence for all limbs: the projection of P3 for the discrete part z, which (17) cannot average.

Each limb's MIP gives costs of its contacts and swings; taken alone their cheapest paths may leave the robot without
balance, let two grippers meet or put them on one hold. Conflict-based search finds the cheapest paths that agree:
where limbs are in conflict, it is resolved in turn at the expense of each of them, cheapest first; where that takes
too long, as where little time is left for many swings, those with the fewest conflicts first.
"""

from __future__ import annotations

import heapq
import itertools
from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
from crux_contracts import LIMB_NAMES

from crux_planner.admm.limb_paths import LimbPaths, Path
from crux_planner.admm.windows import Swinging, Windows
from crux_planner.errors import InfeasibleError
from crux_planner.model.arrays import Array
from crux_planner.search.equilibrium import StaticEquilibrium
from crux_planner.solvers import clock

_MOST_AT_ONCE = 2
_CHEAPEST_FIRST = 150  # conflicts resolved in the order of cost


@dataclass(frozen=True)
class ContactCosts:
    """Of one limb: each contact through each window (S, C), each arc (A,)."""

    held: Array
    arcs: Array


@dataclass(frozen=True)
class Fact:
    """What a limb does: takes arc `arc`; or else, through window `window`, holds `contact` or (None) is in the air."""

    limb: int
    window: int = -1
    contact: int | None = None
    arc: int | None = None


@dataclass(frozen=True)
class _Stand:
    """A limb on a contact from window `first` until it releases in window `last`, by `leaving` if not for good."""

    contact: int
    first: int
    last: int
    leaving: int | None


@dataclass(frozen=True)
class _Node:
    """Paths, one a limb, each the cheapest without what is forbidden to it."""

    paths: list[Path]
    forbidden: tuple[frozenset[Fact], ...]

    @property
    def cost(self) -> float:
        return sum(path.cost for path in self.paths)


Sound = Callable[[list[Swinging]], bool]
"""Whether swings that agree window by window leave a motion over all knots."""


class Agreement:
    """The limbs of one problem."""

    def __init__(self, windows: Windows, equilibrium: StaticEquilibrium) -> None:
        self.windows, self.equilibrium = windows, equilibrium
        self.paths = [LimbPaths(windows, limb) for limb in range(len(LIMB_NAMES))]
        self.at_once = 1  # limbs in the air together; more only where the wall or the time leave no other way
        self._flying = [
            np.array([[a.first <= t < a.end for a in paths.arcs] for t in range(windows.count)], dtype=bool)
            for paths in self.paths
        ]
        self._free: dict[tuple[tuple[int, int], tuple[int, int]], bool] = {}
        self._sound: dict[tuple[tuple[int, ...], ...], bool] = {}

    def cheapest(self, costs: list[ContactCosts], sound: Sound, deadline: float) -> list[Path]:
        """The cheapest paths, one a limb, that agree and are `sound`. Raises InfeasibleError."""
        while (paths := self._cheapest(costs, sound, deadline)) is None:
            if self.at_once == _MOST_AT_ONCE:
                raise InfeasibleError("contacts", "no contact sequence on the windows of the limbs' blocks suits all")
            self.at_once += 1
        return paths

    def _cheapest(self, costs: list[ContactCosts], sound: Sound, deadline: float) -> list[Path] | None:
        first = [paths.shortest(own.held, own.arcs) for paths, own in zip(self.paths, costs, strict=True)]
        for limb, path in enumerate(first):
            if not np.isfinite(path.cost):
                raise InfeasibleError(
                    "contacts", f"{LIMB_NAMES[limb]} finds no chain of holds on the windows of its block"
                )
        nodes = [_Node(first, (frozenset(),) * len(LIMB_NAMES))]
        by_cost, by_conflicts = [(nodes[0].cost, 0)], [(0, nodes[0].cost, 0)]
        resolved: set[int] = set()
        while len(resolved) < len(nodes) and clock.now() < deadline:
            number = heapq.heappop(by_cost)[-1] if len(resolved) < _CHEAPEST_FIRST else heapq.heappop(by_conflicts)[-1]
            if number in resolved:
                continue
            resolved.add(number)
            node = nodes[number]
            conflict = self._conflict(node.paths, sound)
            if conflict is None:
                return node.paths
            for fact in conflict:
                limb = fact.limb
                less = node.forbidden[limb] | {fact}
                path = self.paths[limb].shortest(*self._without(limb, costs[limb], less))
                if not np.isfinite(path.cost):
                    continue
                paths = [path if other == limb else old for other, old in enumerate(node.paths)]
                rest = tuple(less if other == limb else old for other, old in enumerate(node.forbidden))
                nodes.append(_Node(paths, rest))
                heapq.heappush(by_cost, (nodes[-1].cost, len(nodes) - 1))
                heapq.heappush(by_conflicts, (self._conflicts(paths), nodes[-1].cost, len(nodes) - 1))
        if len(resolved) < len(nodes):
            raise InfeasibleError("time limit", "the limbs found no contact sequence to agree on in the time allowed")
        return None

    def swings(self, paths: list[Path]) -> list[Swinging]:
        """All limbs' swings."""
        return [swing for own, path in zip(self.paths, paths, strict=True) for swing in own.swings(path)]

    def _without(self, limb: int, costs: ContactCosts, facts: frozenset[Fact]) -> tuple[Array, Array]:
        held, arcs = costs.held.copy(), costs.arcs.copy()
        for fact in facts:
            if fact.arc is not None:
                arcs[fact.arc] = np.inf
            elif fact.contact is not None:
                held[fact.window, fact.contact] = np.inf
            else:
                arcs[self._flying[limb][fact.window]] = np.inf
        return held, arcs

    def _conflict(self, paths: list[Path], sound: Sound) -> list[Fact] | None:
        """Facts of which one must not be, None where all agree."""
        facts = next(self._meetings(paths), None) or self._fallen(paths)
        if facts is not None:
            return facts
        key = tuple(path.arcs for path in paths)
        if key not in self._sound:
            self._sound[key] = sound(self.swings(paths))
        if self._sound[key]:
            return None
        taken = [Fact(limb, arc=i) for limb, path in enumerate(paths) for i in path.arcs]
        last = self.windows.count - 1
        stayed = [Fact(limb, last, self._stands(limb, path)[-1].contact) for limb, path in enumerate(paths)]
        return taken + [fact for fact, path in zip(stayed, paths, strict=True) if not path.arcs]

    def _stands(self, limb: int, path: Path) -> list[_Stand]:
        stands, contact, since = [], self.windows.problem.start_contacts[limb], 0
        for i in path.arcs:
            arc = self.paths[limb].arcs[i]
            stands.append(_Stand(contact, since, arc.first, i))
            contact, since = arc.goal, arc.end
        return [*stands, _Stand(contact, since, self.windows.count, None)]

    def _conflicts(self, paths: list[Path]) -> int:
        """How many meetings there are, and limbs too many in the air, window by window."""
        away = sum((self._flying[limb][:, list(path.arcs)].any(axis=1).astype(int) for limb, path in enumerate(paths)))
        return sum(1 for _ in self._meetings(paths)) + int(np.maximum(away - self.at_once, 0).sum())

    def _meetings(self, paths: list[Path]) -> Iterator[list[Fact]]:
        """Swings in each other's way or past a gripper that stands in theirs, and two limbs on one hold."""
        stands = [self._stands(limb, path) for limb, path in enumerate(paths)]
        contacts = self.windows.problem.contacts
        for limb, path in enumerate(paths):
            for i in path.arcs:
                arc = self.paths[limb].arcs[i]
                for other in range(len(LIMB_NAMES)):
                    if other == limb:
                        continue
                    for stand in stands[other]:
                        meet = stand.first < arc.end and arc.first <= stand.last
                        if meet and self.windows.blocks(limb, arc, other, stand.contact):
                            yield [Fact(limb, arc=i), _standing(other, stand, max(arc.first, stand.first))]
                    for j in paths[other].arcs:
                        beside = self.paths[other].arcs[j]
                        meet = beside.first < arc.end and arc.first < beside.end
                        if meet and not self._apart((arc.start, arc.goal), (beside.start, beside.goal)):
                            yield [Fact(limb, arc=i), Fact(other, arc=j)]
        for limb, other in itertools.combinations(range(len(LIMB_NAMES)), 2):
            for one, two in itertools.product(stands[limb], stands[other]):
                begin, end = max(one.first, two.first), min(one.last, two.last)
                if begin <= end and contacts[one.contact].hold == contacts[two.contact].hold:
                    yield [_standing(limb, one, begin), _standing(other, two, begin)]

    def _apart(self, one: tuple[int, int], two: tuple[int, int]) -> bool:
        """Whether two swings may happen together."""
        key = (min(one, two), max(one, two))
        if key not in self._free:
            self._free[key] = self.windows.swings.free([*key], ())
        return self._free[key]

    def _fallen(self, paths: list[Path]) -> list[Fact] | None:
        """A window in which the limbs that stand leave the body no place, or no balance."""
        reach = self.windows.reach
        low_slack, high_slack = self.windows.body_range()
        for t in range(self.windows.count):
            facts, low, high = [], low_slack, high_slack
            grippers: list[int] = []  # twice each limb's contact, or both of its swing
            for limb, path in enumerate(paths):
                over = [a for i in path.arcs if (a := self.paths[limb].arcs[i]).first <= t < a.end]
                held = [over[0].start, over[0].goal] if over else [self._held(limb, path, t)]
                low = np.maximum(low, reach.low[limb, held].min(axis=0))
                high = np.minimum(high, reach.high[limb, held].max(axis=0))
                grippers += 2 * held if len(held) == 1 else held
                facts.append(Fact(limb, t, None if over else held[0]))
            flying = [fact for fact in facts if fact.contact is None]
            if len(flying) > self.at_once:
                return flying
            support = tuple(fact.contact for fact in facts if fact.contact is not None)
            middle = (low + high) / 2
            if (low > high).any() or self.equilibrium.position(support, low, high, middle, tuple(grippers)) is None:
                return facts
        return None

    def _held(self, limb: int, path: Path, window: int) -> int:
        return next(s.contact for s in self._stands(limb, path)[::-1] if s.first <= window)


def _standing(limb: int, stand: _Stand, window: int) -> Fact:
    """That a limb stands where it does in `window`; in the window in which it releases, that it does so."""
    if window == stand.last and stand.leaving is not None:
        return Fact(limb, arc=stand.leaving)
    return Fact(limb, window, stand.contact)
