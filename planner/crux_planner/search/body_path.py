"""Where the body is and what the grippers carry, for a given sequence of moves: convex programs on static balance.

Level body: with contacts fixed, balance (8), limit surface (2)+(3) at the margin and reach (9a) are linear, so the best
body path is one sparse QP: first over the events of the sequence (each lift-off and touch-down), which tells how long
the body needs between them, then over all knots of the schedule, which starts the NLP.
"""

from dataclasses import dataclass, replace
from functools import partial
from itertools import pairwise

import numpy as np

from crux_planner.model.arrays import Array, Indices
from crux_planner.model.kinematics import rotation_from_rpy
from crux_planner.model.problem import Problem
from crux_planner.model.schedule import Move, Schedule
from crux_planner.model.workspace import Reach
from crux_planner.physics.reach import between, body_positions
from crux_planner.physics.reachable_set import REACH_RESERVE_M
from crux_planner.physics.speed_limits import speeds
from crux_planner.search.equilibrium import FORCE_BOUND_N, TWIST_BOUND_NM, WRENCH, StaticEquilibrium
from crux_planner.search.stances import Oracles
from crux_planner.solvers.path import Grip, Grips, PathProblem, least_cost
from crux_planner.solvers.qp import SparseQp

SPEED_SHARE = 0.95  # of the body's largest speed
_WAITING = 1e-2  # cost of a further knot against squared lengths [m^2]: above any detour it could save
_BOUND = np.array([FORCE_BOUND_N, FORCE_BOUND_N, TWIST_BOUND_NM, FORCE_BOUND_N, FORCE_BOUND_N])  # of (w, n)
_ANYWHERE_M = 100.0  # beyond any wall
_LEVEL = np.eye(3)
_COMFORT = 1e-5  # weight of wrenches against squared lengths [m^2/N^2]: keeps the body where the grippers carry least


def smooth_events(oracles: Oracles, moves: list[Move]) -> list[Move]:
    """The same moves with all body positions at lift-off and touch-down chosen together: short way, low wrenches."""
    if not moves:
        return moves
    problem, equilibrium, swings, qp = oracles.problem, oracles.equilibrium, oracles.swings, SparseQp()
    path: list[Indices] = []
    for move in moves:
        for stance in (move.before, move.after):
            bounds = oracles.reachable.of(stance)
            assert bounds is not None
            grippers = equilibrium.mean_place(stance)
            path.append(_position(qp, equilibrium, bounds, move.support, grippers, _LEVEL)[0])
    fixed = [problem.start.position_m, problem.goal.body.position_m]
    one, two = np.ones((3, 1)), np.tile([1.0, -1.0], (3, 1))
    qp.squares(path[0][:, None], one, fixed[0], 1.0)
    qp.squares(path[-1][:, None], one, fixed[1], 1.0)
    for a, b in pairwise(path):
        qp.squares(np.column_stack([a, b]), two, np.zeros(3), 1.0)
    least = [max(swings.intervals(m.before[i], m.after[i]) for i in m.limbs) for m in moves]
    _charge_for_waiting(qp, problem, path, moves, least)
    solution = qp.solve()
    if solution is None:  # at the very edge of what the search allowed: keep what it found
        return moves
    at = [solution[index] for index in path]
    return [replace(m, lift_off=at[2 * i], touch_down=at[2 * i + 1]) for i, m in enumerate(moves)]


def _charge_for_waiting(
    qp: SparseQp, problem: Problem, path: list[Indices], moves: list[Move], swings: list[int]
) -> None:
    """Make it dear that the body goes further in a swing, or a stance between two, than their least time allows."""
    held = [*[contacts for move in moves for contacts in (move.before, move.held)], moves[-1].after]
    fastest, limits = problem.body.max_speed_m_s, problem.speed_limits
    steps = [SPEED_SHARE * min(limits.get(h, np.inf), fastest) * problem.dt_s for h in held]
    axes = np.hstack([-np.eye(3), np.eye(3)])
    start, end = (qp.variables(at, at) for at in (problem.start.position_m, problem.goal.body.position_m))
    allowed = [0, *[knots for swing in swings for knots in (swing, 1)]]  # before, in and after each swing
    for (a, b), knots, step in zip(pairwise([start, *path, end]), allowed, steps, strict=True):
        late = qp.variables(np.zeros(1), np.full(1, np.inf))  # further knots
        qp.squares(late[:, None], np.ones((1, 1)), -np.ones(1), _WAITING)  # (late + 1)^2: nearly linear
        rows = np.hstack([np.vstack([axes, -axes]), np.full((6, 1), -step)])
        qp.below(rows, np.concatenate([a, b, late]), np.full(6, step * knots))


