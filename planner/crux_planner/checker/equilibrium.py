"""Equilibrium between the knots, where the body moves on while wrenches blend from knot to knot, and the margin
against tumbling.

The blended wrenches of a stance give accelerations between those of the knots (they are convex combinations of theirs)
but do not balance the moments: the body is not where either knot had it. The controller makes up for that with the
wrenches of the limbs in stance. So the check is not that the residual is zero but that a correction exists: the least
change of forces and of twists about the finger axes, shared by load, that balances the moment; with it every finger's
demand must stay inside the exact limit surface for some normal force up to the plan's limit. The squeeze may rise: the
grasp force controller sets it from the demand.
"""

from __future__ import annotations

import numpy as np

from crux_planner.checker import tolerances
from crux_planner.checker.geometry import Array
from crux_planner.checker.limit_surface import FingerLoads, cone_excess
from crux_planner.checker.plan_arrays import PlanArrays
from crux_planner.checker.report import Findings
from crux_planner.checker.sampling import Samples
from crux_planner.checker.scene import Scene


def skew(v: Array) -> Array:
    """Cross-product matrices (..., 3) -> (..., 3, 3)."""
    x, y, z = np.moveaxis(v, -1, 0)
    zero = np.zeros_like(x)
    return np.stack([np.stack([zero, -z, y], -1), np.stack([z, zero, -x], -1), np.stack([-y, x, zero], -1)], axis=-2)


def corrected_wrenches(samples: Samples, twist_length_m: float, point_model: bool) -> tuple[Array, Array, Array]:
    """Gripper forces and moments (T, 4, 3) after the least correction that balances the moment about the body without
    changing the total force, and the residual (T,) [Nm] that no correction of the limbs in stance removes.

    `twist_length_m` weighs a twist [Nm] against a force [N], as the controller's own sharing of loads does.
    """
    count = len(samples.time_s)
    arm = samples.gripper_position - samples.body_position[:, None, :]
    lack = np.zeros((count, 6))
    lack[:, 3:] = -(np.cross(arm, samples.force) + samples.moment).sum(axis=1)
    grasp = np.zeros((count, 6, 4, 4))
    grasp[:, :3, :, :3] = np.eye(3)[None, :, None, :]
    grasp[:, 3:, :, :3] = skew(arm).transpose(0, 2, 1, 3)
    if not point_model:
        grasp[:, 3:, :, 3] = twist_length_m * samples.opening_axis.swapaxes(1, 2)
    share = np.repeat(samples.load, 4, axis=1)
    flat = grasp.reshape(count, 6, 16)
    scaled = flat * share[:, None, :]
    normal = scaled @ flat.swapaxes(1, 2)
    change = share * (flat.swapaxes(1, 2) @ (np.linalg.pinv(normal, rcond=1e-9) @ lack[..., None]))[..., 0]
    left = lack - (flat @ change[..., None])[..., 0]
    change = change.reshape(count, 4, 4)
    force = samples.force + change[..., :3]
    moment = samples.moment + twist_length_m * change[..., 3:] * samples.opening_axis
    return force, moment, np.abs(left).max(axis=1)


def check_between_knots(
    plan: PlanArrays,
    samples: Samples,
    loads: FingerLoads,
    scene: Scene,
    *,
    twist_length_m: float,
    findings: Findings,
) -> None:
    """Blended wrenches: none on a limb whose load is zero, and a correction inside the limit surface everywhere."""
    for limb in range(4):
        stray = np.where(samples.load[:, limb] <= 0.0, np.linalg.norm(samples.force[:, limb], axis=1), -np.inf)
        findings.add_series(
            "air_force_between_knots", stray, samples.time_s, "N", tolerance=tolerances.FORCE_N, limb=limb
        )
    point_model = scene.point_model
    force, moment, left = corrected_wrenches(samples, twist_length_m, point_model)
    findings.add_series("equilibrium_between_knots", left, samples.time_s, "N m", tolerance=tolerances.MOMENT_NM)
    for limb in range(4):
        at = samples.interval
        bears = samples.load[:, limb] > 0.0
        if point_model:
            excess = cone_excess(
                force[:, limb, :2],
                np.zeros(len(at)),
                force[:, limb, 2],
                friction=loads.friction[at, limb, 0],
                patch_k_m=0.0,
                spine_shear_N=loads.spine_shear_N[at, limb, 0],
                spine_twist_Nm=loads.spine_twist_Nm[at, limb, 0],
            )
            excess = np.maximum(excess, force[:, limb, 2] - plan.max_normal_N)
        else:
            hanging = scene.spines_only.get(limb)
            excess = _grasp_excess(plan, samples, loads, limb, hanging, force=force[:, limb], moment=moment[:, limb])
        findings.add_series(
            "limit_surface_between_knots",
            np.where(bears, excess, -np.inf),
            samples.time_s,
            "N",
            tolerance=tolerances.FRICTION_CONE_BETWEEN_KNOTS_N,
            limb=limb,
        )


