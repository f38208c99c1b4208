"""P2a, equation (19a): contacts by the MIP on windows, then x, u and y at the knots by one QP with these binaries.

Both are without (8b), and begin with nothing that a search has found.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import Generic, TypeVar

import numpy as np

from crux_planner.admm.admm import ContactPlan, Knots
from crux_planner.admm.hull import Decision, HullMilp
from crux_planner.admm.walk_mip import WalkMip
from crux_planner.admm.window_cost import window_cost
from crux_planner.admm.windows import Windows, clash
from crux_planner.errors import InfeasibleError
from crux_planner.model.arrays import Array
from crux_planner.model.walk_problem import WalkProblem
from crux_planner.physics.static_balance import StaticBalance
from crux_planner.solvers import clock
from crux_planner.trajectory.consensus import Eta, Scales
from crux_planner.trajectory.knot_qp import KnotSolution, solve_knots
from crux_planner.trajectory.walk_qp import ContactQp, WalkKnots

MILP_GAP = 0.01
MILP_TIME_S = 6.0  # of one iteration, once some contacts are known
_CUTS = 12  # decisions thrown away in one iteration before giving up

D = TypeVar("D")
K = TypeVar("K", bound=Knots)


class ContactBlock(ABC, Generic[D, K]):
    """P2a of one problem; rows are built once, cuts and tangents stay, and each decision starts from the one before."""

    def __init__(self, scales: Scales) -> None:
        self.scales = scales
        self._known: D | None = None

    def minimise(self, rho: float, target: Eta | None, deadline: float) -> ContactPlan[K]:
        """Minimise J + rho / 2 |eta - target|^2. Raises InfeasibleError."""
        for _ in range(_CUTS):
            left = deadline - clock.now()
            limit = max(left if self._known is None else min(MILP_TIME_S, left), 1.0)
            decision = self._decide(rho, target, limit)
            plan = self._at_knots(decision, rho, target)
            if plan is None:
                continue
            self._touch(plan.knots)
            self._known = decision
            return plan
        raise InfeasibleError("contacts", f"no plan at the knots among the {_CUTS} best decisions for contacts")

    @abstractmethod
    def _decide(self, rho: float, target: Eta | None, limit_s: float) -> D:
        """Contacts by the MIP."""

    @abstractmethod
    def _at_knots(self, decision: D, rho: float, target: Eta | None) -> ContactPlan[K] | None:
        """x, u and y by the QP; where contacts leave none, they are never decided for again."""

    @abstractmethod
    def _touch(self, knots: K) -> None:
        """Tangents at what the QP has found."""


class ClimbContacts(ContactBlock[Decision, KnotSolution]):
    """Those of a climb."""

    def __init__(self, windows: Windows, scales: Scales, *, moments: bool = False) -> None:
        super().__init__(scales)
        self.windows, self.problem = windows, windows.problem
        self._balance = StaticBalance(self.problem, self.problem.friction_share)
        self._moments, self._hull = moments, HullMilp(windows, self._balance, moments=moments)

    def _decide(self, rho: float, target: Eta | None, limit_s: float) -> Decision:
        cost = window_cost(self.windows, rho, target, self.scales)
        known = None if self._known is None else self._known.swings
        result = self._hull.solve(cost, gap=MILP_GAP, time_limit_s=limit_s, start=known)
        if result.infeasible:
            raise InfeasibleError(
                "contacts", "HiGHS finds no contacts for the contact block's windows under (8a) and (9a)"
            )
        if result.values is None:
            raise InfeasibleError("time limit", "the contact block found no contacts in the time allowed")
        return self._hull.decision(result)

    def _at_knots(self, decision: Decision, rho: float, target: Eta | None) -> ContactPlan[KnotSolution] | None:
        together = clash(self.windows, decision.swings)
        if together is not None:
            self._hull.forbid(together)
            return None
        schedule, path = self.windows.schedule(decision.swings), self._path(decision)
        knots = solve_knots(self.problem, self._balance, schedule, rho, target, self.scales, path, self._moments)
        if knots is None:
            self._hull.forbid_exactly(decision)
            return None
        return ContactPlan(Eta.of_contacts(self.problem, schedule, knots.body, knots.wrenches), knots)

    def _touch(self, knots: KnotSolution) -> None:
        self._hull.touch(knots.wrenches, knots.schedule)

    def _path(self, decision: Decision) -> Array:
        """Body positions (N + 1, 3) through those of the windows, each in the middle of its window."""
        n, windows = self.problem.steps, self.windows
        middles = [0.5 * sum(windows.span(t)) for t in range(windows.count)]
        middles[0], middles[-1] = 0.0, float(n)
        knots = np.arange(n + 1)
        return np.stack([np.interp(knots, middles, decision.body[:, axis]) for axis in range(3)], axis=1)


class WalkSteps(ContactBlock[Array, WalkKnots]):
    """Those of a walk; a decision is the values of the MIP's variables."""

    def __init__(self, problem: WalkProblem, scales: Scales) -> None:
        super().__init__(scales)
        self.problem = problem
        self._mip, self._qp = WalkMip(problem), ContactQp(problem, scales, moments=False)

    def _decide(self, rho: float, target: Eta | None, limit_s: float) -> Array:
        values, none = self._mip.solve(rho, target, self.scales, time_limit_s=limit_s, start=self._known)
        if values is None:
            reason = "contacts" if none else "time limit"
            raise InfeasibleError(reason, "HiGHS finds no steps to the goal for the contact block under (8a) and (9a)")
        return values

    def _at_knots(self, decision: Array, rho: float, target: Eta | None) -> ContactPlan[WalkKnots] | None:
        knots = self._qp.solve(self._mip.motion(decision), rho, target)
        if knots is None:
            self._mip.forbid(decision)
            return None
        return ContactPlan(Eta.of_points(knots.body, knots.feet(self.problem.step_height_m), knots.forces), knots)

    def _touch(self, knots: WalkKnots) -> None:
        self._mip.touch(knots)
