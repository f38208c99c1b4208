"""What a gait costs, nearly: P2a of a walk in the plane, a fifth of the size of trajectory.walk_qp's.

The body keeps its height. Normal forces are shares of the weight and lateral forces follow from where they act, so
that (8) is two rows a knot; tilting and turning cost no force here, but they are as slow as there.
"""

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from crux_planner.model.arrays import Array, Flags, Indices
from crux_planner.model.gait import Gait, WalkMotion, nominal_footholds, progress
from crux_planner.model.kinematics import rotation_z
from crux_planner.model.problem import BODY_STATES
from crux_planner.model.walk_problem import WalkProblem
from crux_planner.physics.bounds import apart_rows, foothold_bounds, least_load_N, rate_steps, step_rows, walk_bounds
from crux_planner.physics.cost import FOOTHOLD_WEIGHT, FORCE_SHARE, gait_cost
from crux_planner.solvers.qp import Qp
from crux_planner.solvers.sparse_blocks import Entries, Rows

_BODY = (0, 1, 3, 4, 5)  # along, across, roll, pitch, yaw of walk_qp's body states
_FREE = 1e3  # a bound beyond what matters
_ITERATIONS = 30  # gaits that need more have no solution
_ACCURACY = dict.fromkeys(("eps_abs", "eps_rel", "eps_duality_gap_abs", "eps_duality_gap_rel"), 1e-4)


@dataclass(frozen=True)
class FlatWalk(WalkMotion):
    """J, nearly; what each foot on the ground costs, and what each in the air would save were it there (N, 4)."""

    cost: float
    worth: Array


