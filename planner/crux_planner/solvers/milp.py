"""A mixed-integer linear program put together piece by piece, solved by HiGHS."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import highspy
import numpy as np
import scipy.sparse as sp

from crux_planner.model.arrays import Array, Flags, Indices
from crux_planner.solvers import clock


@dataclass(frozen=True)
class MilpResult:
    """`values` is None where none was found; `bound` is HiGHS's lower bound of the objective (-inf where none is), and
    `infeasible` what it says with its presolve and without: neither is proven here.

    `work` counts the rows that the simplex method looked at.
    """

    values: Array | None
    objective: float
    bound: float
    infeasible: bool
    work: int


class Milp:
    """Bounds, integrality and rows low <= a x <= high; the cost is given to `solve`, so that rows can be re-used.

    `options` are those of HiGHS that are not as usual.
    """

    def __init__(self, **options: bool) -> None:
        self.size = 0
        self._options = {"output_flag": False, "threads": 1, "random_seed": 0, **options}
        self._low: list[Array] = []
        self._high: list[Array] = []
        self._integer: list[Flags] = []
        self._columns: list[Indices] = []
        self._passed = -1  # rows that the solver knows
        self._values: list[Array] = []
        self._lengths: list[int] = []
        self._row_low: list[float] = []
        self._row_high: list[float] = []
        self._solver: highspy.Highs | None = None
        self._until = np.inf  # of clock.now

    @property
    def rows(self) -> int:
        """Number of rows."""
        return len(self._lengths)

    @property
    def binaries(self) -> int:
        """Number of integer variables."""
        return int(np.concatenate(self._integer).sum())

    def variables(self, count: int, low: Array | float, high: Array | float, *, integer: bool = False) -> Indices:
        """Add `count` variables; returns their numbers."""
        index = np.arange(self.size, self.size + count)
        self._low.append(np.broadcast_to(np.asarray(low, dtype=float), count).copy())
        self._high.append(np.broadcast_to(np.asarray(high, dtype=float), count).copy())
        self._integer.append(np.full(count, integer))
        self.size += count
        return index

    def row(self, columns: Indices | list[int], coefficients: Array | list[float], low: float, high: float) -> None:
        """Add low <= coefficients . x[columns] <= high; a column may come twice."""
        values = np.asarray(coefficients, dtype=float)
        kept = values != 0.0
        index, where = np.unique(np.asarray(columns, dtype=int)[kept], return_inverse=True)
        self._columns.append(index.astype(int))
        self._values.append(np.bincount(where, values[kept], minlength=len(index)).astype(float))
        self._lengths.append(len(index))
        self._row_low.append(low)
        self._row_high.append(high)

    def add(self, terms: Sequence[tuple[Indices | int, Any]], low: Any, high: Any) -> None:
        """Add rows low <= sum of coefficient * x[column] <= high, one for each element of what all of these
        broadcast to; a column comes once in a row at most.
        """
        shape = np.broadcast_shapes(*(np.shape(part) for term in terms for part in term), np.shape(low), np.shape(high))
        columns, values = (
            np.stack([np.broadcast_to(term[i], shape).ravel() for term in terms], axis=1) for i in (0, 1)
        )
        used = values != 0.0
        self._columns.append(columns[used].astype(int))
        self._values.append(values[used].astype(float))
        self._lengths += used.sum(axis=1).tolist()
        self._row_low += np.broadcast_to(low, shape).ravel().tolist()
        self._row_high += np.broadcast_to(high, shape).ravel().tolist()

    def solve(
        self,
        cost: Array,
        *,
        constant: float = 0.0,
        start: Array | None = None,
        gap: float,
        time_limit_s: float,
        nodes: int = 2**31 - 1,
        relaxed: bool = False,
    ) -> MilpResult:
        """Minimise cost . x + constant to a `gap` relative to it; rows added since the last call are taken up.

        `start` may be NaN where nothing is known; with `relaxed`, integrality is left out; limits are of clock.now and
        of the nodes of the tree.
        """
        solver = self._fresh()
        solver.setOptionValue("mip_rel_gap", gap)
        solver.setOptionValue("mip_max_nodes", nodes)
        self._until = clock.now() + time_limit_s
        solver.setOptionValue("solve_relaxation", relaxed)
        solver.changeColsCost(self.size, np.arange(self.size, dtype=np.int32), cost)
        solver.changeObjectiveOffset(constant)
        if start is not None:
            known = np.flatnonzero(~np.isnan(start)).astype(np.int32)
            solver.setSolution(len(known), known, start[known])
        solver.run()
        if solver.getModelStatus() == highspy.HighsModelStatus.kInfeasible:  # it has said so where it was wrong
            solver.setOptionValue("presolve", "off")
            solver.clearSolver()
            solver.run()
            solver.setOptionValue("presolve", "choose")
        info, status = solver.getInfo(), solver.getModelStatus()
        found = info.primal_solution_status == highspy.SolutionStatus.kSolutionStatusFeasible
        values = np.array(solver.getSolution().col_value) if found else None
        optimal = status == highspy.HighsModelStatus.kOptimal
        bound = (info.objective_function_value if optimal else -np.inf) if relaxed else info.mip_dual_bound
        objective = float(info.objective_function_value) if found else np.inf
        infeasible, work = status == highspy.HighsModelStatus.kInfeasible, info.simplex_iteration_count * self.rows
        return MilpResult(values, objective, float(bound), infeasible, work)

    def _fresh(self) -> highspy.Highs:
        """The solver with all rows."""
        if self._solver is None:
            self._solver = highspy.Highs()  # type: ignore[no-untyped-call]
            for option, value in self._options.items():
                self._solver.setOptionValue(option, value)
            for interrupt in (self._solver.cbMipInterrupt, self._solver.cbSimplexInterrupt):
                interrupt.subscribe(self._look_at_the_clock)
        if self._passed != self.rows:
            self._solver.passModel(self._model())
            self._passed = self.rows
        return self._solver

    def _look_at_the_clock(self, event: Any) -> None:
        """HiGHS's own limit is of the wall clock."""
        event.interrupt(clock.now() > self._until)

    def _model(self) -> highspy.HighsLp:
        starts = np.concatenate([[0], np.cumsum(self._lengths)])
        entries = np.concatenate(self._values), np.concatenate(self._columns), starts
        matrix = sp.csr_matrix(entries, (self.rows, self.size))
        columns = np.concatenate(self._low), np.concatenate(self._high)
        rows = np.array(self._row_low), np.array(self._row_high)
        return highs_model(matrix, np.zeros(self.size), columns, rows, np.concatenate(self._integer))


def highs_model(
    matrix: Any, cost: Array, columns: tuple[Array, Array], rows: tuple[Array, Array], integer: Flags
) -> highspy.HighsLp:
    """min cost . x with bounds of the columns x and the rows matrix @ x, as HiGHS takes it."""
    model, by_column = highspy.HighsLp(), matrix.tocsc()
    model.num_row_, model.num_col_ = matrix.shape
    model.col_cost_ = cost
    model.col_lower_, model.col_upper_ = columns
    model.row_lower_, model.row_upper_ = rows
    model.a_matrix_.format_ = highspy.MatrixFormat.kColwise
    model.a_matrix_.start_, model.a_matrix_.index_ = by_column.indptr, by_column.indices
    model.a_matrix_.value_ = by_column.data
    kinds = (highspy.HighsVarType.kContinuous, highspy.HighsVarType.kInteger)
    model.integrality_ = [kinds[int(flag)] for flag in integer]
    return model
