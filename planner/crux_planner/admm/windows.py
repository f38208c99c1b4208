"""The coarse grid of the contact MILP: windows of several knots, the contacts and swings a limb may use in them."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np
from crux_contracts import LIMB_NAMES

from crux_planner.model.arrays import Array
from crux_planner.model.problem import Problem
from crux_planner.model.schedule import Move, Schedule, Swinging, stance_after
from crux_planner.physics.reachable_set import ReachableSet, goal_contacts
from crux_planner.swing.at_knots import grippers_at_knots
from crux_planner.swing.swing_cache import SwingCache

STAGE_KNOTS = 5
REST_KNOTS = 1  # at the beginning of a swing's first window: wrenches of a new stance settle before a limb releases
_SHORTEST_SWING = 2  # knots in the air (msgs/PLAN.md)
_ASIDE_M = 0.1  # how far beyond start and goal the body may go


@dataclass(frozen=True)
class Arc:
    """A swing: in the air in windows `first` .. `end` - 1, on contact `start` before and on `goal` from `end` on."""

    first: int
    end: int
    start: int
    goal: int


@dataclass
class Windows:
    """Stage t spans knots t * knots .. (t + 1) * knots - 1, the last one all that remain."""

    problem: Problem
    reach: ReachableSet
    swings: SwingCache
    knots: int = STAGE_KNOTS
    count: int = field(init=False)
    contacts: list[list[int]] = field(init=False)  # per limb: one a (hold, face pair), within reach of some body
    arcs: list[list[Arc]] = field(init=False)  # per limb
    goals: list[list[int]] = field(init=False)

    def __post_init__(self) -> None:
        problem = self.problem
        self.count = problem.steps // self.knots
        ends = goal_contacts(problem, self.reach)
        self.contacts = [_one_per_pair(problem, self.reach, limb, *self.body_range()) for limb in range(4)]
        self.goals = [[c for c in self.contacts[limb] if c in ends[limb]] for limb in range(4)]
        self.arcs = [self._arcs(limb) for limb in range(4)]

    def span(self, window: int) -> tuple[int, int]:
        """First knot of a window and the one after its last; the plan's last knot N is not among them."""
        return window * self.knots, self.problem.steps if window == self.count - 1 else (window + 1) * self.knots

    def body_range(self) -> tuple[Array, Array]:
        """Bounds of the body's position."""
        problem = self.problem
        ends = np.stack([problem.start.position_m, problem.goal.body.position_m])
        low, high = ends.min(axis=0) - _ASIDE_M, ends.max(axis=0) + _ASIDE_M
        low[2], high[2] = problem.body.height_m
        return low, high

    def schedule(self, airborne: list[Swinging]) -> Schedule:
        """Contacts and gripper poses at the knots for swings, those of one limb in the order of time."""
        return Schedule(self._moves(airborne), *grippers_at_knots(self.problem, self.swings, airborne))

    def swinging(self, limb: int, arc: Arc) -> Swinging:
        """An arc at the knots."""
        return Swinging(limb, arc.first * self.knots + REST_KNOTS, arc.end * self.knots, arc.start, arc.goal)

    def held(self, limb: int, airborne: list[Swinging]) -> list[int | None]:
        """The contact of a limb through each window, None in the air."""
        contacts: list[int | None] = []
        own = [swing for swing in airborne if swing.limb == limb]
        for t in range(self.count):
            over = [s for s in own if s.end <= self.span(t)[0]]
            current = over[-1].goal if over else self.problem.start_contacts[limb]
            flying = any(s.first // self.knots <= t <= (s.end - 1) // self.knots for s in own)
            contacts.append(None if flying else current)
        return contacts

    def blocks(self, limb: int, arc: Arc, other: int, contact: int) -> bool:
        """Whether a gripper of limb `other` on `contact` stands in an arc's way."""
        return limb != other and not self.swings.free([(arc.start, arc.goal)], (contact,))

    def least_knots(self, start: int, goal: int) -> int:
        """Knots in the air that a swing needs."""
        return max(self.swings.intervals(start, goal), _SHORTEST_SWING)

    def _arcs(self, limb: int) -> list[Arc]:
        arcs = []
        for start in self.contacts[limb]:
            near = set(map(int, self.reach.neighbours(limb, start)))
            for goal in self.contacts[limb]:
                if goal not in near or self.swings.swing(start, goal) is None:
                    continue
                long = self._stages_for(start, goal)
                arcs += [Arc(t, t + long, start, goal) for t in range(1, self.count - long)]
        return arcs

    def _stages_for(self, start: int, goal: int) -> int:
        return -(-(self.least_knots(start, goal) + REST_KNOTS) // self.knots)

    def _moves(self, airborne: list[Swinging]) -> list[Move]:
        """Swings that begin together are one move; the body is where it starts, the knots decide."""
        before, moves, place = self.problem.start_contacts, [], self.problem.start.position_m
        for first in sorted({s.first for s in airborne}):
            together = sorted((s for s in airborne if s.first == first), key=lambda s: s.limb)
            limbs = tuple(s.limb for s in together)
            after = stance_after(before, limbs, tuple(s.goal for s in together))
            moves.append(Move(before, after, limbs, place, place))
            before = after
        return moves


def clash(windows: Windows, airborne: list[Swinging]) -> tuple[Swinging, ...] | None:
    """Swings that touch a gripper which stands, or each other: what must not come together; None where all are free."""
    problem, swings = windows.problem, windows.swings
    for swing in airborne:
        beside = [s for s in airborne if s.limb != swing.limb]
        for limb in range(len(LIMB_NAMES)):
            if limb == swing.limb:
                continue
            own = sorted((s for s in airborne if s.limb == limb), key=lambda s: s.first)
            stands, since, by = problem.start_contacts[limb], 0, None
            for other in [*own, None]:
                until = problem.steps if other is None else other.first
                overlap = since < swing.end and swing.first <= until
                if overlap and not swings.free([(swing.start, swing.goal)], (stands,)):
                    return (swing,) if by is None else (swing, by)
                if other is not None:
                    stands, since, by = other.goal, other.end, other
        for other in beside:
            meet = other.first < swing.end and swing.first < other.end
            if meet and not swings.free([(swing.start, swing.goal), (other.start, other.goal)], ()):
                return swing, other
    return None


def _one_per_pair(problem: Problem, reach: ReachableSet, limb: int, low: Array, high: Array) -> list[int]:
    """Contacts of a limb within reach from [low, high]; where a pair can be gripped two ways, the less turned one."""
    chosen: dict[tuple[int, int], int] = {}
    start = problem.start_contacts[limb]
    for c in reach.usable[limb]:
        if (reach.low[limb, c] > high).any() or (reach.high[limb, c] < low).any():
            continue
        contact = problem.contacts[c]
        key = (contact.hold, contact.pair)
        known = chosen.get(key)
        turn = abs(contact.yaw_rad - problem.contacts[start].yaw_rad)
        if known is None or turn < abs(problem.contacts[known].yaw_rad - problem.contacts[start].yaw_rad) - 1e-9:
            chosen[key] = c
    return sorted({*chosen.values(), start})
