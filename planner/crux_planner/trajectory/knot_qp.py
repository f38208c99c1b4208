"""P2a of a climb with its binaries fixed: x, u and y at every knot; (8b) and (9a) linearised, the rest exact.

R(theta) of (9a) is fixed at level, with the box shrunk for it; (8b) is taken about a given body path, where it differs
from the exact one by the product of two small numbers, the body's way off the path and its acceleration.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from crux_planner.model.arrays import Array, Indices
from crux_planner.model.problem import Problem
from crux_planner.model.schedule import Schedule
from crux_planner.physics.bounds import body_bounds, wrench_bounds
from crux_planner.physics.cost import plan_cost, wrench_weights
from crux_planner.physics.dynamics import WRENCH_INPUTS
from crux_planner.physics.reach import between, body_positions
from crux_planner.physics.reachable_set import REACH_RESERVE_M
from crux_planner.physics.static_balance import StaticBalance
from crux_planner.solvers.sparse_blocks import skews
from crux_planner.trajectory.centroidal_qp import MOMENT_OF_FORCE, CentroidalQp
from crux_planner.trajectory.consensus import Eta, Scales
from crux_planner.trajectory.solution import Solution, Start, start_from_positions

_FORCE_BOUND_N, _TWIST_BOUND_NM = 300.0, 10.0  # beyond what matters: they keep the QP compact


@dataclass(frozen=True)
class KnotSolution:
    """Body states (N + 1, 12), wrenches q = (s1, s2, m, n1, n2) per knot and limb in stance, and J."""

    problem: Problem
    schedule: Schedule
    body: Array
    wrenches: list[dict[int, Array]]
    cost: float

    @property
    def order(self) -> list[str]:
        """Limbs in the order in which they release."""
        return self.schedule.gait

    def with_body(self, body: Array) -> KnotSolution:
        """The same with other body states."""
        return replace(self, body=body, cost=plan_cost(self.problem, self.schedule, body, self.wrenches))

    @property
    def solution(self) -> Solution:
        """As if it were exact."""
        return Solution(self.body, self.wrenches, self.cost, 0, "", True, 0.0, 0.0, {}, self.problem.torque_limits_Nm)

    def start(self) -> Start:
        """Where the exact program starts: these wrenches, and a body that turns evenly."""
        return start_from_positions(self.problem, self.body[:, :3], self.wrenches)


def solve_knots(
    problem: Problem,
    balance: StaticBalance,
    schedule: Schedule,
    rho: float,
    target: Eta | None,
    scales: Scales,
    path: Array,
    moments: bool,
    alone: bool = False,
) -> KnotSolution | None:
    """Minimise J, and rho / 2 |eta - target|^2 where there is a target; None where the schedule leaves no solution.

    Limbs `alone` have neither (8) nor (9a); their body is the target's.
    """
    low, high = (target.body, target.body) if alone and target is not None else _bounds(problem, schedule)
    if (low > high).any():
        return None
    held = np.array([[-1 if c is None else c for c in knot] for knot in schedule.contacts[: problem.steps]])
    places = np.argwhere(held >= 0)
    qp = CentroidalQp(problem, places, WRENCH_INPUTS)
    contacts = held[places[:, 0], places[:, 1]]
    if not alone:
        _add_dynamics(qp, balance, contacts, path, schedule.poses[:, :, :3].mean(axis=1))
    qp.add_body_cost(rho, target, scales)
    qp.squares(qp.inputs, problem.weights.wrench * wrench_weights(problem), 0.0)
    if target is not None:
        _pull(qp, problem, contacts, rho, target, scales)
    cone = np.zeros((len(places), len(balance.directions), WRENCH_INPUTS))
    cone[..., :3] = balance.directions
    at = cone.shape[1] * np.arange(len(places))
    for finger in (0, 1):  # (2)-(4) at the margin
        rows = cone.copy()
        rows[..., 3 + finger] = -balance.load[contacts, finger]
        qp.rows.blocks(at, qp.inputs[:, 0], rows)
        qp.rows.close(-np.inf, balance.spine[contacts, finger].ravel())
    free = np.array([_FORCE_BOUND_N] * 2 + [_TWIST_BOUND_NM] + [balance.max_normal_N] * 2)
    limits = np.clip([wrench_bounds(problem, contact) for contact in problem.contacts], -free, free)[contacts]
    lows, highs = (np.append(body, limits[:, end]) for end, body in ((0, low), (1, high)))
    found = qp.solve(lows, highs, moments=moments, accuracy=1e-6, iterations=80)
    if found is None:
        return None
    states = found.x[qp.states]
    wrenches: list[dict[int, Array]] = [{} for _ in range(problem.steps)]
    for (k, limb), index in zip(places.tolist(), qp.inputs, strict=True):
        wrenches[k][limb] = found.x[index]
    return KnotSolution(problem, schedule, states, wrenches, plan_cost(problem, schedule, states, wrenches))


def _bounds(problem: Problem, schedule: Schedule) -> tuple[Array, Array]:
    """(7) and (9a) as bounds of the body states."""
    low, high = body_bounds(problem, schedule)
    near, far = body_positions(schedule.poses[1:, :, :3], between(problem, REACH_RESERVE_M / 2))
    low[1:, :3] = np.maximum(low[1:, :3], near.max(axis=1))
    high[1:, :3] = np.minimum(high[1:, :3], far.min(axis=1))
    return low, high


def _add_dynamics(qp: CentroidalQp, balance: StaticBalance, contacts: Indices, path: Array, grippers: Array) -> None:
    """(8) of a level body about its `path` (N + 1, 3), with its grippers' mean places (N + 1, 3).

    Moment about c: M - c x F, with c x F taken as c x (-M g) + c0 x (F + M g), c0 on the path.
    """
    n, knots = qp.problem.steps, qp.places[:, 0]
    centres = [balance.centre(place) for place in grippers[:n]]
    maps = np.insert(balance.maps, 4, -balance.maps[..., 3], axis=2)[contacts]
    easier = np.linalg.inv(qp.problem.inertia_b)
    arms = np.array([moved @ r + still for r, (moved, still) in zip(path[:n], centres, strict=True)])
    lean = easier @ balance.weight(grippers[0])[0][3:]
    qp.add_dynamics(maps[:, :3], easier @ (maps[:, 3:] - skews(arms)[knots] @ maps[:, :3]), np.tile(lean, (n, 1, 1)))
    qp.right[:, MOMENT_OF_FORCE] = -qp.problem.dt_s * path[:n] @ lean.T


def _pull(qp: CentroidalQp, problem: Problem, contacts: Indices, rho: float, target: Eta, scales: Scales) -> None:
    """rho / 2 |lambda - target|^2 of the grippers' fingers."""
    k, limb = qp.places.T
    axis, tangent, up = (
        np.array([getattr(problem.contacts[c], of) for c in contacts]) for of in ("axis", "tangent", "up")
    )
    fingers = np.stack([2 * limb, 2 * limb + 1], axis=1)
    forces, moments = target.forces[k[:, None], fingers], target.moments[k[:, None], fingers]
    shear, twist = forces.mean(axis=1), moments.mean(axis=1)
    parts = [(shear, tangent), (shear, up), (twist, axis), (forces[:, 0], axis), (-forces[:, 1], axis)]
    wanted = np.stack([(vector * along).sum(axis=1) for vector, along in parts], axis=1)
    force, moment = scales.force**2, scales.moment**2
    qp.squares(qp.inputs, rho / 2 * np.array([2 * force, 2 * force, 2 * moment, force, force]), wanted)
