"""The least that a knot of J (6) costs with a set of grips, shown by multipliers: for every plan that passes the check.

For multipliers pi of force and moment about W's origin, both sides of balance in grips.py are equal, so that
    cost  =  cost + right side - left side
          >= sum over grips of the least of R |q|^2 - pi . w(q)
             + least over bodies of Q |x - x_g|^2 + right side,
each least by itself, over all that (1)-(4), (7) and the joints' limits leave: grasps anywhere on their faces, any tilt
and heading. Any pi will do. Of a grip, q = (s1, s2, m / k, n1, n2), the least is shown by weak duality once more.
"""

from __future__ import annotations

from dataclasses import dataclass, fields, replace

import numpy as np
from crux_contracts.cost_weights import cost_weights
from crux_contracts.robot import Robot

from crux_planner.checker.geometry import Array, Flags, Indices, rotation_about_z
from crux_planner.checker.grips import AIR_N, SLACK_N, Frame, Offer
from crux_planner.checker.no_way import AIR, NotShownError, NoWay, Places
from crux_planner.checker.outer import FOLLOW, Outer

_HEADINGS_RAD = np.array([0.05, 0.15, 0.35])  # ends of cells of headings on both sides of the goal's
_LOADS, _SHARES = np.linspace(0.0, 1.0, 17), np.linspace(0.0, 1.0, 9)  # second multipliers looked at
_MOST = 60_000  # sets of grips


class GripCosts:
    """The least of R |q|^2 - pi . w of every grip."""

    def __init__(self, found: list[Offer], above_m: float, k_m: float, most_N: float, weight: float) -> None:
        self.corners = np.array([each.corners_w_m for each in found])  # (G, 4, 3)
        self.wrists = self.corners + np.array([0.0, 0.0, above_m])
        self.axis, self.tangent = (np.array([getattr(each, name) for each in found]) for name in ("axis", "tangent"))
        self.friction, spines = (np.array([getattr(each, name) for each in found]) for name in ("friction", "spines"))
        both = spines.max(axis=1)  # (G, 3); a load shown by one finger alone has that one's spines
        self.spines = np.stack([spines[:, 1], *[both] * (len(_SHARES) - 2), spines[:, 0]], axis=1)  # (G, shares, 3)
        self.k_m, self.most_N, self.weight = k_m, most_N + SLACK_N, weight
        forgiven = [each.forgiven(k_m, most_N) for each in found]
        self.slack_N, self.slack_Nm = (np.array(each) for each in zip(*forgiven, strict=True))  # (G, 2), (G,)

    def least(self, multipliers: Array, slope: Array) -> Array:
        """(G,), each grip's part FOLLOW of where the centre of mass is included, `slope` (3,) the cost of that.

        It is concave in the place, so that the corners of where a grasp can be have the least.
        """
        force, moment, weight = multipliers[:3], multipliers[3:], self.weight
        pull = force + np.cross(moment, self.corners)  # (G, 4, 3) by force at the corner
        twist = np.broadcast_to(self.k_m * (self.axis @ moment)[:, None], pull.shape[:2])
        load = 2 * np.stack([(pull * self.tangent[:, None]).sum(axis=-1), pull[..., 2], twist], axis=-1)
        wanted = load / (4 * weight)  # the cheapest (s1, s2, m / k), were there no limit
        beyond = np.maximum(np.abs(wanted)[:, :, None] - self.spines[:, None], 0.0)
        over = np.linalg.norm(beyond, axis=-1)[..., None, :]  # (G, 4, 1, shares)
        price = 4 * weight * over * _LOADS[:, None]
        less = np.minimum(over, price / (4 * weight))
        total = 2 * weight * less**2 + price * (over - less)
        spread = (pull * self.axis[:, None]).sum(axis=-1)[..., None, None]
        for finger, (side, share) in enumerate(((1.0, _SHARES), (-1.0, 1.0 - _SHARES))):
            rough, slack_N = (each[:, finger, None, None, None] for each in (self.friction, self.slack_N))
            slope_n = -side * spread - share * price * rough
            normal = np.clip(-slope_n / (2 * weight), -SLACK_N, self.most_N)
            total = total + weight * normal**2 + slope_n * normal - share * price * slack_N
        best = total.max(axis=(2, 3)) - 2 * weight * (wanted**2).sum(axis=-1)
        best = best + FOLLOW * self.wrists @ slope
        return np.asarray(best.min(axis=1) - self.slack_Nm * np.linalg.norm(moment))


