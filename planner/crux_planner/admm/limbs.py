"""The limbs of P3: a MIP for each, solved in parallel; then what they have at the knots, by one QP.

A limb's block is P2a's rows of that limb (hull.HullMilp, walk_mip.WalkMip): contacts, swings and limit surface, or
steps and cone. The body is in none of them: (8) and (9a) are the NLP's. What the limbs have of one another is in the
shared copy (turns.py).
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace

import numpy as np
from crux_contracts import LIMB_NAMES, N_LIMBS

from crux_planner.admm.admm import ContactPlan
from crux_planner.admm.hull import HullMilp
from crux_planner.admm.turns import in_turn
from crux_planner.admm.walk_mip import WalkMip, window_ends
from crux_planner.admm.window_cost import window_cost
from crux_planner.admm.windows import REST_KNOTS, Windows
from crux_planner.errors import InfeasibleError
from crux_planner.model.arrays import Array, Indices
from crux_planner.model.gait import WalkMotion, nominal_footholds
from crux_planner.model.schedule import Swinging
from crux_planner.model.slots import Slot, Slots
from crux_planner.model.walk_problem import WalkProblem
from crux_planner.physics.static_balance import StaticBalance
from crux_planner.solvers.worker import Team
from crux_planner.trajectory.consensus import FORCE_THRESHOLD_N, Eta, Scales
from crux_planner.trajectory.knot_qp import KnotSolution, solve_knots
from crux_planner.trajectory.walk_qp import ContactQp, WalkKnots

_LIMBS = tuple(range(N_LIMBS))
_GAP, TIME_S = 0.01, 6.0  # of a limb's MIP


class LimbMips:
    """The MIPs of a process, each built when it is asked for."""

    def __init__(self, windows: Windows, scales: Scales) -> None:
        self._windows, self._scales = windows, scales
        self._balance = StaticBalance(windows.problem, windows.problem.friction_share)
        self._known: dict[int, HullMilp] = {}

    def __call__(self, limb: int, rho: float, target: Eta) -> list[Swinging]:
        """The limb's swings in the argmin of its share. Raises InfeasibleError."""
        if limb not in self._known:
            self._known[limb] = HullMilp(self._windows, self._balance, (limb,))
        milp, cost = self._known[limb], window_cost(self._windows, rho, target, self._scales)
        found = milp.solve(cost, gap=_GAP, time_limit_s=TIME_S)
        if found.values is None:
            text = f"HiGHS finds no chain of holds for {LIMB_NAMES[limb]} on the windows of its block"
            raise InfeasibleError("contacts", text)
        return milp.decision(found).swings


class FootMips:
    """The MIPs of a process: rows of every foot by itself, of which one is asked for."""

    def __init__(self, problem: WalkProblem, scales: Scales) -> None:
        self._mip, self._scales = WalkMip(problem, alone=True), scales

    def __call__(self, limb: int, rho: float, target: Eta) -> tuple[Slot, ...]:
        """The foot's steps in the argmin of its share. Raises InfeasibleError."""
        values, _ = self._mip.solve(rho, target, self._scales, time_limit_s=TIME_S, limb=limb)
        if values is None:
            raise InfeasibleError("contacts", f"HiGHS finds no steps to the goal for {LIMB_NAMES[limb]} in its block")
        return self._mip.slots(values, limb)


class _Limbs:
    """What limbs and feet have in common."""

    def __init__(self, edges: Indices, rest: int, scales: Scales) -> None:
        self._edges, self._rest, self.scales = edges, rest, scales

    def in_turn(self, copy: Eta, away: Array, before: Array) -> Eta:
        """The nearest copy in which the swings of `away` take turns."""
        return in_turn(copy, away, before, self._edges, self._rest, self.scales)

    def disputed(self, apart: Eta) -> Array:
        """(T, 1): 1 for windows in which limbs and motion are `apart` by more than the threshold on forces."""
        largest = np.abs(apart.forces).max(axis=(1, 2))
        return (np.maximum.reduceat(largest, self._edges[:-1]) > FORCE_THRESHOLD_N)[:, None].astype(float)

    def _flagged(self, eta: Eta, swings: Iterable[tuple[int, int, int]]) -> Eta:
        """With who is away: `swings` as limb and the knots on the edges of windows between which it is."""
        away = np.zeros((len(self._edges) - 1, len(_LIMBS)))
        for limb, lift, land in swings:
            first, end = np.searchsorted(self._edges, [lift, land])
            away[first:end, limb] = 1.0
        return replace(eta, away=away)


