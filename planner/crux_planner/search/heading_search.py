"""Where a level body with one heading finds no way: contacts and the body's heading are searched together.

The heading is a grid of yaws; at each of them (9a) is a set of boxes again (`ReachableSet.turned`). A limb may go to
any hold that the three others let it reach: the body moves on while it swings. A* with a lazy oracle: a move is looked
at (its swing, its balance) only when it is next in line.
"""

from __future__ import annotations

import heapq
import itertools
from collections import Counter
from dataclasses import dataclass

import numpy as np
from scipy.sparse import csr_array
from scipy.sparse.csgraph import dijkstra

from crux_planner.model.arrays import Array, Flags
from crux_planner.model.kinematics import rotation_z
from crux_planner.model.problem import Problem
from crux_planner.model.schedule import Move, Stance, stance_after
from crux_planner.physics.reachable_set import ReachableSet
from crux_planner.search.equilibrium import clipped
from crux_planner.search.schedule import TURN_SHARE
from crux_planner.search.stances import MOVE_COST, STANCE_KNOTS, SearchReport
from crux_planner.search.torque_limits import TorqueLimits
from crux_planner.solvers import clock
from crux_planner.swing.swing import STEP_SHARE
from crux_planner.swing.swing_cache import SwingCache

HEADING_STEP_RAD = 0.07
YAW_RESERVE_RAD = 0.01  # kept of the grippers' range of yaw
SPARE_HEADINGS = 3  # beyond the start's and the goal's
SIMILARITY = 2.0  # knots that a state must beat one alike by (in all but heading and place on the holds) before it
CARRIED_M = 0.15  # way of the body while a limb swings, as the estimate of the way to go sees it
_SETTLED = 1e-9

State = tuple[Stance, int]


@dataclass(frozen=True)
class View:
    """The problem as a body of one heading sees it: axes turned by `yaw_rad`."""

    yaw_rad: float
    reach: ReachableSet
    equilibrium: TorqueLimits
    usable: Flags  # (4, C) contacts that a limb may use and that are within its gripper's range of yaw

    def to_h(self, position: Array) -> Array:
        """From the view's axes."""
        return np.asarray(rotation_z(self.yaw_rad) @ position)

    def from_h(self, position: Array) -> Array:
        """To the view's axes."""
        return np.asarray(rotation_z(-self.yaw_rad) @ position)