@dataclass(frozen=True)
class BodyPath:
    """Positions (N + 1, 3) and per knot 0..N-1 the wrenches of the limbs in stance, limb -> (s1, s2, m, F, n)."""

    positions: Array
    wrenches: list[dict[int, Array]]


def knot_path(problem: Problem, equilibrium: StaticEquilibrium, schedule: Schedule) -> BodyPath | None:
    """The best quasi-static path over the knots of a schedule, None where there is none."""
    shape, to_h = between(problem, REACH_RESERVE_M / 2), np.tile(_LEVEL, (len(schedule.poses), 1, 1))
    lows, highs = body_positions(schedule.poses[..., :3], shape)
    low, high = lows.max(axis=1), highs.min(axis=1)  # (N + 1, m)
    low[:, 2] = np.maximum(low[:, 2], problem.body.height_m[0])
    high[:, 2] = np.minimum(high[:, 2], problem.body.height_m[1])
    if (low > high).any():
        return None
    first, last, slack = problem.start.position_m, problem.goal.body.position_m, problem.goal.aim_m
    low[:2, 3:], high[:2, 3:] = -_ANYWHERE_M, _ANYWHERE_M
    low[:2, :3], high[:2, :3] = first, first  # at rest in knot 0: knot 1 is the same
    low[-1, :3] = np.maximum(low[-1, :3], last - slack)
    high[-1, :3] = np.minimum(high[-1, :3], last + slack)
    if (low > high).any():
        return None
    return _best_between(problem, equilibrium, schedule, low, high, to_h)


def path_about(
    problem: Problem, equilibrium: StaticEquilibrium, schedule: Schedule, poses: Array, half_m: float
) -> BodyPath | None:
    """The best quasi-static path within `half_m` along x and y of the body of poses (N + 1, 6); None if none."""
    to_h = rotation_from_rpy(poses[:, 3:])
    half = np.tile([half_m, half_m, 0.0], (len(poses), 1))
    half[:2], half[-1] = 0.0, problem.goal.aim_m
    along = (poses[:, None, :3] @ to_h)[:, 0]
    return _best_between(problem, equilibrium, schedule, along - half, along + half, to_h)


def _best_between(
    problem: Problem, equilibrium: StaticEquilibrium, schedule: Schedule, low: Array, high: Array, to_h: Array
) -> BodyPath | None:
    """A path between bounds (N + 1, m) along the directions of the reach, which `to_h` (N + 1, 3, 3) turns to H."""
    if (to_h == np.eye(3)).all() and (found := _best_compiled(problem, equilibrium, schedule, low, high)) is not None:
        return found
    qp, path, grips = SparseQp(), list[Indices](), list[dict[int, Indices]]()
    means = schedule.poses[..., :3].mean(axis=1)
    for k in range(problem.steps):
        on = {limb: c for limb in range(4) if (c := schedule.contacts[k][limb]) is not None}
        at = (low[k], high[k]), tuple(on.values()), means[k], to_h[k]
        position, wrenches = _position(qp, equilibrium, *at, problem.weights.wrench)
        path.append(position)
        grips.append(dict(zip(on, wrenches, strict=True)))
    path.append(within(qp, problem.boxes, low[-1], high[-1], to_h[-1]))
    _add_cost(qp, problem, schedule, path)
    solution = qp.solve()
    if solution is None:
        return None
    return BodyPath(solution[np.array(path)], [{limb: solution[i] for limb, i in grip.items()} for grip in grips])


