"""P2a of a walk with its gait fixed: body, foot forces and footholds by one sparse QP.

(8), (9a) and the cone are linear about a given motion and exact where the answer is that motion: solved about its own
answer, again and again, the QP solves P1 of the gait.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np
import scipy.sparse as sp

from crux_planner.model.arrays import Array, Indices
from crux_planner.model.gait import Gait, nominal_footholds, progress
from crux_planner.model.kinematics import rotation_from_rpy, rotation_z
from crux_planner.model.problem import BODY_STATES
from crux_planner.model.walk_problem import WalkProblem
from crux_planner.physics.walk_bounds import (
    FEET_APART_M,
    body_bounds,
    foothold_bounds,
    least_load_N,
    rate_steps,
    step_polygon,
)
from crux_planner.physics.walk_cost import FOOTHOLD_WEIGHT, FORCE_SHARE, walk_cost
from crux_planner.physics.walk_dynamics import euler_rates
from crux_planner.solvers.qp import Qp
from crux_planner.solvers.sparse_blocks import Entries, skews

if TYPE_CHECKING:
    from crux_planner.trajectory.consensus import Eta, Scales

_SIDES = 8  # of the polygon about the cone, one of them where the force points
_CONE_RESERVE_N = 0.02
_FREE = 1e3  # a bound beyond what matters keeps the QP compact
_MOMENT_OF_FORCE = slice(9, 12)
_INFINITE = 1e30  # as PIQP has it


@dataclass(frozen=True)
class WalkKnots:
    """x and u at the knots: body states (N + 1, 12), forces (N, 4, 3) [N], footholds (4 + S, 2); J, J with the
    consensus term, and what a newton more or less would change where a foot is off the ground (N, 4, 3).
    """

    gait: Gait
    body: Array
    forces: Array
    footholds: Array
    cost: float
    value: float
    pull: Array

    def feet(self, step_height_m: float) -> Array:
        """(N + 1, 4, 3)."""
        plan = self.gait.blend @ self.footholds
        return np.concatenate([plan, step_height_m * self.gait.height[..., None]], axis=2)


@dataclass(frozen=True)
class Reference:
    """The motion about which (8b) and (9a) are linear."""

    body: Array  # (N + 1, 12)
    forces: Array  # (N, 4, 3)
    footholds: Array  # (4 + S, 2)

    @classmethod
    def straight(cls, problem: WalkProblem, gait: Gait) -> Reference:
        """Straight to the goal in the time of the steps, the weight shared by the feet in stance."""
        way = np.interp(np.arange(problem.steps + 1), *progress(problem, gait))
        pose = np.concatenate([problem.start.position_m, problem.start.rpy_rad])
        there = np.concatenate([problem.goal.body.position_m, problem.goal.body.rpy_rad])
        body = np.zeros((problem.steps + 1, BODY_STATES))
        body[:, :6] = pose + way[:, None] * (there - pose)
        return cls(body, _standing_forces(problem, gait), nominal_footholds(problem, gait))

    def halfway(self, knots: WalkKnots) -> Reference:
        """Between this one and an answer."""
        body, forces = (self.body + knots.body) / 2, (self.forces + knots.forces) / 2
        return Reference(body, forces, (self.footholds + knots.footholds) / 2)

    @classmethod
    def of(cls, problem: WalkProblem, gait: Gait, body: Array) -> Reference:
        """A body motion with another gait."""
        return cls(body, _standing_forces(problem, gait), nominal_footholds(problem, gait))


class ContactQp:
    """The QP of one problem for any gait; what gaits have in common is built once."""

    def __init__(self, problem: WalkProblem, scales: Scales | None, *, moments: bool = True) -> None:
        self.problem, self.scales, self.moments = problem, scales, moments
        n, dt = problem.steps, problem.dt_s
        one = sp.eye(BODY_STATES)
        rate = sp.csr_matrix(np.eye(BODY_STATES) + dt * np.eye(BODY_STATES, k=6))
        self._euler = (
            sp.kron(sp.hstack([sp.csr_matrix((n, 1)), sp.eye(n)]), one)
            - sp.kron(sp.hstack([sp.eye(n), sp.csr_matrix((n, 1))]), rate)
        ).tocoo()

    def solve(
        self, gait: Gait, reference: Reference, rho: float, target: Eta | None, accuracy: float = 1e-5
    ) -> WalkKnots | None:
        """Minimise J, and rho / 2 |eta - target|^2 where there is a target; None where the gait has no solution."""
        problem, n, dt = self.problem, self.problem.steps, self.problem.dt_s
        bounds = body_bounds(problem, gait)
        spots = foothold_bounds(problem, gait)
        if (bounds[0] > bounds[1]).any() or spots is None:
            return None
        places = np.argwhere(gait.stance[:n])
        at_f = BODY_STATES * (n + 1)
        at_h = at_f + 3 * len(places)
        size = at_h + 2 * len(gait.steps)
        blend, fixed = gait.blend[:, :, 4:], gait.blend[:, :, :4] @ problem.start_feet_w_m
        feet = np.concatenate(
            [gait.blend @ reference.footholds, problem.step_height_m * gait.height[..., None]], axis=2
        )
        # (8)
        arms = feet[:n] - reference.body[:n, None, :3]
        theta, omega = reference.body[:n, 3:6], reference.body[:n, 9:12]
        easier = np.linalg.inv(problem.inertia_b)
        turn = easier @ rotation_from_rpy(theta).swapaxes(1, 2)
        lever = np.einsum("kab,kibc->kiac", turn, skews(arms))  # (N, 4, 3, 3): angular acceleration per newton
        total = reference.forces.sum(axis=1)
        moved = np.einsum("kab,kibc->kiac", turn, skews(reference.forces))
        rows = Entries()
        k, i = places.T
        rows.blocks(
            12 * k + 6, at_f + 3 * np.arange(len(k)), np.tile(-dt / problem.mass_kg * np.eye(3), (len(k), 1, 1))
        )
        right = np.zeros((n, BODY_STATES))
        right[:, 3:6] = dt * (euler_rates(theta, omega) - omega)
        right[:, 6:9] = dt * problem.gravity_w
        if self.moments:
            knots = np.arange(n)
            rows.blocks(12 * k + 9, at_f + 3 * np.arange(len(k)), -dt * lever[k, i])
            rows.blocks(12 * knots + 9, 12 * knots, -dt * np.einsum("kab,kbc->kac", turn, skews(total)))
            about = np.einsum("kiab,kij->kjab", moved[..., :2], blend[:n])
            for j in range(len(gait.steps)):
                rows.blocks(12 * knots + 9, np.full(n, at_h + 2 * j), dt * about[:, j])
            off = fixed[:n] - feet[:n, :, :2]
            constant = -np.einsum("kiab,kib->ka", moved[..., :2], off)
            constant -= np.einsum("kab,kbc,kc->ka", turn, skews(total), reference.body[:n, :3])
            constant -= np.cross(omega, omega @ problem.inertia_b.T) @ easier.T
            right[:, _MOMENT_OF_FORCE] = dt * constant
        equal = rows.matrix((BODY_STATES * n, size), self._euler).tocsr()
        keep = np.ones(BODY_STATES * n, dtype=bool)
        if not self.moments:
            keep.reshape(n, BODY_STATES)[:, _MOMENT_OF_FORCE] = False
        below, low_g, high_g = self._inequalities(gait, reference, places, feet, fixed, blend, at_f, at_h, size)
        hessian, linear, constant_cost = self._objective(gait, places, rho, target, blend, fixed, at_f, at_h, size)
        least = least_load_N(problem)
        low_f = np.tile([-_FREE, -_FREE, least], len(places))
        high_f = np.tile([_FREE, _FREE, problem.max_normal_N], len(places))
        found = Qp(
            hessian,
            linear,
            (equal[keep].tocsc(), right.ravel()[keep]),
            (below, low_g, high_g),
            np.concatenate([np.maximum(bounds[0], -_FREE).ravel(), low_f, spots[0].ravel()]),
            np.concatenate([np.minimum(bounds[1], _FREE).ravel(), high_f, spots[1].ravel()]),
            eps_abs=accuracy,
            eps_rel=accuracy / 10,
            max_iter=60,
        ).solve()
        if not found.solved:
            return None
        values = found.x
        body = values[:at_f].reshape(n + 1, BODY_STATES)
        forces = np.zeros((n, 4, 3))
        forces[k, i] = values[at_f:at_h].reshape(-1, 3)
        footholds = np.vstack([problem.start_feet_w_m, values[at_h:].reshape(-1, 2)])
        dual = np.zeros((n, BODY_STATES))
        dual.ravel()[keep] = found.multipliers
        pull = -dt / problem.mass_kg * dual[:, None, 6:9] - dt * np.einsum("kiab,ka->kib", lever, dual[:, 9:12])
        cost = walk_cost(problem, gait, body, forces)
        near = float(values @ (hessian @ values) / 2 + linear @ values) + constant_cost
        return WalkKnots(gait, body, forces, footholds, cost, near + cost - self._smooth_cost(body, forces), pull)

    def _smooth_cost(self, body: Array, forces: Array) -> float:
        return walk_cost(self.problem, Gait((), np.zeros(0), self.problem.steps + 1), body, forces)

    def _inequalities(
        self,
        gait: Gait,
        reference: Reference,
        places: Indices,
        feet: Array,
        fixed: Array,
        blend: Array,
        at_f: int,
        at_h: int,
        size: int,
    ) -> tuple[sp.csc_matrix, Array, Array]:
        """The cone, (9a), shares of the weight on three feet, lengths of steps, feet of a side apart."""
        problem, n, count = self.problem, self.problem.steps, len(places)
        rows, low, high = Entries(), [], []
        lateral = reference.forces[places[:, 0], places[:, 1], :2]
        angles = np.arctan2(lateral[:, 1], lateral[:, 0])[:, None] + 2 * np.pi * np.arange(_SIDES) / _SIDES
        cone = np.stack([np.cos(angles), np.sin(angles), np.full_like(angles, -problem.friction)], axis=2)
        rows.blocks(_SIDES * np.arange(count), at_f + 3 * np.arange(count), cone)
        low.append(np.full(_SIDES * count, -np.inf))
        high.append(np.full(_SIDES * count, -_CONE_RESERVE_N))
        start = _SIDES * count
        one = np.tile(np.eye(6), (n, 1, 1))
        every = np.arange(n)
        rows.blocks(start + 6 * every, 12 * every + 18, one)
        rows.blocks(start + 6 * every, 12 * every + 6, -one)
        change = np.tile(rate_steps(problem), n)
        low.append(-change)
        high.append(change)
        start += 6 * n
        # (9a), offsets of the feet in the body frame
        knots = np.arange(1, n + 1)
        unturn = rotation_from_rpy(reference.body[1:, 3:6]).swapaxes(1, 2)
        away = np.einsum("kab,kib->kia", unturn, feet[1:] - reference.body[1:, None, :3])
        tilted = skews(away)
        tilted_from = reference.body[1:, 3:6]
        ground = np.concatenate([fixed[1:], feet[1:, :, 2:]], axis=2)
        for limb in range(4):
            begin = start + 3 * (knots - 1)
            rows.blocks(begin, 12 * knots, -unturn)
            rows.blocks(begin, 12 * knots + 3, tilted[:, limb])
            for j, step in enumerate(gait.steps):
                if step.limb == limb:
                    here = np.flatnonzero(blend[1:, limb, j])
                    rows.blocks(
                        begin[here],
                        np.full(len(here), at_h + 2 * j),
                        unturn[here][:, :, :2] * blend[1:, limb, j][here, None, None],
                    )
            known = np.einsum("kab,kb->ka", unturn, ground[:, limb]) - np.einsum(
                "kab,kb->ka", tilted[:, limb], tilted_from
            )
            slack = problem.boxes.half_m
            low.append((problem.boxes.centre_b_m[limb] - slack - known).ravel())
            high.append((problem.boxes.centre_b_m[limb] + slack - known).ravel())
            start += 3 * n
            for cut in (each for each in problem.cuts if each.limb == limb):
                across = cut.normal_b @ unturn
                rows.blocks(start + knots - 1, 12 * knots, -across[:, None])
                rows.blocks(start + knots - 1, 12 * knots + 3, (cut.normal_b @ tilted[:, limb])[:, None])
                moving, which = np.nonzero(blend[1:, limb])
                for axis in (0, 1):
                    value = across[moving, axis] * blend[1 + moving, limb, which]
                    rows.entries(start + moving, at_h + 2 * which + axis, value)
                low.append(np.full(n, -np.inf))
                high.append(cut.most - known @ cut.normal_b)
                start += n
        # the limbs' mass on three feet
        number = np.full((n, 4), -1)
        number[places[:, 0], places[:, 1]] = np.arange(count)
        three = np.flatnonzero(gait.stance[:n].sum(axis=1) == 3)
        on = np.nonzero(gait.stance[three])[1].reshape(-1, 3)
        corners = np.concatenate([feet[three[:, None], on, :2], np.ones((len(three), 3, 1))], axis=2)
        spread = np.linalg.inv(corners.transpose(0, 2, 1))[:, :, :2]
        pull = problem.limbs_share * spread
        begin = start + 3 * np.arange(len(three))
        weight = reference.forces[three, :, 2].sum(axis=1)
        for corner in range(3):
            rows.entries(begin + corner, at_f + 3 * number[three, on[:, corner]] + 2, 1.0 / weight)
        rows.blocks(begin, 12 * three, -4 * pull)
        inertia = 4 * problem.pendulum_s2 / problem.dt_s * pull
        rows.blocks(begin, 12 * three + 18, inertia)
        rows.blocks(begin, 12 * three + 6, -inertia)
        all_feet = problem.centre_of_pressure(blend.sum(axis=1))[three]
        for j in range(len(gait.steps)):
            rows.blocks(begin, np.full(len(three), at_h + 2 * j), pull * all_feet[:, j, None, None])
        neutral = rotation_z(reference.body[three, 5])[:, :2, :2] @ problem.neutral_feet_b_m.sum(axis=0)
        known = np.einsum("kab,kb->ka", pull, problem.centre_of_pressure(fixed.sum(axis=1))[three] - neutral)
        low.append((problem.profile.true_share - known).ravel())
        high.append(np.full(3 * len(three), np.inf))
        start += 3 * len(three)
        # between the knots: the cone of three feet that balance the body where it is, here and at the next knot
        level = np.linalg.inv(corners.transpose(0, 2, 1))[:, :, 2]
        for ahead in (0, 1):
            lean = problem.wall_friction * weight[:, None, None] * spread
            height = problem.wall_friction * reference.body[three + ahead, 2, None, None] * spread
            begin = start + 3 * np.arange(len(three))
            for corner in range(3):
                place = number[three, on[:, corner]]
                rows.blocks(begin + corner, at_f + 3 * place, cone[place, 0, None, :2])
                rows.blocks(begin, at_f + 3 * place, height)
            rows.blocks(begin, 12 * (three + ahead), -lean)
            low.append(np.full(3 * len(three), -np.inf))
            high.append((problem.wall_friction * weight[:, None] * level).ravel() - _CONE_RESERVE_N)
            start += 3 * len(three)
        # lengths of steps
        last = list(range(4))
        for j, step in enumerate(gait.steps):
            before = last[step.limb]
            normals, most = step_polygon(problem, step, reference.footholds[before], reference.footholds[4 + j])
            rows.dense(start, at_h + 2 * j + np.arange(2), normals)
            if before < 4:
                most = most + normals @ problem.start_feet_w_m[before]
            else:
                rows.dense(start, at_h + 2 * (before - 4) + np.arange(2), -normals)
            last[step.limb] = 4 + j
            low.append(np.full(len(most), -np.inf))
            high.append(most)
            start += len(most)
        # feet of a side apart
        for front, rear in ((0, 2), (1, 3)):
            difference = blend[:, front] - blend[:, rear]
            knots_apart, of_step = np.nonzero(difference)
            rows.entries(start + knots_apart, at_h + 2 * of_step, difference[knots_apart, of_step])
            low.append(FEET_APART_M - (fixed[:, front, 0] - fixed[:, rear, 0]))
            high.append(np.full(n + 1, np.inf))
            start += n + 1
        below = rows.matrix((start, size)).tocsc()
        return below, np.maximum(np.concatenate(low), -_INFINITE), np.minimum(np.concatenate(high), _INFINITE)

    def _objective(
        self,
        gait: Gait,
        places: Indices,
        rho: float,
        target: Eta | None,
        blend: Array,
        fixed: Array,
        at_f: int,
        at_h: int,
        size: int,
    ) -> tuple[sp.csc_matrix, Array, float]:
        """Hessian, gradient and constant of J's smooth terms and the consensus term."""
        problem, weights, scales = self.problem, self.problem.weights, self.scales
        n, goal = problem.steps, problem.goal.body
        diagonal, linear, constant = np.zeros(size), np.zeros(size), 0.0

        def squares(index: Indices, weight: Array | float, wanted: Array) -> None:
            nonlocal constant
            weight = np.broadcast_to(weight, index.shape)
            np.add.at(diagonal, index, 2 * weight)
            np.add.at(linear, index, -2 * weight * wanted)
            constant += float((weight * wanted**2).sum())

        states = np.arange(at_f).reshape(n + 1, BODY_STATES)
        q = np.array([weights.position] * 3 + [weights.orientation] * 3 + [weights.velocity] * 6)
        wanted = np.concatenate([goal.position_m, goal.rpy_rad, np.zeros(6)])
        squares(states, q, np.broadcast_to(wanted, states.shape))
        force = np.arange(at_f, at_h).reshape(-1, 3)
        squares(force, FORCE_SHARE * weights.wrench, np.zeros(force.shape))
        spots = np.arange(at_h, size).reshape(-1, 2)
        nominal = nominal_footholds(problem, gait)[4:]
        squares(spots, FOOTHOLD_WEIGHT, nominal)
        steps = np.zeros((len(gait.steps), len(gait.steps)))
        if target is not None and scales is not None:
            unit = np.array([scales.position] * 3 + [scales.orientation] * 3 + [scales.rate] * 6)
            squares(states, rho / 2 * unit**2, target.body)
            k, i = places.T
            squares(force, rho / 2 * scales.force**2, target.forces[k, i])
            off = target.fingers[..., :2] - fixed  # (N + 1, 4, 2)
            near = rho / 2 * scales.position**2
            steps = 2 * near * np.einsum("kij,kil->jl", blend, blend)
            linear[at_h:] -= 2 * near * np.einsum("kij,kia->ja", blend, off).ravel()
            air = np.ones((n, 4), dtype=bool)
            air[k, i] = False
            heights = problem.step_height_m * gait.height - target.fingers[..., 2]
            constant += near * float((off**2).sum() + (heights**2).sum())
            constant += rho / 2 * scales.force**2 * float((target.forces[air] ** 2).sum())
        hessian = sp.diags(diagonal, format="coo")
        corner = sp.coo_matrix(np.kron(steps, np.eye(2)))
        total = sp.csc_matrix(
            (
                np.concatenate([hessian.data, corner.data]),
                (
                    np.concatenate([hessian.row, at_h + corner.row]),
                    np.concatenate([hessian.col, at_h + corner.col]),
                ),
            ),
            (size, size),
        )
        return total, linear, constant


def _standing_forces(problem: WalkProblem, gait: Gait) -> Array:
    stance = gait.stance[: problem.steps]
    shares = stance / np.maximum(stance.sum(axis=1, keepdims=True), 1)
    forces: Array = shares[..., None] * (-problem.mass_kg * problem.gravity_w)
    return forces