class ClimbLimbs(_Limbs):
    """The four limb blocks of a climb as one."""

    def __init__(self, windows: Windows, mips: Team[list[Swinging]], scales: Scales) -> None:
        super().__init__(
            np.array([*(windows.span(t)[0] for t in range(windows.count)), windows.problem.steps]), REST_KNOTS, scales
        )
        self._windows, self._mips = windows, mips
        self._balance = StaticBalance(windows.problem, windows.problem.friction_share)

    def standing(self) -> Eta:
        """Nothing but the start, and no forces."""
        problem = self._windows.problem
        pose = np.concatenate([problem.start.position_m, problem.start.rpy_rad, np.zeros(6)])
        body, nothing = np.tile(pose, (problem.steps + 1, 1)), [dict[int, Array]() for _ in range(problem.steps)]
        return self._flagged(Eta.of_contacts(problem, self._windows.schedule([]), body, nothing), ())

    def minimise(self, rho: float, target: Eta) -> ContactPlan[KnotSolution]:
        """Every limb's argmin against `target`."""
        problem = self._windows.problem
        swings = [s for own in self._mips.answers([(limb, rho, target) for limb in _LIMBS]) for s in own]
        schedule, path = self._windows.schedule(swings), target.body[:, :3]
        knots = solve_knots(problem, self._balance, schedule, rho, target, self.scales, path, False, alone=True)
        if knots is None:
            raise InfeasibleError("contacts", "PIQP finds no wrenches of a limb's block within the limit surface")
        eta = Eta.of_contacts(problem, schedule, target.body, knots.wrenches)
        return ContactPlan(self._flagged(eta, ((s.limb, s.first - REST_KNOTS, s.end) for s in swings)), knots)


class WalkLimbs(_Limbs):
    """The four feet's blocks as one."""

    def __init__(self, problem: WalkProblem, mips: Team[tuple[Slot, ...]], scales: Scales) -> None:
        super().__init__(window_ends(problem.steps), 0, scales)
        self._problem, self._mips = problem, mips
        self._qp = ContactQp(problem, scales, alone=True)

    def standing(self) -> Eta:
        """Nothing but the start, and no forces."""
        n, start = self._problem.steps, self._problem.start
        body = np.tile(np.concatenate([start.position_m, start.rpy_rad, np.zeros(6)]), (n + 1, 1))
        feet = np.tile(np.pad(self._problem.start_feet_h_m, ((0, 0), (0, 1))), (n + 1, 1, 1))
        return self._flagged(Eta.of_points(body, feet, np.zeros((n, len(_LIMBS), 3))), ())

    def minimise(self, rho: float, target: Eta) -> ContactPlan[WalkKnots]:
        """Every foot's argmin against `target`."""
        problem = self._problem
        gait = Slots(tuple(self._mips.answers([(limb, rho, target) for limb in _LIMBS]))).gait(problem.steps + 1)
        about = WalkMotion(gait, target.body, target.forces, nominal_footholds(problem, gait))
        knots = self._qp.solve(about, rho, target)
        if knots is None:
            raise InfeasibleError("contacts", "PIQP finds no footholds for the feet's blocks")
        eta = Eta.of_points(target.body, knots.feet(problem.step_height_m), knots.forces)
        return ContactPlan(self._flagged(eta, ((s.limb, s.lift, s.land) for s in gait.steps)), knots)
