"""Where the ends of a climb are best: which pose of the goal's to aim at, and where on their holds grippers start.

A goal may have holds in reach only at one edge of what its tolerances allow: poses are aimed at that leave every limb
the most. A scenario names hold and faces of a start grasp; grippers on neighbouring holds may need places off the
middle so that one of them can leave.
"""

import itertools
from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np

from crux_planner.model.arrays import Array, Flags
from crux_planner.model.hands import UPRIGHT, hands_of, rotations
from crux_planner.model.kinematics import rotation_from_rpy
from crux_planner.model.poses import within_limits
from crux_planner.model.problem import Goal, Pose, Problem
from crux_planner.model.schedule import Stance
from crux_planner.reach.poses import GripperPoses
from crux_planner.reach.protocol import Reach
from crux_planner.search.equilibrium import StaticEquilibrium
from crux_planner.swing.swing_cache import SwingCache

_SAMPLES = 4000
_USED_SHARE, _LEFT_SHARE = 0.93, 0.06  # of the tolerances: for the aim, and around it
_STRAYING = 1.0  # share of a limb's choice that the whole tolerance is worth


def aims(problem: Problem, reaches: Sequence[Reach]) -> Iterator[Problem]:
    """The problem with goal poses, turned but not tilted off the goal's, that leave every limb holds by its map: those
    first that leave most, each with contacts in reach that none before has.
    """
    goal = problem.goal
    share = _unit_balls(_SAMPLES)
    share[:, 1, :2] = 0.0
    position = goal.body.position_m + _USED_SHARE * goal.tolerance_m * share[:, 0]
    rpy = goal.body.rpy_rad + _USED_SHARE * goal.tolerance_rad * share[:, 1]
    seen = _seen(hands_of(np.array([c.pose for c in problem.contacts])), position, rpy)
    reached = np.stack([reach.reaches(seen) for reach in reaches], axis=1) & _usable(problem, rpy[:, 2])
    worth = _worth(problem, reached, share)
    known = np.zeros(reached.shape[1:], dtype=bool)
    for best in np.argsort(-worth, kind="stable").tolist():
        if not np.isfinite(worth[best]):
            return
        if (reached[best] & ~known).any():
            known |= reached[best]
            yield _aimed_at(problem, position[best], rpy[best])


def _seen(hands: Array, position: Array, rpy_rad: Array) -> GripperPoses:
    """Hands (C, 4 or 6) as bodies (n, 3) with roll, pitch and yaw (n, 3) have them, (n, C)."""
    roll, pitch, yaw_rad = rpy_rad.T
    cos, sin = np.cos(yaw_rad[:, None]), np.sin(yaw_rad[:, None])
    east, north, up = np.moveaxis(hands[:, :3] - position[:, None], 2, 0)
    ahead, aside, yaw = cos * east + sin * north, cos * north - sin * east, hands[:, 3] - yaw_rad[:, None]
    if hands.shape[1] == UPRIGHT:
        return GripperPoses(ahead, aside, up, yaw, roll[:, None], pitch[:, None])
    back = np.swapaxes(rotation_from_rpy(rpy_rad), 1, 2)[:, None]
    place = (back @ (hands[:, :3] - position[:, None])[..., None])[..., 0]
    return GripperPoses.of(place, back @ rotations(hands), yaw)


def _aimed_at(problem: Problem, position: Array, rpy: Array) -> Problem:
    goal = problem.goal
    there = Goal(Pose(position, rpy), _LEFT_SHARE * goal.tolerance_m, _LEFT_SHARE * goal.tolerance_rad, goal.grasps)
    return replace(problem, goal=there)


def _worth(problem: Problem, reached: Flags, share: Array) -> Array:
    """(n,) of goal poses, by the holds in reach there (n, 4, C) and how far they stray; -inf where a limb has none."""
    holds = np.array([c.hold for c in problem.contacts])
    starts = np.unique(holds, return_index=True)[1]
    order = np.argsort(holds, kind="stable")
    by_hold = np.logical_or.reduceat(reached[..., order], np.searchsorted(holds[order], holds[starts]), axis=2)
    choice = by_hold.sum(axis=2)  # (n, 4) holds
    worth = np.where(choice > 0, np.log(np.maximum(choice, 1)), -np.inf).sum(axis=1)
    return np.asarray(worth - _STRAYING * np.linalg.norm(share, axis=2).sum(axis=1))


def _unit_balls(count: int) -> Array:
    """Points (count, 2, 3) of two unit balls, the middle first, more towards the rims; always the same ones."""
    random = np.random.default_rng(0)
    points = random.normal(size=(count, 2, 3))
    points *= (random.random((count, 2)) ** (1 / 6) / np.linalg.norm(points, axis=2))[..., None]
    points[0] = 0.0
    return points


def _usable(problem: Problem, yaw: Array) -> Flags:
    """(n, 4, C) whether a limb may use a contact at headings (n,), and end on it."""
    low, high = problem.gripper_yaw_rad
    fingers = np.array([c.spines_only for c in problem.contacts])
    may = fingers == fingers[list(problem.start_contacts), None]  # (4, C)
    may &= np.array([[problem.may_end(limb, c) for c in problem.contacts] for limb in range(4)])
    turned = np.array([c.yaw_rad for c in problem.contacts]) - yaw[:, None]
    return np.asarray(may & ((turned >= low) & (turned <= high))[:, None])


def clear_start(problem: Problem, swings: SwingCache) -> Stance | None:
    """The start's contacts with the least way off the middle such that all grippers keep clear; None if none does.

    `problem` has contacts off the middle; what it starts on is in the middle.
    """
    start = problem.start_contacts
    options = []
    for limb, centred in enumerate(start):
        own = problem.limb_masses[limb].limb
        wanted = problem.contacts[centred]
        near = []
        for i, c in enumerate(problem.contacts):
            if (c.hold, c.finger1_face, c.spines_only) != (wanted.hold, wanted.finger1_face, wanted.spines_only):
                continue
            aside = float(np.linalg.norm(c.centre_h_m - wanted.centre_h_m))
            if c.yaw_rad == wanted.yaw_rad and within_limits(own, problem.start, c.pose):
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
