"""How slow the body must be: between two knots the wrenches lag behind a body that moves.

On weak supports the corrections that make up for the lag leave the limit surface; they grow with the way of the body
in one interval. The check says where. What is known is kept per set of contacts, so that other sequences over the same
stances know it too.
"""

import numpy as np

from crux_planner.model.arrays import Array
from crux_planner.model.schedule import SpeedLimits

WANTED_N = 0.3  # of excess at most; the check forgives a little more


def speeds(speed_limits: SpeedLimits, contacts: list[list[int | None]], most_m_s: float) -> Array:
    """(N + 1,) largest body speed at the knots."""
    return np.array([min(speed_limits.get(tuple(held), most_m_s), most_m_s) for held in contacts])
