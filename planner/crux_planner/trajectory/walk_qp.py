"""P2a of a walk with its gait fixed, body, foot forces and footholds by one sparse QP, and by it the exact walk.

(8), (9a) and the cone are linear about a given motion and exact where the answer is that motion: solved about its own
answer, again and again, the QP solves P1 of the gait. Long walks have motions that cost next to nothing, such as a slow
bounce of the body, and the answers drift along them. After some rounds a term that vanishes at the answer keeps each
one near the one before.
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
from crux_planner.physics.bounds import apart_rows, foothold_bounds, least_load_N, rate_steps, step_rows, walk_bounds
from crux_planner.physics.cost import FOOTHOLD_WEIGHT, FORCE_SHARE, walk_cost
from crux_planner.physics.walk_dynamics import defects, euler_rates
from crux_planner.solvers import clock
from crux_planner.solvers.sparse_blocks import Rows, skews
from crux_planner.trajectory.centroidal_qp import FREE, MOMENT_OF_FORCE, CentroidalQp
from crux_planner.trajectory.solution import WalkSolution

if TYPE_CHECKING:
    from crux_planner.trajectory.consensus import Eta, Scales

_SIDES = 8  # of the polygon about the cone, one of them where the force points
_CONE_RESERVE_N = 0.02
_PARTS = 4  # of an interval, at whose ends feet are looked at
_ROUNDS = 16
_FREE_ROUNDS = 8  # after them an answer is held to the one before
_HOLDING = 100.0  # rho of that
_NEARER = 0.8  # an answer is to be than the one before: two may else follow one another for ever
_ACCURACY = 1e-7  # of the QP
_MOMENT_NM, _FORCE_N, _PLACE = 1e-4, 1e-3, 1e-6  # left open by (8) at most
_COST = 1e-5  # of J, as a share, from one answer to the next


@dataclass(frozen=True)
class WalkKnots(WalkMotion):
    """x and u at the knots, and J."""

    problem: WalkProblem
    cost: float

    @property
    def order(self) -> list[str]:
        """Limbs in the order in which they lift off."""
        return self.gait.names

    def with_body(self, body: Array) -> WalkKnots:
        """The same with other body states."""
        return replace(self, body=body, cost=walk_cost(self.problem, self.gait, body, self.forces))


@dataclass(frozen=True)
class _About:
    """A reference: its gait's feet, and what of them is fixed."""

    reference: WalkMotion
    places: Indices  # (P, 2) knot and limb in stance
    feet: Array  # (N + 1, 4, 3) of the reference
    centre: Array  # (N + 1, 3) of mass, of the reference
    fixed: Array  # (N + 1, 4, 2) what the start's footholds give of them
    blend: Array  # (N + 1, 4, S) times the steps' footholds gives the rest

    @classmethod
    def of(cls, problem: WalkProblem, reference: WalkMotion) -> _About:
        """For the gait's variables."""
        gait = reference.gait
        places, whole = np.argwhere(gait.stance[: problem.steps]), gait.blend
        fixed = whole[:, :, :4] @ problem.start_feet_h_m
        height = problem.step_height_m * gait.height[..., None]
        feet = np.concatenate([whole @ reference.footholds, height], axis=2)
        yaws = gait.yaw(float(problem.goal.body.rpy_rad[2]))
        centre = problem.centres_of_mass(reference.body[:, :6], feet, yaws)
        return cls(reference, places, feet, centre, fixed, whole[:, :, 4:])


