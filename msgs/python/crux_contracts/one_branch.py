"""Limits within which a limb does not pass from one solution of its inverse kinematics to another.

Where a joint makes the limb singular whatever the others do, such as an elbow that is straight, two solutions meet, and
reach ends there though no joint is at a limit. Plans keep off such an angle, on the side of the middle of the range.
The checker, the runtime and the simulation have the whole range. Where joints turn against each other with the gripper
at rest, as those of a wrist with two axes in a line, reach does not end.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from .limb_motion import motion
from .robot_bounds import JOINTS
from .robot_types import Array, Limb

BAND = 3.5e-3  # [m] or [rad] of reach that plans leave, so that they meet the joint's limit before reach ends
_POSTURES, _STEPS, _HALVINGS = 8, 60, 40  # of the other joints, of a joint's range, and of a step
_SAME_RAD = 1e-6  # between the angles at which a limb is singular in each of the postures
_NOTHING = 1e-6  # a singular value
_STEP_RAD, _LEAST_BENT = 1e-3, 1e-3  # of joints about a singular posture, and [m/rad2] that a gripper comes back there


def on_one_branch(limb: Limb) -> Limb:
    """The limb with `branch_rad`; as it is where limits are swapped, which others tell."""
    if (limb.lower_rad > limb.upper_rad).any():
        return limb
    own, middle = len(limb.joints), limb.middle_rad
    ends = np.array([limb.lower_rad, limb.upper_rad])
    postures = np.random.default_rng(0).uniform(ends[0], ends[1], (_POSTURES, len(middle)))
    postures[:, own:] = 0.0
    branch = np.tile([[-np.inf], [np.inf]], own)
    for joint in range(1, own):  # the first turns all of the limb
        for angle, off_rad in _singular_at(limb, postures, joint, ends[:, joint]):
            side = int(angle > middle[joint])
            off = angle + (-off_rad if side else off_rad)
            if ends[0, joint] < off < ends[1, joint]:
                branch[side, joint] = (min if side else max)(branch[side, joint], off)
    return replace(limb, branch_rad=branch)


def _singular_at(limb: Limb, postures: Array, joint: int, ends: Array) -> list[tuple[float, float]]:
    """Angles of a joint within its limits (2,) at which reach ends in all postures (n, S), and how far plans keep off
    them.
    """
    zero, rule = limb.at_zero, np.linalg.svd(motion(limb.at_zero, limb.middle_rad[None])[0][0])[2][JOINTS:]

    def sign_at(q_rad: Array) -> Array:
        jacobians, _ = motion(zero, q_rad)
        rules = np.broadcast_to(rule, (len(jacobians), *rule.shape))
        return np.asarray(np.sign(np.linalg.det(np.concatenate([jacobians, rules], axis=1))))

    angles = np.linspace(ends[0], ends[1], _STEPS + 1)
    posed = np.repeat(postures[:, None], len(angles), axis=1)
    posed[..., joint] = angles
    sign = sign_at(posed.reshape(-1, posed.shape[2])).reshape(posed.shape[:2])
    found = []
    for step in np.flatnonzero((sign[:, 1:] != sign[:, :-1]).all(axis=0)):
        low, high = np.full((2, _POSTURES), angles[step : step + 2, None])
        for _ in range(_HALVINGS):
            middle = (low + high) / 2
            here = np.array(postures)
            here[:, joint] = middle
            before = sign_at(here) == sign[:, step]
            low, high = np.where(before, middle, low), np.where(before, high, middle)
        here = np.array(postures)
        here[:, joint] = low
        off_rad = [_kept_off_rad(limb, each, joint) for each in here]
        if np.ptp(low) < _SAME_RAD and min(off_rad) > 0.0:
            found.append((float(low.mean()), min(off_rad)))
    return found


def _kept_off_rad(limb: Limb, q_rad: Array, joint: int) -> float:
    """How far a joint is off singular angles (S,) where the gripper has come back by BAND; 0 where the limb's own
    joints are not singular, or turn on with the gripper at rest.
    """
    own = len(limb.joints)
    ways, sizes, turns = np.linalg.svd(motion(limb.at_zero, q_rad[None])[0][0, :, :own])
    rank = int((sizes > _NOTHING).sum())
    turn = np.zeros(len(q_rad))
    turn[:own] = turns[rank:].T @ turns[rank:, joint]  # with the gripper at rest to first order, most of the joint
    if rank == min(own, JOINTS) or not turn.any():
        return 0.0
    turn /= np.linalg.norm(turn)
    there, back = motion(limb.at_zero, q_rad + _STEP_RAD * np.array([turn, -turn]))[0]
    bent = float(np.linalg.norm(ways[:, rank:].T @ (there - back) @ turn)) / (2 * _STEP_RAD)
    return abs(turn[joint]) * float(np.sqrt(2 * BAND / bent)) if bent > _LEAST_BENT else 0.0
