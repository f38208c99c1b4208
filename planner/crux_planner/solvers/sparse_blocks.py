"""Sparse matrices put together block by block, and products with cross-product matrices, many at a time."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from crux_planner.model.arrays import Array, Indices


class Entries:
    """Entries of a sparse matrix, gathered block by block."""

    def __init__(self) -> None:
        self._parts: list[tuple[Indices, Indices, Array]] = []

    def entries(self, rows: Indices, columns: Indices, values: Array) -> None:
        self._parts.append((rows, columns, values))

    def blocks(self, rows: Indices, columns: Indices, values: Array) -> None:
        """Blocks (n, a, b) with their first rows and columns (n,)."""
        a, b = values.shape[1:]
        shape = (len(rows), a, b)
        row = np.broadcast_to(rows[:, None, None] + np.arange(a)[:, None], shape)
        column = np.broadcast_to(columns[:, None, None] + np.arange(b), shape)
        self._parts.append((row.ravel(), column.ravel(), values.ravel()))

    def dense(self, row: int, columns: Indices, values: Array) -> None:
        """One block from `row` on, its columns anywhere."""
        a, b = values.shape
        rows = np.repeat(row + np.arange(a), b)
        self._parts.append((rows, np.tile(columns, a), values.ravel()))

    def matrix(self, shape: tuple[int, int], more: sp.coo_matrix | None = None) -> sp.coo_matrix:
        parts = [*self._parts, *([] if more is None else [(more.row, more.col, more.data)])]
        rows, columns, values = (np.concatenate([part[i] for part in parts]) for i in range(3))
        solid = values != 0.0
        return sp.coo_matrix((values[solid], (rows[solid], columns[solid])), shape)


def skews(v: Array) -> Array:
    """(..., 3, 3) of (..., 3)."""
    zero = np.zeros(v.shape[:-1])
    x, y, z = v[..., 0], v[..., 1], v[..., 2]
    flat = np.stack([zero, -z, y, z, zero, -x, -y, x, zero], axis=-1)
    return flat.reshape(*v.shape, 3)
