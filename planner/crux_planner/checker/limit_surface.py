"""The contact model: limit surface with micro-spines (1)-(3), bounds of the normal force, (4) the pair's equal load.

Friction is judged by (2a), which lies inside both (2) and what a disc under even pressure bears. A finger's wrench lies
in the Minkowski sum of that cone and the spine box (3). The box is a product of intervals centred at zero and the
cone's section is symmetric about the same axes, so the nearest point of the box is found component by component: w is
in the sum if and only if shrinking |fx|, |fy| and |tz| by the box (not below zero) leaves a point in the cone. No
polytope, no tolerance of a solver.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from crux_contracts import LIMB_NAMES
from crux_contracts.scenario import Scenario

from crux_planner.checker import tolerances
from crux_planner.checker.geometry import Array
from crux_planner.checker.plan_arrays import PlanArrays
from crux_planner.checker.report import Findings

_WHOLE = np.ones((0, 4))  # pads bear as a whole
DISC_POWER = 1.65
"""Of (2a). With 2 it would be (2), whose combined shear and twist are up to 7.0 % more than a disc under even pressure
bears; with this one it is up to 1.7 % less, and never more."""


def cone_excess(
    shear_N: Array,
    twist_Nm: Array,
    normal_N: Array,
    *,
    friction: Array,
    patch_k_m: Array | float,
    spine_shear_N: Array,
    spine_twist_Nm: Array,
) -> Array:
    """Newtons by which a wrench lies outside (2a), negative inside: (|s|^p + |t/k|^p)^(1/p) - mu fz, s and t being the
    shear and the twist that spines leave, p = DISC_POWER.

    shear (..., 2), the others (...). With k = 0 (a point contact) any twist beyond the spines' is outside.
    """
    shear = np.maximum(np.abs(shear_N) - spine_shear_N[..., None], 0.0)
    twist = np.maximum(np.abs(twist_Nm) - spine_twist_Nm, 0.0)
    point = np.less_equal(patch_k_m, 0.0)
    k_m = np.where(point, 1.0, patch_k_m)
    twist_as_force = np.where(point, np.where(twist > tolerances.MOMENT_NM, np.inf, 0.0), twist / k_m)
    sliding = np.sqrt((shear * shear).sum(axis=-1))
    demand = (sliding**DISC_POWER + twist_as_force**DISC_POWER) ** (1.0 / DISC_POWER)
    return np.asarray(demand - friction * np.maximum(normal_N, 0.0))


@dataclass(frozen=True)
class FingerLoads:
    """Finger wrenches in their contact frames, shapes (K, 4, 2): normal force pushes the finger off its face."""

    normal_N: Array
    shear_N: Array  # (K, 4, 2, 2) along z x e and up the face, z the hold's where it does not lean (on the wall: x, y)
    twist_Nm: Array  # about n1, and about -n2: the same direction for both fingers, unless they lean
    other_moment_Nm: Array
    friction: Array
    spine_shear_N: Array
    spine_twist_Nm: Array
    touching: Array  # bool
    pad_share: Array  # of the pad that bears: k is so much less

    def excess(
        self, shear_N: Array, twist_Nm: Array, normal_N: Array, at: Any, patch_k_m: float, rough: float = 1.0
    ) -> Array:
        """`cone_excess` of wrenches on the faces of the fingers `at` some places, `rough` times their friction."""
        return cone_excess(
            shear_N,
            twist_Nm,
            normal_N,
            friction=rough * self.friction[at],
            patch_k_m=patch_k_m * self.pad_share[at],
            spine_shear_N=self.spine_shear_N[at],
            spine_twist_Nm=self.spine_twist_Nm[at],
        )


def pad_shares(scenario: Scenario) -> Array:
    """Of the pads on the side faces of holds that bears, (H, 4)."""
    shares = np.ones((len(scenario.holds), 4))
    for hold, body in enumerate(scenario.holds):
        for grip in body.grips:
            shares[hold, 2 * "xy".index(grip.faces) :][:2] = grip.share
    return shares


def finger_loads(plan: PlanArrays, wall_friction: float, shares: Array = _WHOLE) -> FingerLoads:
    """Resolve the plan's finger forces and moments in the frames of the faces they touch; `shares`: `pad_shares`."""
    normal = plan.face_normal
    common = normal[:, :, :1, :]
    on_wall = plan.on_wall[..., None, None]
    z = plan.up_face[:, :, None, :]
    tangent1 = np.where(on_wall, np.array([1.0, 0.0, 0.0]), np.cross(z, common))
    tangent2 = np.where(on_wall, np.array([0.0, 1.0, 0.0]), z)
    if plan.leaning.any():
        leans, lean = plan.leaning[..., None, None], plan.lean[..., None]
        twisted = normal * np.array([[1.0], [-1.0]])
        common = np.where(leans, twisted, common)
        tangent1 = tangent1 / np.linalg.norm(tangent1, axis=-1, keepdims=True)
        upright = (normal - np.sin(lean) * z) / np.cos(lean)
        tangent2 = np.where(leans, np.cos(lean) * z - np.sin(lean) * upright, tangent2)
    force, moment = plan.finger_force, plan.touch_moment
    twist = (moment * common).sum(axis=-1)
    touching = plan.gripped | plan.on_wall
    index = np.where(plan.gripped, plan.hold, 0)[..., None]
    wall = plan.on_wall[..., None]
    if plan.cuboids.names:
        friction = np.where(wall, wall_friction, plan.cuboids.friction[index, plan.faces])
        spiny = np.where(wall, True, plan.cuboids.spines[index, plan.faces])
    else:
        friction, spiny = np.full(twist.shape, wall_friction), np.ones(twist.shape, dtype=bool)
    bears = np.ones(twist.shape)
    gripped = plan.gripped & (plan.hold < len(shares))
    bears[gripped] = shares[plan.hold[gripped][:, None], plan.faces[gripped]]
    return FingerLoads(
        (force * normal).sum(axis=-1),
        np.stack([(force * tangent1).sum(axis=-1), (force * tangent2).sum(axis=-1)], axis=-1),
        twist,
        np.linalg.norm(moment - twist[..., None] * common, axis=-1),
        friction,
        plan.spine_shear_N * spiny * bears,
        plan.spine_twist_Nm * spiny * bears,
        np.broadcast_to(touching[..., None], twist.shape),
        bears,
    )


