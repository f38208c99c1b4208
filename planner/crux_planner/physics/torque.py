"""Joint torques of a limb in stance: what its motors need to carry a gripper wrench and the limb's own weight.

tau_i = -axis_i . ((c - o_i) x F + M) - sum_j axis_i . ((com_j - o_i) x m_j g), with joint origins o_i and axes from
model.limb.
"""

from functools import cache
from typing import Any

import casadi as ca

from crux_planner.model.limb import NUMBERS, placed
from crux_planner.model.placed_limb import combined, cross, dot
from crux_planner.physics.dynamics import WRENCH_INPUTS, gripper_wrench, rotation

GRASP, UP, LEANING = 9, 3, 3 * WRENCH_INPUTS
"""Numbers of a grasp: centre, axis, tangent; up, where grippers are tilted; where faces lean, rows of
Contact.leaning_moments."""


@cache
def joint_torques(size: int = NUMBERS, tilted: bool = False) -> ca.Function:
    """(numbers, pose, centre, axis, force, moment, gravity) -> torques (S,) [Nm] of a limb with LimbMasses' `numbers`
    (`size`) at a body pose (6), its gripper at `centre` with opening axis `axis`, upright on the wall; where `tilted`,
    its z axis is one more argument.

    `force` and `moment` act on the robot at the gripper's centre; all in H (casadi).
    """
    numbers, pose = ca.SX.sym("numbers", size), ca.SX.sym("pose", 6)
    names = ("centre", "axis", "force", "moment", "gravity", *(("up",) if tilted else ()))
    centre, axis, force, moment, gravity, *turned = arguments = [ca.SX.sym(name, 3) for name in names]
    r, theta = pose[:3], pose[3:]
    to_b = rotation(theta).T
    up_b = to_b @ turned[0] if tilted else to_b[:, 2]
    gripper, up, along = (_parts(v) for v in (to_b @ (centre - r), up_b, to_b @ axis))
    gravity_b, force_b, twist = (_parts(to_b @ v) for v in (gravity, force, moment))
    limb = placed(numbers, gripper, up, along)
    loads = [(depth, place, combined((mass, gravity_b))) for depth, place, mass in limb.links]
    loads.append((len(limb.axes), gripper, force_b))
    torques = []
    for i, (origin, axis_i) in enumerate(zip(limb.origins, limb.axes, strict=True)):
        total = twist
        for depth, place, load in loads:
            if depth > i:
                total = combined((1.0, total), (1.0, cross(combined((1.0, place), (-1.0, origin)), load)))
        torques.append(-dot(axis_i, total))
    return ca.Function("joint_torques", [numbers, pose, *arguments], [ca.vertcat(*torques)])


def held_torques(numbers: Any, pose: Any, q: Any, grasp: Any, gravity: Any) -> Any:
    """Torques (S,) [Nm] of a limb (its `numbers`) that holds q by `grasp` (casadi), see `GRASP`."""
    centre, axis, tangent = grasp[0:3], grasp[3:6], grasp[6:9]
    up = up_of(grasp)
    force, _ = gripper_wrench(q, centre, axis, tangent, *up)
    moment = 2 * q[2] * axis
    if grasp.shape[0] >= GRASP + LEANING:
        moment += leaning_moment(grasp, q)
    return joint_torques(numbers.shape[0], bool(up))(numbers, pose, centre, axis, force, moment, gravity, *up)


def up_of(grasp: Any) -> list[Any]:
    """(3,) way off the hold of a grasp that has it, else nothing (casadi)."""
    return [grasp[GRASP : GRASP + UP]] if grasp.shape[0] in (GRASP + UP, GRASP + UP + LEANING) else []


def leaning_moment(grasp: Any, q: Any) -> Any:
    """(3,) about the gripper's centre, of pads on leaning faces (casadi)."""
    size = grasp.shape[0]
    rows = (grasp[at : at + WRENCH_INPUTS] for at in range(size - LEANING, size, WRENCH_INPUTS))
    return ca.vertcat(*[ca.dot(row, q) for row in rows])


def _parts(v: Any) -> tuple[Any, Any, Any]:
    return v[0], v[1], v[2]
