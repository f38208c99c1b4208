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

from itertools import permutations

import numpy as np

from crux_planner.checker import tolerances
from crux_planner.checker.geometry import Array, cross, solved
from crux_planner.checker.limit_surface import FingerLoads, cone_excess
from crux_planner.checker.plan_arrays import PlanArrays
from crux_planner.checker.report import Findings
from crux_planner.checker.sampling import Samples
from crux_planner.checker.scene import Scene


def corrected_wrenches(
    samples: Samples,
    twist_length_m: float,
    about_w_m: Array,
    net: tuple[Array, Array] | None,
    *,
    point_model: bool = False,
) -> tuple[Array, Array, Array]:
    """Gripper forces and moments (T, 4, 3) after the least correction that balances the moment about the places
    `about_w_m` (T, 3) without changing the total force, and the residual (T,) [Nm] that no correction of the limbs in
    stance removes. With `net` the total force and moment are these, (T, 3) each; point feet have no twists.

    `twist_length_m` weighs a twist [Nm] against a force [N], as the controller's own sharing of loads does.
    """
    force, moment, axis = (v.transpose(1, 2, 0) for v in (samples.force, samples.moment, samples.opening_axis))
    arm = (samples.gripper_position - about_w_m[:, None, :]).transpose(1, 2, 0)  # (4, 3, T), as the others
    share, directions = samples.load.T, 3 if point_model else 4
    lack = np.zeros((6, len(samples.time_s)))
    if net is not None:
        lack[:3], lack[3:] = net[0].T - force.sum(axis=0), net[1].T
    lack[3:] -= sum(cross(arm[limb], force[limb]) + moment[limb] for limb in range(4))
    effects = np.zeros((4, directions, 6, lack.shape[1]))  # of a force along each axis, and of a twist
    for limb in range(4):
        for i, along in enumerate(np.eye(3)):
            effects[limb, i, i] = 1.0
            effects[limb, i, 3:] = cross(arm[limb], along[:, None])
        if not point_model:
            effects[limb, 3, 3:] = twist_length_m * axis[limb]
    shared = share[:, None, None] * effects
    weights = _least_squares(np.einsum("ldit,ldjt->ijt", effects, shared), lack)
    change = np.einsum("ldit,it->ldt", shared, weights)
    left = lack - np.einsum("ldit,ldt->it", effects, change)
    force, moment = force + change[:, :3], moment.copy()
    if not point_model:
        moment += twist_length_m * change[:, 3:] * axis
    return force.transpose(2, 0, 1), moment.transpose(2, 0, 1), np.abs(left).max(axis=0)


def _least_squares(normal: Array, right: Array) -> Array:
    """Least-norm solutions (6, T) of normal equations (6, 6, T), by the pseudoinverse where they come near to lacking
    rank.
    """
    factors = normal.copy()
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        found = solved(factors, right)
    pivots = np.diagonal(factors)  # (T, 6)
    poor = np.flatnonzero(~(pivots.min(axis=1) > _POOR_PIVOT * np.diagonal(normal).max(axis=1)))
    if len(poor) > 0:
        inverse = np.linalg.pinv(normal[..., poor].transpose(2, 0, 1), rcond=1e-9)
        found[:, poor] = (inverse @ right[:, poor].T[..., None])[..., 0].T
    return found


_POOR_PIVOT = 1e-4


def check_between_knots(
    plan: PlanArrays, shared: Samples, left: Array, loads: FingerLoads, scene: Scene, findings: Findings
) -> None:
    """Blended wrenches: none on a limb whose load is zero, and a correction inside the limit surface everywhere.

    `shared` has the corrected wrenches, `left` (T,) [Nm] is what no correction removes.
    """
    samples, force, moment = shared, shared.force, shared.moment
    for limb in range(4):
        stray = np.where(samples.load[:, limb] <= 0.0, np.linalg.norm(force[:, limb], axis=1), -np.inf)
        findings.add_series("air_force_between_knots", stray, samples.time_s, "N", limb=limb)
    point_model = scene.point_model
    findings.add_series("equilibrium_between_knots", left, samples.time_s, "N m")
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
    pull = pull.sum(axis=2)[:-1].T
    feet = (plan.gripped | plan.on_wall)[:-1].T
    place, body = plan.gripper_position[:-1].transpose(1, 2, 0), plan.body_position[:-1].T
    best = np.inf
    for a, b in permutations(range(len(feet)), 2):
        edge = (place[b] - place[a])[:2]
        length = np.sqrt((edge * edge).sum(axis=0))
        axis = np.array([*(edge / np.where(length < 1e-6, 1.0, length)), np.zeros_like(length)])
        others = [c for c in range(len(feet)) if c not in (a, b)]
        arms = [axis[0] * (place[c] - place[a])[1] - axis[1] * (place[c] - place[a])[0] for c in others]
        is_edge = feet[a] & feet[b] & (length >= 1e-6)
        for c, arm in zip(others, arms, strict=True):
            is_edge &= ~feet[c] | (arm >= 0.0)
        # about the edge: positive presses the inner side towards the wall
        gravity = -(cross(body - place[a], weight[:, None]) * axis).sum(axis=0)
        holding = sum(np.where(feet[c], pull[c] * arm, 0.0) for c, arm in zip(others, arms, strict=True))
        best = min(best, float(np.where(is_edge, (gravity + holding) / size, np.inf).min()))
    return best if np.isfinite(best) else None
