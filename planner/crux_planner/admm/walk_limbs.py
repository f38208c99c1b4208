"""The limbs of P3 on a walk: their blocks' answers joined, and what each is told of the others."""

from __future__ import annotations

import numpy as np

from crux_planner.admm.admm import ContactPlan, Motion
from crux_planner.admm.walk_limb_block import FootPlan
from crux_planner.errors import InfeasibleError
from crux_planner.model.arrays import Array
from crux_planner.model.slots import LEAST_GAP, Slots
from crux_planner.model.walk_problem import WalkProblem
from crux_planner.search.gait_search import FlatSearch
from crux_planner.solvers.worker import Team
from crux_planner.trajectory.consensus import Eta, Scales
from crux_planner.trajectory.walk_qp import WalkKnots

_USUAL_ORDER = [2, 0, 3, 1]  # rear before front, side after side
_RIGHT_OF_WAY = 3.0  # cost of a knot in the air beside a foot that comes before in the order


class WalkLimbs:
    """The four limb blocks of a walk as one."""

    def __init__(self, problem: WalkProblem, blocks: Team[FootPlan], scales: Scales) -> None:
        self._problem, self._blocks, self._scales = problem, blocks, scales
        self._plans: dict[int, FootPlan] = {}
        self._order = _right_of_way(problem)

    def first_guess(self, motion: Motion, rho: float) -> Eta:
        """A first copy: forces that carry the body on its way, and feet that choose one after another."""
        problem = self._problem
        n = problem.steps
        pose = np.concatenate([problem.start.position_m, problem.start.rpy_rad, np.zeros(6)])
        feet = np.concatenate([problem.start_feet_w_m, np.zeros((4, 1))], axis=1)
        forces = np.tile(-problem.mass_kg * problem.gravity_w / 4, (n, 4, 1))
        still = Eta(
            np.tile(pose, (n + 1, 1)), np.tile(feet, (n + 1, 1, 1)), np.zeros((n + 1, 0)), forces, np.zeros((n, 0, 3))
        )
        moving = motion.project(still, rho)
        # Feet go on evenly with the time, one after another.
        turn = np.argsort(self._order)
        way = np.clip((np.arange(n + 1)[:, None] - n * (turn + 0.5) / 4.5) / (n / 4.5) + 0.5, 0.0, 1.0)
        there = np.concatenate([problem.goal_feet_w_m, np.zeros((4, 1))], axis=1)
        even = Eta(moving.body, feet + way[..., None] * (there - feet), moving.yaws, moving.forces, moving.moments)
        self._plans = {}
        for limb in self._order:
            (self._plans[limb],) = self._answers([limb], rho, even)
        chosen = self._joined(moving.body).eta
        return Eta(chosen.body, chosen.fingers, chosen.yaws, moving.forces, moving.moments)

    def minimise(self, rho: float, target: Eta) -> ContactPlan[WalkKnots]:
        """Every limb's argmin against `target`, in parallel, joined."""
        self._plans = dict(enumerate(self._answers(list(range(4)), rho, target)))
        return self._joined(target.body)

    def _answers(self, limbs: list[int], rho: float, target: Eta) -> list[FootPlan]:
        air_cost = self._yielding()
        return self._blocks.answers(
            [
                (limb, rho, target.fingers[:, limb], target.forces[:, limb], air_cost[:, limb], self._scales)
                for limb in limbs
            ]
        )

    def _yielding(self) -> Array:
        """(N, 4): what it costs a foot to be in the air where one before it in the order last was.

        Feet alike would else step together and, each knowing nothing of the others, go on doing so.
        """
        n = self._problem.steps
        flying = np.zeros((n, 4), dtype=int)
        for limb, plan in self._plans.items():
            for lift, land in plan.slots:
                flying[max(lift - LEAST_GAP, 0) : land + LEAST_GAP, limb] = 1
        cost = np.zeros((n, 4))
        ordered = flying[:, self._order]
        cost[:, self._order] = _RIGHT_OF_WAY * (np.cumsum(ordered, axis=1) - ordered)
        return cost

    def _joined(self, body: Array) -> ContactPlan[WalkKnots]:
        """The limbs' answers as one eta, with the body given."""
        problem, n = self._problem, self._problem.steps
        gait = Slots(tuple(self._plans[limb].slots for limb in range(4))).gait(n + 1)
        done = [0] * 4
        spots = list(problem.start_feet_w_m)
        for step in gait.steps:
            spots.append(self._plans[step.limb].footholds[done[step.limb]])
            done[step.limb] += 1
        forces = np.stack([self._plans[limb].forces for limb in range(4)], axis=1)
        knots = WalkKnots(gait, body, forces, np.array(spots), problem, np.inf, np.inf, np.zeros((n, 4, 3)))
        return ContactPlan(Eta.of_points(body, knots.feet(problem.step_height_m), forces), knots)


def _right_of_way(problem: WalkProblem) -> list[int]:
    """The order of the feet in the cheapest regular gait, which is one that leaves the body in balance."""
    try:
        gait = FlatSearch(problem).begin(np.inf).gait
    except InfeasibleError:
        return _USUAL_ORDER
    return list(dict.fromkeys(step.limb for step in gait.steps)) or _USUAL_ORDER
