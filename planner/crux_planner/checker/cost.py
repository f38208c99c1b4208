"""J (6) of a climb as the checker counts it, from the plan's message and the scenario alone."""

from __future__ import annotations

import numpy as np
from crux_contracts.cost_weights import cost_weights
from crux_contracts.scenario import Scenario

from crux_planner.checker.plan_arrays import PlanArrays


def cost(plan: PlanArrays, scenario: Scenario) -> float:
    """J of knots 0..N: body states at all of them, wrenches over the N intervals, limbs in the air, their changes."""
    w, goal = cost_weights(scenario), scenario.goal.body
    total = w.position * ((plan.body_position - goal.position_m) ** 2).sum()
    turned = plan.body_rpy - goal.rpy_rad
    turned[:, 2] -= 2 * np.pi * np.round(turned[0, 2] / (2 * np.pi))  # the short way round from the start to the goal
    total += w.orientation * (turned**2).sum()
    total += w.velocity * ((plan.body_velocity**2).sum() + (plan.body_rate**2).sum())
    moments = (plan.touch_moment[:-1] ** 2).sum() / plan.patch_k_m**2 if plan.patch_k_m else 0.0  # points bear none
    total += w.wrench * ((plan.finger_force[:-1] ** 2).sum() + moments)
    air = ~plan.stance
    total -= w.lift * plan.gripper_position[..., 2][air].sum() + w.opening * plan.separation[air].sum()
    return float(total + w.switching * np.abs(np.diff(air.astype(int), axis=0)).sum())