class ContactQp:
    """The QPs of one problem for any gait; of feet `alone` with neither (8) nor (9a), their body the one given."""

    def __init__(
        self, problem: WalkProblem, scales: Scales | None, *, moments: bool = True, alone: bool = False
    ) -> None:
        self.problem, self.scales, self.moments, self.alone = problem, scales, moments and not alone, alone

    def solve(
        self, about: WalkMotion, rho: float = 0.0, target: Eta | None = None, accuracy: float = 1e-5
    ) -> WalkKnots | None:
        """Minimise J, and rho / 2 |eta - target|^2 where there is a target; None where the gait has no solution.

        (8b) and (9a) are linear about a motion by the gait.
        """
        gait, problem = about.gait, self.problem
        bounds = (about.body, about.body) if self.alone else walk_bounds(problem, gait)
        spots = foothold_bounds(problem, gait)
        if (bounds[0] > bounds[1]).any() or spots is None:
            return None
        of = _About.of(problem, about)
        qp = CentroidalQp(problem, of.places, 3, len(gait.steps))
        k, i = of.places.T
        if not self.alone:
            self._add_dynamics(qp, of)
        self._add_cost(qp, of, rho, target)
        self._add_inequalities(qp, of)
        least = least_load_N(problem)
        limits = [-FREE, -FREE, least], [FREE, FREE, problem.max_normal_N]
        low, high = (
            np.concatenate([body.ravel(), np.tile(force, len(k)), spot.ravel()])
            for body, force, spot in zip(bounds, limits, spots, strict=True)
        )
        found = qp.solve(low, high, moments=self.moments, accuracy=accuracy, iterations=60)
        if found is None:
            return None
        body, forces = found.x[qp.states], np.zeros((problem.steps, 4, 3))
        forces[k, i] = found.x[qp.inputs]
        footholds = np.vstack([problem.start_feet_h_m, found.x[qp.footholds]])
        return WalkKnots(gait, body, forces, footholds, problem, walk_cost(problem, gait, body, forces))

    def _add_dynamics(self, qp: CentroidalQp, of: _About) -> None:
        """(8)."""
        problem, n, dt = self.problem, self.problem.steps, self.problem.dt_s
        reference, feet = of.reference, of.feet
        arms = feet[:n] - of.centre[:n, None]
        theta, omega = reference.body[:n, 3:6], reference.body[:n, 9:12]
        easier = np.linalg.inv(problem.inertia_b)
        turn = easier @ rotation_from_rpy(theta).swapaxes(1, 2)
        lever = np.einsum("kab,kibc->kiac", turn, skews(arms))
        # The centre of mass follows body and feet, each limb's mass its foot by `limbs_share`.
        total = skews(reference.forces.sum(axis=1))
        lean = (1.0 - 4 * problem.limbs_share) * turn @ total
        moved = turn[:, None] @ (skews(reference.forces) - problem.limbs_share * total[:, None])
        k, i = of.places.T
        qp.add_dynamics(np.tile(np.eye(3), (len(k), 1, 1)), lever[k, i], lean)
        about = np.einsum("kiab,kij->kjab", moved[..., :2], of.blend[:n])
        for j, (at, _) in enumerate(qp.footholds):
            qp.equations.blocks(BODY_STATES * np.arange(n) + 9, np.full(n, at), dt * about[:, j])
        qp.right[:, 3:6] = dt * (euler_rates(theta, omega) - omega)
        off = of.fixed[:n] - feet[:n, :, :2]
        constant = -np.einsum("kiab,kib->ka", moved[..., :2], off)
        constant -= np.einsum("kab,kb->ka", lean, reference.body[:n, :3])
        constant -= np.cross(omega, omega @ problem.inertia_b.T) @ easier.T
        qp.right[:, MOMENT_OF_FORCE] = dt * constant

    def _add_inequalities(self, qp: CentroidalQp, of: _About) -> None:
        """The cone, (7), (9a), shares of the weight on three feet, lengths of steps, feet of a side apart."""
        cone = self._cone(qp, of)
        step_rows(qp.rows, self.problem, of.reference.gait, of.reference.footholds, qp.at_h)
        if self.alone:
            return
        self._accelerations(qp.rows)
        self._reach(qp, of)
        if self.moments:
            self._three_feet(qp, of, cone)
        apart_rows(qp.rows, of.blend, of.fixed, qp.at_h)

    def _cone(self, qp: CentroidalQp, of: _About) -> Array:
        """Sides of the cone (P, 8, 3) about the reference's forces."""
        at, count = np.arange(len(of.places)), len(of.places)
        lateral = of.reference.forces[of.places[:, 0], of.places[:, 1], :2]
        angles = np.arctan2(lateral[:, 1], lateral[:, 0])[:, None] + 2 * np.pi * np.arange(_SIDES) / _SIDES
        cone = np.stack([np.cos(angles), np.sin(angles), np.full_like(angles, -self.problem.friction)], axis=2)
        qp.rows.blocks(_SIDES * at, qp.inputs[:, 0], cone)
        qp.rows.close(-np.inf, -_CONE_RESERVE_N, _SIDES * count)
        return cone

    def _accelerations(self, rows: Rows) -> None:
        n = self.problem.steps
        one, every = np.tile(np.eye(6), (n, 1, 1)), np.arange(n)
        rows.blocks(6 * every, 12 * every + 18, one)
        rows.blocks(6 * every, 12 * every + 6, -one)
        change = np.tile(rate_steps(self.problem), n)
        rows.close(-change, change)

    def _reach(self, qp: CentroidalQp, of: _About) -> None:
        """(9a), offsets of the feet in the body frame."""
        problem, n, reference, blend, rows = self.problem, self.problem.steps, of.reference, of.blend, qp.rows
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
                    rows.blocks(begin[here], np.full(len(here), qp.at_h + 2 * j), moved)
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
                    rows.entries(moving, qp.at_h + 2 * which + axis, value)
                rows.close(-np.inf, cut.most - known @ cut.normal_b)

    def _three_feet(self, qp: CentroidalQp, of: _About, cone: Array) -> None:
        """Loads on three feet, and their cone, where they balance the body here and at the next knot."""
        problem, n, reference, gait, rows = self.problem, self.problem.steps, of.reference, of.reference.gait, qp.rows
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
        self._keep_loads(qp, of, three, spread, level)
        centre = of.centre[:, :2] - body_share * reference.body[:, :2]
        centre -= problem.limbs_share * (of.feet[..., :2] - of.fixed).sum(axis=1)  # what variables do not move of it
        for ahead in (0, 1):
            lean = problem.wall_friction * weight[:, None, None] * spread
            height = problem.wall_friction * of.centre[three + ahead, 2, None, None] * spread
            for corner in range(3):
                place = number[three, on[:, corner]]
                rows.blocks(begin + corner, qp.inputs[place, 0], cone[place, 0, None, :2])
                rows.blocks(begin, qp.inputs[place, 0], height)
            rows.blocks(begin, 12 * (three + ahead), -body_share * lean)
            followed = problem.limbs_share * lean
            for j in range(len(gait.steps)):
                moved = -followed * together[three + ahead, j, None, None]
                rows.blocks(begin, np.full(len(three), qp.at_h + 2 * j), moved)
            most = problem.wall_friction * weight[:, None] * level
            most += np.einsum("kab,kb->ka", lean, centre[three + ahead])
            rows.close(-np.inf, most.ravel() - _CONE_RESERVE_N)

    def _keep_loads(self, qp: CentroidalQp, of: _About, three: Indices, spread: Array, level: Array) -> None:
        """Shares of the weight on three feet at both ends of their intervals and between, as body and limbs accelerate
        there: exact for the reference, and linear about it as if limbs' masses followed their feet.
        """
        problem, gait, begin, rows = self.problem, of.reference.gait, 3 * np.arange(len(three)), qp.rows
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
                rows.blocks(begin, np.full(len(three), qp.at_h + 2 * j), along)
            kept = np.einsum("ki,kia->ka", shares, of.feet[three, :, :2] - of.fixed[three])
            known = least + np.einsum("kab,kb->ka", spread, kept - followed[at])
            rows.close((problem.profile.true_share - known).ravel(), np.inf, 3 * len(three))

    def _add_cost(self, qp: CentroidalQp, of: _About, rho: float, target: Eta | None) -> None:
        """J's smooth terms and the consensus term."""
        problem, weights, scales, gait = self.problem, self.problem.weights, self.scales, of.reference.gait
        qp.add_body_cost(rho, target, scales)
        qp.squares(qp.inputs, FORCE_SHARE * weights.wrench, 0.0)
        qp.squares(qp.footholds, FOOTHOLD_WEIGHT, nominal_footholds(problem, gait)[4:])
        if target is None or scales is None:
            return
        near = rho / 2 * scales.force**2
        qp.squares(qp.inputs, near, target.forces[of.places[:, 0], of.places[:, 1]])
        near, off = rho / 2 * scales.position**2, target.fingers[..., :2] - of.fixed  # (N + 1, 4, 2)
        steps = sp.coo_matrix(np.kron(2 * near * np.einsum("kij,kil->jl", of.blend, of.blend), np.eye(2)))
        where = qp.at_h + steps.row, qp.at_h + steps.col
        qp.hessian = sp.csc_matrix((steps.data, where), (qp.size, qp.size))
        qp.linear[qp.at_h :] -= 2 * near * np.einsum("kij,kia->ja", of.blend, off).ravel()


