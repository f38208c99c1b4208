"""Feet among grips: a limb in stance on a foothold stands with both pads on a surface, pushes inside the friction cone
and does not move (msgs/PLAN.md, feet among grips).
"""

from dataclasses import replace
from typing import Any

import numpy as np
from crux_contracts.robot import Robot
from crux_contracts.scenario import Scenario

from crux_planner.checker import tolerances
from crux_planner.checker.cuboids import Cuboids
from crux_planner.checker.footholds import NOWHERE, PLANE
from crux_planner.checker.geometry import Array, Indices, rotation_of_gripper, turned_back
from crux_planner.checker.plan_arrays import PlanArrays
from crux_planner.checker.report import Findings
from crux_planner.checker.sampling import Samples


def on_surfaces(plan: PlanArrays, scenario: Scenario, robot: Robot, findings: Findings) -> PlanArrays:
    """The plan with its footholds on surfaces of the scenario; those that are on none, or are not as the surface has
    it, are reported, and copies that differ.
    """
    feet, solids = plan.footholds, plan.cuboids.with_slabs(scenario.wall.slabs)
    if not feet.names:
        return plan  # no limb stands
    names = tuple(foothold.name for foothold in scenario.footholds)
    if feet.names != names:
        detail = f"footholds {list(feet.names)} in the plan, {list(names)} in the scenario"
        findings.add("scenario_match", 1.0, "", detail=detail)
        return plan
    pads_m = 2 * robot.gripper.pad_radius_m * np.array([1.0, 1.0, 0.0])
    surface = np.full(len(names), NOWHERE)
    for f, foothold in enumerate(scenario.footholds):
        detail = f"foothold {foothold.name!r}"
        off = [feet.place_w_m[f] - foothold.position_m, feet.rpy_rad[f] - foothold.rpy_rad, feet.size_m[f] - pads_m]
        findings.add("scenario_match", float(np.abs(off).max()), "", tolerance=tolerances.MATCH_REL, detail=detail)
        surface[f], friction = _surface(feet.place_w_m[f], feet.normal[f], solids, len(plan.cuboids.names), scenario)
        off_surface = float(surface[f] == NOWHERE)
        findings.add("foothold", off_surface, "", detail=f"{foothold.name!r} is on no surface" if off_surface else "")
        wrong = np.abs(feet.friction[f] - [0.0, 0.0, 0.0, 0.0, friction]).max() if not off_surface else 0.0
        findings.add("scenario_match", float(wrong), "", tolerance=tolerances.MATCH_REL, detail=f"{detail}: friction")
    return replace(plan, footholds=feet.on(surface))


def _surface(place_w_m: Array, normal: Array, solids: Cuboids, first: int, scenario: Scenario) -> tuple[int, float]:
    """Number of the surface that a place is on, whose normal this is, and its friction; solids from `first` on are
    those behind bounded surfaces.
    """
    for index in range(first, len(solids.names)):
        turn, half = solids.rotation[index], 0.5 * solids.size_m[index]
        x, y, z = (place_w_m - solids.foot_w_m[index]) @ turn
        beyond = max(abs(x) - half[0], abs(y) - half[1], abs(z - 2 * half[2]))
        if beyond <= tolerances.LENGTH_M and np.abs(normal - turn[:, 2]).max() <= tolerances.ANGLE_RAD:
            return index, scenario.wall.slabs[index - first].friction
    flat = scenario.wall.endless and abs(place_w_m[2]) <= tolerances.LENGTH_M
    if flat and np.abs(normal - [0.0, 0.0, 1.0]).max() <= tolerances.ANGLE_RAD:
        return PLANE, scenario.wall.friction
    return NOWHERE, 0.0


def check_feet(plan: PlanArrays, scenario: Scenario, findings: Findings) -> float | None:
    """All of feet at the knots; returns the least margin of friction [N], None where no limb stands."""
    if not plan.standing.any():
        return None
    solids = plan.cuboids.with_slabs(scenario.wall.slabs)
    margin_N = np.inf
    for limb in range(4):
        at = plan.standing[:, limb]
        if not at.any():
            continue
        times, which = plan.time_s[at], plan.foothold[at, limb]
        where: dict[str, Any] = {"limb": limb}
        off = np.linalg.norm(plan.foot_point[at, limb] - plan.footholds.place_w_m[which], axis=1)
        findings.add_series("contact_face", off, times, "m", **where)
        turn = rotation_of_gripper(plan.gripper_yaw[at, limb], plan.gripper_tilt[at, limb])
        normal = plan.footholds.normal[which]
        sine = np.linalg.norm(np.cross(turn[..., 2], normal), axis=1)
        findings.add_series("finger_axis", np.arctan2(sine, (turn[..., 2] * normal).sum(axis=1)), times, "rad", **where)
        reach = (0.5 * plan.separation[at, limb] + plan.pad_radius_m)[:, None] * turn[..., 0]
        for finger, side in ((1, 1.0), (2, -1.0)):
            pads = plan.foot_point[at, limb] + side * reach
            beyond = _beyond_m(pads, plan.footholds.surface[which], solids)
            findings.add_series("contact_patch", beyond, times, "m", limb=limb, finger=finger)
        margin_N = min(margin_N, _check_forces(plan, limb, normal, findings))
        _check_ways(plan, limb, findings)
    return float(margin_N)


