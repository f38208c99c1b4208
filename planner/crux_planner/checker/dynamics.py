"""The equations of motion: at the knots (8a), (8b) with the moment about the centre of mass, limbs counted, explicit
Euler from knot to knot; along the plan the force and moment that all contacts must have together, Newton-Euler for
every link, limbs as inverse kinematics places them. A foot must press for that, never pull.
"""

import numpy as np

from crux_planner.checker import tolerances
from crux_planner.checker.geometry import Array, body_rate_matrix, cross, rotation_from_rpy, rotation_vector, turned
from crux_planner.checker.limb_model import ChainState, WholeRobot
from crux_planner.checker.plan_arrays import PlanArrays
from crux_planner.checker.report import Findings
from crux_planner.checker.sampling import Samples

_FLAT_M2 = 1e-4  # twice the area of three feet in a row, about which nothing can be said


def check_dynamics(plan: PlanArrays, centre_w_m: Array, mass_kg: float, inertia_b: Array, findings: Findings) -> None:
    """Residuals over the intervals [k, k + 1): M r'' = sum f + M g, I w' + w x I w = R^T sum ((p - c) x f + m),
    r and theta stepped by explicit Euler with omega_B = E(theta) theta'.

    `centre_w_m` (K - 1, 3) is the whole robot's centre of mass c at the knots before the last one, `inertia_b` the
    composite inertia about it, axes of B, at the plan's first posture.
    """
    dt, now, nxt = plan.step_s[:, None], slice(0, -1), slice(1, None)
    times = plan.time_s[now]
    velocity, rate = plan.body_velocity, plan.body_rate

    step = plan.body_position[nxt] - plan.body_position[now] - dt * velocity[now]
    findings.add_series("position_step", np.abs(step).max(axis=1), times, "m")

    turning = (body_rate_matrix(plan.body_rpy[now]) @ np.diff(plan.body_rpy, axis=0)[..., None])[..., 0]
    findings.add_series("orientation_step", np.abs(turning - dt * rate[now]).max(axis=1), times, "rad")

    force = plan.finger_force[now].sum(axis=(1, 2))
    acceleration = np.diff(velocity, axis=0) / dt
    balance = mass_kg * (acceleration - plan.gravity_w) - force
    findings.add_series("force_balance", np.abs(balance).max(axis=1), times, "N")

    arm = plan.force_position[now] - centre_w_m[:, None, None, :]
    moment = (np.cross(arm, plan.finger_force[now]) + plan.finger_moment[now]).sum(axis=(1, 2))
    rotation = rotation_from_rpy(plan.body_rpy[now])
    moment_b = (rotation.swapaxes(1, 2) @ moment[..., None])[..., 0]
    spin = np.cross(rate[now], rate[now] @ inertia_b.T)
    residual = (np.diff(rate, axis=0) / dt) @ inertia_b.T + spin - moment_b
    findings.add_series("moment_balance", np.abs(residual).max(axis=1), times, "N m")


def centre_of_mass(samples: Samples, robot: WholeRobot, states: list[ChainState]) -> Array:
    """Centre of mass (T, 3) in W."""
    return samples.body_position + turned(samples.rotation, robot.centre_of_mass(states))


def net_wrench(
    samples: Samples, robot: WholeRobot, states: list[ChainState], gravity_w: Array, window_s: float
) -> tuple[Array, Array]:
    """Force (T, 3) and moment (T, 3) about W's origin that all contacts must have together, in the mean over `window_s`
    about each sample: how momentum and angular momentum change, less gravity's part. Before and after it stands still.
    """
    times, centre = samples.time_s, centre_of_mass(samples, robot, states)
    middle, step = 0.5 * (times[1:] + times[:-1]), np.diff(times)
    momentum, spin = np.zeros((2, 3, len(step)))
    links = [(robot.body, samples.body_position, samples.rotation)]
    for limb, state in zip(robot.limbs, states, strict=True):
        for link in limb.links:
            place = samples.body_position + turned(samples.rotation, state.link_position_m[link.name])
            links.append((link, place, samples.rotation @ state.link_rotation[link.name]))
    for link, origin, rotation in links:
        place = origin + turned(rotation, link.com_m)
        velocity = (np.diff(place, axis=0) / step[:, None]).T
        momentum += link.mass_kg * velocity
        turning = rotation_vector(np.einsum("tij,tik->tjk", rotation[:-1], rotation[1:])) / step[:, None]
        spin += link.mass_kg * cross(0.5 * (place[1:] + place[:-1]).T, velocity)
        spin += turned(rotation[:-1], turning @ link.inertia_kg_m2.T).T
    ends = times[:, None] + np.array([-0.5, 0.5]) * window_s
    rates = []
    for series in (momentum, spin):
        at = np.array([np.interp(ends, middle, along, left=0.0, right=0.0) for along in series])
        rates.append(((at[..., 1] - at[..., 0]) / window_s).T)
    weight = robot.mass_kg * gravity_w
    return rates[0] - weight, rates[1] - np.cross(centre, weight)


def check_feet_press(feet: Samples, net: tuple[Array, Array], window_s: float, findings: Findings) -> None:
    """Where three or four feet stand within `window_s`, on z = 0, they can all press as the wrench `net` on them needs.

    Of four feet some three do if the ground's force passes between them: those that press most are taken.
    """
    force, moment = net
    wanted = np.stack([force[:, 2], -moment[:, 1], moment[:, 0]], axis=1)  # sums of f_z, x f_z and y f_z
    times, count = feet.time_s, np.cumsum(np.vstack([np.zeros(4), feet.load > 0.0]), axis=0)
    begin, end = (np.searchsorted(times, times + sign * window_s / 2) for sign in (-1, 1))
    bears = count[np.maximum(end, np.arange(len(times)) + 1)] > count[begin]
    most, foot = np.full(len(times), -np.inf), np.zeros(len(times), dtype=int)
    for left_out in range(4):
        three = np.delete(np.arange(4), left_out)
        places = feet.gripper_position[:, three]
        corners = np.stack([np.ones_like(places[..., 0]), places[..., 0], places[..., 1]], axis=1)
        rows = np.flatnonzero(bears[:, three].all(axis=1) & (np.abs(np.linalg.det(corners)) > _FLAT_M2))
        loads = np.linalg.solve(corners[rows], wanted[rows, :, None])[..., 0]
        least = loads.argmin(axis=1)
        better = loads.min(axis=1) > most[rows]
        most[rows[better]], foot[rows[better]] = loads.min(axis=1)[better], three[least[better]]
    for limb in range(4):
        known = (foot == limb) & np.isfinite(most)  # out of reach is said elsewhere
        pull = np.where(known, -most, -np.inf)
        findings.add_series("foot_pull", pull, times, "N", tolerance=tolerances.FORCE_N, limb=limb)