def _grasp_excess(
    plan: PlanArrays,
    samples: Samples,
    loads: FingerLoads,
    limb: int,
    hanging: int | None,
    *,
    force: Array,
    moment: Array,
) -> Array:
    """Newtons by which a gripper's wrench exceeds what its two fingers can carry, each with half the shear and twist,
    the finger that is pushed harder at the largest normal force: the other one presses less by the pull between them.
    Where finger `hanging` hangs on by its spines only it does not press, and the other one takes the pull alone.
    """
    axis, at = samples.opening_axis[:, limb], samples.interval
    tangent = np.stack([-axis[:, 1], axis[:, 0]], axis=1)
    shear = 0.5 * np.stack([(force[:, :2] * tangent).sum(axis=1), force[:, 2]], axis=1)
    twist = 0.5 * (moment * axis).sum(axis=1)
    along = (force * axis).sum(axis=1)
    normal = np.stack([plan.max_normal_N + np.minimum(along, 0.0), plan.max_normal_N - np.maximum(along, 0.0)], axis=1)
    beyond = -normal.min(axis=1)
    if hanging is not None:
        pressing = along if hanging == 2 else -along
        normal = np.zeros_like(normal)
        normal[:, 2 - hanging] = pressing
        beyond = np.maximum(-pressing, pressing - plan.max_normal_N)
    excess = [
        cone_excess(
            shear,
            twist,
            normal[:, f],
            friction=loads.friction[at, limb, f],
            patch_k_m=plan.patch_k_m,
            spine_shear_N=loads.spine_shear_N[at, limb, f],
            spine_twist_Nm=loads.spine_twist_Nm[at, limb, f],
        )
        for f in (0, 1)
    ]
    return np.asarray(np.maximum(np.maximum(*excess), beyond))


def tumble_margin(plan: PlanArrays, loads: FingerLoads, mass_kg: float) -> float | None:
    """Tumble stability margin min M_ab / (m g) [m] over knots and tumbling axes.

    A tumbling axis runs through two contacts a, b in stance with all other grippers in stance on one side of it (in
    the plane of the wall). M_ab is the moment about it of gravity, pressing positive, and of the pull off the wall
    which the other grippers can hold with the planned normal forces: friction mu fz and spines of both fingers.
    """
    weight = mass_kg * plan.gravity_w
    size = float(np.linalg.norm(weight))
    pull = np.where(loads.touching, loads.friction * np.maximum(loads.normal_N, 0.0) + loads.spine_shear_N, 0.0)
    pull = pull.sum(axis=2)
    best: float | None = None
    for k in range(plan.n_knots - 1):
        feet = [limb for limb in range(4) if plan.gripped[k, limb] or plan.on_wall[k, limb]]
        for a in feet:
            for b in feet:
                if a == b:
                    continue
                pa, pb = plan.gripper_position[k, a], plan.gripper_position[k, b]
                edge = pb - pa
                edge[2] = 0.0
                length = float(np.linalg.norm(edge))
                if length < 1e-6:
                    continue
                edge /= length
                inward = np.array([-edge[1], edge[0], 0.0])
                arms = {c: float(inward @ (plan.gripper_position[k, c] - pa)) for c in feet if c not in (a, b)}
                if any(arm < 0.0 for arm in arms.values()):
                    continue
                lever = plan.body_position[k] - pa
                # about the edge: positive presses the inner side towards the wall
                gravity = -float(np.cross(lever, weight) @ edge)
                holding = sum(pull[k, c] * arm for c, arm in arms.items())
                margin = (gravity + holding) / size
                best = margin if best is None else min(best, margin)
    return best