def _beyond_m(points_w_m: Array, surface: Indices, solids: Cuboids) -> Array:
    """(n,) how far points (n, 3) on surfaces (n,) are beyond their edges; the plane has none."""
    index = np.maximum(surface, 0)
    if not solids.names:
        return np.full(len(index), -np.inf)
    local = turned_back(solids.rotation[index], points_w_m - solids.foot_w_m[index])
    beyond = (np.abs(local[:, :2]) - 0.5 * solids.size_m[index, :2]).max(axis=1)
    return np.where(surface >= 0, beyond, -np.inf)


def _check_forces(plan: PlanArrays, limb: int, normal: Array, findings: Findings) -> float:
    """A foot pushes within its cone, half by each finger, without a moment; returns the least margin of friction."""
    at = plan.standing[:, limb]
    force, times = plan.finger_force[at, limb], plan.time_s[at]
    pressed, beyond = _in_cone(force.sum(axis=1), normal, plan.footholds.friction[plan.foothold[at, limb], 4])
    uneven = np.linalg.norm(force[:, 0] - force[:, 1], axis=1)
    moment = np.linalg.norm(plan.finger_moment[at, limb], axis=2).max(axis=1)
    for name, values, unit in (
        ("foot_pull", -pressed, "N"),
        ("foot_press", pressed - plan.max_normal_N, "N"),
        ("foot_slide", beyond, "N"),
        ("foot_halves", uneven, "N"),
        ("foot_moment", moment, "N m"),
    ):
        findings.add_series(name, values, times, unit, limb=limb)
    return float(-beyond.max())


def _in_cone(force: Array, normal: Array, friction: Array) -> tuple[Array, Array]:
    """(n,) what presses of forces (n, 3), and by how much what slides is more than friction bears."""
    pressed = (force * normal).sum(axis=-1)
    along = np.linalg.norm(force - pressed[..., None] * normal, axis=-1)
    return np.asarray(pressed), np.asarray(along - friction * np.maximum(pressed, 0.0))


def foot_excess(plan: PlanArrays, samples: Samples, limb: int) -> Array:
    """(T,) newtons by which a foot's force between the knots is outside its cone or its largest normal force."""
    foothold = plan.foothold[samples.interval, limb]
    normal, friction = plan.footholds.normal[foothold], plan.footholds.friction[foothold, 4]
    pressed, beyond = _in_cone(samples.force[:, limb], normal, friction)
    return np.asarray(np.maximum(beyond, np.maximum(-pressed, pressed - plan.max_normal_N)))


def nearest_in_cone(plan: PlanArrays, samples: Samples) -> Array:
    """(T, 4, 3) forces, those of feet the nearest that they can bear."""
    foothold, force = plan.foothold[samples.interval], samples.force
    normal, friction = plan.footholds.normal[foothold], plan.footholds.friction[foothold, 4]
    pressed = (force * normal).sum(axis=-1)
    along = force - pressed[..., None] * normal
    size = np.linalg.norm(along, axis=-1)
    on_cone = (pressed + friction * size) / (1.0 + friction**2)
    pressed = np.clip(np.where(size <= friction * pressed, pressed, on_cone), 0.0, plan.max_normal_N)
    share = np.minimum(friction * pressed / np.where(size > 0.0, size, 1.0), 1.0)
    borne = pressed[..., None] * normal + share[..., None] * along
    return np.where(samples.foot[..., None], borne, force)


def _check_ways(plan: PlanArrays, limb: int, findings: Findings) -> None:
    """A gripper leaves a foothold, and comes to one, along the surface's normal while it is as near to it as nothing
    else may be, and its fingers rest meanwhile.
    """
    standing = plan.standing[:, limb]
    air = ~plan.stance[:, limb]
    for k in range(plan.n_knots - 1):
        leaves = k > 0 and standing[k - 1] and air[k]
        comes = air[k] and standing[k + 1]
        if not (leaves or comes):
            continue
        foothold = plan.foothold[k - 1 if leaves else k + 1, limb]
        way = plan.gripper_position[k + 1, limb] - plan.gripper_position[k, limb]
        off = float(way @ plan.footholds.normal[foothold]) * (1.0 if leaves else -1.0)
        aside = float(np.linalg.norm(way - (way @ plan.footholds.normal[foothold]) * plan.footholds.normal[foothold]))
        near = aside * tolerances.MOVING_CLEARANCE_M / off if off > tolerances.MOVING_CLEARANCE_M else 1.0
        where: dict[str, Any] = {"limb": limb, "time_s": float(plan.time_s[k])}
        findings.add("foot_way", near, "m", **where)
        moved = float(abs(plan.separation[k + 1, limb] - plan.separation[k, limb]))
        findings.add("foot_fingers", moved, "m", **where)
