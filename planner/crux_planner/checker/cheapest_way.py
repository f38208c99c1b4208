"""The least that a plan of N steps costs from the start to the goal: a dynamic program over sets of grips and knots.

A limb holds a grip or is in the air; from one knot to the next any limbs release and take hold. A swing lasts at least
two knots, as a plan is read, and as long as a gripper at full speed takes from one grip to the next. A knot costs what
knot_cost.py shows for its set of grips, with the body where it can be by then, less the most that height and opening
of limbs in the air earn; every lift-off and touch-down costs S. The body's places at different knots need not fit.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from crux_contracts.robot import Robot
from crux_contracts.scenario import Scenario

from crux_planner.checker.geometry import Array, Indices
from crux_planner.checker.grips import Offer, offers
from crux_planner.checker.knot_cost import KnotCosts
from crux_planner.checker.no_way import AIR, Node, NotShownError, NoWay
from crux_planner.checker.outer import FORGIVEN_M, FORGIVEN_RAD

_MOST, _MOST_KNOTS = 500_000, 60_000_000  # states of all limbs, and of all knots together
_LARGEST = 1e4  # multipliers in the unit of P, beyond which rounding would count; good ones are a hundredth of that
_AGES = (16, 8, 6, 5, 4, 3, 2)
_ROUNDING = 1e-9  # of each knot, and of what it costs


class CheapestWay:
    """Of one scenario and number of steps; `value` (N, n) rises with the multipliers that are shown."""

    def __init__(self, scenario: Scenario, robot: Robot, steps: int) -> None:
        if not 0 < steps <= scenario.horizon.steps:
            raise NotShownError(f"{steps} steps: the scenario has {scenario.horizon.steps}")
        self.scenario, self.robot, self.steps = scenario, robot, steps
        self._most, many = min(_MOST, _MOST_KNOTS // steps), len(offers(scenario, robot))
        if (many + _AGES[-1]) ** 4 > self._most:
            raise NotShownError(f"{many} grips on the wall's holds over {steps} steps: too many for all sets of them")
        self.search = NoWay(scenario, robot)
        self.knots = KnotCosts(self.search, robot)
        self._hold = np.unique(self.search.hold, return_inverse=True)[1]
        self._start, self._goals = self.search.start(), self.search.goals()
        weights, grasp = self.knots.weights, robot.grasp
        highest, widest = grasp.max_swing_height_m + FORGIVEN_M, 2 * (robot.gripper.opening_m[1] + FORGIVEN_M)
        self._earned = weights.lift * highest + weights.opening * widest
        self._air = least_knots(self.search.offers, robot, scenario.horizon.dt_s)
        self.value = np.zeros((steps, len(self.knots.sets)))
        for knot in range(steps):
            self.show(knot, np.zeros(6))

    def show(self, knot: int | None, multipliers: Array, which: Indices | None = None) -> None:
        """Raise the values of all sets or some, at one knot or at all, by multipliers (6,); huge ones do nothing."""
        if np.abs(multipliers).max() > _LARGEST * self.knots.weights.wrench:
            return
        box, yaw_rad = (None, None) if knot is None else self.window(knot)
        at, of = slice(None) if knot is None else knot, slice(None) if which is None else which
        self.value[at, of] = np.fmax(self.value[at, of], self.knots.least(multipliers, box, yaw_rad, which))

    def window(self, knot: int) -> tuple[Array, Array]:
        """Where the body can be at a knot, a box (2, 3) in W, and its headings (2,): it begins at rest."""
        start, goal, body = self.scenario.start.body, self.scenario.goal, self.robot.body
        dt_s, last = self.scenario.horizon.dt_s, self.steps - knot
        first = max(knot - 1, 0)
        turn = abs(np.cos(start.rpy_rad[2])) + abs(np.sin(start.rpy_rad[2]))  # speeds are along the first heading
        step = ((body.max_speed_m_s + 1e-4) * dt_s + FORGIVEN_M) * np.array([turn, turn, 1.0])
        near, far = first * step + FORGIVEN_M, last * step + goal.tolerance_m + FORGIVEN_M
        low = np.maximum(np.array(start.position_m) - near, np.array(goal.body.position_m) - far)
        high = np.minimum(np.array(start.position_m) + near, np.array(goal.body.position_m) + far)
        turned = first * (self.search.fastest_rad_s * dt_s + FORGIVEN_RAD) + FORGIVEN_RAD
        return np.array([low, high]), start.rpy_rad[2] + np.array([-turned, turned])

    def least(self) -> float:
        """What no plan of so many steps costs less than."""
        return self._program().forward(self.stages())

    def drop(self, cost: float) -> Array:
        """Leave out the sets through which no plan costs less; the least through those left, (N, n)."""
        through = self._program().through(self.stages())
        kept = through.min(axis=0) <= cost
        self.knots.keep(kept)
        self.value = self.value[:, kept]
        return np.asarray(through[:, kept])

    def stages(self) -> Array:
        """(N, n) what sets cost at knots at least, less what limbs in the air earn."""
        return (1.0 - _ROUNDING) * self.value - self._earned * self.knots.in_air - _ROUNDING

    def _program(self) -> Program:
        return Program(
            self.knots.sets, self._start, self._goals, self._hold, self._air, self.knots.weights.switching, self._most
        )


def least_knots(found: list[Offer], robot: Robot, dt_s: float) -> Indices:
    """(G, G) least knots in the air from one grip to another: the way in a line, the turn up to a swap of fingers."""
    ends = np.array([each.corners_w_m[:, :2] for each in found])
    yaw = np.array([np.arctan2(each.axis[1], each.axis[0]) for each in found])
    middle, half = ends.mean(axis=1), np.linalg.norm(np.ptp(ends, axis=1), axis=1) / 2 + FORGIVEN_M
    way = np.linalg.norm(middle[:, None] - middle, axis=2) - half[:, None] - half
    turned = np.abs(yaw[:, None] - yaw) % np.pi
    turned = np.minimum(turned, np.pi - turned) - 2 * FORGIVEN_RAD
    speed, rate = robot.grasp.approach_speed_m_s + 1e-4, robot.grasp.yaw_rate_rad_s + 1e-3
    intervals = np.maximum(way / (speed * dt_s), turned / (rate * dt_s))
    return np.asarray(np.maximum(np.ceil(intervals), 2.0), dtype=int)


@dataclass(frozen=True)
class Limb:
    """States of one limb: its grips, then the air by class (the hold it comes from, or any) and age."""

    grips: Indices  # (G,) of the scenario's
    of_class: Indices  # (G,) class of a swing that begins there
    air: Indices  # (C, G) least knots of a swing of a class to a grip

    @staticmethod
    def of(grips: Indices, hold: Indices, air: Indices, ages: int) -> Limb:
        """With so many ages told apart, and for more than two of them the holds; `air` (G, G) of these grips."""
        of_class = np.unique(hold, return_inverse=True)[1] if ages > 2 else np.zeros(len(grips), dtype=int)
        least = [air[of_class == c].min(axis=0) for c in range(of_class.max() + 1)]
        return Limb(grips, of_class, np.minimum(least, ages))

    @property
    def ages(self) -> int:
        """Knots in the air that are told apart, the last one for all that follow."""
        return int(self.air.max())

    @property
    def options(self) -> Indices:
        """Of every state, the place in `grips`; what comes after them is the air."""
        many = len(self.grips)
        return np.minimum(np.arange(many + len(self.air) * self.ages), many)

    def step(self, value: Array, change: float) -> Array:
        """What states (s, ...) cost at the next knot at least."""
        many, new = len(self.grips), value.copy()
        for c, least in enumerate(self.air):
            block = slice(many + c * self.ages, many + (c + 1) * self.ages)
            air = value[block]
            since = np.minimum.accumulate(air[::-1])[::-1]  # [a]: in the air for a + 1 knots or more
            new[:many] = np.minimum(new[:many], since[least - 1] + change)
            new[block][1:] = air[:-1]
            new[block][-1] = np.minimum(new[block][-1], air[-1])
            new[block][0] = value[:many][self.of_class == c].min(axis=0) + change
        return new

    def step_back(self, value: Array, change: float) -> Array:
        """The same of costs to go, from one knot to the one before."""
        many, new = len(self.grips), value.copy()
        for c, least in enumerate(self.air):
            block = slice(many + c * self.ages, many + (c + 1) * self.ages)
            air, own = value[block], self.of_class == c
            new[:many][own] = np.minimum(value[:many][own], air[0] + change)
            new[block][:-1] = air[1:]
            for age in range(1, self.ages + 1):
                landed = value[:many][least <= age].min(axis=0, initial=np.inf) + change
                new[block][age - 1] = np.minimum(new[block][age - 1], landed)
        return new


class Program:
    """The dynamic program over sets (n, 4) at every knot and `goals` at the last one; as many ages of swings are told
    apart as there is space for.
    """

    def __init__(
        self,
        sets: Indices,
        start: Node,
        goals: set[Node],
        hold: Indices,
        air: Indices,
        change: float,
        most: int = _MOST,
    ) -> None:
        self.change, ends = change, np.array([start, *sorted(goals)])
        used = [np.setdiff1d(np.concatenate([sets[:, limb], ends[:, limb]]), [AIR]) for limb in range(4)]
        for ages in _AGES:
            self.limbs = [Limb.of(grips, hold[grips], air[np.ix_(grips, grips)], ages) for grips in used]
            self._options = [limb.options for limb in self.limbs]
            if np.prod([float(len(each)) for each in self._options]) <= most:
                break
        else:
            raise NotShownError("too many sets of grips")
        self._sets, self._ends = self._places(sets), self._places(ends)

    def _places(self, sets: Indices) -> tuple[Indices, ...]:
        """Of each limb, its options."""
        columns = []
        for limb, own in zip(self.limbs, sets.T, strict=True):
            columns.append(np.where(own == AIR, len(limb.grips), np.searchsorted(limb.grips, own)))
        return tuple(columns)

    def forward(self, stages: Array, kept: list[Array] | None = None) -> float:
        """The least from the start to a goal, stages (N, n) the costs of sets at knots; `kept`: states at knots."""
        value = np.full([len(each) for each in self._options], np.inf)
        value[tuple(own[0] for own in self._ends)] = 0.0
        for stage in stages:
            value = value + self._costs(stage)
            if kept is not None:
                kept.append(value)
            for axis, limb in enumerate(self.limbs):
                value = np.moveaxis(limb.step(np.moveaxis(value, axis, 0), self.change), 0, axis)
        return float(value[tuple(own[1:] for own in self._ends)].min(initial=np.inf))

    def through(self, stages: Array) -> Array:
        """(N, n) the least of all ways that are with a set at a knot."""
        before: list[Array] = []
        self.forward(stages, before)
        value = np.full(before[0].shape, np.inf)
        value[tuple(own[1:] for own in self._ends)] = 0.0
        found = np.empty(stages.shape)
        for knot in reversed(range(len(stages))):
            for axis, limb in enumerate(self.limbs):
                value = np.moveaxis(limb.step_back(np.moveaxis(value, axis, 0), self.change), 0, axis)
            whole = before[knot] + value
            for axis, limb in enumerate(self.limbs):
                whole = np.minimum.reduceat(whole, np.arange(len(limb.grips) + 1), axis=axis)
            found[knot] = whole[self._sets]
            value = value + self._costs(stages[knot])
        return found

    def _costs(self, stage: Array) -> Array:
        """By states; inf where there is no set."""
        table = np.full([len(limb.grips) + 1 for limb in self.limbs], np.inf)
        table[self._sets] = stage
        return table[np.ix_(*self._options)]
