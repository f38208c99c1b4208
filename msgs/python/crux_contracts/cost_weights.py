"""Weights of J, equation (6): one definition for whoever plans, checks or certifies."""

from __future__ import annotations

from dataclasses import dataclass, replace

from .scenario_types import Scenario


@dataclass(frozen=True)
class CostWeights:
    """What each term of J counts, a knot."""

    position: float = 1.0  # Q, on |r - r_goal|^2 [1/m^2]
    orientation: float = 1.0  # Q, on |theta - theta_goal|^2 [1/rad^2]
    velocity: float = 10.0  # Q, on the body's velocity [s^2/m^2] and rate [s^2/rad^2]
    wrench: float = 1e-4  # P, on the fingers' forces^2 and (twist / k)^2 [1/N^2]
    lift: float = 0.02  # -zeta, on the height of grippers in the air [1/m]
    opening: float = 0.02  # -xi, on the distance between their fingers [1/m]
    switching: float = 0.3  # S, on each lift-off and each touch-down


CLIMB = CostWeights()
WALK = CostWeights(velocity=0.1, lift=0.05, opening=0.0, switching=0.1)


def cost_weights(scenario: Scenario) -> CostWeights:
    """The weights of a scenario: those that its `planner.weights` gives, the usual ones else.

    `body` sets both `position` and `orientation`, where these are not given themselves.
    """
    usual, given = (WALK if scenario.contact.model == "point" else CLIMB), dict(scenario.planner.weights)
    body = given.pop("body", None)
    both = {} if body is None else {"position": body, "orientation": body}
    return replace(usual, **{**both, **given})
