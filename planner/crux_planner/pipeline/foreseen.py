"""Joints that a plan takes beyond their limits between its knots, seen before the check at a small part of its cost."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from crux_contracts.interpolation import PlanReference

from crux_planner.checker import Violation
from crux_planner.model.arrays import Array
from crux_planner.model.hands import rotations
from crux_planner.model.kinematics import rotation_from_rpy
from crux_planner.reach.poses import GripperPoses
from crux_planner.reach.protocol import Reach

_SHARES = np.arange(1, 8) / 8  # of an interval, looked at


def beyond_limits(plan: PlanReference, reaches: Sequence[Reach]) -> list[Violation]:
    """As the check reports them: one for each time in which a joint is beyond, where it is so most [rad]. Of limbs with
    a closed form; those of others cost as much as the check.
    """
    times = (plan.time_s[:-1, None] + _SHARES * plan.step_s[:, None]).ravel()
    place, rpy = plan.body(times)
    to_body = np.swapaxes(rotation_from_rpy(rpy), -1, -2)
    found: list[Violation] = []
    for number, reach in enumerate(reaches):
        if not reach.limb.closed_form:
            continue
        hands = _hands(plan, number)
        seen = (to_body @ (hands[:, :3] - place)[..., None])[..., 0]
        poses = GripperPoses.of(seen, to_body @ rotations(hands), hands[:, 3] - rpy[:, 2])
        q = reach.angles(poses)
        beyond = np.maximum(reach.limb.lower_rad - q, q - reach.limb.upper_rad)
        for joint, name in enumerate(reach.limb.joint_names):
            out = np.flatnonzero(beyond[:, joint] > 0.0)
            for run in np.split(out, np.flatnonzero(np.diff(out) > 1) + 1):
                if len(run):
                    worst = run[np.argmax(beyond[run, joint])]
                    at = float(times[worst]), float(beyond[worst, joint])
                    found.append(Violation("joint_position", reach.limb.name, None, *at, "rad", name, joint))
    return found


def _hands(plan: PlanReference, limb: int) -> Array:
    """(n, 6) of a limb, as `model.hands` has them, in W."""
    parts = [plan.limb(limb, k, _SHARES) for k in range(plan.intervals)]
    places, yaws, tilts = (
        np.concatenate([getattr(part, name) for part in parts]) for name in ("position_w_m", "yaw_w_rad", "tilt_w_rad")
    )
    return np.column_stack([places, yaws, tilts])
