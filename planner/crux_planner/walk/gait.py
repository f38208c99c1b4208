"""Which foot steps when: candidate gaits, each scored by one small QP, the best first.

The QP is the walk on a flat support with a body of constant height and no spin: normal forces are shares of the weight,
lateral acceleration follows from where they act, so that (8a) and (8b) are linear with the footholds given.
"""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from crux_planner.arrays import Array, Flags, Indices
from crux_planner.errors import InfeasibleError
from crux_planner.kinematics import rotation_z
from crux_planner.problem import LIMBS
from crux_planner.search.sparse_qp import SparseQp
from crux_planner.terms.reach import body_positions, turned_half
from crux_planner.walk.problem import FINAL_FOOT_M, WalkProblem

LEAST_AIR = 3  # knots
LEAST_SHARE = 0.15  # of the weight on a foot in stance: keeps the body off the edge of its support
TRUE_SHARE = 0.12  # the same for the centre of mass as it is with the limbs' own mass, while three feet stand
SPEED_SHARE = 0.95
STRIDE_SHARE = 0.5  # of the workspace's length that a step may take on the straight way
AIR_SHARE = 0.62  # of the time, with some foot in the air
_PAIRS = {2: (((0, 3), (1, 2)), ((0, 2), (1, 3)), ((0, 1), (2, 3)))}  # trot, pace, bound


@dataclass(frozen=True)
class Step:
    """One foot's step: in the air at the knots lift..land - 1, on its new foothold from knot `land`."""

    limb: int
    lift: int
    land: int

    def shares(self) -> tuple[Array, Array]:
        """Way (0..1) and height (0..1) at the knots lift..land; both begin and end at rest."""
        u = np.linspace(0.0, 1.0, self.land - self.lift + 1)
        return u * u * (3 - 2 * u), 16 * (u * (1 - u)) ** 2


@dataclass(frozen=True)
class Gait:
    """Steps in the order of their beginning, over the knots 0..N; `shares` (S,) of the whole way after each step."""

    steps: tuple[Step, ...]
    shares: Array
    knots: int

    @property
    def names(self) -> list[str]:
        """Limbs in the order in which they lift off; limbs that lift off together joined by +."""
        groups = itertools.groupby(self.steps, key=lambda step: step.lift)
        return ["+".join(LIMBS[step.limb] for step in group) for _, group in groups]

    @property
    def stance(self) -> Flags:
        """(N + 1, 4)."""
        on = np.ones((self.knots, 4), dtype=bool)
        for step in self.steps:
            on[step.lift : step.land, step.limb] = False
        return on

    @property
    def blend(self) -> Array:
        """(N + 1, 4, 4 + S): footholds' shares in the foot's plan position; the 4 start footholds come first."""
        weights = np.zeros((self.knots, 4, 4 + len(self.steps)))
        weights[:, np.arange(4), np.arange(4)] = 1.0
        last = list(range(4))
        for i, step in enumerate(self.steps):
            way, _ = step.shares()
            weights[step.lift :, step.limb] = 0.0
            weights[step.lift : step.land + 1, step.limb, last[step.limb]] = 1.0 - way
            weights[step.lift : step.land + 1, step.limb, 4 + i] = way
            weights[step.land + 1 :, step.limb, 4 + i] = 1.0
            last[step.limb] = 4 + i
        return weights

    @property
    def height(self) -> Array:
        """(N + 1, 4) of the feet, as a share of the step height."""
        z = np.zeros((self.knots, 4))
        for step in self.steps:
            z[step.lift : step.land + 1, step.limb] = step.shares()[1]
        return z

    def yaw(self, goal_yaw: float) -> Array:
        """(N + 1, 4) of the feet: turned on with the way, step by step."""
        turned = np.concatenate([np.zeros(4), self.shares]) * goal_yaw
        yaw: Array = self.blend @ turned
        return yaw


@dataclass(frozen=True)
class Candidate:
    """A gait with nominal footholds (4 + S, 2), the QP's body path (N + 1, 2), foot loads (N, 4) [N] and cost."""

    gait: Gait
    footholds: Array
    body: Array
    loads: Array
    cost: float


def candidates(problem: WalkProblem, at_once: int) -> list[Candidate]:
    """All regular gaits with `at_once` feet in the air that the QP finds feasible, cheapest first."""
    scored = [_score(problem, gait) for gait in regular_gaits(problem, at_once, fewest_rounds(problem, STRIDE_SHARE))]
    return sorted((c for c in scored if c is not None), key=lambda c: c.cost)


