"""A proven lower bound of J (6) of every climb: the cheapest way through grasps and time, each knot at its own best.

The relaxation, step by step; each only allows more or asks less:
1. Contacts, swings, bounds (7): the planner's (Problem). Reach (9a): a box around all that a limb reaches. Swings are
   straight up, across, straight down; a limb in the air needs no more than the quickest of those to where it lands,
   from anywhere. Friction and spines are from above: the whole limit surface, without the plan's margin.
2. Every knot has its own body pose and its own wrenches: at most in reach of start and goal at full speed. Its cost is
   bounded by weak duality (bound.multipliers), whatever the QP that proposes the multipliers does.
3. (8) asks for balance up to the largest accelerations that speeds within (7) allow.
4. Height and opening of limbs in the air earn what they can at most; speeds cost nothing.
5. A dynamic program over all sets of grasps and knots (bound.timeline) adds up the cheapest way. Sets of grasps are
   evaluated only where the cheapest way goes, and others by multipliers of those they are most like (bound.similarity).
   On walls with very many sets limbs and body go by themselves, tied by multipliers (bound.limb_by_limb), and where
   that is too much still, what is left is `floor` and the body's way at full speed: weak, but a bound. Plans that stray
   so far that they cost more than the J asked about are left out: the bound is never above that J.

Work is counted, not timed, so that the bound of a wall is the same number every time.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field, replace

import numpy as np

from crux_planner.certificates.bound import native
from crux_planner.certificates.bound.excursion import body_range, excursion_cost, quickest_way, range_at, yaw_range
from crux_planner.certificates.bound.grasps import Grasps, by_faces, grasps
from crux_planner.certificates.bound.limb_by_limb import LimbByLimb, ascended, size
from crux_planner.certificates.bound.multipliers import KnotQp, Multipliers, Window
from crux_planner.certificates.bound.places import orientations
from crux_planner.certificates.bound.similarity import Similarity
from crux_planner.certificates.bound.swings import detours, earned, ends, floor, knot_floor, shared_weight
from crux_planner.certificates.bound.timeline import DynamicProgram
from crux_planner.model.arrays import Array, Flags, Indices
from crux_planner.model.problem import Problem
from crux_planner.solvers import clock

TIME_LIMIT_S = 20.0
EFFORT = 0.45  # of the default, in the unit of the next line
_STATE_S, _PAIR_S, _QP_S = 1.2e-8, 4e-7, 1.5e-3  # effort of a state at a knot, of a evaluated pair, of a QP
_COST_S, _BODY_S = 3e-8, 5e-3  # the same of a cost in bound.limb_by_limb, and of all else for an ascent's step
_HEATS = 0.005, 0.002, 0.001  # of J: softer is quicker to ascend, and farther from what is proven
_MOST, _ASKED, _FEWEST = 20.0, 200, 30  # effort of it; its steps at a time, and those that it takes at least
_WORTH = 0.002  # of the bound, what more steps add at least
_FEW = 0.95
_MANY = 5000  # sets of grasps, beyond which fewer multipliers are asked about all of them
LARGEST = 30_000  # sets of grasps
_WINDOW = 8  # knots after the start and before the goal at which full speed says where the body can be
_ROUND = 40  # sets of grasps evaluated in a round, those on the cheapest ways; more where a round takes long
_SHARED = 50  # times as many learn from their multipliers


def lower_bound(
    problem: Problem,
    cost: float = np.inf,
    time_limit_s: float = TIME_LIMIT_S,
    report: Callable[[float], None] = lambda _bound: None,
    effort: float = np.inf,
) -> float | None:
    """A number that J of no plan is below, at most `cost`; None where (2) is not what holds, where faces lean or
    cuboids are turned, for limbs without closed-form kinematics, and where libcrux_bound.so has not been built.

    `report` is told each better bound, so that one may stop listening at any time.
    """
    paper = problem.limit_surface == "paper"  # which lets pass what (2) does not
    if paper or not problem.upright or not problem.closed_form or native.library() is None:
        return None
    limits = _Limits(clock.now() + time_limit_s, effort)
    problem = replace(problem, boxes=problem.limb_reach.outer, friction_share=1.0)
    bound = floor(problem) + quickest_way(problem)
    report(min(bound, cost))
    search = _Search.begin(problem, cost, limits)

    def better(found: float) -> None:
        report(min(max(found, bound), cost))

    found = _by_limbs(problem, cost, limits, better) if search is None else search.run(better)
    return float(min(max(bound, found), cost))


def _by_limbs(problem: Problem, cost: float, limits: _Limits, report: Callable[[float], None]) -> float:
    """The ascent of bound.limb_by_limb within the limits, begun with what holds the start's grasps in balance; -inf
    where limbs have too many swings.
    """
    least = floor(problem)
    box, about = body_range(problem, cost - least), orientations(problem, *yaw_range(problem, cost - least))
    if size(problem) * _COST_S * _FEWEST > min(limits.effort, _MOST):
        return -np.inf
    some = grasps(problem, about, *box, [[own[0]] for own in by_faces(problem)])
    if some is None:
        return -np.inf
    dual, best = LimbByLimb(problem, about, box), -np.inf
    qp = KnotQp(Multipliers(problem, about, some))
    x = dual.scaled(qp.multipliers(dict(enumerate(problem.start_contacts)), box))
    each = _BODY_S + _COST_S * dual.work
    asked = min(limits.effort / each, _ASKED) / 2
    for heat in _HEATS:
        last = -np.inf
        while best > (1.0 + _WORTH) * last or last == -np.inf:
            x = ascended(dual, x, heat * max(min(cost, 3 * least), 1.0), int(asked))
            limits.spend(asked * each)
            last, best = best, max(best, dual.bound(x))
            report(best)
            if best >= cost or limits.reached:
                return best
            if np.isfinite(limits.effort):
                break
    return best


@dataclass
class _Limits:
    """When to stop: a time of clock.now, or when an effort is spent."""

    deadline: float
    effort: float

    def spend(self, effort: float) -> None:
        self.effort -= effort

    @property
    def reached(self) -> bool:
        return self.effort <= 0.0 or clock.now() > self.deadline


@dataclass
class _Search:
    """The dynamic program with what is evaluated so far."""

    problem: Problem
    cost: float
    nodes: Grasps
    multipliers: Multipliers
    qp: KnotQp
    box: tuple[Array, Array]
    program: DynamicProgram
    limits: _Limits
    value: Array  # (n,) of each node, at any knot
    known: Flags  # (n,) evaluated by multipliers of its own
    similarity: Similarity
    windows: dict[int, Array] = field(default_factory=dict)  # knot -> (n,)
    known_at: set[tuple[int, int]] = field(default_factory=set)  # (knot, node)
    _tables: dict[int, Array] = field(default_factory=dict)

    @staticmethod
    def begin(problem: Problem, cost: float, limits: _Limits) -> _Search | None:
        """The nodes that may lie on ways that cost less than `cost`; None where those are too many."""
        spare = cost - floor(problem)
        box = body_range(problem, spare)
        about = orientations(problem, *yaw_range(problem, spare))
        nodes = grasps(problem, about, *box, by_faces(problem), LARGEST)
        if nodes is None:
            return None
        multipliers = Multipliers(problem, about, nodes)
        qp = KnotQp(multipliers)
        everything = np.arange(len(nodes.options))
        value = shared_weight(problem)[nodes.in_air] + multipliers.places(everything)
        for held in _examples(problem, few=len(everything) > _MANY):
            value = np.maximum(value, multipliers.values(qp.multipliers(held, box), everything))
            limits.spend(_QP_S + _PAIR_S * len(nodes.node))
        least, more = knot_floor(problem)
        excess = value - least + (earned(problem) - more) * nodes.in_air
        for limb, own in enumerate(nodes.groups):
            contacts = np.concatenate(own)
            around = np.full(len(problem.contacts), np.inf)
            around[contacts] = detours(problem, limb, contacts)
            excess += (nodes.cheapest(limb, around) - around.min())[nodes.options[:, limb]]
        kept = excess + excursion_cost(problem, about, nodes) <= spare
        nodes = nodes.reduced(kept)
        nodes = multipliers.masses.asked(nodes)
        program = DynamicProgram(problem, nodes)
        known = np.zeros(len(nodes.options), dtype=bool)
        multipliers = qp.about = multipliers.on(nodes)
        alike = Similarity(problem, nodes)
        return _Search(problem, cost, nodes, multipliers, qp, box, program, limits, value[kept], known, alike)

    def run(self, report: Callable[[float], None]) -> float:
        """The bound when all that the cheapest way meets is evaluated, or when the limits are reached."""
        problem, bound = self.problem, -np.inf
        while True:
            self._tables = {}
            way = self.program.forward(self._stage)
            if way is None:  # every way costs more than what is asked about
                return np.inf
            bound = max(bound, way.least)
            report(bound)
            sweeps = 2.5 * _STATE_S * self.program.states * problem.steps
            self.limits.spend(sweeps)
            if bound >= self.cost or self.limits.reached:
                return bound
            through = self._drop(self.program.through(way, self._stage))
            if not self._value(through, bound, max(_ROUND, int(sweeps / (2 * _QP_S)))):
                return bound

    def _drop(self, through: Array) -> Array:
        """Leave out the nodes on no way that costs less than what is asked about; what is left of `through`."""
        kept = through.min(axis=0) <= self.cost
        if kept.mean() > _FEW:  # the program for the others costs more than it saves
            return through
        old = np.flatnonzero(kept)
        place = {int(node): i for i, node in enumerate(old)}
        self.nodes = self.nodes.reduced(kept)
        self.multipliers = self.qp.about = self.multipliers.on(self.nodes)
        self.value, self.known = self.value[kept], self.known[kept]
        self.windows = {knot: value[kept] for knot, value in self.windows.items()}
        self.known_at = {(knot, place[node]) for knot, node in self.known_at if node in place}
        self.program = DynamicProgram(self.problem, self.nodes)
        self.similarity = Similarity(self.problem, self.nodes)
        return through[:, kept]

    def _stage(self, knot: int) -> Array:
        key = knot if knot in self.windows else -1
        if key not in self._tables:
            value = self.windows.get(knot, self.value)
            self._tables[key] = value + earned(self.problem) * self.nodes.in_air
        return self._tables[key]

    def _value(self, through: Array, bound: float, many: int) -> bool:
        """Find multipliers for the nodes on the cheapest ways; False where those of the cheapest have theirs."""
        on_way = through <= bound + 1e-9
        found = False
        outer = [k for k in range(len(through)) if min(k, len(through) - k) <= _WINDOW]
        for k in outer:
            others = np.flatnonzero(on_way[k])[:many]
            new = [int(node) for node in others if (k, int(node)) not in self.known_at]
            if not new:
                continue
            box, found = range_at(self.problem, k, self.box), True
            window = self.multipliers.window(others, box)
            for node, proposed in zip(new, self._proposed(np.array(new[:_ROUND]), box), strict=False):
                self.known_at.add((k, node))
                self._value_at(k, proposed, others, window)
                if self.limits.reached:
                    return True
        inner = [k for k in range(len(through)) if k not in outer]
        least = through[inner].min(axis=0) if inner else through.min(axis=0)
        found |= bool((~self.known[on_way[inner].any(axis=0)]).any())
        if not found:
            return False
        order = np.argsort(least, kind="stable")
        wanted = order[~self.known[order] & (least[order] <= self.cost)][:many]
        if not len(wanted):
            return True
        proposed = np.array(list(self._proposed(wanted, self.box)))
        self.limits.spend(_QP_S * len(wanted))
        self.known[wanted] = True
        self._raise(wanted, self._values(proposed, wanted))
        others = order[least[order] <= self.cost][: _SHARED * many]
        near = self.similarity.nearest(others, wanted)
        self._raise(others, self._values(self.similarity.taken_to(proposed[near], wanted[near], others), others))
        return True

    def _values(self, multipliers: Array, which: Indices, window: Window | None = None) -> Array:
        pairs = np.append(self.nodes.first, len(self.nodes.node))
        self.limits.spend(_QP_S + _PAIR_S * float((pairs[which + 1] - pairs[which]).sum()))
        return self.multipliers.values(multipliers, which, window)

    def _raise(self, which: Indices, value: Array) -> None:
        self.value[which] = np.maximum(self.value[which], value)
        for window in self.windows.values():
            window[which] = np.maximum(window[which], value)

    def _value_at(self, knot: int, proposed: Array, others: Indices, window: Window) -> None:
        value = self.windows.setdefault(knot, self.value.copy())
        value[others] = np.maximum(value[others], self._values(proposed, others, window))

    def _proposed(self, which: Indices, box: tuple[Array, Array]) -> Iterator[Array]:
        """(6,) of one node after the other, the body in a box."""
        nodes = self.nodes
        level = (nodes.first[which] + np.append(nodes.first, len(nodes.node))[which + 1]) // 2
        rests = self.multipliers.masses.within(nodes, level, box)[:, 0]
        for node, rest in zip(which.tolist(), rests, strict=True):
            yield self.qp.multipliers(nodes.held(node), box, rest)


def _examples(problem: Problem, few: bool) -> list[dict[int, int]]:
    """Sets of grasps whose multipliers say something of most others: start's and goal's, and each less one limb."""
    missing = (None,) if few else (None, 0, 1, 2, 3)
    start, goal = dict(enumerate(problem.start_contacts)), {}
    for limb, own in enumerate(problem.limb_contacts):
        contacts = np.array([problem.start_contacts[limb], *own])
        last = contacts[ends(problem, limb, contacts)]
        goal[limb] = int(last[0]) if len(last) else start[limb]
    sets = [start] if goal == start else [start, goal]
    return [{limb: c for limb, c in held.items() if limb != out} for held in sets for out in missing]
