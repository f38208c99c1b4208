"""Contacts and gripper poses at the knots, for swings that have their times."""

import numpy as np

from crux_planner.model.arrays import Array
from crux_planner.model.problem import Problem
from crux_planner.model.schedule import Swinging
from crux_planner.swing.swing_cache import SwingCache


def grippers_at_knots(
    problem: Problem, swings: SwingCache, airborne: list[Swinging]
) -> tuple[list[list[int | None]], Array]:
    """Contacts and poses of a schedule for swings, those of one limb in the order of time."""
    total = problem.steps + 1
    contacts: list[list[int | None]] = [[None] * 4 for _ in range(total)]
    poses = np.zeros((total, 4, len(problem.contacts[0].pose)))
    for limb in range(4):
        current, since = problem.start_contacts[limb], 0
        for each in [swing for swing in airborne if swing.limb == limb]:
            _stand(problem, contacts, poses, limb, current, since, each.first)
            way = swings.way(each.start, each.goal)
            poses[each.first : each.end, limb] = way.poses(each.end - each.first)[:-1]
            if not way.start.bears:
                poses[each.first, limb, 4] = way.start.open_m
            current, since = each.goal, each.end
        _stand(problem, contacts, poses, limb, current, since, total)
    return contacts, poses


def _stand(
    problem: Problem, contacts: list[list[int | None]], poses: Array, limb: int, contact: int, first: int, end: int
) -> None:
    grasp = problem.contacts[contact]
    poses[first:end, limb] = grasp.pose
    if not grasp.bears:
        poses[1:end, limb, 4] = grasp.open_m  # its fingers open in the first interval
        return
    for k in range(first, end):
        contacts[k][limb] = contact
