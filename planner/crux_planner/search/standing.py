"""Where on their holds the start's grippers stand: in the middle, or beside it where they would be in each other's way.

A scenario names hold and faces of a start grasp. Grippers on neighbouring holds may need places off the middle so that
one of them can leave.
"""

from __future__ import annotations

import itertools

import numpy as np

from crux_planner.model.kinematics import rotation_from_rpy
from crux_planner.model.problem import Problem
from crux_planner.search.equilibrium import StaticEquilibrium
from crux_planner.swing.swing_cache import SwingCache


def clear_start(problem: Problem, swings: SwingCache) -> tuple[int, int, int, int] | None:
    """The start's contacts with the least way off the middle such that all grippers keep clear; None if none does.

    `problem` has contacts off the middle; what it starts on is in the middle.
    """
    start = problem.start_contacts
    options = []
    rotation = rotation_from_rpy(problem.start.rpy_rad)
    for limb, centred in enumerate(start):
        wanted = problem.contacts[centred]
        near = []
        for i, c in enumerate(problem.contacts):
            if (c.hold, c.finger1_face, c.spines_only) != (wanted.hold, wanted.finger1_face, wanted.spines_only):
                continue
            place = rotation.T @ (c.centre_w_m - problem.start.position_m)
            aside = float(np.linalg.norm(c.centre_w_m - wanted.centre_w_m))
            if c.yaw_rad == wanted.yaw_rad and (problem.boxes.beyond(limb, place) <= 0.0).all():
                near.append((aside, i))
        options.append(near)
    equilibrium, at = StaticEquilibrium(problem, problem.friction_share), problem.start.position_m
    for choice in sorted(itertools.product(*options), key=lambda picks: sum(aside for aside, _ in picks)):
        first, second, third, fourth = (i for _, i in choice)
        stance = (first, second, third, fourth)
        apart = all(swings.apart(a, b) for a, b in itertools.combinations(stance, 2))
        if apart and equilibrium.position(stance, at, at, at) is not None:
            return stance
    return None
