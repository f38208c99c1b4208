"""Inverse kinematics of a limb: in closed form of yaw - pitch - pitch - spherical wrist (pitch, roll, yaw), elbow up,
else numeric (see chain.py).

Everything is vectorised over any leading shape, in the body frame, and knows the robot only through its description.
"""

import numpy as np
from crux_contracts.robot import Limb

from crux_planner.model.arrays import Array, Flags
from crux_planner.model.chain import chain_inverse

_STRAIGHT_ELBOW_COS = 0.9995  # beyond it the limb is stretched or folded: no elbow angle, the Jacobian is singular


def rotation_z(angle_rad: Array | float) -> Array:
    """Rotation about z, shape (..., 3, 3)."""
    angle = np.asarray(angle_rad, dtype=float)
    c, s = np.cos(angle), np.sin(angle)
    zero, one = np.zeros_like(c), np.ones_like(c)
    return _matrix((c, -s, zero), (s, c, zero), (zero, zero, one))


def rotation_from_rpy(rpy_rad: Array) -> Array:
    """R(theta) = Rz Ry Rx, H <- B, of roll-pitch-yaw (..., 3), complex too; shape (..., 3, 3)."""
    rpy = np.asarray(rpy_rad)
    cr, cp, cy = (np.cos(rpy[..., i]) for i in range(3))
    sr, sp, sy = (np.sin(rpy[..., i]) for i in range(3))
    return _matrix(
        (cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr),
        (sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr),
        (-sp, cp * sr, cp * cr),
    )


def inverse(limb: Limb, position_b_m: Array, rotation_b: Array) -> tuple[Array, Flags]:
    """Joint angles (..., S), elbow up and wrist unflipped, and whether the pose is within the links' reach (...).

    Where it is not, the angles are those of the stretched (or folded) limb. Joint limits are not looked at: see
    `limit_margin`. The last joint comes as the angle nearest to the middle of its range. Of limbs without a closed form
    see ChainInverse.
    """
    if not limb.closed_form:
        return chain_inverse(limb).inverse(np.asarray(position_b_m, dtype=float), np.asarray(rotation_b, dtype=float))
    position, rotation = np.asarray(position_b_m, dtype=float), np.asarray(rotation_b, dtype=float)
    wrist = position + limb.wrist_to_gripper_m * rotation[..., :, 2] - limb.shoulder_b_m
    azimuth = np.arctan2(wrist[..., 1], wrist[..., 0])
    radius, height = np.hypot(wrist[..., 0], wrist[..., 1]), wrist[..., 2]
    l1, l2 = limb.upper_link_m, limb.lower_link_m
    cos_elbow = (radius**2 + height**2 - l1**2 - l2**2) / (2 * l1 * l2)
    reached = np.abs(cos_elbow) <= _STRAIGHT_ELBOW_COS
    q3 = np.arccos(np.clip(cos_elbow, -_STRAIGHT_ELBOW_COS, _STRAIGHT_ELBOW_COS))
    q2 = np.arctan2(height, radius) + np.arctan2(l2 * np.sin(q3), l1 + l2 * np.cos(q3))
    hand = np.swapaxes(_forearm_rotation(azimuth, q2 - q3), -1, -2) @ rotation
    q4 = np.arctan2(hand[..., 0, 2], hand[..., 2, 2])
    q5 = -np.arcsin(np.clip(hand[..., 1, 2], -1.0, 1.0))
    q6 = np.arctan2(hand[..., 1, 0], hand[..., 1, 1]) - limb.gripper_mount_rad
    q1 = wrap_near(azimuth - limb.mount_rad, _middle(limb, 0))
    return np.stack([q1, q2, q3, q4, q5, wrap_near(q6, _middle(limb, 5))], axis=-1), reached


def limit_margin(limb: Limb, q_rad: Array) -> Array:
    """Distance of the tightest joint from its limits (...), negative outside [rad]; and where the gripper is turned in
    a way that the limb has no joint for.
    """
    q, own = np.asarray(q_rad, dtype=float), len(limb.joints)
    off = np.minimum(q - limb.lower_rad, limb.upper_rad - q)
    margin = off[..., :own].min(axis=-1)
    return np.asarray(margin if not limb.still else np.minimum(margin, _inside_or_out(off[..., own:].min(axis=-1))))


def joint_margin(limb: Limb, q_rad: Array) -> Array:
    """The same (...) of the limb's own joints alone, as if its gripper could be turned in all ways."""
    own = len(limb.joints)
    off = np.minimum(q_rad - limb.lower_rad, limb.upper_rad - q_rad)
    return np.asarray(off[..., :own].min(axis=-1))


def _inside_or_out(off: Array) -> Array:
    """Infinite where it is not below zero: turns are allowed or not, and have no margin."""
    return np.where(off >= 0.0, np.inf, off)


def wrap_near(angle_rad: Array | float, centre_rad: Array | float) -> Array:
    """The angle plus the whole turns that bring it within half a turn of `centre_rad`."""
    return np.asarray(centre_rad + (np.asarray(angle_rad, dtype=float) - centre_rad + np.pi) % (2 * np.pi) - np.pi)


def _middle(limb: Limb, joint: int) -> float:
    return float(limb.lower_rad[joint] + limb.upper_rad[joint]) / 2


def _forearm_rotation(azimuth: Array, elevation: Array) -> Array:
    """Rz(azimuth) Ry(-elevation): x along the lower link."""
    ca, sa, ce, se = np.cos(azimuth), np.sin(azimuth), np.cos(elevation), np.sin(elevation)
    return _matrix((ca * ce, -sa, -ca * se), (sa * ce, ca, -sa * se), (se, np.zeros_like(se), ce))


def _matrix(*rows: tuple[Array, Array, Array]) -> Array:
    """Of entries (...) of one shape, as np.stack, which takes ten times as long for one matrix."""
    first = np.asarray(rows[0][0])
    found = np.empty((*first.shape, 3, 3), dtype=first.dtype)
    for i, row in enumerate(rows):
        for j, entry in enumerate(row):
            found[..., i, j] = entry
    return found
