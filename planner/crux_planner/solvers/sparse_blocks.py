"""Sparse matrices put together block by block, and products with cross-product matrices, many at a time."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
import scipy.sparse as sp

from crux_planner.model.arrays import Array, Indices

_INFINITE = 1e30  # as PIQP has it
_NOTHING = np.zeros(0, dtype=int), np.zeros(0, dtype=int), np.zeros(0)


class Entries:
    """Entries of a sparse matrix, gathered block by block: those of others first, rows counted from `count` on."""

    def __init__(self, *others: Entries) -> None:
        self.count = 0
        self._parts: list[tuple[Indices, Indices, Array]] = [part for other in others for part in other._parts]

    def entries(self, rows: Indices, columns: Indices, values: Array) -> None:
        self._parts.append((self.count + rows, columns, values))

    def blocks(self, rows: Indices, columns: Indices, values: Array) -> None:
        """Blocks (n, a, b) with their first rows and columns (n,)."""
        a, b = values.shape[1:]
        shape = (len(rows), a, b)
        row = np.broadcast_to(rows[:, None, None] + np.arange(a)[:, None], shape)
        column = np.broadcast_to(columns[:, None, None] + np.arange(b), shape)
        self.entries(row.ravel(), column.ravel(), values.ravel())

    def dense(self, row: int, columns: Indices, values: Array) -> None:
        """One block from `row` on, its columns anywhere."""
        a, b = values.shape
        rows = np.repeat(row + np.arange(a), b)
        self.entries(rows, np.tile(columns, a), values.ravel())

    def matrix(self, shape: tuple[int, int], *, zeros: bool = False) -> sp.coo_matrix:
        """The sum of all entries; with `zeros`, those that are 0 stay part of its pattern."""
        parts = [_NOTHING, *self._parts]
        rows, columns, values = (np.concatenate([part[i] for part in parts]) for i in range(3))
        solid = np.full(values.shape, True) if zeros else values != 0.0
        return sp.coo_matrix((values[solid], (rows[solid], columns[solid])), shape)


class Rows(Entries):
    """low <= matrix @ x <= high, gathered group by group: `close` ends one, whose rows are numbered from 0."""

    def __init__(self) -> None:
        super().__init__()
        self._low: list[Array] = []
        self._high: list[Array] = []

    def close(self, low: Array | float, high: Array | float, rows: int | None = None) -> None:
        """End a group with its bounds, numbers for as many `rows`."""
        shape = (len(np.atleast_1d(high)) if rows is None else rows,)
        self._low.append(np.broadcast_to(low, shape))
        self._high.append(np.broadcast_to(high, shape))
        self.count += shape[0]

    def all(self, size: int, *, zeros: bool = False) -> tuple[sp.csc_matrix, Array, Array]:
        """The matrix for x (size,), with its explicit zeros or without, and the bounds as PIQP has them."""
        low, high = (np.concatenate([np.zeros(0), *ends]) for ends in (self._low, self._high))
        matrix = self.matrix((self.count, size), zeros=zeros).tocsc()
        return matrix, np.maximum(low, -_INFINITE), np.minimum(high, _INFINITE)


def block_diagonal(blocks: Sequence[Array]) -> Array:
    """A dense matrix with blocks (m, n) one after the other; scipy.linalg, which has it too, is slow to import."""
    rows, columns = (np.cumsum([0, *(block.shape[axis] for block in blocks)]) for axis in (0, 1))
    found = np.zeros((rows[-1], columns[-1]))
    for i, block in enumerate(blocks):
        found[rows[i] : rows[i + 1], columns[i] : columns[i + 1]] = block
    return found


def skews(v: Array) -> Array:
    """The matrices (..., 3, 3) of the cross products v x of vectors (..., 3)."""
    return np.asarray((v @ _CROSS).reshape(*v.shape, 3))


_CROSS = np.array([[0.0, 0, 0, 0, 0, -1, 0, 1, 0], [0, 0, 1, 0, 0, 0, -1, 0, 0], [0, -1, 0, 1, 0, 0, 0, 0, 0]])
