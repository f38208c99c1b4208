"""P2a with its binaries fixed: x, u and y at every knot by one sparse QP; (8b) and (9a) linearised, the rest exact.

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
from crux_planner.physics.cost import plan_cost, state_weights, wrench_weights
from crux_planner.physics.dynamics import skew
from crux_planner.physics.limit_surface import finger_forces
from crux_planner.physics.reach import body_positions, turned
from crux_planner.search.body_path import BodyPath
from crux_planner.search.equilibrium import StaticEquilibrium
from crux_planner.search.stances import REACH_RESERVE_M
from crux_planner.solvers.qp import SparseQp
from crux_planner.trajectory.consensus import Eta, Scales
from crux_planner.trajectory.solution import Solution, Start, start_from_path, to_net

_FORCE_BOUND_N, _TWIST_BOUND_NM, _FREE = 300.0, 10.0, 1e3  # beyond what matters: they keep the QP compact


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
        return Solution(self.body, self.wrenches, self.cost, 0, "", True, 0.0, 0.0, {})

    def start(self) -> Start:
        """Where the exact program starts: no more squeeze than the smaller of two normal forces."""
        shared = [{limb: to_net(q) for limb, q in knot.items()} for knot in self.wrenches]
        return start_from_path(self.problem, BodyPath(self.body[:, :3], shared), self.schedule.yaw_rad)


def solve_knots(
    problem: Problem,
    equilibrium: StaticEquilibrium,
    schedule: Schedule,
    rho: float,
    target: Eta | None,
    scales: Scales,
    path: Array,
    moments: bool,
) -> KnotSolution | None:
    """Minimise J, and rho / 2 |eta - target|^2 where there is a target; None where the schedule leaves no solution."""
    bounds = _bounds(problem, schedule)
    if bounds is None:
        return None
    qp = SparseQp()
    body = [qp.variables(low, high) for low, high in zip(*bounds, strict=True)]
    grips: list[dict[int, Indices]] = []
    for k in range(problem.steps):
        held = {limb: c for limb in range(4) if (c := schedule.contacts[k][limb]) is not None}
        grips.append({limb: _grip(qp, problem, equilibrium, c) for limb, c in held.items()})
        about = (path[k], schedule.poses[k, :, :3].mean(axis=0)) if moments else None
        _step(qp, problem, equilibrium, body[k], body[k + 1], grips[k], held, about)
        if target is not None:
            for limb, c in held.items():
                _pull(qp, problem, c, grips[k][limb], target, k, limb, rho, scales)
    _body_cost(qp, problem, body, target, rho, scales)
    values = qp.solve()
    if values is None:
        return None
    states = values[np.array(body)]
    wrenches = [{limb: values[index] for limb, index in grip.items()} for grip in grips]
    return KnotSolution(problem, schedule, states, wrenches, plan_cost(problem, schedule, states, wrenches))


def _bounds(problem: Problem, schedule: Schedule) -> tuple[Array, Array] | None:
    """(7) and (9a) as bounds of the body states."""
    low, high = body_bounds(problem, schedule)
    turn = max(np.abs(problem.start.rpy_rad).max(), np.abs(problem.goal.body.rpy_rad).max())
    near, far = body_positions(schedule.poses[1:, :, :3], turned(problem.boxes, float(turn), REACH_RESERVE_M / 2))
    low[1:, :3] = np.maximum(low[1:, :3], near.max(axis=1))
    high[1:, :3] = np.minimum(high[1:, :3], far.min(axis=1))
    if (low > high).any():
        return None
    return np.maximum(low, -_FREE), np.minimum(high, _FREE)


def _grip(qp: SparseQp, problem: Problem, equilibrium: StaticEquilibrium, contact: int) -> Indices:
    """A gripper's q within (2)-(4) at the margin."""
    low, high = wrench_bounds(problem, problem.contacts[contact])
    free = np.array(
        [_FORCE_BOUND_N, _FORCE_BOUND_N, _TWIST_BOUND_NM, equilibrium.max_normal_N, equilibrium.max_normal_N]
    )
    index = qp.variables(np.maximum(low, -free), np.minimum(high, free))
    for normal, load, spine in zip((3, 4), equilibrium.load[contact], equilibrium.spine[contact], strict=True):
        rows = np.column_stack([equilibrium.directions, -load])
        qp.below(rows, index[[0, 1, 2, normal]], spine)
    qp.squares(index[:, None], np.sqrt(wrench_weights(problem))[:, None], np.zeros(5), problem.weights.wrench)
    return index


