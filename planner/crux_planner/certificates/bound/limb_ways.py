"""The cheapest way of one limb by itself: which contact it is on at each knot, and when it swings from one to the next.

Every knot on a contact and every knot of a swing has a cost. A swing lasts at least as long as the gripper takes, and
as the body takes to come within reach of where it lands. Beside the least of all ways there is their soft least,
-T log sum exp(-cost / T), which is smooth in the costs: its slopes are how much of the ways is where.
"""

from __future__ import annotations

import numpy as np

from crux_planner.certificates.bound.places import shoulder_to_wrist
from crux_planner.certificates.bound.swings import ends, knots_in_air
from crux_planner.model.arrays import Array, Flags, Indices
from crux_planner.model.problem import Problem


class LimbWays:
    """Of one limb over `contacts` (C,), that of the start first; `allowed` (N + 1, C) says where it may be at a knot.

    Its swings (P,) are sorted by where they end; costs are `ground` (N, C) and `air` (N, P).
    """

    def __init__(self, problem: Problem, limb: int, contacts: Indices, allowed: Flags) -> None:
        air = knots_in_air(problem, contacts, back=True)
        place = np.stack([problem.contacts[c].centre_h_m[:2] for c in contacts])
        arm = problem.limb_masses[limb].limb
        far_m = 2 * (shoulder_to_wrist(arm)[1] + float(np.linalg.norm(arm.shoulder_b_m)))
        apart = np.linalg.norm(place[:, None] - place, axis=2)
        speed = 2**0.5 * problem.body.max_speed_m_s * problem.dt_s
        air = np.maximum(
            air, np.ceil((apart - far_m) / speed - 1.0)
        )  # the body is in reach a knot before and at landing
        self.allowed, self.change = allowed[1:], problem.weights.switching
        self.ends = ends(problem, limb, contacts)
        last = np.array([np.flatnonzero(own)[-1] if own.any() else -1 for own in allowed.T])
        first = np.array([np.flatnonzero(own)[0] if own.any() else len(own) for own in allowed.T])
        come, go = np.nonzero((first[:, None] + air < last).T)  # where it ends first: sorted by that
        self.begins, self.lands, self.knots = go, come, air[go, come].astype(int)
        self._groups = np.flatnonzero(np.diff(come, prepend=-1))
        self._landed_on = come[self._groups]
        self._by_begin = np.argsort(go, kind="stable")
        self._begun = np.flatnonzero(np.diff(go[self._by_begin], prepend=-1))
        self._begun_on = go[self._by_begin][self._begun]

    def least(self, ground: Array, air: Array) -> float:
        """What no way costs less than."""
        total = np.concatenate([np.zeros((1, air.shape[1])), np.cumsum(air, axis=0)])
        value = np.full((len(ground) + 1, ground.shape[1]), np.inf)
        value[0, 0] = 0.0
        aloft, every = np.full(air.shape[1], np.inf), np.arange(air.shape[1])  # may land, less `total`
        for k in range(1, len(value)):
            value[k] = value[k - 1] + ground[k - 1]
            begun = k - self.knots  # first knot in the air of those that may land now
            since = np.maximum(begun, 1)
            entered = value[since - 1, self.begins] + ground[since - 1, self.begins] - total[since, every]
            aloft = np.minimum(aloft, np.where(begun >= 1, entered, np.inf))
            if len(self._groups):
                landed = np.minimum.reduceat(aloft + total[k], self._groups) + 2 * self.change
                value[k, self._landed_on] = np.minimum(value[k, self._landed_on], landed)
            value[k, ~self.allowed[k - 1]] = np.inf
        return float(value[-1, self.ends].min(initial=np.inf))

    def soft(self, ground: Array, air: Array, heat: float, about: float) -> tuple[float, Array, Array] | None:
        """-heat log sum exp(-cost / heat) over all ways, and its slopes in the costs, (N, C) and (N, P): how much of
        the ways is on a contact or swing at a knot. None where that is too small or large for numbers, the least being
        `about` so much.
        """
        each = about / len(ground)  # taken off every knot, so that numbers stay near 1
        with np.errstate(over="ignore", under="ignore", invalid="ignore", divide="ignore"):
            on, up, change = np.exp((each - ground) / heat), np.exp((each - air) / heat), np.exp(-self.change / heat)
            whole = self._whole(air - each, heat) * change
            before, ready = self._before(on, up, whole, change)
            after, entered = self._after(on, up, whole, change)
            size = float(before[-1] @ after[-1])
            if not np.isfinite(size) or size <= 0.0:
                return None
            left = before[:-1].take(self.begins, axis=1) * on.take(self.begins, axis=1) * entered[1:] / size
            moved = np.zeros_like(up)  # leave for the air, less land
            moved[1:] = left[:-1]
            moved -= ready[:-1] * change * after[:-1].take(self.lands, axis=1) / size
            staying, aloft = before[:-1] * after[:-1] / size, np.maximum(np.cumsum(moved, axis=0), 0.0)
        if not (np.isfinite(staying).all() and np.isfinite(aloft).all()):
            return None
        return len(ground) * each - heat * float(np.log(size)), staying, aloft

    def _whole(self, air: Array, heat: float) -> Array:
        """(N + 1, P) of the knots of a swing that are over at a knot, as many as it takes at least; 0 where too few."""
        total = np.concatenate([np.zeros((1, air.shape[1])), np.cumsum(air, axis=0)])
        begun = np.arange(len(total))[:, None] - self.knots
        since = np.take_along_axis(total, np.maximum(begun, 0), axis=0)
        return np.where(begun >= 1, np.exp((since - total) / heat), 0.0)

    def _before(self, on: Array, up: Array, whole: Array, change: float) -> tuple[Array, Array]:
        """(N + 1, C) and (N + 1, P) of all ways up to a knot: to contacts, and on swings that may land."""
        knots, many = on.shape
        before, ready = np.zeros((knots + 1, many)), np.zeros((knots + 1, up.shape[1]))
        longest = int(self.knots.max(initial=0)) + 1
        left = np.zeros((longest + knots, many))  # contacts, by the knot before
        place = (longest - 1 - self.knots) * many + self.begins
        before[0, 0] = 1.0
        for k in range(1, knots + 1):
            left[longest + k - 1] = stay = before[k - 1] * on[k - 1]
            np.multiply(ready[k - 1], up[k - 1], out=ready[k])
            ready[k] += left.take(place + k * many) * whole[k]
            before[k] = stay
            if len(self._groups):
                before[k, self._landed_on] += np.add.reduceat(ready[k], self._groups) * change
            before[k] *= self.allowed[k - 1]
        return before, ready

    def _after(self, on: Array, up: Array, whole: Array, change: float) -> tuple[Array, Array]:
        """(N + 1, C), (N + 1, P) of all ways from a knot on: from contacts, of swings first in the air there."""
        (knots, many), swings = on.shape, up.shape[1]
        after, entered = np.zeros((knots + 1, many)), np.zeros((knots + 1, swings))
        landing = np.zeros((knots + 2, swings))
        over = np.zeros((knots + 2 + int(self.knots.max(initial=0)), swings))  # of swings that have just lasted enough
        place = self.knots * swings + np.arange(swings)
        after[knots, self.ends] = self.allowed[-1, self.ends]
        for k in range(knots, -1, -1):
            if k < knots:
                after[k] = after[k + 1]
                entered[k + 1] = over.take(place + (k + 1) * swings)
                if len(self._begun):
                    after[k, self._begun_on] += np.add.reduceat(entered[k + 1].take(self._by_begin), self._begun)
                after[k] *= on[k]
                if k > 0:
                    after[k] *= self.allowed[k - 1]
            landing[k] = change * after[k].take(self.lands)
            if k < knots:
                landing[k] += up[k] * landing[k + 1]
            over[k] = whole[k] * landing[k]
        return after, entered
