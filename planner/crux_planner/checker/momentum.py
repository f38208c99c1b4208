"""The whole robot's centre of mass along the plan, limbs counted as inverse kinematics places them."""

from __future__ import annotations

from crux_planner.checker.geometry import Array, turned
from crux_planner.checker.limb_model import ChainState, WholeRobot
from crux_planner.checker.sampling import Samples


def centre_of_mass(samples: Samples, robot: WholeRobot, states: list[ChainState]) -> Array:
    """Centre of mass (T, 3) in W."""
    return samples.body_position + turned(samples.rotation, robot.centre_of_mass(states))