def _step(
    qp: SparseQp,
    problem: Problem,
    equilibrium: StaticEquilibrium,
    now: Indices,
    then: Indices,
    grips: dict[int, Indices],
    held: dict[int, int],
    about: tuple[Array, Array] | None,
) -> None:
    """(8a), and (8b) about a place of the body and the mean one of its grippers, by explicit Euler."""
    dt = problem.dt_s
    one = np.eye(6)
    pose, rate = slice(0, 6), slice(6, 12)
    columns = np.concatenate([then[pose], now[pose], now[rate]])
    qp.equal(np.hstack([one, -one, -dt * one]), columns, np.zeros(6))
    maps = [np.insert(equilibrium.maps[c], 4, -equilibrium.maps[c][:, 3], axis=1) for c in held.values()]
    total = np.hstack(maps) if maps else np.zeros((6, 0))
    wrench = np.concatenate([[], *grips.values()]).astype(int)
    force = np.hstack([one[:3, :3], -one[:3, :3], -dt / problem.mass_kg * total[:3]])
    columns = np.concatenate([then[6:9], now[6:9], wrench])
    qp.equal(force, columns, dt * problem.gravity_w)
    if about is None:
        return
    # Moment about c: M - c x F, with c x F taken as c x (-M g) + c0 x (F + M g), c0 at `about`.
    turn = np.linalg.inv(problem.inertia_b) * dt
    (moved, still), (body, right) = equilibrium.centre(about[1]), equilibrium.weight(about[1])
    arm = skew(moved @ about[0] + still)
    matrix = np.hstack([one[:3, :3], -one[:3, :3], -turn @ (total[3:] - arm @ total[:3]), -turn @ body[3:]])
    columns = np.concatenate([then[9:12], now[9:12], wrench, now[:3]])
    qp.equal(matrix, columns, -turn @ (arm @ problem.weight_N + right[3:]))


def _pull(
    qp: SparseQp,
    problem: Problem,
    contact: int,
    index: Indices,
    target: Eta,
    k: int,
    limb: int,
    rho: float,
    scales: Scales,
) -> None:
    """rho / 2 |lambda - target|^2 of one gripper's two fingers."""
    grasp, fingers = problem.contacts[contact], slice(2 * limb, 2 * limb + 2)
    units = [finger_forces(unit, grasp.axis, grasp.tangent) for unit in np.eye(5)]
    forces, moments = (np.stack([unit[i].ravel() for unit in units], axis=1) for i in (0, 1))
    columns = np.tile(index, (6, 1))
    qp.squares(columns, forces, target.forces[k, fingers].ravel(), rho / 2 * scales.force**2)
    qp.squares(columns[:, 2:3], moments[:, 2:3], target.moments[k, fingers].ravel(), rho / 2 * scales.moment**2)


def _body_cost(
    qp: SparseQp, problem: Problem, body: list[Indices], target: Eta | None, rho: float, scales: Scales
) -> None:
    q, wanted = state_weights(problem)
    unit = np.array([scales.position] * 3 + [scales.orientation] * 3 + [scales.rate] * 6)
    for k, index in enumerate(body):
        qp.squares(index[:, None], np.sqrt(q)[:, None], np.sqrt(q) * wanted, 1.0)
        if target is not None:
            qp.squares(index[:, None], unit[:, None], unit * target.body[k], rho / 2)
