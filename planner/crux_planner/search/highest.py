"""How far up a wall one gets: the search on the map without a goal, the highest stance first."""

from __future__ import annotations

import heapq
import itertools
from dataclasses import dataclass, field

import numpy as np
from crux_contracts import LIMB_NAMES

from crux_planner.model.arrays import Flags, Indices
from crux_planner.model.schedule import Contacts, Stance
from crux_planner.search.map_search import MapSearch, Node, Swing
from crux_planner.solvers import clock

_AHEAD_RAD = 1e-6  # off the start's heading
_RESTS, _LOOKS = 12, 8  # stances, the highest, and poses on each that are looked at for one at which motors hold it


@dataclass(frozen=True)
class Rest:
    """A stance, the moves to it, and a place (3,) [m] in H, with the start's heading, at which motors hold the body: as
    near as that to the middle of its places on the stance.
    """

    stance: Stance
    moves: int
    body_h_m: tuple[float, float, float]


@dataclass
class Highest:
    """What the search saw: the highest place of a body (3,) in balance on four limbs, [m] in H, and the stance there;
    the moves to it; which limbs hold each contact in some stance; for each limb what stops it in that stance; where the
    body rests highest.
    """

    body_h_m: tuple[float, float, float]
    stance: Stance
    moves: int
    rest: Rest | None = None
    held_by: dict[int, set[int]] = field(default_factory=dict)
    stops: dict[str, str] = field(default_factory=dict)
    stances: int = 0
    complete: bool = False  # all that the map has was looked at


class Upwards(MapSearch):
    """The search of one problem, whose goal does not count."""

    @property
    def starts_on_the_map(self) -> bool:
        """Whether the start itself is, not only a pose beside it."""
        start, axes = self.problem.start, self.masks.grid.axes
        pose = (start.rpy_rad[2], *start.rpy_rad[:2], *start.position_m[[2, 0, 1]])
        cell = tuple(int(np.argmin(np.abs(axis - at))) for axis, at in zip(axes, pose, strict=True))
        return bool(self.poses(self.problem.start_contacts)[cell])

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
        heights: dict[Node, float] = {}
        while queue and most > 0 and clock.now() < deadline:
            _, _, each = heapq.heappop(queue)
            if isinstance(each, Swing):
                if not self._lifts_off(each):
                    continue
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
            heights[each] = body[0]
            if best is None or body[0] > best.body_h_m[0]:
                best = Highest(body, each[0], moves[each])
                highest = each
            for swing in self._others(each):
                heapq.heappush(queue, (self._rank(swing.after), next(count), swing))
        if best is None:
            return None
        best.held_by, best.stances, best.complete = held_by, len(moves), not queue
        best.stops = {name: self._stop(highest, limb) for limb, name in enumerate(LIMB_NAMES)}
        rests = (self._rest(node, moves[node]) for node in heapq.nlargest(_RESTS, heights, key=heights.__getitem__))
        best.rest = max((each for each in rests if each is not None), key=lambda rest: rest.body_h_m[0], default=None)
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
        balanced = self._balanced(node)
        cells = np.argwhere(balanced if balanced.any() else self._parts(node[0]) == node[1])
        return self._place(cells[int(np.argmax(cells[:, 4]))])

    def _balanced(self, node: Node) -> Flags:
        """Where friction holds a body of a node."""
        stance, part = node
        mine = self._parts(stance) == part
        stands = self.footing.stands(stance, self._places[list(stance)].mean(axis=0))
        return np.zeros_like(mine) if stands is None else mine & stands

    def _rest(self, node: Node, moves: int) -> Rest | None:
        """Where the body rests on a node; None where no place is found."""
        cells = np.argwhere(self._balanced(node))
        cells = cells[np.abs(self.masks.grid.yaw_rad[cells[:, 0]]) < _AHEAD_RAD]
        off = np.linalg.norm(cells - cells.mean(axis=0), axis=1) if len(cells) else np.zeros(0)
        for cell in cells[np.argsort(off, kind="stable")[:_LOOKS]]:
            if self.footing.strong_at(node[0], node[0], tuple(cell.tolist())):
                return Rest(node[0], moves, self._place(cell))
        return None

    def _place(self, cell: Indices) -> tuple[float, float, float]:
        place, _ = self.masks.grid.pose(cell.tolist())
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
        if not any(self._lifts_off(swing) for swing in swings):
            return "cannot lift off: motors are too weak without it"
        if any(self._landed(swing) for swing in swings):
            return "moves on, but no higher body was found by it"
        return f"finds no free swing to {', '.join(self.problem.hold_names[hold] for hold in ends)}"
