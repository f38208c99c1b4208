"""Equations (8a) and (8b) of a whole walk at once, in numpy: rates of the angles, and what a motion leaves open."""

import numpy as np

from crux_planner.model.arrays import Array
from crux_planner.model.kinematics import rotation_from_rpy
from crux_planner.model.walk_problem import WalkProblem


def euler_rates(theta: Array, omega_b: Array) -> Array:
    """Rates of roll, pitch, yaw (..., 3) for angular velocities in the body frame (..., 3)."""
    (roll, pitch, _), (p, q, r) = np.moveaxis(theta, -1, 0), np.moveaxis(omega_b, -1, 0)
    turning = np.sin(roll) * q + np.cos(roll) * r
    return np.stack([p + np.tan(pitch) * turning, np.cos(roll) * q - np.sin(roll) * r, turning / np.cos(pitch)], -1)


def defects(problem: WalkProblem, body: Array, feet: Array, yaws: Array, forces: Array) -> Array:
    """(N, 12): body states (N + 1, 12) less Euler's, by feet (N + 1, 4, 3), yaws (N + 1, 4), forces (N, 4, 3)."""
    now, dt = body[:-1], problem.dt_s
    theta, omega = now[:, 3:6], now[:, 9:12]
    centre = problem.centres_of_mass(now[:, :6], feet[:-1], yaws[:-1])
    moment = np.cross(feet[:-1] - centre[:, None], forces).sum(axis=1)
    turned = np.einsum("kba,kb->ka", rotation_from_rpy(theta), moment)
    inertia = problem.inertia_b
    spin = np.linalg.solve(inertia, (turned - np.cross(omega, omega @ inertia.T)).T).T
    rates = [now[:, 6:9], euler_rates(theta, omega), forces.sum(axis=1) / problem.mass_kg + problem.gravity_h, spin]
    return np.asarray(body[1:] - now - dt * np.concatenate(rates, axis=1))
