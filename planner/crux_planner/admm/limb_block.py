"""One limb's MIP of P3: contacts, gripper poses and wrenches of a limb against its shared copy; exact on the stages.

Without the other limbs a limb's contacts are a path through stages, and given a contact its wrenches are one small
convex problem a knot: min R |u|^2 + rho / 2 |lambda - target|^2 on the limit surface. So the MIP is a shortest path,
solved to proven optimality without branching. Blocks of different limbs run in parallel processes.
"""

from __future__ import annotations

import multiprocessing
import os
from concurrent.futures import ProcessPoolExecutor
from dataclasses import dataclass

import numpy as np
import piqp

from crux_planner.admm.consensus import Eta, Scales
from crux_planner.admm.stage_cost import arc_costs, held_costs
from crux_planner.admm.stages import REST_KNOTS, Arc, Stages, Swinging
from crux_planner.arrays import Array
from crux_planner.errors import InfeasibleError
from crux_planner.problem import LIMBS
from crux_planner.search.balance import Balance
from crux_planner.terms.bounds import wrench_bounds
from crux_planner.terms.limit_surface import finger_forces


@dataclass(frozen=True)
class LimbPlan:
    """A limb's swings and its wrenches q = (s1, s2, m, n1, n2) at the knots 0..N-1 in stance."""

    swings: list[Swinging]
    wrenches: dict[int, Array]


@dataclass(frozen=True)
class LimbBlock:
    """The MIP of limb `limb`."""

    stages: Stages
    balance: Balance
    limb: int

    def minimise(self, rho: float, target: Eta, air_cost: Array, others: Array, scales: Scales) -> LimbPlan:
        """Minimise the limb's part of J and of rho / 2 |eta - target|^2; `air_cost` (S,) is added in the air.

        `others` (4, S) are the contacts of all limbs as last known, -1 in the air.
        Raises InfeasibleError where no path leads from the start's contact to one of the goal's.
        """
        stages, limb = self.stages, self.limb
        wrenches, effort = self._wrenches(rho, target, scales)
        held = held_costs(stages, limb, target, rho, scales)
        for t in range(stages.count):
            first, end = stages.span(t)
            held[t] += effort[first:end].sum(axis=0)
        arcs = arc_costs(stages, limb, target, rho, scales)
        for i, arc in enumerate(stages.arcs[limb]):
            rest = stages.span(arc.first)[0]
            if self._blocked(arc, others):
                arcs[i] += _BLOCKED
            arcs[i] += effort[rest : rest + REST_KNOTS, arc.start].sum() + air_cost[arc.first : arc.end].sum()
        swings = self._shortest(held, arcs)
        contacts = [knot[limb] for knot in stages.schedule(swings).contacts[: stages.problem.steps]]
        return LimbPlan(swings, {k: wrenches[k][c] for k, c in enumerate(contacts) if c is not None})

    def _blocked(self, arc: Arc, others: Array) -> bool:
        return any(
            self.stages.blocks(self.limb, arc, other, int(c))
            for other in range(4)
            for c in set(others[other, arc.first : arc.end].tolist())
            if c >= 0
        )

    def _shortest(self, held: Array, arcs: Array) -> list[Swinging]:
        stages, limb = self.stages, self.limb
        best = np.full(held.shape, np.inf)
        came: dict[tuple[int, int], int] = {}
        start = stages.problem.start_contacts[limb]
        best[0, start] = held[0, start]
        landing: dict[int, list[int]] = {}
        for i, arc in enumerate(stages.arcs[limb]):
            landing.setdefault(arc.end, []).append(i)
        for t in range(1, stages.count):
            best[t] = best[t - 1] + held[t]
            for i in landing.get(t, []):
                arc = stages.arcs[limb][i]
                cost = best[arc.first - 1, arc.start] + arcs[i] + held[t, arc.goal]
                if cost < best[t, arc.goal]:
                    best[t, arc.goal] = cost
                    came[t, arc.goal] = i
        c = min(stages.goals[limb], key=lambda goal: best[-1, goal], default=None)
        if c is None or not np.isfinite(best[-1, c]):
            raise InfeasibleError("contacts", f"{LIMBS[limb]} finds no chain of holds on the stages of its block")
        swings, t = [], stages.count - 1
        while t > 0:
            taken = came.get((t, c))
            if taken is None:
                t -= 1
                continue
            arc = stages.arcs[limb][taken]
            swings.append(stages.swinging(limb, arc))
            t, c = arc.first - 1, arc.start
        return swings[::-1]

    def _wrenches(self, rho: float, target: Eta, scales: Scales) -> tuple[list[dict[int, Array]], Array]:
        """Best q for each knot and contact, and its cost (N, C) above that of the limb in the air."""
        problem, balance = self.stages.problem, self.balance
        near, turn = rho * scales.force**2, rho * scales.moment**2
        effort = problem.weights.wrench * np.array([2.0, 2.0, 2.0 / problem.patch.k_m**2, 1.0, 1.0])
        hessian = np.diag(2 * effort + near * np.array([2.0, 2.0, 0.0, 1.0, 1.0]) + turn * np.array([0, 0, 2.0, 0, 0]))
        fingers = slice(2 * self.limb, 2 * self.limb + 2)
        forces, moments = target.forces[:, fingers].reshape(-1, 6), target.moments[:, fingers].reshape(-1, 6)
        answers: list[dict[int, Array]] = [{} for _ in range(problem.steps)]
        costs = np.zeros((problem.steps, len(problem.contacts)))
        for c in self.stages.contacts[self.limb]:
            contact = problem.contacts[c]
            low, high = wrench_bounds(problem, contact)
            low, high = np.maximum(low, -1e3), np.minimum(high, 1e3)
            units = [finger_forces(unit, contact.axis, contact.tangent) for unit in np.eye(5)]
            to_force, to_moment = (np.stack([unit[i].ravel() for unit in units], axis=1) for i in (0, 1))
            load = -balance.margin * balance.reach * balance.friction[c]
            none = np.zeros_like(load)
            rows = np.vstack([np.column_stack([balance.directions, *pair]) for pair in ((load, none), (none, load))])
            right = np.tile(balance.spine[c], 2)
            linear = -near * forces @ to_force - turn * moments @ to_moment
            solver = piqp.DenseSolver()
            solver.settings.verbose = False
            solver.setup(hessian, linear[0], None, None, rows, None, right, low, high)
            for k in range(problem.steps):
                solver.update(c=linear[k])
                solver.solve()
                q = np.array(solver.result.x)
                answers[k][c] = q
                costs[k, c] = 0.5 * q @ hessian @ q + linear[k] @ q
        return answers, costs


