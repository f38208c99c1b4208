"""Nonlinear programs of casadi's, solved by ipopt."""

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from crux_planner.model.arrays import Array

_QUIET: dict[str, Any] = {"print_time": 0, "ipopt.print_level": 0, "ipopt.sb": "yes", "ipopt.linear_solver": "mumps"}
AGAIN: dict[str, Any] = {
    "ipopt.mu_strategy": "monotone",
    "ipopt.mu_init": 1e-3,
    "ipopt.tol": 1e-5,
    "ipopt.constr_viol_tol": 1e-7,
    "ipopt.acceptable_iter": 0,
    "ipopt.max_iter": 100,
    "ipopt.warm_start_init_point": "yes",
    "ipopt.warm_start_bound_push": 1e-6,
    "ipopt.warm_start_mult_bound_push": 1e-6,
}


@dataclass(frozen=True)
class NlpSolution:
    """x and g where ipopt ended, and how."""

    x: Array
    rows: Array
    cost: float
    iterations: int
    status: str
    solved: bool


class Nlp:
    """min f(x, p) with bounds of x and of g(x, p), `nlp` as casadi has it; compiled once.

    Options: `AGAIN` are those of one that is solved over and over from its last answer.
    """

    def __init__(
        self, nlp: dict[str, Any], bounds: tuple[Array, Array], row_bounds: tuple[Array, Array], options: dict[str, Any]
    ) -> None:
        self._solver = ca.nlpsol("nlp", "ipopt", nlp, {**_QUIET, **options})
        self._bounds = dict(zip(("lbx", "ubx", "lbg", "ubg"), (*bounds, *row_bounds), strict=True))
        self._last: dict[str, Any] = {}

    def solve(self, start: Array, parameters: Any = None, *, again: bool = False) -> NlpSolution:
        """From `start`; with `again`, from the last answer and its multipliers where there is one."""
        given = {"x0": start, **(self._last if again else {})}
        if parameters is not None:
            given["p"] = parameters
        result, stats = self._solver(**given, **self._bounds), self._solver.stats()
        self._last = {"x0": result["x"], "lam_x0": result["lam_x"], "lam_g0": result["lam_g"]}
        x, rows = (np.array(result[name]).ravel() for name in ("x", "g"))
        how = int(stats["iter_count"]), str(stats["return_status"]), bool(stats["success"])
        return NlpSolution(x, rows, float(result["f"]), *how)