class HeadingSearch:
    """Search over (stance, heading) of one problem."""

    def __init__(self, problem: Problem, reach: ReachableSet, swings: SwingCache, ends: Flags) -> None:
        """`ends` (4, C): contacts in reach at the goal's pose."""
        self.problem, self.swings, self.ends = problem, swings, ends
        goal_yaw = float(problem.goal.body.rpy_rad[2])
        count = int(np.ceil(abs(goal_yaw) / HEADING_STEP_RAD))
        step = goal_yaw / count if count else HEADING_STEP_RAD
        numbers = range(-SPARE_HEADINGS, count + SPARE_HEADINGS + 1)
        torque_limits = TorqueLimits(problem, problem.friction_share, problem.last_torques_Nm)
        self.views = [_view(problem, reach, torque_limits, number * step) for number in numbers]
        self.begin, self.end = SPARE_HEADINGS, SPARE_HEADINGS + count
        self.turn_knots = abs(step) / (TURN_SHARE * problem.body.max_rate_rad_s * problem.dt_s)
        self.centres = np.stack([c.centre_h_m for c in problem.contacts])
        self.holds = np.array([c.hold for c in problem.contacts])
        self.grips = np.array([2 * c.hold + c.pair for c in problem.contacts])
        yaws = np.array([c.yaw_rad for c in problem.contacts])
        way = np.linalg.norm(self.centres[:, None] - self.centres[None], axis=2)
        turn = np.abs(yaws[:, None] - yaws[None])
        reach_m = STEP_SHARE * problem.swing.speed_m_s * problem.dt_s
        turn_rad = STEP_SHARE * problem.swing.yaw_rate_rad_s * problem.dt_s
        across = np.maximum(np.ceil(np.maximum(way / reach_m, turn / turn_rad)), 1.0)
        self.least_cost = across + 2.0 + STANCE_KNOTS + MOVE_COST  # up, across, down; (C, C)
        self.to_go = np.stack([self._costs_to_go(limb) for limb in range(4)])  # (4, C)

    def _costs_to_go(self, limb: int) -> Array:
        """(C,) knots to the goal at least, were the limb alone and the body never far behind."""
        meet = np.zeros(self.least_cost.shape, dtype=bool)
        for view in self.views:
            low, high = view.reach.low[limb] - CARRIED_M / 2, view.reach.high[limb] + CARRIED_M / 2
            both = np.maximum(low[:, None], low[None]) <= np.minimum(high[:, None], high[None])
            meet |= both.all(axis=2) & view.usable[limb, :, None] & view.usable[limb, None]
        edges, ends = csr_array(np.where(meet, self.least_cost, 0.0)), np.flatnonzero(self.ends[limb])
        if not len(ends):
            return np.full(len(self.centres), np.inf)
        return np.asarray(dijkstra(edges, indices=ends, min_only=True))

    def _likes(self, state: State) -> tuple[int, ...]:
        """What a state has in common with those that differ only in heading and in where holds are gripped."""
        return tuple(self.grips[list(state[0])].tolist())

    def estimate(self, state: State) -> float:
        """Knots to the goal, roughly."""
        stance, heading = state
        on = float(sum(self.to_go[limb, c] for limb, c in enumerate(stance)))
        return on + self.turn_knots * abs(heading - self.end)

    def search(self, *, greed: float, deadline: float, most: int) -> tuple[list[Move] | None, SearchReport]:
        """Moves to the goal, None where none are found after looks at `most` moves; and what the search saw."""
        report, counter = SearchReport(), itertools.count()
        start: State = (self.problem.start_contacts, self.begin)
        best: dict[State, float] = {start: 0.0}
        parent: dict[State, tuple[State, Move | None]] = {}
        if not np.isfinite(self.estimate(start)):
            return None, report
        first = _Step(start, start, None, self.problem.start.position_m)
        queue = [(greed * self.estimate(start), next(counter), 0.0, first, True)]
        done: set[State] = set()
        like: Counter[tuple[int, ...]] = Counter()
        while queue:
            _, _, cost, step, settled = heapq.heappop(queue)
            state = step.after
            if state in done or (not settled and cost >= best.get(state, np.inf) - _SETTLED):
                continue
            if not settled:
                report.timed_out = report.looked >= most or (report.expanded % 16 == 0 and clock.now() > deadline)
                if report.timed_out:
                    break
                report.looked += 1
                settling = self._settle(step, cost)
                if settling is None or settling[1] >= best.get(state, np.inf) - _SETTLED:
                    continue
                move, cost = settling
                best[state], parent[state] = cost, (step.before, move)
                body = step.body if move is None else move.touch_down
                entry = _Step(step.before, state, step.limb, body)
                heapq.heappush(queue, (cost + greed * self.estimate(state), next(counter), cost, entry, True))
                continue
            done.add(state)
            like[self._likes(state)] += 1
            report.expanded += 1
            ahead = self.estimate(state)
            if ahead < report.nearest_cost:
                report.nearest, report.nearest_cost = state[0], ahead
            if ahead < _SETTLED and self._ends_well(state):
                return self._trace(parent, state), report
            for following, more in self._steps(state, step.body):
                total = cost + more
                if total < best.get(following.after, np.inf) - _SETTLED:
                    then = following.after
                    rank = total + greed * self.estimate(then) + SIMILARITY * like[self._likes(then)]
                    heapq.heappush(queue, (rank, next(counter), total, following, False))
        return None, report

    def _steps(self, state: State, body: Array) -> list[tuple[_Step, float]]:
        """What may follow, with the least it costs; not yet looked at closely."""
        stance, heading = state
        steps = [
            (_Step(state, (stance, other), None, body), self.turn_knots)
            for other in (heading - 1, heading + 1)
            if 0 <= other < len(self.views) and self.views[other].reach.of(stance) is not None
        ]
        view = self.views[heading]
        bounds = view.reach.of(stance)
        if bounds is None:
            return steps
        for limb in self.problem.may_move(stance):
            support = tuple(c for other, c in enumerate(stance) if other != limb)
            if view.equilibrium.by_friction(support, *bounds, view.from_h(body), stance) is None:
                continue
            others = [other for other in range(4) if other != limb]
            low = view.reach.low[others, list(support)].max(axis=0)
            high = view.reach.high[others, list(support)].min(axis=0)
            fits = view.usable[limb] & np.isfinite(self.to_go[limb])
            fits &= (view.reach.low[limb] <= high).all(axis=1) & (view.reach.high[limb] >= low).all(axis=1)
            fits &= ~np.isin(self.holds, self.holds[list(support)])
            fits[stance[limb]] = False
            for end in map(int, np.flatnonzero(fits)):
                step = _Step(state, (stance_after(stance, (limb,), (end,)), heading), limb, body)
                steps.append((step, float(self.least_cost[stance[limb], end])))
        return steps

    def _settle(self, step: _Step, cost: float) -> tuple[Move | None, float] | None:
        """The step as a move (None: a turn) and its true cost; None where it cannot be made."""
        stance, heading = step.after
        view = self.views[heading]
        landing = view.reach.of(stance)
        if landing is None or not all(view.usable[range(4), stance]):
            return None
        wanted = clipped(view.from_h(self.problem.goal.body.position_m), *landing)
        if step.limb is None:
            return None if view.equilibrium.by_friction(stance, *landing, wanted) is None else (None, cost)
        before, limb = step.before[0], step.limb
        support = tuple(c for other, c in enumerate(stance) if other != limb)
        if not self.swings.free([(before[limb], stance[limb])], support):
            return None
        bounds = view.reach.of(before)
        assert bounds is not None
        body = view.from_h(step.body)
        lift_off = view.equilibrium.position(support, *bounds, body, before)
        if lift_off is None:
            return None
        touch_down = view.equilibrium.position(support, *landing, wanted, stance)
        if touch_down is None:
            return None
        extra = self.swings.intervals(before[limb], stance[limb]) + STANCE_KNOTS + MOVE_COST
        cost += max(0.0, extra - float(self.least_cost[before[limb], stance[limb]]))
        move = Move(before, stance, (limb,), view.to_h(lift_off), view.to_h(touch_down), view.yaw_rad)
        return move, cost

    def _ends_well(self, state: State) -> bool:
        """Whether the goal's body pose is in reach and in balance."""
        stance, heading = state
        view, goal = self.views[heading], self.problem.goal
        if heading != self.end or not self.ends[range(4), stance].all():
            return False
        place, slack = view.from_h(goal.body.position_m), goal.position_slack_m
        return view.equilibrium.position(stance, place - slack, place + slack, place) is not None

    def _trace(self, parent: dict[State, tuple[State, Move | None]], state: State) -> list[Move]:
        moves = []
        while state in parent:
            state, move = parent[state]
            if move is not None:
                moves.append(move)
        return moves[::-1]


@dataclass(frozen=True)
class _Step:
    """A limb goes on, or (limb None) the body turns; `body` is where it was, in H."""

    before: State
    after: State
    limb: int | None
    body: Array


def _view(problem: Problem, reach: ReachableSet, torque_limits: TorqueLimits, yaw_rad: float) -> View:
    turned = reach.turned(yaw_rad)
    low, high = problem.gripper_yaw_rad
    yaws = np.array([c.yaw_rad for c in problem.contacts]) - yaw_rad
    fingers = np.array([c.spines_only for c in problem.contacts])
    usable = fingers == fingers[list(problem.start_contacts), None]  # (4, C)
    usable &= (yaws >= low + YAW_RESERVE_RAD) & (yaws <= high - YAW_RESERVE_RAD)
    return View(yaw_rad, turned, torque_limits.turned(turned.problem), usable)