def solve(problem: WalkProblem, knots: WalkKnots, deadline: float) -> WalkSolution:
    """P1 of one gait, from a walk near its solution."""
    qp, cost, before = ContactQp(problem, None), np.inf, np.inf
    about: WalkMotion = knots
    for count in range(1, _ROUNDS + 1):
        held = count > _FREE_ROUNDS
        again = _held(problem, knots) if held else qp.solve(about, accuracy=_ACCURACY)
        if again is None or clock.now() > deadline:
            break
        settled = abs(again.cost - cost) < _COST * abs(again.cost)
        knots, cost = again, again.cost
        solution = of_knots(problem, knots, count)
        if settled and solution.solved:
            return solution
        away = float(np.abs(knots.body - about.body).max())
        nearer = away < _NEARER * before
        about, before = knots if nearer else about.halfway(knots), away
    status = "Time is over" if clock.now() > deadline else "its answers do not settle"
    return replace(of_knots(problem, knots, count), solved=False, status=status)


def _held(problem: WalkProblem, knots: WalkKnots) -> WalkKnots | None:
    """The next answer, near the one before."""
    from crux_planner.trajectory.consensus import Eta, Scales

    near = Eta.of_points(knots.body, knots.feet(problem.step_height_m), knots.forces)
    return ContactQp(problem, Scales()).solve(knots, _HOLDING, near, _ACCURACY)


def of_knots(problem: WalkProblem, knots: WalkKnots, iterations: int) -> WalkSolution:
    """A walk as it is; `solved` where (8) holds."""
    feet, yaws = knots.feet(problem.step_height_m), knots.gait.yaw(float(problem.goal.body.rpy_rad[2]))
    left = np.abs(defects(problem, knots.body, feet, yaws, knots.forces))
    moment = float((left[:, 9:12] @ np.abs(problem.inertia_b).T).max()) / problem.dt_s
    force = float(left[:, 6:9].max()) * problem.mass_kg / problem.dt_s
    place = float(left[:, :6].max())
    solved = moment < _MOMENT_NM and force < _FORCE_N and place < _PLACE
    status = "solved" if solved else "(8) does not hold"
    motion = knots.gait, knots.body, knots.forces, knots.footholds
    return WalkSolution(*motion, knots.cost, iterations, status, solved, place, force)
