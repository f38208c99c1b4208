"""Joint torques of a limb in stance: what its motors need to carry a gripper wrench and the limb's own weight.

tau_i = -axis_i . ((c - o_i) x F + M) - sum_j axis_i . ((com_j - o_i) x m_j g), with joint origins o_i and axes from the
closed-form inverse kinematics written without angles: the elbow is a corner of a triangle, the wrist's axes are cross
products. Smooth wherever the limb is neither stretched nor folded.
"""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from crux_planner.model.limits import LimbMasses
from crux_planner.physics.dynamics import gripper_wrench, next_pose, rotation

JOINTS = 6
INTERVAL_TORQUES = 2 * JOINTS


def joint_torques(
    masses: LimbMasses, r: Any, theta: Any, centre: Any, axis: Any, force: Any, moment: Any, gravity: Any
) -> Any:
    """Torques (6,) [Nm] at body pose (r, theta), gripper at `centre` with opening axis `axis`, upright on the wall.

    `force` and `moment` act on the robot at the gripper's centre; all in W (casadi).
    """
    limb = masses.limb
    to_b = rotation(theta).T
    up = to_b[:, 2]
    gripper = to_b @ (centre - r)
    shoulder = ca.DM(limb.shoulder_b_m)
    wrist = gripper + limb.wrist_to_gripper_m * up
    elbow, out = _elbow(wrist - shoulder, limb.upper_link_m, limb.lower_link_m)
    elbow = shoulder + elbow
    side = ca.vertcat(-out[1], out[0], 0)  # y of the yawed limb
    roll = _unit(ca.cross(side, up))
    body_z = ca.DM([0, 0, 1])
    origins = [shoulder, shoulder, elbow, wrist, wrist, wrist]
    axes = [body_z, -side, side, side, roll, up]

    along_x = to_b @ axis
    hand_x = _turned(along_x, up, -limb.gripper_mount_rad)
    frames = [
        (shoulder, ca.vertcat(out, 0), side),
        (shoulder, (elbow - shoulder) / limb.upper_link_m, side),
        (elbow, (wrist - elbow) / limb.lower_link_m, side),
        (wrist, roll, side),
        (wrist, roll, ca.cross(up, roll)),
        (wrist, hand_x, ca.cross(up, hand_x)),
    ]
    gravity_b = to_b @ gravity
    loads = []  # (number of joints before it, place, force)
    for depth, ((origin, x, y), link) in enumerate(zip(frames, masses.links, strict=True), start=1):
        com = origin + link.com_m[0] * x + link.com_m[1] * y + link.com_m[2] * ca.cross(x, y)
        loads.append((depth, com, link.mass_kg * gravity_b))
    hand = limb.hand_com_g_m
    hand_com = gripper + hand[0] * along_x + hand[1] * ca.cross(up, along_x) + hand[2] * up
    loads.append((JOINTS, hand_com, limb.hand_mass_kg * gravity_b))
    loads.append((JOINTS, gripper, to_b @ force))
    twist = to_b @ moment
    torques = []
    for i, (origin, axis_i) in enumerate(zip(origins, axes, strict=True)):
        total = twist
        for depth, place, load in loads:
            if depth > i:
                total = total + ca.cross(place - origin, load)
        torques.append(-ca.dot(axis_i, total))
    return ca.vertcat(*torques)


def interval_torques(masses: LimbMasses, x: Any, q: Any, grasp: Any, gravity: Any, dt: float) -> Any:
    """Torques (12,) [Nm] at both ends of a knot's interval: its wrench q is held from the knot's body state x (12) on
    until the next pose. `grasp` (9) is centre, opening axis, tangent (casadi).
    """
    centre, axis, tangent = grasp[0:3], grasp[3:6], grasp[6:9]
    force, _ = gripper_wrench(q, centre, axis, tangent)
    ends = []
    for pose in (x[:6], next_pose(x, dt)):
        ends.append(joint_torques(masses, pose[0:3], pose[3:6], centre, axis, force, 2 * q[2] * axis, gravity))
    return ca.vertcat(*ends)


def _elbow(wrist: Any, upper: float, lower: float) -> tuple[Any, Any]:
    """Elbow (3,) and the limb's horizontal direction (2,) for a wrist position, both positions from the shoulder."""
    radius = ca.sqrt(wrist[0] ** 2 + wrist[1] ** 2)
    out = wrist[:2] / radius
    squared = radius**2 + wrist[2] ** 2
    share = (upper**2 - lower**2 + squared) / (2 * squared)  # foot of the elbow's height on the line to the wrist
    height = ca.sqrt(upper**2 / squared - share**2)  # as a share of that line
    return ca.vertcat((share * radius - height * wrist[2]) * out, share * wrist[2] + height * radius), out


def _unit(v: Any) -> Any:
    return v / ca.sqrt(ca.sumsqr(v))


def _turned(v: Any, about: Any, angle: float) -> Any:
    """A vector turned about a unit vector perpendicular to it."""
    return np.cos(angle) * v + np.sin(angle) * ca.cross(about, v)
