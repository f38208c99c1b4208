"""Static balance on a set of grasps: is there a body position within bounds, and a wrench for every gripper?

The oracle of the search, of what physics.static_balance has. Least-norm wrenches, one product with a stored matrix,
settle most queries; a small QP settles the rest.
"""

from typing import Any, NamedTuple

import numpy as np

from crux_planner.model.arrays import Array
from crux_planner.model.problem import Problem
from crux_planner.physics.limit_surface import grip_rows
from crux_planner.physics.static_balance import StaticBalance
from crux_planner.solvers.qp import Qp
from crux_planner.solvers.sparse_blocks import block_diagonal, skews

_SETTINGS = {"eps_abs": 1e-6, "max_iter": 60}  # of PIQP
WRENCH = 5  # QP variables a gripper: w and its squeeze n, see physics.limit_surface
FORCE_BOUND_N, TWIST_BOUND_NM = 500.0, 20.0  # beyond any limit surface; they only keep the QPs compact
MOMENT_ARM_M = 0.3  # weighs moments against forces where both are one residual
_POSITION_WEIGHT, _WRENCH_WEIGHT = 1.0, 1e-7  # in a query the position wanted comes first


def clipped(position: Array, low: Array, high: Array) -> Array:
    """The position moved into bounds (m,) as far as these are along x, y and z."""
    return np.asarray(np.clip(position, low[:3], high[:3]))


class Query(NamedTuple):
    """A body position in [low, high] near `wanted` on the contacts `support`, its grippers on `grippers`."""

    support: tuple[int, ...]
    low: Array
    high: Array
    wanted: Array
    grippers: tuple[int, ...]

    @property
    def key(self) -> tuple[Any, ...]:
        """The same for queries that are the same but for rounding."""
        return self.support, self.grippers, np.round(np.concatenate(self[1:4]), 4).tobytes()


