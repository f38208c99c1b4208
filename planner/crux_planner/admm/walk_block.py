"""P2a of a walk, equation (19a): steps by the MIP, then x, u and the footholds by one QP with these binaries."""

from __future__ import annotations

from crux_planner.admm.admm import ContactPlan
from crux_planner.admm.walk_mip import WalkMip
from crux_planner.errors import InfeasibleError
from crux_planner.model.arrays import Array
from crux_planner.model.walk_problem import WalkProblem
from crux_planner.solvers import clock
from crux_planner.trajectory.consensus import Eta, Scales
from crux_planner.trajectory.walk_qp import ContactQp, WalkKnots

MILP_TIME_S = 6.0  # of one iteration, once some steps are known
_CUTS = 12  # decisions thrown away in one iteration before giving up


class WalkBlock:
    """P2a of one walk; rows are built once, cuts and tangents stay, and each decision starts from the one before."""

    def __init__(self, problem: WalkProblem, scales: Scales) -> None:
        self.problem, self.scales = problem, scales
        self._mip, self._qp = WalkMip(problem), ContactQp(problem, scales, moments=False)
        self._known: Array | None = None

    def minimise(self, rho: float, target: Eta | None, deadline: float) -> ContactPlan[WalkKnots]:
        """Minimise J + rho / 2 |eta - target|^2. Raises InfeasibleError."""
        for _ in range(_CUTS):
            left = deadline - clock.now()
            limit = max(left if self._known is None else min(MILP_TIME_S, left), 1.0)
            values, none = self._mip.solve(rho, target, self.scales, time_limit_s=limit, start=self._known)
            if values is None:
                reason = "contacts" if none else "time limit"
                raise InfeasibleError(reason, "the contact block found no steps that reach the goal by (8a) and (9a)")
            knots = self._qp.solve(self._mip.motion(values), rho, target)
            if knots is None:
                self._mip.forbid(values)
                continue
            self._mip.touch(knots)
            self._known = values
            return ContactPlan(Eta.of_points(knots.body, knots.feet(self.problem.step_height_m), knots.forces), knots)
        raise InfeasibleError("contacts", f"no walk at the knots among the {_CUTS} best decisions on its steps")
