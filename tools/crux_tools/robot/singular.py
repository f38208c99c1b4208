"""Whether a limb is singular between places that it reaches, as an arm is whose wrist gets into one line."""

from __future__ import annotations

import numpy as np
from crux_contracts.robot_bounds import JOINTS
from crux_planner.checker.inverse_kinematics import arm_of
from crux_planner.checker.limb_model import Limb
from numpy.typing import NDArray

Array = NDArray[np.float64]
LEAST_SHARE = 0.02  # of the postures on the other side of a singular one
STEP_RAD = 1e-4  # of a joint, to either side
FAST = 0.3  # of what turns at a singular posture with the gripper at rest, the least share of a joint


def singular_within(limb: Limb, q_rad: Array, kept_rad: Array | None = None) -> str:
    """Where a limb of six joints is singular between postures (n, J), those within (2, J), and what keeps plans off:
    det J changes its sign. Empty where it does not.
    """
    if kept_rad is not None:
        q_rad = q_rad[((q_rad >= kept_rad[0]) & (q_rad <= kept_rad[1])).all(axis=1)]
    if len(limb.joints) != JOINTS or len(q_rad) == 0:
        return ""
    arm, _ = arm_of(limb)
    jacobian = arm.forward(q_rad)[2]
    share = float((np.linalg.det(jacobian) > 0).mean())
    if min(share, 1.0 - share) < LEAST_SHARE:
        return ""
    _, sizes, ways = np.linalg.svd(jacobian)
    least = int(sizes[:, -1].argmin())
    here, step = q_rad[least], STEP_RAD * np.eye(JOINTS)
    bends = np.linalg.det(arm.forward(here + step)[2]) - np.linalg.det(arm.forward(here - step)[2])
    cause = int(np.abs(bends).argmax())
    fast = " and ".join(limb.joints[i].name for i in np.flatnonzero(np.abs(ways[least, -1]) > FAST))
    at = f"{limb.joints[cause].name} of {round(float(here[cause]), 2) + 0.0:g} rad"
    return f"{limb.name} is singular at a {at}, where {fast} turn fast: limits on one side of it keep plans off"
