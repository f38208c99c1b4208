"""Joint torques of a limb in stance: what its motors need to carry a gripper wrench and the limb's own weight.

tau_i = -axis_i . ((c - o_i) x F + M) - sum_j axis_i . ((com_j - o_i) x m_j g), with joint origins o_i and axes from
model.limb.
"""

from __future__ import annotations

from typing import Any

import casadi as ca

from crux_planner.model.limb import JOINTS, LimbMasses, combined, cross, dot, placed
from crux_planner.physics.dynamics import gripper_wrench, next_pose, rotation

INTERVAL_TORQUES = 2 * JOINTS


def joint_torques(
    masses: LimbMasses, r: Any, theta: Any, centre: Any, axis: Any, force: Any, moment: Any, gravity: Any
) -> Any:
    """Torques (6,) [Nm] at body pose (r, theta), gripper at `centre` with opening axis `axis`, upright on the wall.

    `force` and `moment` act on the robot at the gripper's centre; all in W (casadi).
    """
    to_b = rotation(theta).T
    gripper, up, along = (_parts(v) for v in (to_b @ (centre - r), to_b[:, 2], to_b @ axis))
    gravity_b, force_b, twist = (_parts(to_b @ v) for v in (gravity, force, moment))
    limb = placed(masses, gripper, up, along)
    loads = [(depth, place, combined((mass, gravity_b))) for depth, place, mass in limb.links]
    loads.append((JOINTS, gripper, force_b))
    torques = []
    for i, (origin, axis_i) in enumerate(zip(limb.origins, limb.axes, strict=True)):
        total = twist
        for depth, place, load in loads:
            if depth > i:
                total = combined((1.0, total), (1.0, cross(combined((1.0, place), (-1.0, origin)), load)))
        torques.append(-dot(axis_i, total))
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


def _parts(v: Any) -> tuple[Any, Any, Any]:
    return v[0], v[1], v[2]