class StaticEquilibrium(StaticBalance):
    """Balance queries of one problem; contacts are indices into `problem.contacts`."""

    def __init__(self, problem: Problem, margin: float) -> None:
        super().__init__(problem, margin)
        # Twists count as the forces at the patch's rim that make them.
        self.effort = np.array([2.0, 2.0, 2.0 / problem.patch.k_m, 1.0])
        self._least_norm: dict[tuple[int, ...], Array] = {}
        self._known: dict[tuple[Any, ...], Array | None] = {}
        self._rows: dict[int, tuple[Array, Array]] = {}

    def position(
        self, support: tuple[int, ...], low: Array, high: Array, wanted: Array, grippers: tuple[int, ...] | None = None
    ) -> Array | None:
        """A body position near `wanted`, in balance on the contacts `support`; None if none was found.

        The grippers' mean place is that of the contacts `grippers`, or of `support` where it is all. Bounds are
        along the directions of the problem's reach, or as many of these as are given, x, y and z first.
        """
        return self._find(Query(tuple(sorted(self.bearing(support))), low, high, wanted, grippers or support))

    def _find(self, query: Query) -> Array | None:
        if (key := query.key) not in self._known:
            low, high = query.low, query.high
            near = clipped(query.wanted, low, high)
            along = self.problem.boxes.directions[3 : len(low)] @ near
            inside = (along >= low[3:]).all() and (along <= high[3:]).all()
            settled = inside and self._least_norm_fits(query.support, near, query.grippers)
            self._known[key] = near if settled else self._solve(query)
        return self._known[key]

    def bearing(self, support: tuple[int, ...]) -> tuple[int, ...]:
        """Those of the contacts that are grasps."""
        return tuple(c for c in support if self.problem.contacts[c].bears)

    def right_side(self, position: Array, grippers: Array) -> Array:
        """What the grippers' forces and moments about the origin must sum to, (6,), their mean place `grippers`."""
        body, right = self.weight(grippers)
        return right - body @ position

    def limit_rows(self, contact: int) -> tuple[Array, Array]:
        """(A, b), A @ (s1, s2, m, F, n) <= b: limit surface and largest normal force, at the margin."""
        if contact not in self._rows:
            limits, reach = self.limits[contact], self.margin * self.reach
            foot = self.problem.contacts[contact].foot
            self._rows[contact] = grip_rows(limits, self.directions, reach, self.press_N[contact], foot)
        return self._rows[contact]

    def missing_force(
        self, support: tuple[int, ...], low: Array, high: Array, grippers: tuple[int, ...] | None = None
    ) -> float:
        """Force [N] that balance lacks at least for body positions in [low, high], as multipliers show it; inf where
        nothing was found. `grippers` as in `position`.

        Moments count over `MOMENT_ARM_M`, about the middle of the contacts.
        """
        support, grippers = self.bearing(support), grippers or support
        n = 3 + WRENCH * len(support)
        limits, bounds, wrench_low, wrench_high = self._limits(support)
        rows = np.hstack([np.zeros((len(limits), 3)), limits])
        low, high = np.concatenate([low[:3], wrench_low]), np.concatenate([high[:3], wrench_high])
        middle = np.mean([self.problem.contacts[c].centre_h_m for c in support], axis=0)
        about_middle = np.block([[np.eye(3), np.zeros((3, 3))], [-skews(middle), np.eye(3)]])
        about_middle[3:] /= MOMENT_ARM_M
        matrix, right = self._balance(support, grippers)
        weighted, target = about_middle @ matrix, about_middle @ right
        cost = weighted.T @ weighted + 1e-9 * np.eye(n)
        qp = Qp(cost, -weighted.T @ target, None, (rows, None, bounds), low, high, **_SETTINGS)
        found = qp.solve()
        return qp.constraints.shown_distance(weighted, target, found) if found.solved else float("inf")

    def least_norm(self, support: tuple[int, ...]) -> Array:
        """(4 m, 6): times what they must sum to, the wrenches of least effort of the m grasps of a support."""
        support = self.bearing(support)
        if support not in self._least_norm:
            effort = np.tile(self.effort, len(support))
            self._least_norm[support] = np.linalg.pinv(self._joined(support) / effort) / effort[:, None]
        return self._least_norm[support]

    def _least_norm_fits(self, support: tuple[int, ...], position: Array, grippers: tuple[int, ...]) -> bool:
        index = list(support)
        if any(self.problem.contacts[c].leans for c in index):
            return False  # pads on leaning faces have limits that their squeeze moves
        right = self.right_side(position, self.mean_place(grippers))
        wrench = (self.least_norm(support) @ right).reshape(-1, 4)
        residual = self._joined(support) @ wrench.ravel() - right
        excess = (wrench[:, :3] @ self.directions.T)[:, None] - self.spine[index]
        normal = np.where(excess > 0, excess / np.maximum(self.load[index], 1e-12), 0.0).max(axis=2)
        press = np.maximum(normal, normal[:, ::-1] + wrench[:, 3:] * np.array([1.0, -1.0]))
        return bool(np.abs(residual).max() < 1e-6 and (press <= self.press_N[index]).all())

    def _joined(self, support: tuple[int, ...]) -> Array:
        return np.concatenate(self.maps[list(support)], axis=1)

    def _balance(self, support: tuple[int, ...], grippers: tuple[int, ...]) -> tuple[Array, Array]:
        """(6, 3 + 5 m) of (body position, wrenches) and (6,) what they come to in balance."""
        matrix = np.zeros((6, 3 + WRENCH * len(support)))
        matrix[:, :3], right = self.weight(self.mean_place(grippers))
        for i, c in enumerate(support):
            matrix[:, 3 + WRENCH * i : 7 + WRENCH * i] = self.maps[c]
        return matrix, right

    def _limits(self, support: tuple[int, ...]) -> tuple[Array, Array, Array, Array]:
        """Limit rows and bounds of the wrenches of all grippers in `support`."""
        parts = [self.limit_rows(c) for c in support]
        rows = block_diagonal([a for a, _ in parts])
        high = np.tile([FORCE_BOUND_N, FORCE_BOUND_N, TWIST_BOUND_NM, FORCE_BOUND_N, FORCE_BOUND_N], len(support))
        low = -high
        low[4::WRENCH] = 0.0
        return rows, np.concatenate([b for _, b in parts]), low, high

    def _solve(self, query: Query, further: tuple[Array, Array] | None = None) -> Array | None:
        """A body position in balance near that wanted; `further` are rows (A, b) on (position, wrenches), A x <= b."""
        support, low, high, wanted, grippers = query
        n = WRENCH * len(support)
        limits, bounds, wrench_low, wrench_high = self._limits(support)
        effort = np.tile(_WRENCH_WEIGHT * np.append(self.effort, 1.0) ** 2, len(support))
        cost = np.concatenate([np.full(3, _POSITION_WEIGHT), effort])
        linear = np.concatenate([-_POSITION_WEIGHT * wanted, np.zeros(n)])
        rows = np.hstack([np.zeros((len(limits), 3)), limits])
        if further is not None:
            rows, bounds = np.vstack([rows, further[0]]), np.concatenate([bounds, further[1]])
        if len(low) > 3:
            oblique = np.zeros((len(low) - 3, rows.shape[1]))
            oblique[:, :3] = self.problem.boxes.directions[3 : len(low)]
            rows, bounds = np.vstack([rows, oblique, -oblique]), np.concatenate([bounds, high[3:], -low[3:]])
        lows, highs = np.concatenate([low[:3], wrench_low]), np.concatenate([high[:3], wrench_high])
        qp = Qp(np.diag(cost), linear, self._balance(support, grippers), (rows, None, bounds), lows, highs, **_SETTINGS)
        found = qp.solve()
        return clipped(found.x[:3], low, high) if found.solved else None