def _across(plan: PlanArrays, loads: FingerLoads) -> Array:
    """Forces of the fingers across their opening axis, which (4) shares, (K, 4, 2, 2): along z x e and z."""
    if not plan.leaning.any():
        return loads.shear_N
    lift = np.where(plan.leaning[..., None], plan.finger_force[..., 2], loads.shear_N[..., 1])
    return np.stack([loads.shear_N[..., 0], lift], axis=-1)


def check_limit_surface(plan: PlanArrays, scenario: Scenario, findings: Findings) -> float | None:
    """(1)-(4) at every knot; returns the least margin mu fz - demand [N]. Fingers on spines only must not press."""
    loads = finger_loads(plan, scenario.wall.friction, pad_shares(scenario))
    excess = loads.excess(loads.shear_N, loads.twist_Nm, loads.normal_N, ..., plan.patch_k_m)
    touching = loads.touching
    for limb in range(4):
        for finger in (0, 1):
            at = (slice(None), limb, finger)
            normal = loads.normal_N[at]
            for name, amounts, unit in (
                ("limit_surface", excess[at], "N"),
                ("normal_force_min", -normal, "N"),
                ("normal_force_max", normal - plan.max_normal_N, "N"),
                ("contact_moment", loads.other_moment_Nm[at], "N m"),
            ):
                values = np.where(touching[at], amounts, -np.inf)
                findings.add_series(name, values, plan.time_s, unit, limb=limb, finger=finger + 1)
        if (hanging := scenario.contact.spines_only.get(LIMB_NAMES[limb])) is not None:
            at = (slice(None), limb, hanging - 1)
            pressing = np.where(touching[at], np.abs(loads.normal_N[at]), -np.inf)
            findings.add_series("spines_only", pressing, plan.time_s, "N", limb=limb, finger=hanging)
        pair = plan.gripped[:, limb]
        shear = np.abs(np.diff(_across(plan, loads)[:, limb], axis=1)[:, 0]).max(axis=-1)
        twist = np.abs(np.diff(loads.twist_Nm[:, limb], axis=1)[:, 0])
        for name, values, unit in (("equal_shear", shear, "N"), ("equal_twist", twist, "N m")):
            findings.add_series(name, np.where(pair, values, -np.inf), plan.time_s, unit, limb=limb)
    if not touching.any():
        return None
    return float(-excess[touching].max())
