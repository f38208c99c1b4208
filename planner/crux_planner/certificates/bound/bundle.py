"""Multipliers that rise by a proximal bundle: where the crawls seen so far, mixed, are in balance with the body.

What it proposes need not be trusted: every multiplier gives a bound.
"""

from __future__ import annotations

import numpy as np

from crux_planner.certificates.bound.centre_of_pressure import CentreOfPressure
from crux_planner.model.arrays import Array
from crux_planner.solvers.qp import Qp

_KEPT = 24  # columns
_NEARNESS = 0.5  # weight on how far the next multipliers are from the best ones


class Bundle:
    """Crawls seen, as columns of their cost and outputs."""

    def __init__(self, pressure: CentreOfPressure, multipliers: Array) -> None:
        self.multipliers, self.bound, self.best = multipliers, -np.inf, multipliers
        self._free = pressure.outputs
        self._inverse = np.linalg.inv(pressure.yielding + _NEARNESS * np.eye(len(multipliers)))
        self._costs: list[float] = []
        self._outputs: list[Array] = []

    def add(self, bound: float, cost: float, outputs: Array) -> None:
        """What the multipliers gave."""
        if bound > self.bound:
            self.bound, self.best = bound, self.multipliers
        self._costs.append(cost)
        self._outputs.append(outputs)

    def propose(self) -> None:
        """Set the next multipliers."""
        columns, costs = np.array(self._outputs), np.array(self._costs)
        about = self._free + _NEARNESS * self.best
        weighed = columns @ self._inverse
        m = len(costs)
        hessian, mixed = weighed @ columns.T + 1e-12 * np.eye(m), (np.ones((1, m)), np.ones(1))
        qp = Qp(hessian, costs - weighed @ about, mixed, None, np.zeros(m), np.ones(m))
        share = np.nan_to_num(qp.solve().x)
        self.multipliers = self._inverse @ (about - share @ columns)
        if m > _KEPT:
            kept = {*np.argsort(-share)[: _KEPT - 1].tolist(), m - 1}
            self._costs = [self._costs[i] for i in kept]
            self._outputs = [self._outputs[i] for i in kept]
