"""One NLP with continuous binaries, solved by ipopt again and again under a shrinking relaxation.

After Stein, Oldenburg & Marquardt (2004): the NLP's one parameter bounds alpha (1 - alpha) and the products with
alpha that stand for "if in contact"; every run starts from the last answer.
"""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import casadi as ca
import numpy as np

from crux_planner.errors import InfeasibleError
from crux_planner.model.arrays import Array
from crux_planner.solvers import clock
from crux_planner.solvers.ipopt import Nlp

RELAXATIONS = (0.25, 0.05, 0.01, 2e-3, 4e-4)
DECIDED = 0.05  # so near 0 or 1 a contact counts as decided
_IPOPT: dict[str, Any] = {
    "ipopt.tol": 1e-3,
    "ipopt.constr_viol_tol": 1e-4,
    "ipopt.max_iter": 400,
    "ipopt.hessian_approximation": "exact",
}


class Watch(ca.Callback):
    """Tells ipopt to stop where another iteration as long as the longest so far would end after the deadline."""

    def __init__(self, variables: int, rows: int, parameters: int, deadline: float) -> None:
        ca.Callback.__init__(self)
        self._sizes = {"x": variables, "lam_x": variables, "f": 1, "g": rows, "lam_g": rows, "lam_p": parameters}
        self._deadline, self._last, self._longest = deadline, clock.now(), 0.0
        self.late = False
        self.construct("watch", {})

    def get_n_in(self) -> int:
        """As many as nlpsol gives out."""
        return int(ca.nlpsol_n_out())

    def get_n_out(self) -> int:
        """Whether to stop."""
        return 1

    def get_name_in(self, i: int) -> str:
        """As nlpsol names what it gives out."""
        return str(ca.nlpsol_out(i))

    def get_name_out(self, i: int) -> str:  # noqa: ARG002
        """Of the one output."""
        return "stop"

    def get_sparsity_in(self, i: int) -> Any:
        """Dense columns."""
        return ca.Sparsity.dense(self._sizes[ca.nlpsol_out(i)], 1)

    def eval(self, arg: Any) -> list[int]:  # noqa: ARG002
        """1 where there is no time left."""
        now = clock.now()
        self._longest, self._last = max(self._longest, now - self._last), now
        self.late = now + self._longest > self._deadline
        return [int(self.late)]


@dataclass(frozen=True)
class Relaxed:
    """An NLP in x with the relaxation as its parameter p, bounds of x and its rows; `binaries` takes alpha from x."""

    nlp: dict[str, Any]
    bounds: tuple[Array, Array]
    row_bounds: tuple[Array, Array]
    binaries: Callable[[Array], Array]
    options: dict[str, Any] = field(default_factory=dict)  # of ipopt, beyond the usual ones

    def solve(
        self, values: Array, deadline: float, report: Callable[[str], None] = lambda _line: None
    ) -> tuple[Array, list[int]]:
        """The answer to the last relaxation and ipopt's iterations for each. Raises InfeasibleError where one fails."""
        low, high = self.bounds
        watch = Watch(len(values), len(self.row_bounds[0]), 1, deadline)
        options = {**_IPOPT, **self.options, "iteration_callback": watch}
        solver = Nlp(self.nlp, self.bounds, self.row_bounds, options)
        iterations: list[int] = []
        for i, relaxation in enumerate(RELAXATIONS, 1):
            found = solver.solve(np.clip(values, low, high), relaxation)
            values = found.x
            iterations.append(found.iterations)
            progress = self.progress(values, found.rows)
            if not found.solved:
                late = watch.late or clock.now() > deadline
                why = "runs out of time" if late else f"stops ({found.status})"
                raise InfeasibleError(
                    "time limit" if late else "benchmark",
                    f"the benchmark NLP {why} at relaxation {relaxation:g}, {i} of {len(RELAXATIONS)}, after "
                    f"{sum(iterations)} iterations; it came to {progress}",
                )
            report(f"relaxation {relaxation:g}: {iterations[-1]} iterations, {progress}")
        return values, iterations

    def progress(self, values: Array, rows: Array) -> str:
        """How far a point is from a plan."""
        low, high = self.row_bounds
        off = float(np.maximum(np.maximum(low - rows, rows - high), 0.0).max())
        alpha = self.binaries(values)
        undecided = float((np.minimum(alpha, 1 - alpha) > DECIDED).mean())
        return f"rows off by up to {off:.2g}, {100 * undecided:.0f} % of the contacts neither made nor broken"
