"""P2a of a climb, equation (19a): contacts by the MIP on windows, then x, u and y at the knots by one convex QP.

The QP is P2a with its binaries fixed. Both are without (8b), and begin with nothing that a search has found.
"""

from __future__ import annotations

import numpy as np

from crux_planner.admm.admm import ContactPlan
from crux_planner.admm.hull import Decision, HullMilp
from crux_planner.admm.window_cost import window_cost
from crux_planner.admm.windows import Swinging, Windows, clash
from crux_planner.errors import InfeasibleError
from crux_planner.model.arrays import Array
from crux_planner.physics.static_balance import StaticBalance
from crux_planner.solvers import clock
from crux_planner.trajectory.consensus import Eta, Scales
from crux_planner.trajectory.knot_qp import KnotSolution, solve_knots

MILP_GAP = 0.01
MILP_TIME_S = 6.0  # of one iteration, once some contacts are known
_CUTS = 12  # decisions thrown away in one iteration before giving up


class ContactBlock:
    """P2a of one problem; rows are built once, cuts and tangents stay, and each decision starts from the one before."""

    def __init__(self, windows: Windows, *, scales: Scales) -> None:
        self.windows, self.problem, self.scales = windows, windows.problem, scales
        self._balance = StaticBalance(self.problem, self.problem.friction_share)
        self._hull = HullMilp(windows, self._balance)
        self._known: list[Swinging] | None = None
        self.bound = -np.inf  # proven, of the last MILP's objective

    def minimise(self, rho: float, target: Eta | None, deadline: float) -> ContactPlan[KnotSolution]:
        """Minimise J + rho / 2 |eta - target|^2. Raises InfeasibleError."""
        cost = window_cost(self.windows, rho, target, self.scales)
        for _ in range(_CUTS):
            left = deadline - clock.now()
            limit = max(left if self._known is None else min(MILP_TIME_S, left), 1.0)
            result = self._hull.solve(cost, gap=MILP_GAP, time_limit_s=limit, start=self._known)
            if result.values is None:
                raise _nothing_found(result.infeasible)
            decision = self._hull.decision(result)
            together = clash(self.windows, decision.swings)
            if together is not None:
                self._hull.forbid(together)
                continue
            schedule = self.windows.schedule(decision.swings)
            knots = solve_knots(
                self.problem, self._balance, schedule, rho, target, self.scales, self.path(decision), False
            )
            if knots is None:
                self._hull.forbid_exactly(decision)
                continue
            self._hull.touch(knots.wrenches, schedule)
            self._known, self.bound = decision.swings, result.bound
            eta = Eta.of_contacts(self.problem, schedule, knots.body, knots.wrenches)
            return ContactPlan(eta, knots)
        raise InfeasibleError("contacts", f"no contacts with a body path at the knots among the {_CUTS} best decisions")

    def path(self, decision: Decision) -> Array:
        """Body positions (N + 1, 3) through those of the windows, each in the middle of its window."""
        n, windows = self.problem.steps, self.windows
        middles = [0.5 * sum(windows.span(t)) for t in range(windows.count)]
        middles[0], middles[-1] = 0.0, float(n)
        knots = np.arange(n + 1)
        return np.stack([np.interp(knots, middles, decision.body[:, axis]) for axis in range(3)], axis=1)


def _nothing_found(infeasible: bool) -> InfeasibleError:
    if infeasible:
        return InfeasibleError("contacts", "no contacts on the windows of the contact block satisfy reach and (8a)")
    return InfeasibleError("time limit", "the contact block found no contacts in the time allowed")
