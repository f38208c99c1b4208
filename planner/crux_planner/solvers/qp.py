"""Quadratic programs, solved by PIQP."""

from dataclasses import dataclass
from typing import Any

import numpy as np
import piqp
import scipy.sparse as sp

from crux_planner.model.arrays import Array, Indices
from crux_planner.solvers.sparse_blocks import Entries, Rows

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

    def solve(self) -> QpSolution:
        """The solution."""
        solved = self._solver.solve() == piqp.PIQP_SOLVED
        return QpSolution(np.array(self._solver.result.x), np.array(self._solver.result.y), solved)


def _bounded(matrix: Any, least: Array | None, most: Array) -> tuple[Any, Array | None, Array]:
    """The rows that ask for something: of others PIQP says on standard output that it leaves them out."""
    asks = most < _FREE if least is None else (most < _FREE) | (least > -_FREE)
    return (matrix, least, most) if asks.all() else (matrix[asks], None if least is None else least[asks], most[asks])


class Block:
    """What is not zero of rows that are used again."""

    def __init__(self, matrix: Array) -> None:
        self.rows, self.columns = np.nonzero(matrix)
        self.values, self.count = matrix[self.rows, self.columns], len(matrix)


class SparseQp:
    """A sparse QP put together piece by piece: least weighted squares in bounds and linear rows; variables in order."""

    def __init__(self) -> None:
        self._low: list[Array] = []
        self._high: list[Array] = []
        self.size = 0
        self._cost: list[tuple[Indices, Array, Array]] = []  # sqrt-weighted squares: columns, coefficients, targets
        self._equal, self._below = Rows(), Rows()

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
        terms = root * np.asarray(coefficients, dtype=float), root * np.asarray(target)
        self._cost.append((np.asarray(columns), *terms))

    def equal(self, matrix: Array | Block, columns: Indices, right: Array) -> None:
        """matrix @ x[columns] = right."""
        self._add(self._equal, matrix, columns, right)

    def below(self, matrix: Array | Block, columns: Indices, right: Array) -> None:
        """matrix @ x[columns] <= right."""
        self._add(self._below, matrix, columns, right)

    def _add(self, rows: Rows, matrix: Array | Block, columns: Indices, right: Array) -> None:
        block = matrix if isinstance(matrix, Block) else Block(matrix)
        rows.entries(block.rows, columns[block.columns], block.values)
        rows.close(-np.inf, right)

    def value(self, x: Array) -> float:
        """The weighted squares at x."""
        return float(sum((((c * x[i]).sum(axis=1) - t) ** 2).sum() for i, c, t in self._cost))

    def solve(self) -> Array | None:
        """The solution, or None where the constraints leave none."""
        hessian, linear, diagonal = Entries(), np.zeros(self.size), np.arange(self.size)
        hessian.entries(diagonal, diagonal, np.full(self.size, _REGULARISATION))
        for cols, coefficients, target in self._cost:
            terms = cols.shape[1]
            products = 2.0 * (coefficients[:, :, None] * coefficients[:, None])
            hessian.entries(np.repeat(cols, terms, axis=1).ravel(), np.tile(cols, terms).ravel(), products.ravel())
            np.add.at(linear, cols, -2.0 * coefficients * target[:, None])
        cost = hessian.matrix((self.size, self.size), zeros=True).tocsc()
        (equal, _, right), (below, _, most) = self._equal.all(self.size), self._below.all(self.size)
        low, high = np.concatenate(self._low), np.concatenate(self._high)
        settings = {"eps_abs": 1e-6, "eps_rel": 1e-7, "max_iter": 80}
        found = Qp(cost, linear, (equal, right), (below, None, most), low, high, **settings).solve()
        return found.x if found.solved else None
