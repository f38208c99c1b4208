"""Quadratic programs, solved by PIQP.

PIQP calls some badly scaled programs infeasible that are not, and gives up on others. So where it finds no solution,
its multipliers have to show that there is none; where they do not, it is asked again with rows and columns scaled.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import piqp
import scipy.sparse as sp

from crux_planner.model.arrays import Array, Indices
from crux_planner.solvers.sparse_blocks import Entries, Rows

_REGULARISATION = 1e-8
_FREE = 1e29  # no bound
_ROUNDING = 1e-13  # of the terms of a sum
_SCALINGS, _AGAIN = 12, 200  # rounds of scaling, and iterations with a scaled program


@dataclass(frozen=True)
class QpSolution:
    """Where the solver ended, the multipliers there of the equations and of the rows (negative at a row's lower end),
    and whether it met its tolerances.
    """

    x: Array
    multipliers: Array
    of_rows: Array
    solved: bool


@dataclass(frozen=True)
class Constraints:
    """equal @ x = right, least <= rows @ x <= most, low <= x <= high; matrices may be sparse."""

    equal: Any
    right: Array
    rows: Any
    least: Array
    most: Array
    low: Array
    high: Array

    def shown_least(self, linear: Array, multipliers: Array, of_rows: Array) -> float:
        """A number below which linear . x is nowhere within the constraints: weak duality, which any multipliers of the
        equations and the rows give, rounding kept back. -inf where they show nothing.
        """
        y, z = np.nan_to_num(multipliers), np.nan_to_num(of_rows)
        slope = linear + self.equal.T @ y + self.rows.T @ z
        size = np.abs(linear) + abs(self.equal).T @ np.abs(y) + abs(self.rows).T @ np.abs(z)
        ends = np.where(slope >= 0.0, self.low, self.high)
        limits = np.where(z > 0.0, self.most, np.where(z < 0.0, self.least, 0.0))
        total = slope @ ends - self.right @ y - limits @ z
        farthest = np.where(size > 0.0, np.maximum(np.abs(self.low), np.abs(self.high)), 0.0)
        rounding = size @ farthest + np.abs(self.right) @ np.abs(y) + np.abs(limits) @ np.abs(z)
        shown = float(total - _ROUNDING * rounding)
        return shown if np.isfinite(shown) else -np.inf

    def shown_distance(self, matrix: Array, target: Array, found: QpSolution) -> float:
        """A number below which |target - matrix @ x| is nowhere within the constraints, by the multipliers of a QP that
        had half its square for cost: along one direction, weak duality.
        """
        way = target - matrix @ found.x
        size = float(np.linalg.norm(way))
        if size == 0.0:
            return 0.0
        way, of_equal, of_rows = (each / size for each in (way, found.multipliers, found.of_rows))
        return max(0.0, float(way @ target) + self.shown_least(-way @ matrix, of_equal, of_rows))

    def shown_empty(self, multipliers: Array, of_rows: Array) -> bool:
        """Whether these multipliers show that nothing is within the constraints (Farkas)."""
        size = float(np.abs(np.nan_to_num(np.concatenate([multipliers, of_rows, [0.0]]))).max())
        if size == 0.0:
            return bool((self.low > self.high).any())
        return self.shown_least(np.zeros(len(self.low)), multipliers / size, of_rows / size) > 0.0


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
        self._cost, self._linear, self._settings = cost, linear, settings
        self._equal: tuple[Any, Any] = equal or (None, None)
        self._kept: tuple[Any, Any, Any] = _bounded(*rows) if rows is not None else (None, None, None)
        self._low, self._high = low, high

    @property
    def constraints(self) -> Constraints:
        """All but what is minimised."""
        none = np.zeros((0, len(self._low))), np.zeros(0)
        equal, right = none if self._equal[0] is None else self._equal
        matrix, least, most = self._kept
        rows, most = none if matrix is None else (matrix, most)
        least = np.full(len(most), -np.inf) if least is None else least
        return Constraints(equal, right, rows, least, most, self._low, self._high)

    def solve(self) -> QpSolution:
        """The solution. Where it is not `solved`, the multipliers mostly show that there is none
        (`constraints.shown_empty`); else the work allowed for a sparse program was used up, or it failed twice.
        """
        is_sparse = sp.issparse(self._cost)
        program = (self._cost, self._linear, *self._equal, *self._kept, self._low, self._high)
        status, found = _solved(piqp.SparseSolver() if is_sparse else piqp.DenseSolver(), program, self._settings)
        if found.solved or (is_sparse and status == piqp.PIQP_MAX_ITER_REACHED):
            return found
        constraints = self.constraints
        return found if constraints.shown_empty(found.multipliers, found.of_rows) else self._scaled(constraints)

    def _scaled(self, given: Constraints) -> QpSolution:
        """The same with columns of x, rows and cost scaled to the size of one."""
        matrix = sp.csr_matrix(sp.vstack([sp.csr_matrix(given.equal), sp.csr_matrix(given.rows)]))
        column = np.ones(matrix.shape[1])
        for _ in range(_SCALINGS):
            row = 1.0 / _nonzero(abs(matrix @ sp.diags(column)).max(axis=1).toarray().ravel())
            column /= np.sqrt(_nonzero(abs(sp.diags(row) @ matrix @ sp.diags(column)).max(axis=0).toarray().ravel()))
        matrix = matrix @ sp.diags(column)
        row = 1.0 / _nonzero(np.sqrt(np.asarray(matrix.multiply(matrix).sum(axis=1)).ravel()))
        matrix, equations = sp.csc_matrix(sp.diags(row) @ matrix), len(given.right)
        cost = sp.csc_matrix(sp.diags(column) @ sp.csr_matrix(self._cost) @ sp.diags(column))
        unit = 1.0 / float(_nonzero(np.array([abs(cost).max()]))[0])
        least, most = (_times(row[equations:], ends) for ends in (given.least, given.most))
        ends = (_times(1.0 / column, each) for each in (given.low, given.high))
        equal = (matrix[:equations], row[:equations] * given.right) if equations else (None, None)
        rows = (matrix[equations:], least, most) if len(most) else (None, None, None)
        settings = {**self._settings, "max_iter": _AGAIN}
        program = (unit * cost, unit * column * self._linear, *equal, *rows, *ends)
        _, found = _solved(piqp.SparseSolver(), program, settings)
        of_equal, of_rows = row[:equations] * found.multipliers / unit, row[equations:] * found.of_rows / unit
        return QpSolution(column * found.x, of_equal, of_rows, found.solved)


def _solved(solver: Any, program: tuple[Any, ...], settings: dict[str, float]) -> tuple[Any, QpSolution]:
    """PIQP's status and what it found."""
    for name, value in {"verbose": False, **settings}.items():
        setattr(solver.settings, name, value)
    solver.setup(*program)
    status, result = solver.solve(), solver.result
    of_rows = np.maximum(result.z_u, 0.0) - np.maximum(result.z_l, 0.0)
    return status, QpSolution(np.array(result.x), np.array(result.y), of_rows, status == piqp.PIQP_SOLVED)


def _nonzero(sizes: Array) -> Array:
    return np.where(sizes > 0.0, sizes, 1.0)


def _times(scale: Array, ends: Array) -> Array:
    """Bounds scaled, those that are none left as they are."""
    return np.where(np.abs(ends) < _FREE, scale * ends, ends)


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
        """The solution, or None where none was found."""
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
