"""Equations (8a) and (8b): centroidal dynamics, explicit Euler, H-frame forces on the robot positive.

Moments are about the centre of mass c of the whole robot, limbs counted, which follows from the poses of body and
grippers; c accelerates as the body's origin does.
"""

from collections.abc import Sequence
from functools import cache
from typing import Any

import casadi as ca
import numpy as np

from crux_planner.model.arrays import Array
from crux_planner.model.hands import TILTED, axes_of
from crux_planner.model.limb import in_reach, placed
from crux_planner.model.problem import CentroidalProblem
from crux_planner.model.walk_problem import WalkProblem

_UPRIGHT = np.array([0.0, 0.0, 1.0])
_UP = ca.DM(_UPRIGHT)
WRENCH_INPUTS = 5  # q = (s1, s2, m, n1, n2) of one gripper, see physics.limit_surface


def rotation(theta: Any) -> Any:
    """R(theta), H <- B, intrinsic z-y-x (casadi)."""
    cr, sr, cp, sp, cy, sy = (f(theta[i]) for i in range(3) for f in (ca.cos, ca.sin))
    return ca.vertcat(
        ca.horzcat(cy * cp, cy * sp * sr - sy * cr, cy * sp * cr + sy * sr),
        ca.horzcat(sy * cp, sy * sp * sr + cy * cr, sy * sp * cr - cy * sr),
        ca.horzcat(-sp, cp * sr, cp * cr),
    )


def euler_rates(theta: Any, omega_b: Any) -> Any:
    """Rates of roll, pitch, yaw for a body-frame angular velocity (casadi)."""
    cr, sr, cp, sp = ca.cos(theta[0]), ca.sin(theta[0]), ca.cos(theta[1]), ca.sin(theta[1])
    p, q, r = omega_b[0], omega_b[1], omega_b[2]
    return ca.vertcat(p + sp / cp * (sr * q + cr * r), cr * q - sr * r, (sr * q + cr * r) / cp)


def gripper_wrench(q: Any, centre: Any, normal: Any, tangent: Any, up: Any = _UP) -> tuple[Any, Any]:
    """Equation (13) with (4): force, and moment about H's origin, of one gripper (casadi), its z axis `up`.

    With f1 = n1 e + s and f2 = -n2 e + s at c + (d/2) e and c - (d/2) e the opening d drops out: the moment is
    c x (f1 + f2) + 2 m e.
    """
    force = (q[3] - q[4]) * normal + 2 * q[0] * tangent + 2 * q[1] * up
    return force, ca.cross(centre, force) + 2 * q[2] * normal


def next_pose(x: Any, dt: float) -> Any:
    """(6,) r and theta one step on: explicit Euler needs the body state alone (casadi)."""
    r, theta, v, omega = x[0:3], x[3:6], x[6:9], x[9:12]
    return ca.vertcat(r + dt * v, theta + dt * euler_rates(theta, omega))


def centre_of_mass(problem: CentroidalProblem, x: Any, hands: list[Any], numbers: Sequence[Any] | None = None) -> Any:
    """(3,) in H for a body state and hands (4 or 6) (casadi); `numbers` of the limbs where they are more
    than LimbMasses has.
    """
    to_b, moment = rotation(x[3:6]).T, ca.DM(problem.body_moment_kg_m)
    given = [limb.numbers for limb in problem.limb_masses] if numbers is None else numbers
    for own, hand in zip(given, hands, strict=True):
        axis, _, up = axes_of(hand)
        up_b = to_b[:, 2] if hand.shape[0] < TILTED else to_b @ up
        moment += _first_moment(own.shape[0])(own, to_b @ (hand[0:3] - x[0:3]), up_b, to_b @ axis)
    return x[0:3] + to_b.T @ (moment / problem.mass_kg)


@cache
def _first_moment(size: int) -> ca.Function:
    """(numbers of a limb, its gripper's centre, z axis, opening axis), in the body frame -> first moment (3,)."""
    numbers, *grip = (ca.SX.sym(*each) for each in (("numbers", size), ("g", 3), ("up", 3), ("along", 3)))
    gripper, up, along = ((v[0], v[1], v[2]) for v in grip)
    limb = placed(numbers, in_reach(numbers, gripper, up), up, along)
    return ca.Function("first_moment", [numbers, *grip], [ca.vertcat(*limb.first_moment())])


def on_feet(problem: WalkProblem, feet: Any, yaws: Any) -> list[Any]:
    """Grippers (x, y, z, yaw) that stand on foot points (12) with yaws (4) (casadi)."""
    above = ca.DM([0.0, 0.0, problem.pad_radius_m])
    return [ca.vertcat(feet[3 * i : 3 * i + 3] + above, yaws[i]) for i in range(4)]


def euler_step(x: Any, force: Any, moment_origin: Any, centre: Any, p: CentroidalProblem) -> Any:
    """The body state one step on, from the total force and its moment about H's origin; `centre` is that of mass. The
    problem's inertia and gravity may be casadi's symbols.
    """
    v, omega = x[6:9], x[9:12]
    inertia = p.inertia_b if isinstance(p.inertia_b, ca.SX) else ca.DM(p.inertia_b)
    moment = rotation(x[3:6]).T @ (moment_origin - ca.cross(centre, force))
    acceleration = force / p.mass_kg + p.gravity_h
    angular = ca.inv(inertia) @ (moment - ca.cross(omega, inertia @ omega))
    return ca.vertcat(next_pose(x, p.dt_s), v + p.dt_s * acceleration, omega + p.dt_s * angular)


def static_map(
    centre: Array, normal: Array, tangent: Array, leaning: Array | None = None, up: Array = _UPRIGHT
) -> Array:
    """(6, 4): force and moment about the origin of one gripper as a linear map of w = (s1, s2, m, n1 - n2), shear along
    `tangent` and `up`; `leaning`
    (3, 5) are `Contact.leaning_moments`, of whose squeeze n1 + n2 nothing is counted.

    In balance the forces sum to -M g, so the moment about r is the moment about the origin minus r x (-M g), which is
    linear in r: (8b) needs no linearisation.
    """
    force = np.stack([2 * tangent, 2 * up, np.zeros(3), normal], axis=1)
    moment = np.cross(centre, force, axisa=0, axisb=0, axisc=0)
    moment[:, 2] += 2 * normal
    if leaning is not None:
        moment += np.column_stack([leaning[:, :3], (leaning[:, 3] - leaning[:, 4]) / 2])
    return np.vstack([force, moment])
