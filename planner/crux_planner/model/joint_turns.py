"""How far the joints of a limb turn as its gripper moves, and how stiff their position gains make it.

Near a singular posture they turn far for little: speeds, and what errors of joints and places cause, grow with it, and
the stiffness with its square.
"""

from dataclasses import dataclass

import numpy as np
from crux_contracts.robot import Limb

from crux_planner.model.arrays import Array
from crux_planner.model.chain import POSE, forward

_DAMPING = 1e-10  # of the inverse Jacobian: of singular postures it is large, not infinite


@dataclass(frozen=True)
class JointTurns:
    """Of n postures, whatever way the gripper moves along.

    `most_rad_m` (n, J): what each joint turns for a metre of it. `stiffness_N_m` (n,): with what force the joints'
    stiffness pulls at it, for a metre that it is off.
    """

    most_rad_m: Array
    stiffness_N_m: Array


def joint_turns(limb: Limb, q_rad: Array, stiffness_Nm_rad: Array) -> JointTurns:
    """At angles (n, S), with the stiffness (n, J, J) of its joints. Of limbs of seven joints it is about the
    least turns, of those of fewer than six about what their joints do of a motion.
    """
    jacobian = forward(limb.at_zero, q_rad).jacobian()
    back = np.swapaxes(jacobian, 1, 2)
    inverse = back @ np.linalg.inv(jacobian @ back + _DAMPING * np.eye(POSE))
    turns = inverse[:, : len(limb.joints), :3]
    stiffness = np.swapaxes(turns, 1, 2) @ stiffness_Nm_rad @ turns
    return JointTurns(np.linalg.norm(turns, axis=2), np.asarray(np.linalg.eigvalsh(stiffness)[:, -1]))
