"""The body's places at the nodes of a sequence of moves: a convex program over a chain of places, at each of which the
grips on a node's contacts carry the body in static balance.

The compiled solver of solvers.path answers where it converges; that there is no path is PIQP's word.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise

import numpy as np

from crux_planner.model.arrays import Array, Indices
from crux_planner.model.problem import Problem
from crux_planner.model.workspace import Reach
from crux_planner.physics.bounds import LEAST_NORMAL_N
from crux_planner.physics.limit_surface import grip_rows, polytope_directions
from crux_planner.search.body_path import within
from crux_planner.search.equilibrium import FORCE_BOUND_N, TWIST_BOUND_NM, StaticEquilibrium
from crux_planner.solvers.path import Grip, Grips, PathProblem, least_cost
from crux_planner.solvers.qp import Block, SparseQp
from crux_planner.solvers.sparse_blocks import block_diagonal

_CONE_SHARE = 0.97  # of the polytope that touches the cone (2) from outside: on average as large as the cone
_LEVEL = np.eye(3)
_DIFFERENCE = Block(np.hstack([-np.eye(3), np.eye(3)]))
_BOTH_WAYS = Block(np.vstack([np.hstack([-np.eye(3), np.eye(3)]), np.hstack([np.eye(3), -np.eye(3)])]))
_MINUS_PLUS = np.tile([-1.0, 1.0], (3, 1))
_WRENCH = 6  # QP variables a gripper: s1, s2, m, F = n1 - n2, their mean a, the smaller n


@dataclass(frozen=True)
class Node:
    """The body at a knot, within bounds; on swings the grippers of `support` carry it, there for `share` knots of J.

    What `what` says is the same makes the same bounds, support and share.
    """

    what: tuple[object, ...]
    knot: int
    low: Array
    high: Array
    support: tuple[int, ...] = ()
    share: float = 0.0
    grippers: tuple[int, ...] = ()  # contacts in the middle of which they are


@dataclass(frozen=True)
class _Together:
    """Of the grippers' q on some contacts: bounds, limits @ q <= right, balance @ (q, body's place)."""

    low: Array
    high: Array
    limits: Block
    right: Array
    balance: Block


class EventPath:
    """Paths of one problem; what belongs to contacts is kept."""

    def __init__(self, problem: Problem, equilibrium: StaticEquilibrium, shape: Reach, step_m: float) -> None:
        self.problem, self.equilibrium, self.shape, self.step_m = problem, equilibrium, shape, step_m
        self._effort = np.array([2.0, 2.0, 2.0 / problem.patch.k_m**2, 0.5, 2.0, 0.0])
        self._directions, _ = polytope_directions(problem.patch.k_m)
        unit = self._directions * np.array([1.0, 1.0, problem.patch.k_m])
        self._load = _CONE_SHARE * equilibrium.margin * np.linalg.norm(unit, axis=1)
        self._grips = Grips(self._grip)
        self._together: dict[tuple[int, ...], _Together] = {}
        self._body, _ = equilibrium.weight(np.zeros(3))
        self._weights: dict[tuple[int, ...], Array] = {}

    def solve(self, nodes: list[Node], fixed: list[Array], free: slice) -> tuple[Array, Array] | None:
        """Places of the nodes in `free` and what carrying the body there takes, the body at `fixed` at those beside
        them; None where there is no path.
        """
        return self._compiled(nodes, fixed, free) or self._by_piqp(nodes, fixed, free)

    def stance_effort(self, low: Array, high: Array, stance: tuple[int, ...]) -> float:
        """R-term of one knot on `stance`, the body where it is least between bounds; inf where it has no place."""
        node = Node((), 0, low, np.maximum(low, high), stance, 1.0, stance)
        found = self._compiled([node], [], slice(0, 1))
        if found is not None:
            return self.problem.weights.wrench * float(found[1][0])
        qp = SparseQp()
        self._carry(qp, within(qp, self.shape, node.low, node.high, _LEVEL), node)
        solution = qp.solve()
        return np.inf if solution is None else qp.value(solution)

    def _compiled(self, nodes: list[Node], fixed: list[Array], free: slice) -> tuple[Array, Array] | None:
        weights, count = self.problem.weights, np.diff([node.knot for node in nodes])
        low, high = np.full((2, len(nodes), len(self.shape.directions)), np.inf)
        low *= -1.0
        for i, node in enumerate(nodes):  # some have bounds along the axes alone
            low[i, : len(node.low)], high[i, : len(node.low)] = node.low, node.high
        on = [self._grips.numbers(node.support) for node in nodes]
        for i, at in zip((0, -1), (fixed[0], fixed[-1]) if fixed else (), strict=False):
            if not free.start <= i % len(nodes) < free.stop:
                low[i], high[i], on[i] = -np.inf, np.inf, []
                low[i, :3] = high[i, :3] = at
        moves = count > 0
        given = PathProblem(
            directions=self.shape.directions,
            low=low,
            high=np.maximum(low, high),
            target=self.problem.goal.body.position_m,
            pull=weights.position / 2 * (np.append(count, 0) + np.append(0, count)),
            speed=np.where(moves, weights.velocity / (np.maximum(count, 1) * self.problem.dt_s**2), 0.0),
            step=self.step_m * count,
            carried=np.array([weights.wrench * node.share for node in nodes]),
            body=np.broadcast_to(self._body, (len(nodes), *self._body.shape)),
            weight=np.array([self._weight(node.grippers) for node in nodes]),
            on=on,
        )
        found = least_cost(self._grips, given)
        if found is None:
            return None
        places, q = found
        efforts, each = np.zeros(len(nodes)), q**2 @ self._effort
        np.add.at(efforts, np.repeat(np.arange(len(nodes)), [len(grips) for grips in on]), each)
        return places[free], efforts[free]

    def _weight(self, grippers: tuple[int, ...]) -> Array:
        """What balance comes to with grippers on these contacts; nothing where there are none."""
        if grippers not in self._weights:
            mean = self.equilibrium.mean_place(grippers) if grippers else np.zeros(3)
            self._weights[grippers] = self.equilibrium.weight(mean)[1]
        return self._weights[grippers]

    def _grip(self, contact: int) -> Grip:
        bound = np.array([FORCE_BOUND_N, FORCE_BOUND_N, TWIST_BOUND_NM, FORCE_BOUND_N, FORCE_BOUND_N, FORCE_BOUND_N])
        surfaces, press_N = self.equilibrium.limits[contact], self.equilibrium.press_N[contact]
        rows_of_grip, right_of_grip = grip_rows(surfaces, self._directions, self._load, press_N)
        count = len(self._load) * len(surfaces)
        rows = np.zeros((count + 4, _WRENCH))
        rows[:count, [0, 1, 2, 3, 5 if len(surfaces) == 1 else 4]] = rows_of_grip[:count]
        foot = self.problem.contacts[contact].foot
        if foot:  # its two pads press together, by what is across the axis, and squeeze nothing
            rows[count:, 1] = [-2.0, -2.0, 2.0, 2.0]
        else:
            rows[count:, 3:] = [[0.5, -1.0, 1.0], [-0.5, -1.0, 1.0], [0.5, 1.0, 0.0], [-0.5, 1.0, 0.0]]
        right = np.concatenate([right_of_grip[:count], [0.0, 0.0], press_N])
        least = LEAST_NORMAL_N if self.problem.contacts[contact].may_press.all() and not foot else 0.0
        low = np.concatenate([-bound[:4], [0.0, least]])
        return Grip(rows, right, low, bound, np.pad(self.equilibrium.maps[contact], ((0, 0), (0, 2))), self._effort)

    def _by_piqp(self, nodes: list[Node], fixed: list[Array], free: slice) -> tuple[Array, Array] | None:
        qp = SparseQp()
        places: list[Indices] = []
        grips: list[Indices] = []
        for i, node in enumerate(nodes):
            if free.start <= i < free.stop:
                places.append(within(qp, self.shape, node.low, np.maximum(node.low, node.high), _LEVEL))
                grips.append(self._carry(qp, places[-1], node))
            else:
                at = fixed[0 if i < free.start else -1]
                places.append(qp.variables(at, at))
        self._move_body(qp, [node.knot for node in nodes], places)
        solution = qp.solve()
        if solution is None:
            return None
        efforts = [float((solution[grip].reshape(-1, _WRENCH) ** 2 @ self._effort).sum()) for grip in grips]
        return solution[np.array(places[free])], np.array(efforts)

    def _carry(self, qp: SparseQp, place: Indices, node: Node) -> Indices:
        """Balance at a body place on a node's contacts and its R-term; the numbers of the grippers' q."""
        support = node.support
        if not support:
            return np.zeros(0, dtype=int)
        if support not in self._together:
            self._together[support] = self._gripped(support)
        grips = self._together[support]
        index = qp.variables(grips.low, grips.high)
        qp.below(grips.limits, index, grips.right)
        effort = np.sqrt(np.tile(self._effort, len(support)))
        qp.squares(index[:, None], effort[:, None], np.zeros(len(index)), self.problem.weights.wrench * node.share)
        qp.equal(grips.balance, np.concatenate([index, place]), self._weight(node.grippers))
        return index

    def _gripped(self, support: tuple[int, ...]) -> _Together:
        each = [self._grip(contact) for contact in support]
        low, high, right = (np.concatenate([getattr(grip, part) for grip in each]) for part in ("low", "high", "right"))
        limits, balance = block_diagonal([grip.limits for grip in each]), [grip.map for grip in each]
        return _Together(low, high, Block(limits), right, Block(np.hstack([*balance, self._body])))

    def _move_body(self, qp: SparseQp, knots: list[int], body: list[Indices]) -> None:
        """Q-terms of positions and velocities between the nodes, and the body's speed."""
        weights, goal, dt = self.problem.weights, self.problem.goal.body.position_m, self.problem.dt_s
        for (now, a), (then, b) in pairwise(zip(knots, body, strict=True)):
            count, both = then - now, np.concatenate([a, b])
            if count == 0:
                qp.equal(_DIFFERENCE, both, np.zeros(3))
                continue
            qp.squares(both[:, None], np.ones((6, 1)), np.tile(goal, 2), weights.position * count / 2)
            speed = weights.velocity / (count * dt**2)
            qp.squares(both.reshape(2, 3).T, _MINUS_PLUS, np.zeros(3), speed)
            qp.below(_BOTH_WAYS, both, np.full(6, count * self.step_m))
