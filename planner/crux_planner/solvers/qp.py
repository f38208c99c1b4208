"""Quadratic programs, solved by PIQP."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import piqp
import scipy.sparse as sp

from crux_planner.model.arrays import Array, Indices

_REGULARISATION = 1e-8
_FREE = 1e29  # no bound


@dataclass(frozen=True)
class QpSolution:
    """Where the solver ended, the multipliers of the equations there, and whether it met its tolerances."""

    x: Array
    multipliers: Array
    solved: bool


class Qp:
    """min x' cost x / 2 + linear' x with equal = (A, b): A x = b; rows = (G, l, u): l <= G x <= u; low <= x <= high.

    Matrices are sparse if `cost` is; `settings` are those of PIQP's that are not as usual.
    """

    def __init__(
        self,
        cost: Any,
        linear: Array,
        equal: tuple[Any, Array] | None,
        rows: tuple[Any, Array | None, Array] | None,
        low: Array,
        high: Array,
        **settings: float,
    ) -> None:
        self._solver = piqp.SparseSolver() if sp.issparse(cost) else piqp.DenseSolver()
        for name, value in {"verbose": False, **settings}.items():
            setattr(self._solver.settings, name, value)
        kept = _bounded(*rows) if rows is not None else (None, None, None)
        self._solver.setup(cost, linear, *(equal or (None, None)), *kept, low, high)

    def solve(self, linear: Array | None = None) -> QpSolution:
        """The solution, with another linear term if one is given."""
        if linear is not None:
            self._solver.update(c=linear)
        solved = self._solver.solve() == piqp.PIQP_SOLVED
        return QpSolution(np.array(self._solver.result.x), np.array(self._solver.result.y), solved)


def _bounded(matrix: Any, least: Array | None, most: Array) -> tuple[Any, Array | None, Array]:
    """The rows that ask for something: of others PIQP says on standard output that it leaves them out."""
    asks = most < _FREE if least is None else (most < _FREE) | (least > -_FREE)
    return (matrix, least, most) if asks.all() else (matrix[asks], None if least is None else least[asks], most[asks])


class Entries:
    """What is not zero of rows that are used again."""

    def __init__(self, matrix: Array) -> None:
        self.rows, self.columns = np.nonzero(matrix)
        self.values, self.count = matrix[self.rows, self.columns], len(matrix)


class SparseQp:
    """A sparse QP put together piece by piece: min sum of weighted squares, subject to bounds and linear rows.

    Variables are numbered as they are added.
    """

    def __init__(self) -> None:
        self._low: list[Array] = []
        self._high: list[Array] = []
        self.size = 0
        self._cost: list[
            tuple[Indices, Array, Array]
        ] = []  # rows of sqrt-weighted squares: columns, coefficients, targets
        self._equal = _Rows()
        self._below = _Rows()

    def variables(self, low: Array, high: Array) -> Indices:
        """Add variables with bounds; returns their numbers."""
        index = np.arange(self.size, self.size + len(low))
        self._low.append(np.asarray(low, dtype=float))
        self._high.append(np.asarray(high, dtype=float))
        self.size += len(low)
        return index

    def squares(self, columns: Indices, coefficients: Array, target: Array, weight: float) -> None:
        """Add weight * |sum_j coefficients[:, j] x[columns[:, j]] - target|^2; shapes (n, terms), (n, terms), (n,)."""
        root = np.sqrt(weight)
        self._cost.append(
            (np.asarray(columns), root * np.asarray(coefficients, dtype=float), root * np.asarray(target))
        )

    def equal(self, matrix: Array | Entries, columns: Indices, right: Array) -> None:
        """matrix @ x[columns] = right."""
        self._equal.add(matrix, columns, right)

    def below(self, matrix: Array | Entries, columns: Indices, right: Array) -> None:
        """matrix @ x[columns] <= right."""
        self._below.add(matrix, columns, right)

    def value(self, x: Array) -> float:
        """The weighted squares at x."""
        return float(sum((((c * x[i]).sum(axis=1) - t) ** 2).sum() for i, c, t in self._cost))

    def solve(self) -> Array | None:
        """The solution, or None where the constraints leave none."""
        diagonal = np.arange(self.size)
        rows: list[Indices] = [diagonal]
        columns: list[Indices] = [diagonal]
        values, linear = [np.full(self.size, _REGULARISATION)], np.zeros(self.size)
        for cols, coefficients, target in self._cost:
            terms = cols.shape[1]
            rows.append(np.repeat(cols, terms, axis=1).ravel())
            columns.append(np.tile(cols, terms).ravel())
            values.append(2.0 * (coefficients[:, :, None] * coefficients[:, None]).ravel())
            np.add.at(linear, cols, -2.0 * coefficients * target[:, None])
        where = (np.concatenate(rows), np.concatenate(columns))
        hessian = sp.csc_matrix((np.concatenate(values), where), (self.size, self.size))
        (equal, right), (below, most) = self._equal.matrix(self.size), self._below.matrix(self.size)
        low, high = np.concatenate(self._low), np.concatenate(self._high)
        settings = {"eps_abs": 1e-6, "eps_rel": 1e-7, "max_iter": 80}
        found = Qp(hessian, linear, (equal, right), (below, None, most), low, high, **settings).solve()
        return found.x if found.solved else None


class _Rows:
    def __init__(self) -> None:
        self._parts: list[tuple[Indices, Indices, Array]] = []
        self._right: list[Array] = []
        self._count = 0

    def add(self, matrix: Array | Entries, columns: Indices, right: Array) -> None:
        entries = matrix if isinstance(matrix, Entries) else Entries(matrix)
        self._parts.append((self._count + entries.rows, np.asarray(columns)[entries.columns], entries.values))
        self._right.append(np.asarray(right, dtype=float))
        self._count += entries.count

    def matrix(self, size: int) -> tuple[sp.csc_matrix, Array]:
        if not self._parts:
            return sp.csc_matrix((0, size)), np.zeros(0)
        rows, columns, values = (np.concatenate([p[i] for p in self._parts]) for i in range(3))
        return sp.csc_matrix((values, (rows, columns)), (self._count, size)), np.concatenate(self._right)
