"""What the exact P1 starts from and what it gives, whichever method solves it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from crux_planner.model.arrays import Array
from crux_planner.model.gait import WalkMotion
from crux_planner.model.problem import BODY_STATES, Problem

if TYPE_CHECKING:
    from crux_planner.search.body_path import BodyPath

Place = tuple[int, int]
"""A knot and a limb in stance there."""


@dataclass(frozen=True)
class Solution:
    """Body states (N + 1, 12), wrenches q = (s1, s2, m, n1, n2) per knot and limb in stance, and how it went."""

    body: Array
    wrenches: list[dict[int, Array]]
    cost: float
    iterations: int
    status: str
    solved: bool
    position_residual_m: float
    force_residual_N: float
    torque_shares: dict[Place, float]  # largest joint torque in a knot's interval over its limit, by limb in stance
    torque_limits_Nm: Array  # (4, S) those limits: the problem's usual or its last
    columns: Array | None = None  # (N, 4, 8) of the exact P1: scaled wrenches and the spines' shares

    @property
    def start(self) -> Start:
        """Where a problem much like this one starts."""
        return Start(self.body, self.wrenches, near=True, columns=self.columns)


@dataclass(frozen=True)
class WalkSolution(WalkMotion):
    """A motion and how it went."""

    cost: float
    iterations: int
    status: str
    solved: bool
    position_residual_m: float
    force_residual_N: float


@dataclass(frozen=True)
class Start:
    """Where the solver starts: body, wrenches and columns as in `Solution`; `near`: of a problem much like this one;
    `clear`: body poses (N + 1, 6) nearby at which links keep off each other, where they need not in `body`.
    """

    body: Array
    wrenches: list[dict[int, Array]]
    near: bool = False
    columns: Array | None = None
    clear: Array | None = None


def start_from_path(problem: Problem, path: BodyPath, rpy_rad: Array | None = None) -> Start:
    """The quasi-static path, as `start_from_positions` has it."""
    wrenches = [{limb: to_normals(w) for limb, w in knot.items()} for knot in path.wrenches]
    return start_from_positions(problem, path.positions, wrenches, rpy_rad)


def start_from_positions(
    problem: Problem, positions: Array, wrenches: list[dict[int, Array]], rpy_rad: Array | None = None
) -> Start:
    """A body at `positions` (N + 1, 3) that turns evenly, or as given (N + 1, 3); velocities from the steps."""
    n = problem.steps
    body = np.zeros((n + 1, BODY_STATES))
    body[:, 0:3] = positions
    body[:, 3:6] = np.linspace(problem.start.rpy_rad, problem.goal.body.rpy_rad, n + 1)
    if rpy_rad is not None:
        body[:, 3:6] = rpy_rad
        body[:-1, 9:] = np.diff(rpy_rad, axis=0) / problem.dt_s
    body[:-1, 6:9] = np.diff(positions, axis=0) / problem.dt_s
    return Start(body, wrenches)


def to_normals(w: Array) -> Array:
    """A gripper's q = (s1, s2, m, n1, n2) from (s1, s2, m, F, n): net normal force, and the smaller of the two."""
    s1, s2, m, net, least = w
    return np.array([s1, s2, m, least + max(net, 0.0), least + max(-net, 0.0)])
