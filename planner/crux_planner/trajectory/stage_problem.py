"""The exact P1 of one schedule as a chain of stages: bounds, rows and derivatives as arrays over all knots.

Rows low <= g <= high, in order: body (7), reach (9a), columns, limit surface (2)+(3), torques, reach between knots.
"""

from __future__ import annotations

from copy import copy
from dataclasses import dataclass, replace

import numpy as np

from crux_planner.model.arrays import Array, Flags, Indices
from crux_planner.model.contacts import Contact
from crux_planner.model.hands import UPRIGHT, hands_of
from crux_planner.model.problem import BODY_STATES, Problem
from crux_planner.model.schedule import Schedule
from crux_planner.physics.bounds import wrench_bounds
from crux_planner.physics.dynamics import WRENCH_INPUTS
from crux_planner.physics.torque import LEANING
from crux_planner.trajectory.stage_functions import COLUMN, FORCE_SCALE_N, POSE, SPINE_WEIGHT, StageFunctions

PINNED = 1e8  # weight that holds what is fixed
_RELAXED = 1e-8  # bounds give so much, so that there is an inside
_AWAY = np.array([1.0, 0.0, 0.0])
_BY_KNOT = ["stance", "grasps", "fingers", "maps", "rough", "by_spines", "grippers", "hands", "fixed", "fixed_value"]
"""Arrays of a StageProblem with the knots first."""


@dataclass(frozen=True)
class Derivatives:
    """All that a Newton step needs, at one point."""

    cost: float
    body_slope: Array  # (N + 1, 12) of the cost
    body_hessian: Array  # (N + 1, 12, 12) of the Lagrangian
    column_slope: Array  # (N, 4, 8)
    column_hessian: Array  # (N, 4, 8, 8)
    cross: Array  # (N, 4, 12, 8)
    next_states: Array  # (N, 12)
    state_map: Array  # (N, 12, 12)
    into_state: Array  # (N, 4, 12, 8)
    rows: Array  # (R,)
    reach: Array  # (N, m, 6), knots 1..N
    surface: Array  # (N, 4, m, 8)
    torques: Array  # (P, 2 S, 17) at `limited`
    between: Array  # (B, m, 12) of the states at the intervals' begin