def fewest_rounds(problem: WalkProblem, stride: float) -> int:
    """How often every foot must step, with steps of `stride` of the workspace on the straight way; 0 at the goal."""
    straight = np.abs(problem.goal.body.position_m - problem.start.position_m)[:2]
    turn = abs(float(problem.goal.body.rpy_rad[2]))
    if np.linalg.norm(straight) <= problem.goal.position_room_m and turn <= problem.goal.rotation_room_rad:
        return 0
    strides = straight / (stride * 2 * problem.boxes.half_m[:2])
    return max(1, int(np.ceil(float(strides.max()) - 1e-9)))


def regular_gaits(problem: WalkProblem, at_once: int, rounds: int) -> list[Gait]:
    """Every order of the feet, or of pairs of feet, evenly in time. Raises InfeasibleError where time is too short."""
    if rounds == 0:
        return [Gait((), np.zeros(0), problem.steps + 1)]
    orders: Sequence[Sequence[tuple[int, ...]]]
    if at_once == 1:
        orders = [[(limb,) for limb in order] for order in itertools.permutations(range(4))]
    else:
        orders = [order for pair in _PAIRS[at_once] for order in (pair, pair[::-1])]
    return [lay_out(problem, order, rounds) for order in orders]


def lay_out(problem: WalkProblem, order: Sequence[tuple[int, ...]], rounds: int) -> Gait:
    """The order repeated over `rounds`, evenly in time. Raises InfeasibleError when the horizon is too short."""
    n, moves = problem.steps, len(order) * rounds
    quick = _air_for(problem, rounds)
    air = max(LEAST_AIR, int(AIR_SHARE * n / moves), quick)
    gap = max(1, int((1.0 - AIR_SHARE) / 2 * n / moves))
    if n - moves * air - (moves - 1) * gap < 4:
        gap = 1
    spare = n - moves * air - (moves - 1) * gap
    if spare < 4:
        least = moves * (max(LEAST_AIR, quick) + 1) + 3
        raise InfeasibleError(
            "horizon", f"horizon.steps: {rounds * 4} steps of the feet need at least {least} knots, there are {n}"
        )
    steps, shares, k = [], [], spare // 2
    for i in range(moves):
        for limb in order[i % len(order)]:
            steps.append(Step(limb, k, k + air))
            shares.append((1 + i // len(order)) / rounds)
        k += air + gap
    return Gait(tuple(steps), np.array(shares), n + 1)


def longest_step(problem: WalkProblem, step: Step) -> float:
    """How long a step may be [m] for the foot's mean speed over every interval."""
    way, lift = (np.abs(np.diff(shares)) for shares in step.shares())
    room = (SPEED_SHARE * problem.foot_speed_m_s * problem.dt_s) ** 2 - (problem.step_height_m * lift) ** 2
    return float(np.sqrt((np.maximum(room, 0.0) / way**2).min()))


def _air_for(problem: WalkProblem, rounds: int) -> int:
    """Knots in the air that the longest of equal steps to the goal needs."""
    ways = np.linalg.norm(problem.goal_feet_w_m - problem.start_feet_w_m, axis=1)
    wanted = float(ways.max()) / rounds - FINAL_FOOT_M / rounds
    return next((air for air in range(1, problem.steps) if longest_step(problem, Step(0, 0, air)) >= wanted), 1)


def nominal_footholds(problem: WalkProblem, gait: Gait) -> Array:
    """(4 + S, 2): each foot keeps its place relative to the body on the straight way."""
    start, goal = problem.start, problem.goal.body
    places = list(problem.start_feet_w_m)
    for step, share in zip(gait.steps, gait.shares, strict=True):
        offset = problem.start_feet_w_m[step.limb] - start.position_m[:2]
        turned = rotation_z(share * float(goal.rpy_rad[2]))[:2, :2] @ offset
        places.append(start.position_m[:2] + share * (goal.position_m - start.position_m)[:2] + turned)
    return np.array(places)


def _score(problem: WalkProblem, gait: Gait) -> Candidate | None:
    """The QP of one gait."""
    n, dt, weights = problem.steps, problem.dt_s, problem.weights
    footholds = nominal_footholds(problem, gait)
    feet = gait.blend @ footholds  # (N + 1, 4, 2)
    body = np.linspace(problem.start.position_m, problem.goal.body.position_m, n + 1)
    half = turned_half(problem.boxes.half_m, problem.boxes.centre_b_m, abs(float(problem.goal.body.rpy_rad[2])))
    lows, highs = body_positions(
        np.concatenate([feet, np.zeros((n + 1, 4, 1))], axis=2), problem.boxes.centre_b_m, half
    )
    low, high = lows[..., :2].max(axis=1), highs[..., :2].min(axis=1)
    goal, room = problem.goal.body.position_m[:2], problem.goal.position_room_m
    low[:2], high[:2] = body[0, :2], body[0, :2]  # at rest in knot 0
    low[-2:], high[-2:] = np.maximum(low[-2:], goal - room), np.minimum(high[-2:], goal + room)
    if (low > high).any():
        return None
    qp = SparseQp()
    path = [qp.variables(low[k], high[k]) for k in range(n + 1)]
    stance, loads = gait.stance, []
    across = -float(problem.gravity_w[2])
    one, pair = np.ones((2, 1)), np.tile([-1.0, 1.0], (2, 1))
    for k in range(n + 1):
        qp.squares(path[k][:, None], one, goal, weights.position)
    for k in range(n):
        both = np.column_stack([path[k], path[k + 1]])
        qp.squares(both, pair, np.zeros(2), weights.velocity / dt**2)
        step = np.hstack([-np.eye(2), np.eye(2)])
        qp.below(np.vstack([step, -step]), both.T.ravel(), np.full(4, SPEED_SHARE * problem.body.max_speed_m_s * dt))
        on = np.flatnonzero(stance[k])
        load = qp.variables(np.full(len(on), LEAST_SHARE), np.ones(len(on)))
        qp.equal(np.ones((1, len(on))), load, np.ones(1))
        qp.squares(
            load[:, None], np.ones((len(on), 1)), np.zeros(len(on)), weights.wrench * (problem.mass_kg * across) ** 2
        )
        loads.append((on, load))
        _add_motion(qp, problem, path, k, feet[k, on], load, body[k, 2])
        if len(on) == 3:
            _add_true_balance(qp, problem, path[k], feet[k], on, load)
    solution = qp.solve()
    if solution is None:
        return None
    positions = solution[np.array(path)]
    shares = np.zeros((n, 4))
    for k, (on, load) in enumerate(loads):
        shares[k, on] = solution[load]
    speeds = np.diff(positions, axis=0) / dt
    cost = weights.position * float(((positions - goal) ** 2).sum()) + weights.velocity * float((speeds**2).sum())
    cost += weights.wrench * (problem.mass_kg * across) ** 2 * float((shares**2).sum())
    return Candidate(gait, footholds, positions, shares * problem.mass_kg * across, cost)


def _add_true_balance(
    qp: SparseQp, problem: WalkProblem, position: Indices, feet: Array, on: Indices, load: Indices
) -> None:
    """(8b) has the centre of mass at the body's origin; the true one is pulled towards the feet. A plan that leaves
    every foot some load in truth as well can be carried out: share = load + B (true centre of mass - r).
    """
    spread = np.linalg.inv(np.vstack([feet[on].T, np.ones(3)]))[:, :2]
    pull = problem.limbs_share
    away = spread @ (pull * (feet.sum(axis=0) - problem.neutral_feet_b_m.sum(axis=0)))
    qp.below(np.hstack([-np.eye(3), 4 * pull * spread]), np.concatenate([load, position]), away - TRUE_SHARE)


def _add_motion(
    qp: SparseQp, problem: WalkProblem, path: list[Indices], k: int, feet: Array, load: Indices, height: float
) -> None:
    """r'' = g + (g_n / z)(r - sum share p) along and across, from knot k on, as explicit Euler has it."""
    dt, gravity = problem.dt_s, problem.gravity_w
    pull = -float(gravity[2]) / height
    if k + 2 > problem.steps:
        return
    now, nxt, after = path[k], path[k + 1], path[k + 2]
    eye = np.eye(2)
    matrix = np.hstack([(1.0 - dt**2 * pull) * eye, -2.0 * eye, eye, dt**2 * pull * feet.T])
    qp.equal(matrix, np.concatenate([now, nxt, after, load]), dt**2 * gravity[:2])
