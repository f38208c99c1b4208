"""Equations (8a) and (8b): centroidal dynamics, explicit Euler, W-frame forces on the robot positive."""

from __future__ import annotations

from typing import Any

import casadi as ca
import numpy as np

from crux_planner.model.arrays import Array

WRENCH_INPUTS = 5  # q = (s1, s2, m, n1, n2) of one gripper, see physics.limit_surface


def rotation(theta: Any) -> Any:
    """R(theta), W <- B, intrinsic z-y-x (casadi)."""
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


def gripper_wrench(q: Any, centre: Any, normal: Any, tangent: Any) -> tuple[Any, Any]:
    """Equation (13) with (4): force, and moment about W's origin, of one gripper (casadi).

    With f1 = n1 e + s and f2 = -n2 e + s at c + (d/2) e and c - (d/2) e the opening d drops out: the moment is
    c x (f1 + f2) + 2 m e.
    """
    force = (q[3] - q[4]) * normal + 2 * q[0] * tangent + 2 * q[1] * ca.DM([0, 0, 1])
    return force, ca.cross(centre, force) + 2 * q[2] * normal


def next_pose(x: Any, dt: float) -> Any:
    """(6,) r and theta one step on: explicit Euler needs the body state alone (casadi)."""
    r, theta, v, omega = x[0:3], x[3:6], x[6:9], x[9:12]
    return ca.vertcat(r + dt * v, theta + dt * euler_rates(theta, omega))


def euler_step(x: Any, force: Any, moment_origin: Any, mass: float, inertia: Array, gravity: Array, dt: float) -> Any:
    """The body state one step on, from the total force and its moment about W's origin (casadi)."""
    r, theta, v, omega = x[0:3], x[3:6], x[6:9], x[9:12]
    moment = rotation(theta).T @ (moment_origin - ca.cross(r, force))
    acceleration = force / mass + gravity
    angular = np.linalg.inv(inertia) @ (moment - ca.cross(omega, inertia @ omega))
    return ca.vertcat(next_pose(x, dt), v + dt * acceleration, omega + dt * angular)


def static_map(centre: Array, normal: Array, tangent: Array) -> Array:
    """(6, 4): force and moment about the origin of one gripper as a linear map of w = (s1, s2, m, n1 - n2).

    In balance the forces sum to -M g, so the moment about r is the moment about the origin minus r x (-M g), which is
    linear in r: (8b) needs no linearisation.
    """
    up = np.array([0.0, 0.0, 1.0])
    force = np.stack([2 * tangent, 2 * up, np.zeros(3), normal], axis=1)
    moment = np.cross(centre, force, axisa=0, axisb=0, axisc=0)
    moment[:, 2] += 2 * normal
    return np.vstack([force, moment])


def skew(v: Array) -> Array:
    """Matrix of the cross product v x."""
    return np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])