@dataclass(frozen=True)
class Cells:
    """Where the body of each set of grips may be, by cells of its tilt and heading."""

    cost: Array  # (C,) the least that Q asks for tilt and heading
    yaw_rad: Array  # (C, 2)
    rest: Array  # (C, 16, 2, 3) Frame.rest by the limbs that hold, limb l as bit l
    low: Array  # (C, n, 3) of the body's origin in W
    high: Array

    @staticmethod
    def joined(parts: list[Cells]) -> Cells:
        """All of them, of the same sets."""
        return Cells(*(np.concatenate([getattr(part, each.name) for part in parts]) for each in fields(Cells)))

    def of_sets(self, kept: Flags) -> Cells:
        """Of some of the sets."""
        return replace(self, low=self.low[:, kept], high=self.high[:, kept])


class KnotCosts:
    """Of the sets of grips that limbs may hold at once, one grip a limb or none (AIR)."""

    def __init__(self, search: NoWay, robot: Robot) -> None:
        scenario, found, body = search.scenario, search.offers, robot.body
        self.search, self.weights = search, cost_weights(scenario)
        if self.weights.wrench <= 0.0:
            raise NotShownError("forces have no weight in J")
        self._goal, self._balance = scenario.goal.body, search.balance
        limits = self._balance.k_m, self._balance.most_N, self.weights.wrench
        self._grips = GripCosts(found, search.outer.above_m, *limits)
        self.sets = self._sets(search.places)
        self._held = self.sets != AIR
        level = search.outers.within(body.max_tilt_rad / 3)
        near = Places.of(level.hold_m, level.above_m, found, search.headings_rad)
        tilted = self._cells(search.outer, search.places, body.max_tilt_rad / 3)
        self.cells = Cells.joined([self._cells(level, near, 0.0), tilted])

    @property
    def in_air(self) -> Indices:
        """(n,) limbs."""
        return np.asarray(4 - self._held.sum(axis=1))

    def keep(self, kept: Flags) -> None:
        """Only these sets from now on."""
        self.sets, self._held, self.cells = self.sets[kept], self._held[kept], self.cells.of_sets(kept)

    def _sets(self, where: Places) -> Indices:
        """(n, 4) all whose grips are in reach of one body, at most three limbs in the air: nothing else holds it."""
        hold = np.unique(self.search.hold, return_inverse=True)[1]
        low = np.full((1, len(where.yaw_rad), 2), -np.inf)
        high, sets = -low, np.zeros((1, 0), dtype=int)
        for limb in range(4):
            parts = [(low, high, np.column_stack([sets, np.full(len(sets), AIR)]))]
            for grip in range(len(hold)):
                lows, highs = np.maximum(low, where.low[:, limb, grip]), np.minimum(high, where.high[:, limb, grip])
                free = ~((sets != AIR) & (hold[sets] == hold[grip])).any(axis=1)
                kept = free & (lows <= highs).all(axis=2).any(axis=1)
                own = np.full(int(kept.sum()), grip)
                parts.append((lows[kept], highs[kept], np.column_stack([sets[kept], own])))
            low, high, sets = (np.concatenate(each) for each in zip(*parts, strict=True))
            if len(sets) > _MOST:
                raise NotShownError(f"more than {_MOST} sets of grips")
        return np.asarray(sets[(sets != AIR).any(axis=1)])

    def _cells(self, outer: Outer, where: Places, tilt_rad: float) -> Cells:
        """Of tilts of at least so much, up to what `outer` is about."""
        roll, pitch, yaw = self._goal.rpy_rad
        first, last = self.search.headings_rad
        half = (last - first) / len(where.yaw_rad) / 2
        away = (where.yaw_rad - yaw + np.pi) % (2 * np.pi) - np.pi
        window = np.searchsorted(np.concatenate([-_HEADINGS_RAD[::-1], _HEADINGS_RAD]), away)
        starts = np.flatnonzero(np.diff(window, prepend=-1))
        ends = np.append(starts[1:], len(away)) - 1
        yaws = np.column_stack([where.yaw_rad[starts] - half, where.yaw_rad[ends] + half])
        turned = np.maximum(np.minimum.reduceat(np.abs(away), starts) - half, 0.0)
        tilted = max(tilt_rad - max(abs(roll), abs(pitch)), 0.0)
        frames = [Frame.of(outer, float(a + b) / 2, float(b - a) / 2) for a, b in yaws]
        holding = [tuple(limb for limb in range(4) if pattern >> limb & 1) for pattern in range(16)]
        rest = np.array([[frame.rest(held) for held in holding] for frame in frames])
        parts = [
            self._boxes(outer, where, part, starts) for part in np.array_split(self.sets, len(self.sets) // 2000 + 1)
        ]
        low, high = (np.concatenate(each, axis=1) for each in zip(*parts, strict=True))
        return Cells(self.weights.orientation * (turned**2 + tilted**2), yaws, rest, low, high)

    def _boxes(self, outer: Outer, where: Places, sets: Indices, starts: Indices) -> tuple[Array, Array]:
        """Bounds (C, n, 3) each of the body's origin; nowhere where low is above high."""
        low = np.full((len(where.yaw_rad), len(sets), 2), -np.inf)
        high = -low
        for limb in range(4):
            held = np.flatnonzero(sets[:, limb] != AIR)
            grips = sets[held, limb]
            low[:, held] = np.maximum(low[:, held], where.low[:, limb, grips])
            high[:, held] = np.minimum(high[:, held], where.high[:, limb, grips])
        empty = (low > high).any(axis=2, keepdims=True)
        turn = rotation_about_z(where.yaw_rad)[:, None, :2, :2]
        middle = (turn @ ((low + high) / 2)[..., None])[..., 0]
        half = (np.abs(turn) @ ((high - low) / 2 + 1.1 * outer.sole_m)[..., None])[..., 0]
        lows = np.minimum.reduceat(np.where(empty, np.inf, middle - half), starts)
        highs = np.maximum.reduceat(np.where(empty, -np.inf, middle + half), starts)
        nowhere = lows > highs
        lows[nowhere], highs[nowhere] = 1.0, 0.0
        ends = zip((lows, highs), self.search.height_m, strict=True)
        low, high = (np.dstack([end, np.full(end.shape[:2], height)]) for end, height in ends)
        return low, high

    def least(
        self, multipliers: Array, box: Array | None = None, yaw_rad: Array | None = None, which: Indices | None = None
    ) -> Array:
        """(n,) of all sets or some; inf where no body of a set is in a box (2, 3) with a heading within bounds (2,)."""
        which = np.arange(len(self.sets)) if which is None else which
        cells, balance, held = self.cells, self._balance, self._held[which]
        low, high, cost = cells.low[:, which], cells.high[:, which], cells.cost
        if box is not None:
            low, high = np.maximum(low, box[0]), np.minimum(high, box[1])
        if yaw_rad is not None:
            cost = np.where((cells.yaw_rad[:, 1] < yaw_rad[0]) | (cells.yaw_rad[:, 0] > yaw_rad[1]), np.inf, cost)
        none = (low > high).any(axis=2)
        slope, force, moment = balance.slope(multipliers), multipliers[:3], multipliers[3:]
        by_body = (1.0 - FOLLOW * held.sum(axis=1))[:, None] * slope
        weight, goal = self.weights.position, np.array(self._goal.position_m)
        cheapest = goal - by_body / (2 * weight) if weight > 0.0 else np.where(by_body > 0.0, -np.inf, np.inf)
        place = np.minimum(np.maximum(cheapest, low), high)
        rest = np.minimum(slope * cells.rest[:, :, 0], slope * cells.rest[:, :, 1]).sum(axis=2)
        total = cost[:, None] + rest[:, held @ (1 << np.arange(4))]
        for axis in range(3):
            total += (weight * (place[..., axis] - goal[axis]) ** 2) + by_body[:, axis] * place[..., axis]
        air = 4 - held.sum(axis=1)
        total -= (balance.push_N + AIR_N * air) * self._lever(force, moment, low, high)
        best = np.where(none, np.inf, total).min(axis=0)
        grips = np.append(self._grips.least(multipliers, slope), 0.0)  # the last for AIR
        twist_Nm = balance.twist_Nm + balance.air_Nm * air
        fixed = self.search.outer.mass_kg * float(force @ balance.gravity) + twist_Nm * np.linalg.norm(moment)
        return np.asarray(best + grips[self.sets[which]].sum(axis=1) - fixed)

    def _lever(self, force: Array, moment: Array, low: Array, high: Array) -> Array:
        """(C, n) the most that a newton on the centre of mass does, of bodies within bounds (C, n, 3)."""
        middle, half = (low + high) / 2, (high - low) / 2
        square, size = np.zeros(low.shape[:2]), np.zeros(low.shape[:2])
        for axis in range(3):
            b, c = (axis + 1) % 3, (axis + 2) % 3
            square = square + (force[axis] + moment[b] * middle[..., c] - moment[c] * middle[..., b]) ** 2
            size = size + half[..., axis] ** 2
        return np.asarray(np.sqrt(square) + np.linalg.norm(moment) * (np.sqrt(size) + self._balance.far_m))
