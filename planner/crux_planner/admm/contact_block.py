"""P2a, equation (19a): contacts by the hull MILP on windows, then all of x, u and y at the knots by one convex QP."""

from __future__ import annotations

import numpy as np

from crux_planner.admm.admm import ContactPlan
from crux_planner.admm.hull import Decision, HullMilp
from crux_planner.admm.window_cost import window_cost
from crux_planner.admm.windows import Swinging, Windows, clash
from crux_planner.errors import InfeasibleError
from crux_planner.model.arrays import Array
from crux_planner.search.stances import Oracles, search
from crux_planner.solvers import clock
from crux_planner.trajectory.consensus import Eta, Scales
from crux_planner.trajectory.knot_qp import KnotSolution, solve_knots

MILP_GAP = 0.02
MILP_TIME_S = 6.0  # of one iteration, once some contacts are known
_SEARCH_TIME_S = 2.0
GREED = 1.5  # of that search
_CUTS = 12  # decisions thrown away in one iteration before giving up


class ContactBlock:
    """P2a of one problem; rows are built once, cuts stay, and each decision starts from the one before."""

    def __init__(self, oracles: Oracles, *, moments: bool = True, scales: Scales) -> None:
        self.problem, self.moments, self.scales = oracles.problem, moments, scales
        self.windows = Windows(oracles.problem, oracles.reachable, oracles.swings)
        self._balance, self._oracles = oracles.equilibrium, oracles
        self._hull = HullMilp(self.windows, oracles.equilibrium, moments=moments)
        self._known = self._searched()
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
                self.problem, self._balance, schedule, rho, target, self.scales, self.path(decision), self.moments
            )
            if knots is None:
                self._hull.forbid_exactly(decision)
                continue
            self._known, self.bound = decision.swings, result.bound
            eta = Eta.of_contacts(self.problem, schedule, knots.body, knots.wrenches)
            return ContactPlan(eta, knots)
        raise InfeasibleError("contacts", f"no contacts with a body path at the knots among the {_CUTS} best decisions")

    def _searched(self) -> list[Swinging] | None:
        """A first set of contacts for the MILP to start from: the quickest by the stance search, one limb at a time."""
        until = clock.now() + _SEARCH_TIME_S
        moves, _ = search(self._oracles, at_once=1, greed=GREED, deadline=until)
        return None if moves is None else self.windows.one_by_one(moves)

    def path(self, decision: Decision) -> Array:
        """Body positions (N + 1, 3) through those of the windows, each in the middle of its window."""
        n, windows = self.problem.steps, self.windows
        middles = [0.5 * sum(windows.span(t)) for t in range(windows.count)]
        middles[0], middles[-1] = 0.0, float(n)
        knots = np.arange(n + 1)
        return np.stack([np.interp(knots, middles, decision.body[:, axis]) for axis in range(3)], axis=1)


def _nothing_found(infeasible: bool) -> InfeasibleError:
    if infeasible:
        return InfeasibleError("contacts", "no contacts on the windows of the contact block satisfy reach and balance")
    return InfeasibleError("time limit", "the contact block found no contacts in the time allowed")