_BLOCKED = 1e3  # cost of a swing past a gripper that stands in its way, as far as known
_BLOCKS: list[LimbBlock] = []  # of a worker process


class ParallelLimbs:
    """The four limb blocks, each solved in a process of its own as far as there are cores."""

    def __init__(self, stages: Stages, balance: Balance) -> None:
        # Not forked: a forked worker waits for ever for locks of threads (HiGHS has some) that only this process has.
        self._pool = ProcessPoolExecutor(
            min(4, len(os.sched_getaffinity(0))),
            mp_context=multiprocessing.get_context("spawn"),
            initializer=_remember,
            initargs=(stages, balance),
        )

    def minimise(self, rho: float, target: Eta, air_cost: Array, others: Array, scales: Scales) -> list[LimbPlan]:
        """All limbs' plans; `air_cost` (4, S)."""
        waiting = [self._pool.submit(_minimise, limb, rho, target, air_cost[limb], others, scales) for limb in range(4)]
        return [each.result() for each in waiting]

    def minimise_one(
        self, limb: int, rho: float, target: Eta, air_cost: Array, others: Array, scales: Scales
    ) -> LimbPlan:
        """One limb's plan."""
        return self._pool.submit(_minimise, limb, rho, target, air_cost, others, scales).result()

    def __enter__(self) -> ParallelLimbs:
        return self

    def __exit__(self, *error: object) -> None:
        self._pool.shutdown(cancel_futures=True)


def _remember(stages: Stages, balance: Balance) -> None:
    _BLOCKS[:] = [LimbBlock(stages, balance, limb) for limb in range(4)]


def _minimise(limb: int, rho: float, target: Eta, air_cost: Array, others: Array, scales: Scales) -> LimbPlan:
    return _BLOCKS[limb].minimise(rho, target, air_cost, others, scales)
