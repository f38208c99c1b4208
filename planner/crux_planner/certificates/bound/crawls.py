"""Which foot is where, and when, in a crawl: one foot in the air at a time, all four for a knot between two steps.

A foot stands on its first foothold, on its last, which is near its goal, or on one between. First and last are known;
one between is as near to the first as the knots of the step there allow, or anywhere. The cheapest crawl for given
costs of the knots is found by dynamic programming over the feet's footholds and the knots, for any order of the feet
and any number of steps.
"""

import itertools

import numpy as np

from crux_planner.model.arrays import Array, Flags, Indices
from crux_planner.model.gait import LEAST_AIR, Step, longest_step
from crux_planner.model.slots import FIRST_LIFT, LAST_LAND, LEAST_GAP
from crux_planner.model.walk_problem import FINAL_FOOT_M, WalkProblem
from crux_planner.physics.bounds import FEET_APART_M

BETWEEN = (3, 4, 5, 6, 7, 8)  # knots in the air at most to a foothold between that is told from anywhere
_FIRST, _LAST, _NEAR = 0, 1, 2  # from _NEAR on: between, after so many knots
_ALL_FEET = 4

Stance = tuple[int, ...]
"""Of each foot, where it stands."""


class Crawls:
    """The crawls of a problem: all of them, or those with one step a foot at most.

    Knots have phases. In the first, which feet stand is `on` (P, 4), in ranges `low` and `high` (P, 4, 2). In two more
    some foot is anywhere, or more than one are between: on four feet and on three.
    """

    def __init__(self, problem: WalkProblem, between: tuple[int, ...] | None) -> None:
        self.problem = problem
        airs = np.arange(LEAST_AIR, problem.steps)
        steps = [Step(0, 0, int(air)) for air in airs]
        longest = np.array([longest_step(problem, step) for step in steps])
        heights = np.array([step.shares()[1].sum() for step in steps])
        weights = problem.weights
        self.air_cost = float((weights.lift * problem.step_height_m * heights / airs).min())  # of a knot, at least
        self.step_cost = 2 * weights.switching
        swings = np.maximum(np.abs(problem.goal_feet_h_m - problem.start_feet_h_m) - FINAL_FOOT_M, 0.0)
        self._lengths = np.linalg.norm(swings, axis=1)
        self._airs, self._longest = airs, longest
        self._between = between
        self._near_m = [float(longest[airs <= most].max(initial=0.0)) for most in between or ()]
        self._anywhere = _NEAR + len(self._near_m)
        self._ranges()
        self._moves()

    def _ranges(self) -> None:
        first, last = self.problem.start_feet_h_m, self.problem.goal_feet_h_m
        low = np.array([first, last - FINAL_FOOT_M, *[first - near for near in self._near_m]])
        high = np.array([first, last + FINAL_FOOT_M, *[first + near for near in self._near_m]])
        self.phases: dict[tuple[Stance, int | None], int] = {}
        lows, highs = [], []
        on: list[list[bool]] = []
        for where in itertools.product(range(len(low)), repeat=4):
            if sum(each >= _NEAR for each in where) > 1:
                continue
            for aloft in (None, *(limb for limb in range(4) if where[limb] == _FIRST)):
                self.phases[where, aloft] = len(on)
                lows.append(low[where, range(4)])
                highs.append(high[where, range(4)])
                on.append([limb != aloft for limb in range(4)])
        self.low, self.high = np.array(lows), np.array(highs)
        self.on: Flags = np.array(on)
        # a front foot on its first foothold and the rear one of its side on its last may be too near to one another
        apart = low[0, :2, 0] - low[1, 2:, 0]
        self._shut = [(front, front + 2) for front in range(2) if apart[front] < FEET_APART_M]

    def _steps_from(self, limb: int, at: int) -> list[tuple[int, int]]:
        """Where a foot may step from there, and the least knots in the air."""
        length = float(self._lengths[limb])
        if at == _LAST:
            return []
        if at == _FIRST:
            to = [(_LAST, self._least(length))]
            if self._between is not None:
                to += [(_NEAR + i, least) for i, least in enumerate((LEAST_AIR, *[most + 1 for most in self._between]))]
            return to
        rest = length - self._near_m[at - _NEAR] if at < self._anywhere else 0.0
        return [(_LAST, self._least(rest)), (self._anywhere, LEAST_AIR)]

    def _least(self, length: float) -> int:
        return int(self._airs[self._longest >= length].min(initial=self.problem.steps))

    def _moves(self) -> None:
        """Steps as arrays: the stances they lead from and to, the phase in the air, the least knots in it."""
        places = range(2 if self._between is None else self._anywhere + 1)
        stances = [
            stance
            for stance in itertools.product(places, repeat=4)
            if stance == self._told(stance)
            and not any(stance[front] == _FIRST and stance[rear] == _LAST for front, rear in self._shut)
        ]
        number = {stance: i for i, stance in enumerate(stances)}
        moves = []
        for stance, limb in itertools.product(stances, range(4)):
            for then, least in self._steps_from(limb, stance[limb]):
                led = self._told((*stance[:limb], then, *stance[limb + 1 :]))
                if led in number:
                    moves.append((number[stance], number[led], self._phase_of(stance, limb), least))
        moves.sort(key=lambda move: move[1])
        self._from, self._to, self._aloft, self._knots = np.array(moves).T
        self._led = np.flatnonzero(np.diff(self._to, prepend=-1))  # where those that lead to one stance begin
        self._group = np.cumsum(np.diff(self._to, prepend=-1) > 0) - 1
        self._standing = np.array([self._phase_of(stance, None) for stance in stances])
        self._begin = number[(_FIRST,) * _ALL_FEET]
        idle = self._lengths == 0.0
        there = [[at == _LAST or (at == _FIRST and idle[limb]) for limb, at in enumerate(s)] for s in stances]
        self._ends: Flags = np.array([all(feet) for feet in there])

    def _told(self, stance: Stance) -> Stance:
        """With more than one foot between, they are anywhere."""
        if sum(at >= _NEAR for at in stance) < 2:
            return stance
        return tuple(self._anywhere if at >= _NEAR else at for at in stance)

    def _phase_of(self, stance: Stance, aloft: int | None) -> int:
        on_feet = tuple(_FIRST if limb == aloft else at for limb, at in enumerate(stance))
        return self.phases.get((on_feet, aloft), len(self.phases) + (aloft is not None))

    def cheapest(self, knots: Array) -> tuple[float, Indices]:
        """Least cost of knots (N, P + 2) by phase, and of the steps themselves; the phases at the knots (N,)."""
        n, each = len(knots), np.arange(len(self._from))
        standing, aloft = knots[:, self._standing], knots[:, self._aloft] + self.air_cost
        flown = np.vstack([np.zeros(len(each)), np.cumsum(aloft, axis=0)])  # before a knot
        stood = np.full((n + 1, len(self._ends)), np.inf)  # the knots before, on four feet at the last of them
        stood[0, self._begin] = 0.0
        lifted = np.full((n, len(each)), np.inf)  # less `flown`, the best lift-off up to a knot, and where it is
        lift = np.zeros(lifted.shape, dtype=int)
        came = np.full((n, len(self._ends)), -1)  # the step that ends at a knot, if that is the best way to stand there
        stances = self._to[self._led]
        assert LEAST_GAP == 1
        for k in range(n):
            here = stood[k].copy()
            if k <= n - LAST_LAND:
                off = lifted[np.maximum(k - self._knots, 0), each]
                landed = np.where(k >= self._knots, off, np.inf) + flown[k] + self.step_cost
                best = np.minimum.reduceat(landed, self._led)
                better = best < here[stances]
                chosen = np.maximum.reduceat(np.where(landed <= best[self._group], each, -1), self._led)
                came[k, stances[better]] = chosen[better]
                here[stances[better]] = best[better]
            stood[k + 1] = here + standing[k]
            if k >= FIRST_LIFT:
                off = stood[k, self._from] - flown[k]
                sooner = off >= lifted[k - 1]
                lifted[k] = np.where(sooner, lifted[k - 1], off)
                lift[k] = np.where(sooner, lift[k - 1], k)
        final = np.where(self._ends, stood[n], np.inf)
        stance = int(np.argmin(final))
        return float(final[stance]), self._way(stance, came, lift)

    def _way(self, stance: int, came: Indices, lift: Indices) -> Indices:
        phases, k = np.zeros(len(came), dtype=int), len(came) - 1
        while k >= 0:
            phases[k] = self._standing[stance]
            step = came[k, stance]
            if step >= 0:
                off = lift[k - self._knots[step], step]
                phases[off:k] = self._aloft[step]
                k, stance = off, int(self._from[step])
            k -= 1
        return phases
