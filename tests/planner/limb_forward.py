"""Where a limb's gripper is for given joint angles: what the planner's inverse kinematics must agree with."""

from __future__ import annotations

import numpy as np
from crux_contracts.robot import Limb
from crux_planner.model.arrays import Array
from scipy.spatial.transform import Rotation


def forward(limb: Limb, q_rad: Array) -> tuple[Array, Array]:
    """Gripper position (..., 3) and rotation (..., 3, 3) in the body frame for joint angles (..., 6)."""
    q = q_rad.reshape(-1, 6)
    azimuth, elevation = q[:, 0] + limb.mount_rad, q[:, 1] - q[:, 2]
    radius = limb.upper_link_m * np.cos(q[:, 1]) + limb.lower_link_m * np.cos(elevation)
    height = limb.upper_link_m * np.sin(q[:, 1]) + limb.lower_link_m * np.sin(elevation)
    wrist = limb.shoulder_b_m + np.stack([np.cos(azimuth) * radius, np.sin(azimuth) * radius, height], axis=-1)
    forearm = Rotation.from_euler("ZY", np.stack([azimuth, -elevation], axis=-1))
    hand = Rotation.from_euler("YXZ", q[:, 3:] + [0.0, 0.0, limb.gripper_mount_rad])
    turn = (forearm * hand).as_matrix()
    place = wrist - limb.wrist_to_gripper_m * turn[..., 2]
    return place.reshape(*q_rad.shape[:-1], 3), turn.reshape(*q_rad.shape[:-1], 3, 3)
