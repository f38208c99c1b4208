"""P2a of a walk with its gait fixed: body, foot forces and footholds by one sparse QP.

(8), (9a) and the cone are linear about a given motion and exact where the answer is that motion: solved about its own
answer, again and again, the QP solves P1 of the gait.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np
import scipy.sparse as sp

from crux_planner.model.arrays import Array, Indices
from crux_planner.model.gait import WalkMotion, nominal_footholds
from crux_planner.model.kinematics import rotation_from_rpy
from crux_planner.model.problem import BODY_STATES
from crux_planner.model.walk_problem import WalkProblem
from crux_planner.physics.bounds import (
    apart_rows,
    foothold_bounds,
    least_load_N,
    rate_steps,
    step_rows,
    walk_bounds,
)
from crux_planner.physics.cost import FOOTHOLD_WEIGHT, FORCE_SHARE, gait_cost, state_weights, walk_cost
from crux_planner.physics.walk_dynamics import euler_rates
from crux_planner.solvers.qp import Qp
from crux_planner.solvers.sparse_blocks import Entries, Rows, skews

if TYPE_CHECKING:
    from crux_planner.trajectory.consensus import Eta, Scales

_SIDES = 8  # of the polygon about the cone, one of them where the force points
_CONE_RESERVE_N = 0.02
_PARTS = 4  # of an interval, at whose ends feet are looked at
_FREE = 1e3  # a bound beyond what matters keeps the QP compact
_MOMENT_OF_FORCE = slice(9, 12)


@dataclass(frozen=True)
class WalkKnots(WalkMotion):
    """x and u at the knots, J, J with the consensus term, and what a newton more or less would change where a foot is
    off the ground (N, 4, 3).
    """

    problem: WalkProblem
    cost: float
    value: float
    pull: Array

    @property
    def order(self) -> list[str]:
        """Limbs in the order in which they lift off."""
        return self.gait.names

    def with_body(self, body: Array) -> WalkKnots:
        """The same with other body states."""
        cost = walk_cost(self.problem, self.gait, body, self.forces)
        return replace(self, body=body, cost=cost, value=cost)


@dataclass(frozen=True)
class _Layout:
    """A gait about a reference: where its variables are, body states first; feet, and what of them is fixed."""

    reference: WalkMotion
    places: Indices  # (P, 2) knot and limb in stance
    feet: Array  # (N + 1, 4, 3) of the reference
    centre: Array  # (N + 1, 3) of mass, of the reference
    fixed: Array  # (N + 1, 4, 2) what the start's footholds give of them
    blend: Array  # (N + 1, 4, S) times the steps' footholds gives the rest
    at_f: int
    at_h: int
    size: int

    @classmethod
    def of(cls, problem: WalkProblem, reference: WalkMotion) -> _Layout:
        """For the gait's variables."""
        gait = reference.gait
        places, whole = np.argwhere(gait.stance[: problem.steps]), gait.blend
        at_f = BODY_STATES * (problem.steps + 1)
        at_h = at_f + 3 * len(places)
        fixed = whole[:, :, :4] @ problem.start_feet_w_m
        height = problem.step_height_m * gait.height[..., None]
        feet = np.concatenate([whole @ reference.footholds, height], axis=2)
        yaws = gait.yaw(float(problem.goal.body.rpy_rad[2]))
        centre = problem.centres_of_mass(reference.body[:, :6], feet, yaws)
        size = at_h + 2 * len(gait.steps)
        return cls(reference, places, feet, centre, fixed, whole[:, :, 4:], at_f, at_h, size)


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
        self, about: WalkMotion, rho: float = 0.0, target: Eta | None = None, accuracy: float = 1e-5
    ) -> WalkKnots | None:
        """Minimise J, and rho / 2 |eta - target|^2 where there is a target; None where the gait has no solution.

        (8b) and (9a) are linear about a motion by the gait.
        """
        gait = about.gait
        problem, n, dt = self.problem, self.problem.steps, self.problem.dt_s
        bounds = walk_bounds(problem, gait)
        spots = foothold_bounds(problem, gait)
        if (bounds[0] > bounds[1]).any() or spots is None:
            return None
        of = _Layout.of(problem, about)
        k, i = of.places.T
        equal, right, lever = self._dynamics(of)
        keep = np.ones(BODY_STATES * n, dtype=bool)
        if not self.moments:
            keep.reshape(n, BODY_STATES)[:, _MOMENT_OF_FORCE] = False
        hessian, linear, constant_cost = self._objective(of, rho, target)
        least = least_load_N(problem)
        low_f = np.tile([-_FREE, -_FREE, least], len(k))
        high_f = np.tile([_FREE, _FREE, problem.max_normal_N], len(k))
        found = Qp(
            hessian,
            linear,
            (equal[keep].tocsc(), right.ravel()[keep]),
            self._inequalities(of),
            np.concatenate([np.maximum(bounds[0], -_FREE).ravel(), low_f, spots[0].ravel()]),
            np.concatenate([np.minimum(bounds[1], _FREE).ravel(), high_f, spots[1].ravel()]),
            eps_abs=accuracy,
            eps_rel=accuracy / 10,
            max_iter=60,
        ).solve()
        if not found.solved:
            return None
        values = found.x
        body = values[: of.at_f].reshape(n + 1, BODY_STATES)
        forces = np.zeros((n, 4, 3))
        forces[k, i] = values[of.at_f : of.at_h].reshape(-1, 3)
        footholds = np.vstack([problem.start_feet_w_m, values[of.at_h :].reshape(-1, 2)])
        dual = np.zeros((n, BODY_STATES))
        dual.ravel()[keep] = found.multipliers
        pull = -dt / problem.mass_kg * dual[:, None, 6:9] - dt * np.einsum("kiab,ka->kib", lever, dual[:, 9:12])
        cost = walk_cost(problem, gait, body, forces)
        near = float(values @ (hessian @ values) / 2 + linear @ values) + constant_cost
        return WalkKnots(gait, body, forces, footholds, problem, cost, near + gait_cost(problem, gait), pull)

    def _dynamics(self, of: _Layout) -> tuple[sp.csr_matrix, Array, Array]:
        """(8) as matrix @ x = right, and the angular accelerations per newton of a foot (N, 4, 3, 3)."""
        problem, n, dt = self.problem, self.problem.steps, self.problem.dt_s
        reference, feet, at_f, at_h = of.reference, of.feet, of.at_f, of.at_h
        arms = feet[:n] - of.centre[:n, None]
        theta, omega = reference.body[:n, 3:6], reference.body[:n, 9:12]
        easier = np.linalg.inv(problem.inertia_b)
        turn = easier @ rotation_from_rpy(theta).swapaxes(1, 2)
        lever = np.einsum("kab,kibc->kiac", turn, skews(arms))  # (N, 4, 3, 3): angular acceleration per newton
        # The centre of mass follows body and feet, each limb's mass its foot by `limbs_share`.
        total = skews(reference.forces.sum(axis=1))
        lean = (1.0 - 4 * problem.limbs_share) * turn @ total
        moved = turn[:, None] @ (skews(reference.forces) - problem.limbs_share * total[:, None])
        rows = Entries()
        k, i = of.places.T
        rows.blocks(
            12 * k + 6, at_f + 3 * np.arange(len(k)), np.tile(-dt / problem.mass_kg * np.eye(3), (len(k), 1, 1))
        )
        right = np.zeros((n, BODY_STATES))
        right[:, 3:6] = dt * (euler_rates(theta, omega) - omega)
        right[:, 6:9] = dt * problem.gravity_w
        if self.moments:
            knots = np.arange(n)
            rows.blocks(12 * k + 9, at_f + 3 * np.arange(len(k)), -dt * lever[k, i])
            rows.blocks(12 * knots + 9, 12 * knots, -dt * lean)
            about = np.einsum("kiab,kij->kjab", moved[..., :2], of.blend[:n])
            for j in range(len(of.reference.gait.steps)):
                rows.blocks(12 * knots + 9, np.full(n, at_h + 2 * j), dt * about[:, j])
            off = of.fixed[:n] - feet[:n, :, :2]
            constant = -np.einsum("kiab,kib->ka", moved[..., :2], off)
            constant -= np.einsum("kab,kb->ka", lean, reference.body[:n, :3])
            constant -= np.cross(omega, omega @ problem.inertia_b.T) @ easier.T
            right[:, _MOMENT_OF_FORCE] = dt * constant
        return rows.matrix((BODY_STATES * n, of.size), self._euler).tocsr(), right, lever

    def _inequalities(self, of: _Layout) -> tuple[sp.csc_matrix, Array, Array]:
        """The cone, (7), (9a), shares of the weight on three feet, lengths of steps, feet of a side apart."""
        rows = Rows()
        cone = self._cone(rows, of)
        self._accelerations(rows)
        self._reach(rows, of)
        self._three_feet(rows, of, cone)
        step_rows(rows, self.problem, of.reference.gait, of.reference.footholds, of.at_h)
        apart_rows(rows, of.blend, of.fixed, of.at_h)
        return rows.all(of.size)

    def _cone(self, rows: Rows, of: _Layout) -> Array:
        """Sides of the cone (P, 8, 3) about the reference's forces."""
        at, count = np.arange(len(of.places)), len(of.places)
        lateral = of.reference.forces[of.places[:, 0], of.places[:, 1], :2]
        angles = np.arctan2(lateral[:, 1], lateral[:, 0])[:, None] + 2 * np.pi * np.arange(_SIDES) / _SIDES
        cone = np.stack([np.cos(angles), np.sin(angles), np.full_like(angles, -self.problem.friction)], axis=2)
        rows.blocks(_SIDES * at, of.at_f + 3 * at, cone)
        rows.close(-np.inf, -_CONE_RESERVE_N, _SIDES * count)
        return cone

    def _accelerations(self, rows: Rows) -> None:
        n = self.problem.steps
        one, every = np.tile(np.eye(6), (n, 1, 1)), np.arange(n)
        rows.blocks(6 * every, 12 * every + 18, one)
        rows.blocks(6 * every, 12 * every + 6, -one)
        change = np.tile(rate_steps(self.problem), n)
        rows.close(-change, change)

    def _reach(self, rows: Rows, of: _Layout) -> None:
        """(9a), offsets of the feet in the body frame."""
        problem, n, reference, blend = self.problem, self.problem.steps, of.reference, of.blend
        knots = np.arange(1, n + 1)
        unturn = rotation_from_rpy(reference.body[1:, 3:6]).swapaxes(1, 2)
        away = np.einsum("kab,kib->kia", unturn, of.feet[1:] - reference.body[1:, None, :3])
        tilted = skews(away)
        ground = np.concatenate([of.fixed[1:], of.feet[1:, :, 2:]], axis=2)
        for limb in range(4):
            begin = 3 * (knots - 1)
            rows.blocks(begin, 12 * knots, -unturn)
            rows.blocks(begin, 12 * knots + 3, tilted[:, limb])
            for j, step in enumerate(of.reference.gait.steps):
                if step.limb == limb:
                    here = np.flatnonzero(blend[1:, limb, j])
                    moved = unturn[here][:, :, :2] * blend[1:, limb, j][here, None, None]
                    rows.blocks(begin[here], np.full(len(here), of.at_h + 2 * j), moved)
            tilt = np.einsum("kab,kb->ka", tilted[:, limb], reference.body[1:, 3:6])
            known = np.einsum("kab,kb->ka", unturn, ground[:, limb]) - tilt
            centre, half = problem.boxes.centre_b_m[limb], problem.boxes.half_m
            rows.close((centre - half - known).ravel(), (centre + half - known).ravel())
            for cut in (each for each in problem.cuts if each.limb == limb):
                across = cut.normal_b @ unturn
                rows.blocks(knots - 1, 12 * knots, -across[:, None])
                rows.blocks(knots - 1, 12 * knots + 3, (cut.normal_b @ tilted[:, limb])[:, None])
                moving, which = np.nonzero(blend[1:, limb])
                for axis in (0, 1):
                    value = across[moving, axis] * blend[1 + moving, limb, which]
                    rows.entries(moving, of.at_h + 2 * which + axis, value)
                rows.close(-np.inf, cut.most - known @ cut.normal_b)

    def _three_feet(self, rows: Rows, of: _Layout, cone: Array) -> None:
        """Loads on three feet, and their cone, where they balance the body here and at the next knot."""
        problem, n, reference, gait = self.problem, self.problem.steps, of.reference, of.reference.gait
        number = np.full((n, 4), -1)
        number[of.places[:, 0], of.places[:, 1]] = np.arange(len(of.places))
        three = np.flatnonzero(gait.stance[:n].sum(axis=1) == 3)
        on = np.nonzero(gait.stance[three])[1].reshape(-1, 3)
        corners = np.concatenate([of.feet[three[:, None], on, :2], np.ones((len(three), 3, 1))], axis=2)
        spread = np.linalg.inv(corners.transpose(0, 2, 1))[:, :, :2]
        begin = 3 * np.arange(len(three))
        weight = reference.forces[three, :, 2].sum(axis=1)
        body_share, together = 1.0 - 4 * problem.limbs_share, of.blend.sum(axis=1)
        level = np.linalg.inv(corners.transpose(0, 2, 1))[:, :, 2]
        self._keep_loads(rows, of, three, spread, level)
        centre = of.centre[:, :2] - body_share * reference.body[:, :2]
        centre -= problem.limbs_share * (of.feet[..., :2] - of.fixed).sum(axis=1)  # what variables do not move of it
        for ahead in (0, 1):
            lean = problem.wall_friction * weight[:, None, None] * spread
            height = problem.wall_friction * of.centre[three + ahead, 2, None, None] * spread
            for corner in range(3):
                place = number[three, on[:, corner]]
                rows.blocks(begin + corner, of.at_f + 3 * place, cone[place, 0, None, :2])
                rows.blocks(begin, of.at_f + 3 * place, height)
            rows.blocks(begin, 12 * (three + ahead), -body_share * lean)
            followed = problem.limbs_share * lean
            for j in range(len(gait.steps)):
                moved = -followed * together[three + ahead, j, None, None]
                rows.blocks(begin, np.full(len(three), of.at_h + 2 * j), moved)
            most = problem.wall_friction * weight[:, None] * level
            most += np.einsum("kab,kb->ka", lean, centre[three + ahead])
            rows.close(-np.inf, most.ravel() - _CONE_RESERVE_N)

    def _keep_loads(self, rows: Rows, of: _Layout, three: Indices, spread: Array, level: Array) -> None:
        """Shares of the weight on three feet at both ends of their intervals and between, as body and limbs accelerate
        there: exact for the reference, and linear about it as if limbs' masses followed their feet.
        """
        problem, gait, begin = self.problem, of.reference.gait, 3 * np.arange(len(three))
        body_share, follow = 1.0 - 4 * problem.limbs_share, problem.limbs_share
        poses, ways = of.reference.body[:, :6], follow * of.blend.sum(axis=1)
        yaws = gait.yaw(float(problem.goal.body.rpy_rad[2]))
        pressed, between = (problem.centres_of_pressure(poses, of.feet, yaws, parts) for parts in (1, _PARTS))
        followed = problem.pressing(body_share * poses[:, :2] + follow * (of.feet[..., :2] - of.fixed).sum(axis=1))
        near = _PARTS * three[:, None] + np.arange(_PARTS // 2 + 1)  # samples of the half interval next to a knot
        press, pushed = body_share * problem.pendulum_s2 / problem.dt_s * spread, problem.pressing(ways)
        for ahead, at in enumerate((three, three + 1)):
            here = np.einsum("kab,kb->ka", spread, pressed[at]) + level
            least = np.einsum("kab,ksb->ksa", spread, between[near + ahead * _PARTS // 2]).min(axis=1) + level
            least = np.minimum(here, least + problem.profile.true_share - problem.profile.between_share)
            shares = np.zeros((len(three), 4))
            shares[gait.stance[three]] = here.ravel()
            moved = np.einsum("ki,kij->kj", shares, of.blend[three])
            rows.blocks(begin, 12 * at, body_share * spread)
            rows.blocks(begin, 12 * at + 6, -press)
            rows.blocks(begin, 12 * at - 6, press)
            for j in range(len(gait.steps)):
                along = (pushed[at, j] - moved[:, j])[:, None, None] * spread
                rows.blocks(begin, np.full(len(three), of.at_h + 2 * j), along)
            kept = np.einsum("ki,kia->ka", shares, of.feet[three, :, :2] - of.fixed[three])
            known = least + np.einsum("kab,kb->ka", spread, kept - followed[at])
            rows.close((problem.profile.true_share - known).ravel(), np.inf, 3 * len(three))

    def _objective(self, of: _Layout, rho: float, target: Eta | None) -> tuple[sp.csc_matrix, Array, float]:
        """Hessian, gradient and constant of J's smooth terms and the consensus term."""
        problem, weights, scales = self.problem, self.problem.weights, self.scales
        n, gait, blend = problem.steps, of.reference.gait, of.blend
        diagonal, linear, constant = np.zeros(of.size), np.zeros(of.size), 0.0

        def squares(index: Indices, weight: Array | float, wanted: Array) -> None:
            nonlocal constant
            weight = np.broadcast_to(weight, index.shape)
            np.add.at(diagonal, index, 2 * weight)
            np.add.at(linear, index, -2 * weight * wanted)
            constant += float((weight * wanted**2).sum())

        states = np.arange(of.at_f).reshape(n + 1, BODY_STATES)
        q, wanted = state_weights(problem)
        squares(states, q, np.broadcast_to(wanted, states.shape))
        force = np.arange(of.at_f, of.at_h).reshape(-1, 3)
        squares(force, FORCE_SHARE * weights.wrench, np.zeros(force.shape))
        spots = np.arange(of.at_h, of.size).reshape(-1, 2)
        nominal = nominal_footholds(problem, gait)[4:]
        squares(spots, FOOTHOLD_WEIGHT, nominal)
        steps = np.zeros((len(gait.steps), len(gait.steps)))
        if target is not None and scales is not None:
            unit = np.array([scales.position] * 3 + [scales.orientation] * 3 + [scales.rate] * 6)
            squares(states, rho / 2 * unit**2, target.body)
            k, i = of.places.T
            squares(force, rho / 2 * scales.force**2, target.forces[k, i])
            off = target.fingers[..., :2] - of.fixed  # (N + 1, 4, 2)
            near = rho / 2 * scales.position**2
            steps = 2 * near * np.einsum("kij,kil->jl", blend, blend)
            linear[of.at_h :] -= 2 * near * np.einsum("kij,kia->ja", blend, off).ravel()
            air = np.ones((n, 4), dtype=bool)
            air[k, i] = False
            heights = problem.step_height_m * gait.height - target.fingers[..., 2]
            constant += near * float((off**2).sum() + (heights**2).sum())
            constant += rho / 2 * scales.force**2 * float((target.forces[air] ** 2).sum())
        hessian = sp.diags(diagonal, format="coo")
        corner = sp.coo_matrix(np.kron(steps, np.eye(2)))
        rows, columns = (np.append(getattr(hessian, at), of.at_h + getattr(corner, at)) for at in ("row", "col"))
        total = sp.csc_matrix((np.append(hessian.data, corner.data), (rows, columns)), (of.size, of.size))
        return total, linear, constant
