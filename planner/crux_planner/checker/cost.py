"""J (6) of a climb as the checker counts it, from the plan's message and the scenario alone."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from crux_contracts.scenario import Scenario

from crux_planner.checker.plan_arrays import PlanArrays


@dataclass(frozen=True)
class Weights:
    """Weights of (6) on a climb, those that a scenario's `planner.weights` does not name as they usually are."""

    body: float = 1.0  # Q on (r - r_goal)^2 [1/m^2]; roll, pitch and yaw have `orientation`
    orientation: float = 1.0
    velocity: float = 10.0  # Q on body velocity and rate
    wrench: float = 1e-4  # R on finger forces^2 [1/N^2] and (twist / k)^2
    lift: float = 0.02  # -zeta, on the height of grippers in the air [1/m]
    opening: float = 0.02  # -xi, on what their fingers are apart [1/m]
    switching: float = 0.3  # S, on lift-offs and touch-downs

    @staticmethod
    def of(scenario: Scenario) -> Weights:
        """Of one scenario."""
        given = scenario.planner.weights
        return Weights(**given)


def cost(plan: PlanArrays, scenario: Scenario) -> float:
    """J of knots 0..N: body states at all of them, wrenches over the N intervals, limbs in the air, their changes."""
    w, goal = Weights.of(scenario), scenario.goal.body
    total = w.body * ((plan.body_position - goal.position_m) ** 2).sum()
    total += w.orientation * ((plan.body_rpy - goal.rpy_rad) ** 2).sum()
    total += w.velocity * ((plan.body_velocity**2).sum() + (plan.body_rate**2).sum())
    moments = (plan.finger_moment[:-1] ** 2).sum() / plan.patch_k_m**2
    total += w.wrench * ((plan.finger_force[:-1] ** 2).sum() + moments)
    air = ~plan.stance
    total -= w.lift * plan.gripper_position[..., 2][air].sum() + w.opening * plan.separation[air].sum()
    return float(total + w.switching * np.abs(np.diff(air.astype(int), axis=0)).sum())
