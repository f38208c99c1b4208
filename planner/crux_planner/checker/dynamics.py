"""The equations of motion at the knots: (8a), (8b) with the moment about the centre of mass, limbs counted, explicit
Euler with dt.
"""

from __future__ import annotations

import numpy as np

from crux_planner.checker.geometry import Array, body_rate_matrix, rotation_from_rpy
from crux_planner.checker.plan_arrays import PlanArrays
from crux_planner.checker.report import Findings


def check_dynamics(plan: PlanArrays, centre_w_m: Array, mass_kg: float, inertia_b: Array, findings: Findings) -> None:
    """Residuals over the intervals [k, k + 1): M r'' = sum f + M g, I w' + w x I w = R^T sum ((p - c) x f + m),
    r and theta stepped by explicit Euler with omega_B = E(theta) theta'.

    `centre_w_m` (K - 1, 3) is the whole robot's centre of mass c at the knots before the last one, `inertia_b` the
    composite inertia about it, axes of B, at the plan's first posture.
    """
    dt, now, nxt = plan.dt_s, slice(0, -1), slice(1, None)
    times = plan.time_s[now]
    velocity, rate = plan.body_velocity, plan.body_rate

    step = plan.body_position[nxt] - plan.body_position[now] - dt * velocity[now]
    findings.add_series("position_step", np.abs(step).max(axis=1), times, "m")

    turned = (body_rate_matrix(plan.body_rpy[now]) @ np.diff(plan.body_rpy, axis=0)[..., None])[..., 0]
    findings.add_series("orientation_step", np.abs(turned - dt * rate[now]).max(axis=1), times, "rad")

    force = plan.finger_force[now].sum(axis=(1, 2))
    acceleration = np.diff(velocity, axis=0) / dt
    balance = mass_kg * (acceleration - plan.gravity_w) - force
    findings.add_series("force_balance", np.abs(balance).max(axis=1), times, "N")

    arm = plan.finger_position[now] - centre_w_m[:, None, None, :]
    moment = (np.cross(arm, plan.finger_force[now]) + plan.finger_moment[now]).sum(axis=(1, 2))
    rotation = rotation_from_rpy(plan.body_rpy[now])
    moment_b = (rotation.swapaxes(1, 2) @ moment[..., None])[..., 0]
    spin = np.cross(rate[now], rate[now] @ inertia_b.T)
    residual = (np.diff(rate, axis=0) / dt) @ inertia_b.T + spin - moment_b
    findings.add_series("moment_balance", np.abs(residual).max(axis=1), times, "N m")