def _best_compiled(
    problem: Problem, equilibrium: StaticEquilibrium, schedule: Schedule, low: Array, high: Array
) -> BodyPath | None:
    """The same for a body that does not turn, where the compiled solver finds one."""
    weights, grips = problem.weights, Grips(partial(_grip, equilibrium))
    held = [{limb: c for limb, c in enumerate(knot) if c is not None} for knot in schedule.contacts[: problem.steps]]
    means = schedule.poses[..., :3].mean(axis=1)
    right = [equilibrium.weight(mean) for mean in means]
    found = least_cost(
        grips,
        PathProblem(
            directions=problem.boxes.directions,
            low=low,
            high=high,
            target=problem.goal.body.position_m,
            pull=np.full(len(low), weights.position),
            speed=np.full(problem.steps, weights.velocity / problem.dt_s**2),
            step=_steps(problem, schedule),
            carried=np.full(len(low), weights.wrench),
            body=np.array([body for body, _ in right]),
            weight=np.array([sums for _, sums in right]),
            on=[*(grips.numbers(list(knot.values())) for knot in held), []],
        ),
    )
    if found is None:
        return None
    places, wrenches = found
    each = iter(wrenches[:, :WRENCH])
    return BodyPath(places, [{limb: next(each) for limb in knot} for knot in held])


def _grip(equilibrium: StaticEquilibrium, contact: int) -> Grip:
    """With one number that means nothing."""
    rows, right = equilibrium.limit_rows(contact)
    bound, effort = np.append(_BOUND, 0.0), np.append(equilibrium.effort, [1.0, 1.0]) ** 2
    low = np.concatenate([-bound[:4], [0.0, 0.0]])
    return Grip(
        np.pad(rows, ((0, 0), (0, 1))), right, low, bound, np.pad(equilibrium.maps[contact], ((0, 0), (0, 2))), effort
    )


def _steps(problem: Problem, schedule: Schedule) -> Array:
    """(N,) how far the body gets along an axis from knot to knot."""
    most = speeds(problem.speed_limits, schedule.contacts, problem.body.max_speed_m_s)
    return np.asarray(SPEED_SHARE * most * problem.dt_s)[: problem.steps]


def _add_cost(qp: SparseQp, problem: Problem, schedule: Schedule, path: list[Indices]) -> None:
    weights, goal, dt = problem.weights, problem.goal.body.position_m, problem.dt_s
    difference = np.hstack([-np.eye(3), np.eye(3)])
    for position in path:
        qp.squares(position[:, None], np.ones((3, 1)), goal, weights.position)
    for (a, b), step in zip(pairwise(path), _steps(problem, schedule), strict=True):
        both = np.concatenate([a, b])
        qp.squares(np.column_stack([a, b]), np.tile([-1.0, 1.0], (3, 1)), np.zeros(3), weights.velocity / dt**2)
        qp.below(np.vstack([difference, -difference]), both, np.full(6, step))


def _position(
    qp: SparseQp,
    equilibrium: StaticEquilibrium,
    bounds: tuple[Array, Array],
    support: tuple[int, ...],
    grippers: Array,
    to_h: Array,
    comfort: float = _COMFORT,
) -> tuple[Indices, list[Indices]]:
    """Add a body position in balance on `support`, grippers' mean place `grippers`; its variables and the wrenches'."""
    position = within(qp, equilibrium.problem.boxes, *bounds, to_h)
    wrenches, support = [], equilibrium.bearing(support)
    for contact in support:
        index = qp.variables(np.concatenate([-_BOUND[:4], [0.0]]), _BOUND)
        rows, right = equilibrium.limit_rows(contact)
        qp.below(rows, index, right)
        qp.squares(index[:, None], np.append(equilibrium.effort, 1.0)[:, None], np.zeros(WRENCH), comfort)
        wrenches.append(index)
    maps = np.concatenate([equilibrium.maps[c] for c in support], axis=1)
    columns = np.concatenate([*[w[:4] for w in wrenches], position])
    body, right = equilibrium.weight(grippers, to_h)
    qp.equal(np.hstack([maps, body]), columns, right)
    return position, wrenches


def within(qp: SparseQp, reach: Reach, low: Array, high: Array, to_h: Array) -> Indices:
    """Add a position between bounds (m,) along directions that `to_h` (3, 3) turns to H; its variables' numbers."""
    level = (to_h == np.eye(3)).all()
    ends = (low[:3], high[:3]) if level else (np.full(3, -_ANYWHERE_M), np.full(3, _ANYWHERE_M))
    position = qp.variables(*ends)
    some = slice(3 if level else 0, len(low))
    if some.start < len(low):
        rows = reach.directions[some] @ to_h.T
        qp.below(np.vstack([rows, -rows]), position, np.concatenate([high[some], -low[some]]))
    return position
