"""Which foot steps when, where its footholds nominally are, and how far a step may lead."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np
from crux_contracts import LIMB_NAMES

from crux_planner.model.arrays import Array, Flags
from crux_planner.model.kinematics import rotation_z
from crux_planner.model.walk_problem import WalkProblem

LEAST_AIR = 3  # knots
SPEED_SHARE = 0.95


@dataclass(frozen=True)
class Step:
    """One foot's step: in the air at the knots lift..land - 1, on its new foothold from knot `land`."""

    limb: int
    lift: int
    land: int

    def shares(self) -> tuple[Array, Array]:
        """Way (0..1) and height (0..1) at the knots lift..land; both begin and end at rest."""
        u = np.linspace(0.0, 1.0, self.land - self.lift + 1)
        return u * u * (3 - 2 * u), (4 * u * (1 - u)) ** 2.5


@dataclass(frozen=True)
class Gait:
    """Steps in the order of their beginning, over the knots 0..N; `shares` (S,) of the whole way after each step."""

    steps: tuple[Step, ...]
    shares: Array
    knots: int

    @property
    def names(self) -> list[str]:
        """Limbs in the order in which they lift off; limbs that lift off together joined by +."""
        groups = itertools.groupby(self.steps, key=lambda step: step.lift)
        return ["+".join(LIMB_NAMES[step.limb] for step in group) for _, group in groups]

    @property
    def stance(self) -> Flags:
        """(N + 1, 4)."""
        on = np.ones((self.knots, 4), dtype=bool)
        for step in self.steps:
            on[step.lift : step.land, step.limb] = False
        return on

    @property
    def blend(self) -> Array:
        """(N + 1, 4, 4 + S): footholds' shares in the foot's plan position; the 4 start footholds come first."""
        weights = np.zeros((self.knots, 4, 4 + len(self.steps)))
        weights[:, np.arange(4), np.arange(4)] = 1.0
        last = list(range(4))
        for i, step in enumerate(self.steps):
            way, _ = step.shares()
            weights[step.lift :, step.limb] = 0.0
            weights[step.lift : step.land + 1, step.limb, last[step.limb]] = 1.0 - way
            weights[step.lift : step.land + 1, step.limb, 4 + i] = way
            weights[step.land + 1 :, step.limb, 4 + i] = 1.0
            last[step.limb] = 4 + i
        return weights

    @property
    def height(self) -> Array:
        """(N + 1, 4) of the feet, as a share of the step height."""
        z = np.zeros((self.knots, 4))
        for step in self.steps:
            z[step.lift : step.land + 1, step.limb] = step.shares()[1]
        return z

    def yaw(self, goal_yaw: float) -> Array:
        """(N + 1, 4) of the feet: turned on with the way, step by step."""
        turned = np.concatenate([np.zeros(4), self.shares]) * goal_yaw
        return np.asarray(self.blend @ turned)


@dataclass(frozen=True)
class WalkMotion:
    """A gait with body states (N + 1, 12), foot forces (N, 4, 3) [N] and footholds (4 + S, 2), the start's first."""

    gait: Gait
    body: Array
    forces: Array
    footholds: Array

    def feet(self, step_height_m: float) -> Array:
        """(N + 1, 4, 3)."""
        plan = self.gait.blend @ self.footholds
        return np.concatenate([plan, step_height_m * self.gait.height[..., None]], axis=2)

    def halfway(self, other: WalkMotion) -> WalkMotion:
        """Between this one and another one by the same gait."""
        both = zip((self.body, self.forces, self.footholds), (other.body, other.forces, other.footholds), strict=True)
        return WalkMotion(self.gait, *((one + two) / 2 for one, two in both))


def longest_step(problem: WalkProblem, step: Step) -> float:
    """How long a step may be [m] for the foot's mean speed over every interval."""
    way, lift = (np.abs(np.diff(shares)) for shares in step.shares())
    share = SPEED_SHARE * problem.paces[step.limb]
    slack = (share * problem.foot_speed_m_s * problem.dt_s) ** 2 - (problem.step_height_m * lift) ** 2
    return float(np.sqrt((np.maximum(slack, 0.0) / way**2).min()))


def most_turn(problem: WalkProblem, step: Step) -> float:
    """How far a foot may turn in a step [rad] for its mean rate over every interval."""
    rate = SPEED_SHARE * problem.paces[step.limb] * problem.foot_yaw_rate_rad_s
    return rate * problem.dt_s / float(np.abs(np.diff(step.shares()[0])).max())


def nominal_footholds(problem: WalkProblem, gait: Gait) -> Array:
    """(4 + S, 2): each foot keeps its place relative to the body on the straight way."""
    start, goal = problem.start, problem.goal.body
    places = list(problem.start_feet_h_m)
    for step, share in zip(gait.steps, gait.shares, strict=True):
        offset = problem.start_feet_h_m[step.limb] - start.position_m[:2]
        turned = rotation_z(share * float(goal.rpy_rad[2]))[:2, :2] @ offset
        places.append(start.position_m[:2] + share * (goal.position_m - start.position_m)[:2] + turned)
    return np.array(places)


def progress(problem: WalkProblem, gait: Gait) -> tuple[Array, Array]:
    """Knots and the share of the way at each: straight from the first lift-off to the last touch-down."""
    if not gait.steps:
        return np.array([0.0, problem.steps]), np.array([0.0, 1.0])
    first, end = min(s.lift for s in gait.steps), max(s.land for s in gait.steps)
    return np.array([0.0, first, end, problem.steps + 1.0]), np.array([0.0, 0.0, 1.0, 1.0])