class FlatQp:
    """The QP of one problem for any gait; rows that gaits have in common are built once."""

    def __init__(self, problem: WalkProblem) -> None:
        self.problem = problem
        n, dt = problem.steps, problem.dt_s
        self.across = -float(problem.gravity_h[2])
        self.height = problem.pendulum_s2 * self.across
        self.weight_N = problem.mass_kg * self.across
        k = np.arange(n)
        second = np.zeros((n, n + 1))  # a_k of explicit Euler, at rest after the last knot
        second[k, k] += 1.0
        second[k, k + 1] -= 2.0
        second[k, np.minimum(k + 2, n)] += 1.0
        self._second = second / dt**2
        first = np.zeros((n, n + 1))
        first[k, k], first[k, k + 1] = -1.0 / dt, 1.0 / dt
        # variables: the body's of every knot, then loads, then footholds
        self._at_loads = 5 * (n + 1)
        motion = self.height / self.across * self._second - (1.0 - 4 * problem.limbs_share) * np.eye(n, n + 1)
        tilting = self._second * np.diag(problem.inertia_b)[[1, 0], None, None] / self.weight_N
        self._motion = Entries()
        for axis, (turn, sign) in enumerate(((3, 1.0), (2, -1.0))):
            for matrix, which in ((motion, axis), (sign * tilting[axis], turn)):
                i, j = np.nonzero(matrix)
                self._motion.entries(n + 2 * i + axis, 5 * j + which, matrix[i, j])
        goal = problem.goal.body
        self._goal = np.concatenate([goal.position_m[:2], goal.rpy_rad])
        weights = problem.weights
        self._pull = np.array([weights.position] * 2 + [weights.orientation] * 3)
        self._linear = np.tile(-2 * self._pull * self._goal, n + 1)
        self._first = first
        self._hessian = self._body_hessian()

    def _body_hessian(self) -> Entries:
        """Q on the body's pose and its rates."""
        rates = 2 * self.problem.weights.velocity * self._first.T @ self._first
        i, j = np.nonzero(rates)
        knots, found = np.arange(self.problem.steps + 1), Entries()
        for axis, weight in enumerate(self._pull):
            found.entries(5 * knots + axis, 5 * knots + axis, np.full(len(knots), 2 * weight))
            found.entries(5 * i + axis, 5 * j + axis, rates[i, j])
        return found

    def __call__(self, gait: Gait) -> FlatWalk | None:
        """Minimise J; None where the gait has no solution."""
        problem, n = self.problem, self.problem.steps
        spots = foothold_bounds(problem, gait)
        low, high = (each[:, _BODY].copy() for each in walk_bounds(problem, gait))
        if spots is None or (low > high).any():
            return None
        low[1] = high[1] = low[0]  # at rest
        stance = gait.stance[:n]
        k, i = np.nonzero(stance)
        count, at_l = len(k), self._at_loads
        at_h = at_l + count
        size = at_h + 2 * len(gait.steps)
        whole = gait.blend
        fixed = whole[:, :, :4] @ problem.start_feet_h_m
        places = nominal_footholds(problem, gait)
        places[4:] = nominal = np.clip(places[4:], *spots)
        weight = 2 * FORCE_SHARE * problem.weights.wrench * self.weight_N**2
        others = np.arange(at_l, size)
        own = np.concatenate([np.full(count, weight), np.full(size - at_h, 2 * FOOTHOLD_WEIGHT)])
        hessian = Entries(self._hessian)
        hessian.entries(others, others, own)
        linear = np.concatenate([self._linear, np.zeros(count), -2 * FOOTHOLD_WEIGHT * nominal.ravel()])
        least = least_load_N(problem) / self.weight_N
        most = problem.max_normal_N / self.weight_N
        found = Qp(
            hessian.matrix((size, size), zeros=True).tocsc(),
            linear,
            self._equations(gait, whole, places, size),
            self._inequalities(gait, k, i, whole, fixed, places, at_h, size),
            np.concatenate([np.maximum(low, -_FREE).ravel(), np.full(count, least), spots[0].ravel()]),
            np.concatenate([np.minimum(high, _FREE).ravel(), np.full(count, most), spots[1].ravel()]),
            max_iter=_ITERATIONS,
            **_ACCURACY,
        ).solve()
        if not found.solved:
            return None
        values_x = found.x
        body = values_x[:at_l].reshape(n + 1, 5)
        loads = np.zeros((n, 4))
        loads[k, i] = values_x[at_l:at_h]
        footholds = np.vstack([problem.start_feet_h_m, values_x[at_h:].reshape(-1, 2)])
        dual = found.multipliers
        pull = dual[:n, None] + np.einsum("kia,ka->ki", (whole @ footholds)[:n], dual[n:].reshape(n, 2))
        worth = np.where(stance, weight / 2 * loads**2, np.minimum(pull, 0.0) ** 2 / (2 * weight))
        cost = self._cost(gait, body, loads, stance)
        states, forces = self._states(body), self._forces(body, loads, stance)
        return FlatWalk(gait, states, forces, footholds, cost, worth)

    def _equations(self, gait: Gait, whole: Array, places: Array, size: int) -> tuple[sp.csc_matrix, Array]:
        """Loads sum to the weight; (8a) and (8b), linear about even loads on footholds `places` (4 + S, 2)."""
        problem, n = self.problem, self.problem.steps
        stance, blend, feet = gait.stance[:n], whole[:n, :, 4:], whole @ places
        k, i = np.nonzero(stance)
        load = self._at_loads + np.arange(len(k))
        at_h = self._at_loads + len(k)
        even = stance / stance.sum(axis=1, keepdims=True)
        follow = problem.limbs_share  # of the centre of mass, each foot
        carried = np.einsum("ki,kij->kj", even - follow, blend)
        here, which = np.nonzero(carried)
        found = Entries(self._motion)
        found.entries(k, load, np.ones(len(k)))
        for axis in (0, 1):
            found.entries(n + 2 * k + axis, load, feet[k, i, axis])
            found.entries(n + 2 * here + axis, at_h + 2 * which + axis, carried[here, which])
        yaw = np.interp(np.arange(n), *progress(problem, gait)) * float(problem.goal.body.rpy_rad[2])
        neutral = rotation_z(yaw)[:, :2, :2] @ problem.neutral_feet_b_m.sum(axis=0)
        lean = self.height / self.across * problem.gravity_h[:2] + np.einsum("ki,kij->kj", even, blend) @ places[4:]
        lean += follow * ((whole[:n, :, :4] @ problem.start_feet_h_m).sum(axis=1) - neutral)
        matrix = found.matrix((3 * n, size), zeros=True).tocsc()
        return matrix, np.concatenate([np.ones(n), lean.ravel()])

    def _states(self, body: Array) -> Array:
        """(N + 1, 12): the height goes straight from start to goal."""
        states = np.zeros((self.problem.steps + 1, BODY_STATES))
        states[:, _BODY] = body
        states[:, 2] = np.linspace(self.problem.start.position_m[2], self.problem.goal.body.position_m[2], len(body))
        states[:-1, 6:] = np.diff(states[:, :6], axis=0) / self.problem.dt_s
        return states

    def _forces(self, body: Array, loads: Array, stance: Flags) -> Array:
        lateral = self.problem.mass_kg * (self._second @ body[:, :2] - self.problem.gravity_h[:2])
        share = stance / stance.sum(axis=1, keepdims=True)
        return np.concatenate([share[..., None] * lateral[:, None], self.weight_N * loads[..., None]], axis=2)

    def _cost(self, gait: Gait, body: Array, loads: Array, stance: Flags) -> float:
        """J; the feet in stance share the lateral force."""
        problem, weights = self.problem, self.problem.weights
        lateral = problem.mass_kg * (self._second @ body[:, :2] - problem.gravity_h[:2])
        squares = self.weight_N**2 * float((loads**2).sum())
        squares += float(((lateral**2).sum(axis=1) / stance.sum(axis=1)).sum())
        total = float((self._pull * (body - self._goal) ** 2).sum())
        total += weights.velocity * float(((self._first @ body) ** 2).sum())
        return total + FORCE_SHARE * weights.wrench * squares + gait_cost(problem, gait)

    def _inequalities(
        self, gait: Gait, k: Indices, i: Indices, whole: Array, fixed: Array, nominal: Array, at_h: int, size: int
    ) -> tuple[sp.csc_matrix, Array, Array]:
        """(7), (9a), shares of the weight on three feet, lengths of steps, feet of a side apart."""
        rows, problem, blend = Rows(), self.problem, whole[:, :, 4:]
        fastest = rate_steps(problem)[list(_BODY)] / problem.dt_s
        speed = np.full(2, problem.body.max_speed_m_s)
        for matrix, most in ((self._second, fastest), (self._first, speed)):
            at, j = np.nonzero(matrix)
            for axis in range(len(most)):
                rows.entries(len(most) * at + axis, 5 * j + axis, matrix[at, j])
            rows.close(np.tile(-most, problem.steps), np.tile(most, problem.steps))
        way = np.interp(np.arange(problem.steps + 1), *progress(problem, gait))
        yaw = way * float(problem.goal.body.rpy_rad[2])
        c, s = np.cos(yaw), np.sin(yaw)
        turned = np.array([[c, s], [-s, c]]).transpose(2, 0, 1)[1:]
        self._reach(rows, blend, fixed, yaw, turned, at_h)
        self._three_feet(rows, gait, (k, i), blend, fixed, whole @ nominal, at_h)
        step_rows(rows, problem, gait, nominal, at_h)
        apart_rows(rows, blend, fixed, at_h)
        return rows.all(size, zeros=True)

    def _reach(self, rows: Rows, blend: Array, fixed: Array, yaw: Array, turned: Array, at_h: int) -> None:
        """(9a): offsets in the body frame, along and across."""
        problem, n = self.problem, self.problem.steps
        knots = np.arange(1, n + 1)
        for limb in range(4):
            centre, half = problem.boxes.centre_b_m[limb, :2], problem.boxes.half_m[:2]
            moved, j = np.nonzero(blend[1:, limb])
            for axis in (0, 1):
                row = 2 * (knots - 1) + axis
                for b in (0, 1):
                    rows.entries(row, 5 * knots + b, -turned[:, axis, b])
                    value = turned[moved, axis, b] * blend[1 + moved, limb, j]
                    rows.entries(row[moved], at_h + 2 * j + b, value)
                sign = 1 - 2 * axis
                rows.entries(row, 5 * knots + 3 - axis, np.full(n, sign * self.height))
                rows.entries(row, 5 * knots + 4, np.full(n, sign * centre[1 - axis]))
            known = np.einsum("kab,kb->ka", turned, fixed[1:, limb])
            known += np.outer(yaw[1:], centre[::-1] * [-1.0, 1.0])
            rows.close((centre - half - known).ravel(), (centre + half - known).ravel())

    def _three_feet(
        self, rows: Rows, gait: Gait, on: tuple[Indices, Indices], blend: Array, fixed: Array, feet: Array, at_h: int
    ) -> None:
        """Loads on three feet here and at the next knot, as the mass accelerates then, the limbs' too."""
        problem, n = self.problem, self.problem.steps
        number = np.full((n, 4), -1)
        number[on] = np.arange(len(on[0]))
        three = np.flatnonzero(gait.stance[:n].sum(axis=1) == 3)
        standing = np.nonzero(gait.stance[three])[1].reshape(-1, 3)
        corners = np.concatenate([feet[three[:, None], standing], np.ones((len(three), 3, 1))], axis=2)
        shift = np.linalg.inv(corners.transpose(0, 2, 1))[:, :, :2]
        body_share, press = 1.0 - 4 * problem.limbs_share, problem.pendulum_s2 / problem.dt_s**2
        for ahead in (0, 1):
            together, known = (
                problem.limbs_share * (problem.pressing(places)[three + ahead] - places[three])
                for places in (blend.sum(axis=1), fixed.sum(axis=1))
            )
            seen, j = np.nonzero(together)
            body = [(three + ahead, body_share), (three, -body_share)]
            for late, share in ((ahead, -body_share), (1, 1.0)):  # the body's acceleration then, and what loads have
                body += [(np.minimum(three + late + i - 1, n), share * press * (1.0, -2.0, 1.0)[i]) for i in range(3)]
            for corner in range(3):
                row = 3 * np.arange(len(three)) + corner
                rows.entries(row, self._at_loads + number[three, standing[:, corner]], np.ones(len(three)))
                for b in (0, 1):
                    along = shift[:, corner, b]
                    rows.entries(row[seen], at_h + 2 * j + b, along[seen] * together[seen, j])
                    for knot, share in body:
                        rows.entries(row, 5 * knot + b, share * along)
            most = np.einsum("kab,kb->ka", shift, known)
            rows.close((problem.profile.true_share - most).ravel(), np.inf, 3 * len(three))
