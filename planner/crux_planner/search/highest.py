"""How far up a wall one gets: the search on the map without a goal, the highest stance first."""

from __future__ import annotations

import heapq
import itertools
from dataclasses import dataclass, field

import numpy as np
from crux_contracts import LIMB_NAMES

from crux_planner.model.schedule import Contacts, Stance
from crux_planner.search.map_search import MapSearch, Node, Swing
from crux_planner.solvers import clock


@dataclass
class Highest:
    """What the search saw: the highest place of a body (3,) in balance on four limbs, [m] in H, and the stance there;
    the moves to it; which limbs hold each contact in some stance; for each limb what stops it in that stance.
    """

    body_h_m: tuple[float, float, float]
    stance: Stance
    moves: int
    held_by: dict[int, set[int]] = field(default_factory=dict)
    stops: dict[str, str] = field(default_factory=dict)
    stances: int = 0
    complete: bool = False  # all that the map has was looked at


class Upwards(MapSearch):
    """The search of one problem, whose goal does not count."""

    def highest(self, most: int, deadline: float) -> Highest | None:
        """The highest that is found within so many looks at moves, by the deadline (of clock.now); None where the start
        itself is not on the map.
        """
        start, count, best = self.problem.start_contacts, itertools.count(), None
        queue: list[tuple[float, int, Node | Swing]] = []
        moves: dict[Node, int] = {}
        for part in set(np.unique(self._parts(start)[self.masks.start]).tolist()) - {0}:
            moves[start, part] = 0
            heapq.heappush(queue, (0.0, next(count), (start, part)))
        held_by: dict[int, set[int]] = {}
        while queue and most > 0 and clock.now() < deadline:
            _, _, each = heapq.heappop(queue)
            if isinstance(each, Swing):
                most -= 1
                for part in self._landed(each):
                    node = each.after, part
                    if node not in moves:
                        moves[node] = moves[each.before] + 1
                        heapq.heappush(queue, (self._rank(node[0]), next(count), node))
                continue
            for limb, contact in enumerate(each[0]):
                held_by.setdefault(contact, set()).add(limb)
            body = self._height(each)
            if best is None or body[0] > best.body_h_m[0]:
                best = Highest(body, each[0], moves[each])
                highest = each
            for swing in self._others(each):
                heapq.heappush(queue, (self._rank(swing.after), next(count), swing))
        if best is None:
            return None
        best.held_by, best.stances, best.complete = held_by, len(moves), not queue
        best.stops = {name: self._stop(highest, limb) for limb, name in enumerate(LIMB_NAMES)}
        return best

    def _rank(self, stance: Stance) -> float:
        """The higher the grippers are in the mean, the sooner."""
        return -float(self._places[list(stance), 0].mean())

    def _others(self, node: Node) -> list[Swing]:
        """What may follow a node, but for grips of the same hold by other faces, which gain no height."""
        holds = [self.problem.contacts[c].hold for c in node[0]]
        return [s for s in self._swings(node) if self.problem.contacts[s.end].hold != holds[s.limb]]

    def _height(self, node: Node) -> tuple[float, float, float]:
        """The highest place of a body in a node that balances on four limbs, or that there is at all."""
        stance, part = node
        mine = self._parts(stance) == part
        stands = self.footing.stands(stance, self._places[list(stance)].mean(axis=0))
        balanced = mine if stands is None or not (mine & stands).any() else mine & stands
        cells = np.argwhere(balanced)
        place, _ = self.masks.grid.pose(cells[int(np.argmax(cells[:, 4]))].tolist())
        return float(place[0]), float(place[1]), float(place[2])

    def _stop(self, node: Node, limb: int) -> str:
        """Why a limb gets no further from a node."""
        stance, part = node
        held: Contacts = tuple(c if other != limb else None for other, c in enumerate(stance))
        stands = self.footing.stands(held, self._places[list(stance)].mean(axis=0))
        if stands is None or not ((self._parts(stance) == part) & stands).any():
            return "cannot lift off: the other three do not balance the body from where they reach"
        swings = [swing for swing in self._others(node) if swing.limb == limb]
        ends = sorted({self.problem.contacts[swing.end].hold for swing in swings})
        if not ends:
            return "has no other hold in reach while the others hold on"
        if any(self._landed(swing) for swing in swings):
            return "moves on, but no higher body was found by it"
        return f"finds no free swing to {', '.join(self.problem.hold_names[hold] for hold in ends)}"