class StageProblem:
    """One schedule's P1 with x[0] fixed, and no rows for torques (`limiting`); air columns stay zero."""

    def __init__(self, functions: StageFunctions, problem: Problem, schedule: Schedule) -> None:
        self.functions, self.problem = functions, problem
        n = self.knots = problem.steps
        contacts = [[problem.contacts[c] if c is not None else None for c in knot] for knot in schedule.contacts[:n]]
        self.stance: Flags = np.array([[c is not None for c in knot] for knot in contacts])
        self.grasps = np.array([[_grasp(c, problem.hand_numbers) for c in knot] for knot in contacts])
        none = np.zeros(2)
        friction = np.array([[none if c is None else c.grip_friction for c in knot] for knot in contacts])
        spiny = np.array([[none if c is None else c.spines.any(axis=1) for c in knot] for knot in contacts])
        self.fingers = np.concatenate([problem.friction_share * friction, spiny], axis=-1)
        if problem.leans:
            self._lean(contacts)
        self.maps = functions.wrench_maps(self.grasps.reshape(4 * n, -1))[0].reshape(n, 4, 6, WRENCH_INPUTS)
        self.maps = self.maps * self.stance[..., None, None]
        rough = self.stance[..., None] & (friction > 0.0)  # elsewhere the cone has shrunk to a ray: spines carry all
        self.rough = np.repeat(rough, functions.surface_rows // 2, axis=-1)
        self.by_spines = self.stance & ~rough.all(axis=-1)
        self.grippers = functions.grippers(schedule)
        self.hands = hands_of(schedule.poses[:-1]).reshape(n, -1)
        self.limited: tuple[Indices, Indices] = (np.zeros(0, dtype=int), np.zeros(0, dtype=int))  # knots and limbs
        self.between = functions.between()
        self._set_bounds(schedule, contacts)

    def limiting(self, places: frozenset[tuple[int, int]], problem: Problem) -> StageProblem:
        """The same with rows for torques at these knots and limbs, of a problem that may have other torque limits."""
        part = copy(self)
        knots, limbs = np.array(sorted(places), dtype=int).reshape(-1, 2).T
        part.problem, part.limited = problem, (knots, limbs)
        lows, highs = self.split(self.low), self.split(self.high)
        highs[-2] = _raised(np.tile(problem.torque_limits_Nm[limbs], 2))
        lows[-2] = -highs[-2]
        part._set_rows(lows, highs)
        return part

    def _lean(self, contacts: list[list[Contact | None]]) -> None:
        """Adds to grasps and fingers what leaning faces need."""
        upright, nothing = np.zeros(2), np.zeros(LEANING)
        lean = np.array([[upright if c is None else c.lean_rad for c in knot] for knot in contacts])
        moments = [[nothing if c is None else c.leaning_moments.ravel() for c in knot] for knot in contacts]
        self.fingers = np.concatenate([self.fingers, np.cos(lean), np.sin(lean)], axis=-1)
        self.grasps = np.concatenate([self.grasps, np.array(moments)], axis=-1)

    def _set_bounds(self, schedule: Schedule, contacts: list[list[Contact | None]]) -> None:
        problem = self.problem
        low, high = self.functions.body_bounds(problem, schedule)
        self.first, self.last = low[0], (low[-1] + high[-1]) / 2
        fixed = low >= high - 1e-12
        self.pinned = fixed[-1].astype(float)
        body_low, body_high = np.where(fixed, -np.inf, low)[1:], np.where(fixed, np.inf, high)[1:]
        reach_low, reach_high = self.functions.reach_bounds(problem, schedule)
        self._reach_rows = reach_low.shape[1]
        column_low, column_high = self._column_bounds(contacts)
        self.fixed: Flags = column_low >= column_high
        self.fixed_value = np.where(self.fixed, column_low, 0.0)
        column_low, column_high = np.where(self.fixed, -np.inf, column_low), np.where(self.fixed, np.inf, column_high)
        surface_low = np.where(self.rough, problem.surface_reserve_N / FORCE_SCALE_N, -np.inf)
        torque = np.zeros((0, self._interval_torques))
        lows = [body_low, reach_low, column_low, surface_low, torque, self.between.low]
        highs = [body_high, reach_high, column_high, np.full(surface_low.shape, np.inf), torque, self.between.high]
        self._set_rows([-_raised(-low) for low in lows], [_raised(high) for high in highs])

    @property
    def _interval_torques(self) -> int:
        return 2 * int(self.problem.torque_limits_Nm.shape[1])

    def _set_rows(self, lows: list[Array], highs: list[Array]) -> None:
        self.low, self.high = (np.concatenate([part.ravel() for part in parts]) for parts in (lows, highs))
        self.bounded: Flags = np.isfinite(np.stack([self.low, self.high]))
        self._ends = np.cumsum([part.size for part in lows])[:-1]
        each = [np.repeat(np.arange(self.knots), part.size // self.knots) for part in lows[:-2]]
        between = np.repeat(self.between.intervals, self.between.low.shape[1])
        self._row_knots = np.concatenate([*each, np.repeat(self.limited[0], self._interval_torques), between])

    def window(self, first: int, last: int, body: Array) -> StageProblem:
        """The same from one knot to another, at both of which the body is as in `body` (N + 1, 12)."""
        part = copy(self)
        part.knots, part.first = last - first, body[first]
        for name in _BY_KNOT:
            setattr(part, name, getattr(self, name)[first:last])
        (knots, limbs), intervals = self.limited, self.between.intervals
        inside, within = ((each >= first) & (each < last) for each in (knots, intervals))
        part.limited = knots[inside] - first, limbs[inside]
        part.between = replace(
            self.between,
            intervals=intervals[within] - first,
            **{name: getattr(self.between, name)[within] for name in ("share", "off", "grippers", "low", "high")},
        )
        lows, highs = (
            [*(rows[first:last].copy() for rows in parts[:-2]), parts[-2][inside], parts[-1][within]]
            for parts in (self.split(self.low), self.split(self.high))
        )
        if last < self.knots:
            part.pinned, part.last = np.ones(BODY_STATES), body[last]
            for on_state in (0, 1):  # they hold at a state that is given
                lows[on_state][-1], highs[on_state][-1] = -np.inf, np.inf
        part._set_rows(lows, highs)
        return part

    def lacking(self, body: Array, columns: Array) -> Array:
        """(N,): by how much rows are violated in the interval that begins at each knot, in their units."""
        most = np.zeros(self.knots)
        np.maximum.at(most, self._row_knots, -self.slack(self.rows(body, columns)).min(axis=0))
        return most

    def without_violated(self, kept: slice, body: Array, columns: Array) -> StageProblem:
        """The same without bounds that are violated outside the `kept` knots."""
        part = copy(self)
        values = self.rows(body, columns)
        outside = (self._row_knots < kept.start) | (self._row_knots >= kept.stop)
        part.low = np.where(outside & (values < self.low), -np.inf, self.low)
        part.high = np.where(outside & (values > self.high), np.inf, self.high)
        part.bounded = np.isfinite(np.stack([part.low, part.high]))
        return part

    def _column_bounds(self, contacts: list[list[Contact | None]]) -> tuple[Array, Array]:
        """Bounds (7) of wrenches and (3) of the spines' shares, (N, 4, 8), scaled."""
        problem, scale = self.problem, self.functions.scale
        low, high = (np.full((self.knots, 4, COLUMN), sign * np.inf) for sign in (-1, 1))
        for contact, (knots, limbs) in _places(contacts):
            bounds = wrench_bounds(problem, contact)
            low[knots, limbs, :WRENCH_INPUTS], high[knots, limbs, :WRENCH_INPUTS] = bounds[0] / scale, bounds[1] / scale
            spines, rough = problem.friction_share * contact.spines / scale[:3], contact.grip_friction > 0.0
            if rough.any():
                high[knots, limbs, WRENCH_INPUTS:] = spines.max(axis=0)
            if not rough.all():  # where spines carry all, their limits are those of the load itself
                high[knots, limbs, :3] = spines[~rough].min(axis=0)
            for part in (slice(0, 3), slice(WRENCH_INPUTS, COLUMN)):
                low[knots, limbs, part] = -high[knots, limbs, part]
            low[knots, limbs, 1] = np.maximum(low[knots, limbs, 1], bounds[0][1] / scale[1])  # a foot never pulls
        return low, high

    def split(self, rows: Array) -> list[Array]:
        """A vector of rows as body (N, 12), reach (N, m), column (N, 4, 8), surface (N, 4, m), torques (P, 2 S) and
        reach between knots (B, m)."""
        n, parts = self.knots, np.split(rows, self._ends)
        shapes = [
            (n, BODY_STATES),
            (n, self._reach_rows),
            (n, 4, COLUMN),
            (n, 4, self.functions.surface_rows),
            (len(self.limited[0]), self._interval_torques),
            self.between.low.shape,
        ]
        return [part.reshape(shape) for part, shape in zip(parts, shapes, strict=True)]

    def slack(self, values: Array) -> Array:
        """(2, R): how far rows are inside their bounds; 1 where there is none."""
        return np.where(self.bounded, np.stack([values - self.low, self.high - values]), 1.0)

    def next_states(self, body: Array, columns: Array) -> Array:
        """(N, 12): where (8) leads from every knot."""
        totals = np.einsum("klij,klj->ki", self.maps, columns[..., :WRENCH_INPUTS])
        return np.asarray(self.functions.step(body[:-1], totals, self.hands, np.zeros((self.knots, BODY_STATES)))[0])

    def torque_shares(self, body: Array, columns: Array) -> dict[tuple[int, int], float]:
        """Largest joint torque over its limit in a knot's interval, per knot and limb in stance."""
        knots, limbs = held = np.nonzero(self.stance)
        grasps = self.grasps[held]
        numbers = self.functions.numbers_over(limbs, body[knots], grasps)
        torques = self.functions.torque_values(body[knots], columns[held][:, :WRENCH_INPUTS], grasps, numbers)[0]
        used = (np.abs(torques) / np.tile(self.problem.torque_limits_Nm[limbs], 2)).max(axis=1)
        return dict(zip(zip(knots.tolist(), limbs.tolist(), strict=True), used.tolist(), strict=True))

    def rows(self, body: Array, columns: Array) -> Array:
        """(R,) values."""
        duals = np.zeros_like(self.low)
        return self.derivatives(body, columns, np.zeros((self.knots, BODY_STATES)), duals).rows

    def derivatives(
        self, body: Array, columns: Array, multipliers: Array, duals: Array, *, near: bool = False
    ) -> Derivatives:
        """Everything at a point; Hessians are those of cost + multipliers' dynamics - duals' rows. Far from a solution,
        rows of torques and reach bend either way and lead astray: only the convex part of reach is taken there.
        """
        f, n = self.functions, self.knots
        _, on_reach, _, on_surface, on_torques, on_between = self.split(duals)
        q = columns[..., :WRENCH_INPUTS]
        totals = np.einsum("klij,klj->ki", self.maps, q)
        step, state_map, by_total, step_hessian, step_cross = f.step(body[:-1], totals, self.hands, multipliers)
        reach, reach_slope, reach_hessian = f.reach_at(body[1:], self.grippers, on_reach)
        flat = columns.reshape(-1, COLUMN)
        on_surface = (on_surface * self.rough).reshape(4 * n, -1)
        surface, surface_slope, surface_hessian = f.surface(flat, self.fingers.reshape(4 * n, -1), on_surface)
        body_cost, body_slope, body_hessian = f.body_cost(body)
        column_cost, column_slope, column_hessian = f.column_cost(flat)
        body_hessian[:-1] += step_hessian
        body_hessian[1:, :POSE, :POSE] += -reach_hessian if near else _convex(-reach_hessian)
        column_hessian = (column_hessian - surface_hessian).reshape(n, 4, COLUMN, COLUMN)
        column_slope = column_slope.reshape(n, 4, COLUMN)
        column_slope[..., :3] += 2 * SPINE_WEIGHT * self.by_spines[..., None] * columns[..., :3]
        column_hessian[..., [0, 1, 2], [0, 1, 2]] += 2 * SPINE_WEIGHT * self.by_spines[..., None]
        into = np.zeros((n, 4, BODY_STATES, COLUMN))
        into[..., :WRENCH_INPUTS] = by_total[:, None] @ self.maps
        cross = np.zeros((n, 4, BODY_STATES, COLUMN))
        cross[..., :WRENCH_INPUTS] = step_cross[:, None] @ self.maps
        limited, limbs = self.limited
        torques, torque_slopes = np.zeros((0, 0)), np.zeros((0, self._interval_torques, BODY_STATES + WRENCH_INPUTS))
        if len(limbs):
            held = q[self.limited], self.grasps[self.limited]
            torques, torque_slopes = f.torques(body[limited], *held, f.numbers_over(limbs, body[limited], held[1]))
            if near:
                poses = body[limited, :POSE], step[limited, :POSE]
                bent = f.torque_hessian(limbs, poses, state_map[limited, :POSE], *held, -on_torques)
                self._add_both(bent, body_hessian, column_hessian, cross)
        between, between_slope = self._between(body, step, state_map, on_between, body_hessian, near=near)
        rows = [body[1:], reach, columns, surface, torques, between]
        return Derivatives(
            cost=float(body_cost.sum() + column_cost.sum()) + self._spines_cost(columns),
            body_slope=body_slope,
            body_hessian=body_hessian,
            column_slope=column_slope,
            column_hessian=column_hessian,
            cross=cross,
            next_states=step,
            state_map=state_map,
            into_state=into,
            rows=np.concatenate([part.ravel() for part in rows]),
            reach=reach_slope,
            surface=surface_slope.reshape(n, 4, -1, COLUMN) * self.rough[..., None],
            torques=torque_slopes,
            between=between_slope,
        )

    def _between(
        self, body: Array, step: Array, state_map: Array, duals: Array, body_hessian: Array, *, near: bool
    ) -> tuple[Array, Array]:
        """Reach (B, m) on the way to the next poses and its slopes (B, m, 12); what bends is added to the Hessian."""
        at, share = self.between.intervals, self.between.share[:, None]
        if not len(at):
            return self.between.low, np.zeros((*self.between.low.shape, BODY_STATES))
        pose = body[at, :POSE] + share * (step[at, :POSE] - body[at, :POSE]) + self.between.off
        first = np.eye(POSE, BODY_STATES)
        by_state = first + share[..., None] * (state_map[at, :POSE] - first)
        state = np.concatenate([pose, np.zeros((len(at), BODY_STATES - POSE))], axis=1)
        rows, slope, hessian = self.functions.reach_at(state, self.between.grippers, duals)
        bent = -hessian if near else _convex(-hessian)
        np.add.at(body_hessian, at, by_state.swapaxes(-1, -2) @ bent @ by_state)
        return rows, slope @ by_state

    def cost(self, body: Array, columns: Array) -> float:
        """What is minimised."""
        body_cost, column_cost = (
            self.functions.body_cost(body)[0],
            self.functions.column_cost(columns.reshape(-1, COLUMN))[0],
        )
        return float(body_cost.sum() + column_cost.sum()) + self._spines_cost(columns)

    def _spines_cost(self, columns: Array) -> float:
        return SPINE_WEIGHT * float((columns[self.by_spines][:, :3] ** 2).sum())

    def dual_residual(self, at: Derivatives, multipliers: Array, duals: Array) -> float:
        """Largest entry of the Lagrangian's slope."""
        body, columns = self._pulled(at, -duals)
        body += at.body_slope
        columns += at.column_slope
        body[:-1] += np.einsum("kij,ki->kj", at.state_map, multipliers)
        body[1:] -= multipliers
        columns += np.einsum("klij,ki->klj", at.into_state, multipliers)
        body[-1] *= 1.0 - self.pinned
        columns[self.fixed] = 0.0
        return max(float(np.abs(body[1:]).max()), float(np.abs(columns).max()))

    def condensed(self, at: Derivatives, stiffness: Array) -> tuple[Array, Array, Array]:
        """Hessians of body and columns and the cross terms, with the rows' barrier in them."""
        on_body, on_reach, on_column, on_surface, on_torques, on_between = self.split(stiffness)
        body, columns, cross = at.body_hessian.copy(), at.column_hessian.copy(), at.cross.copy()
        index = np.arange(BODY_STATES)
        body[1:, index, index] += on_body
        body[1:, :POSE, :POSE] += at.reach.swapaxes(-1, -2) @ (on_reach[..., None] * at.reach)
        between = at.between.swapaxes(-1, -2) @ (on_between[..., None] * at.between)
        np.add.at(body, self.between.intervals, between)
        index = np.arange(COLUMN)
        columns[..., index, index] += on_column + self.fixed * PINNED
        columns += at.surface.swapaxes(-1, -2) @ (on_surface[..., None] * at.surface)
        both = at.torques.swapaxes(-1, -2) @ (on_torques[..., None] * at.torques)
        self._add_both(both, body, columns, cross)
        return body, columns, cross

    def slopes(self, at: Derivatives, pull: Array) -> tuple[Array, Array]:
        """Of the cost by body (N + 1, 12) and columns (N, 4, 8), less what the rows' barrier pulls."""
        body, columns = self._pulled(at, -pull)
        return body + at.body_slope, columns + at.column_slope

    def _add_both(self, both: Array, body: Array, columns: Array, cross: Array) -> None:
        """Adds second derivatives (P, 17, 17) by body state and wrench at `limited` to the Hessians."""
        knots, limbs = self.limited
        np.add.at(body, knots, both[:, :BODY_STATES, :BODY_STATES])
        columns[knots, limbs, :WRENCH_INPUTS, :WRENCH_INPUTS] += both[:, BODY_STATES:, BODY_STATES:]
        cross[knots, limbs, :, :WRENCH_INPUTS] += both[:, :BODY_STATES, BODY_STATES:]

    def change(self, at: Derivatives, body: Array, columns: Array) -> Array:
        """Of the rows, for a step."""
        both = np.concatenate([body[self.limited[0]], columns[self.limited][:, :WRENCH_INPUTS]], axis=1)
        parts = [
            body[1:],
            np.einsum("kij,kj->ki", at.reach, body[1:, :POSE]),
            columns,
            np.einsum("klij,klj->kli", at.surface, columns),
            np.einsum("pij,pj->pi", at.torques, both),
            np.einsum("bij,bj->bi", at.between, body[self.between.intervals]),
        ]
        return np.concatenate([part.ravel() for part in parts])

    def _pulled(self, at: Derivatives, forces: Array) -> tuple[Array, Array]:
        """Transposed rows times forces: on the body (N + 1, 12) and on columns (N, 4, 8)."""
        on_body, on_reach, on_column, on_surface, on_torques, on_between = self.split(forces)
        body = np.zeros((self.knots + 1, BODY_STATES))
        body[1:] = on_body
        body[1:, :POSE] += np.einsum("kij,ki->kj", at.reach, on_reach)
        np.add.at(body, self.between.intervals, np.einsum("bij,bi->bj", at.between, on_between))
        columns = on_column + np.einsum("klij,kli->klj", at.surface, on_surface)
        both = np.einsum("pij,pi->pj", at.torques, on_torques)
        np.add.at(body, self.limited[0], both[:, :BODY_STATES])
        columns[(*self.limited, slice(WRENCH_INPUTS))] += both[:, BODY_STATES:]
        return body, columns


def _raised(ends: Array) -> Array:
    """Upper bounds with an inside."""
    return np.asarray(ends + _RELAXED * np.maximum(1.0, np.abs(ends)))


def _grasp(contact: Contact | None, hand_numbers: int) -> list[float]:
    """What physics.torque has of a grasp, less what is of leaning faces; any in the air."""
    of_air = [0.0, 0.0, 0.0, *_AWAY, 0.0, 1.0, 0.0]
    found = of_air if contact is None else [*contact.centre_h_m, *contact.axis, *contact.tangent]
    if hand_numbers == UPRIGHT:
        return found
    return [*found, *((0.0, 0.0, 1.0) if contact is None else contact.up)]


def _convex(hessians: Array) -> Array:
    """The part of symmetric matrices (n, m, m) that is positive semidefinite."""
    values, vectors = np.linalg.eigh(hessians)
    return np.asarray((vectors * np.maximum(values, 0.0)[:, None]) @ vectors.swapaxes(-1, -2))


def _places(contacts: list[list[Contact | None]]) -> list[tuple[Contact, tuple[list[int], list[int]]]]:
    """Every contact with the knots and limbs that it is held at."""
    found: dict[int, tuple[Contact, tuple[list[int], list[int]]]] = {}
    for k, knot in enumerate(contacts):
        for limb, contact in enumerate(knot):
            if contact is not None:
                _, (knots, limbs) = found.setdefault(id(contact), (contact, ([], [])))
                knots.append(k)
                limbs.append(limb)
    return list(found.values())
