"""A sparse quadratic program put together piece by piece, solved by PIQP."""

from __future__ import annotations

import numpy as np
import piqp
import scipy.sparse as sp

from crux_planner.model.arrays import Array, Indices

_REGULARISATION = 1e-8


class SparseQp:
    """min sum of weighted squares, subject to bounds and linear rows; variables are numbered as they are added."""

    def __init__(self) -> None:
        self._low: list[Array] = []
        self._high: list[Array] = []
        self.size = 0
        self._cost: list[
            tuple[Array, Array, Array]
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

    def equal(self, matrix: Array, columns: Indices, right: Array) -> None:
        """matrix @ x[columns] = right."""
        self._equal.add(matrix, columns, right)

    def below(self, matrix: Array, columns: Indices, right: Array) -> None:
        """matrix @ x[columns] <= right."""
        self._below.add(matrix, columns, right)

    def value(self, x: Array) -> float:
        """The weighted squares at x."""
        return float(sum((((c * x[i]).sum(axis=1) - t) ** 2).sum() for i, c, t in self._cost))

    def solve(self) -> Array | None:
        """The solution, or None where the constraints leave none."""
        rows, columns, values, targets, start = [], [], [], [], 0
        for cols, coefficients, target in self._cost:
            n, terms = cols.shape
            rows.append(np.repeat(np.arange(start, start + n), terms))
            columns.append(cols.ravel())
            values.append(coefficients.ravel())
            targets.append(target)
            start += n
        factor = sp.csc_matrix(
            (np.concatenate(values), (np.concatenate(rows), np.concatenate(columns))), (start, self.size)
        )
        hessian = (2 * factor.T @ factor + _REGULARISATION * sp.eye(self.size)).tocsc()
        linear = -2 * factor.T @ np.concatenate(targets)
        solver = piqp.SparseSolver()
        solver.settings.verbose = False
        solver.settings.eps_abs = 1e-6
        solver.settings.eps_rel = 1e-7
        solver.settings.max_iter = 80
        solver.setup(
            hessian,
            linear,
            *self._equal.matrix(self.size),
            self._below.matrix(self.size)[0],
            None,
            self._below.matrix(self.size)[1],
            np.concatenate(self._low),
            np.concatenate(self._high),
        )
        return np.array(solver.result.x) if solver.solve() == piqp.PIQP_SOLVED else None


class _Rows:
    def __init__(self) -> None:
        self._parts: list[tuple[Indices, Indices, Array]] = []
        self._right: list[Array] = []
        self._count = 0

    def add(self, matrix: Array, columns: Indices, right: Array) -> None:
        rows, cols = np.nonzero(matrix)
        self._parts.append((self._count + rows, np.asarray(columns)[cols], matrix[rows, cols]))
        self._right.append(np.asarray(right, dtype=float))
        self._count += len(matrix)

    def matrix(self, size: int) -> tuple[sp.csc_matrix, Array]:
        rows, columns, values = (np.concatenate([p[i] for p in self._parts]) for i in range(3))
        return sp.csc_matrix((values, (rows, columns)), (self._count, size)), np.concatenate(self._right)
