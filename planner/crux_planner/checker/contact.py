"""(10): who touches what. A touching finger rests on its face and does not move; a finger in the air carries nothing; a
hold serves one limb at a time; swings have the structure of msgs/PLAN.md.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
from crux_contracts import LIMB_NAMES
from crux_contracts.robot import Robot
from crux_contracts.scenario import Grip, Scenario

from crux_planner.checker import tolerances
from crux_planner.checker.geometry import Array, Flags, Indices, rotation_of_gripper, turned_back
from crux_planner.checker.limit_surface import pad_shares
from crux_planner.checker.plan_arrays import FACE_NONE, FACE_WALL, PlanArrays
from crux_planner.checker.report import Findings

_HAND_M = 0.1  # an angle off a grip counts as much as its place being off by what this turns


@dataclass(frozen=True)
class Swing:
    """Air knots first..last of a limb."""

    limb: int
    first: int
    last: int


def swings(plan: PlanArrays) -> list[Swing]:
    """All maximal runs of AIR knots."""
    found = []
    for limb in range(4):
        air = ~plan.stance[:, limb]
        edges = np.flatnonzero(np.diff(np.concatenate(([False], air, [False])).astype(np.int8)))
        found += [Swing(limb, int(a), int(b) - 1) for a, b in zip(edges[::2], edges[1::2], strict=True)]
    return found


def check_contact(plan: PlanArrays, scenario: Scenario, robot: Robot, findings: Findings) -> None:
    """All of (10) at the knots."""
    _check_contact_names(plan, scenario, findings)
    _check_faces(plan, scenario.contact.patch_radius_m, robot.grasp.pad_height_m, findings)
    _check_places(plan, scenario, findings)
    _check_rest(plan, findings)
    _check_air(plan, findings)
    _check_swings(plan, findings)
    _check_sharing(plan, findings)


def _check_contact_names(plan: PlanArrays, scenario: Scenario, findings: Findings) -> None:
    """Holds exist and may be grasped, faces exist, friction is the smaller one of the two faces, times the share of the
    pad that bears, as little as that may be, and above 0, as the runtime needs it.
    """
    least = 1.0 - (scenario.uncertainty.friction if scenario.uncertainty else 0.0)
    for k, limb in np.argwhere(plan.stance):
        hold, face, where = plan.hold[k, limb], plan.finger1_face[k, limb], plan.time_s[k]
        if scenario.contact.model == "point":
            if face != FACE_WALL or hold != -1:
                detail = f"a point contact stands on the wall (face {FACE_WALL}, hold -1), not face {face}, hold {hold}"
                findings.add("hold", 1.0, "", limb=limb, time_s=where, detail=detail)
            continue
        if plan.standing[k, limb]:
            continue
        if not 0 <= hold < len(plan.cuboids.names):
            detail = f"hold {hold} does not exist, there are {len(plan.cuboids.names)}"
            findings.add("hold", 1.0, "", limb=limb, time_s=where, detail=detail)
        elif not plan.cuboids.graspable[hold]:
            detail = f"{plan.cuboids.names[hold]!r} is an obstacle, not a hold"
            findings.add("hold", 1.0, "", limb=limb, time_s=where, detail=detail)
        if not 0 <= face < 4:
            findings.add("hold", 1.0, "", limb=limb, time_s=where, detail=f"finger 1 on face {face}, expected 0..3")
    for k, limb in np.argwhere(~plan.stance):
        if plan.hold[k, limb] != -1 or plan.finger1_face[k, limb] != FACE_NONE:
            detail = f"in the air, but hold {plan.hold[k, limb]}, face {plan.finger1_face[k, limb]} (expected -1, -1)"
            findings.add("hold", 1.0, "", limb=limb, time_s=plan.time_s[k], detail=detail)
    if plan.cuboids.names:
        index = np.where(plan.gripped, plan.hold, 0)
        bears = np.ones((len(plan.cuboids.names), 5))
        bears[: len(scenario.holds), :4] = pad_shares(scenario)
        pair = (bears * plan.cuboids.friction)[index[..., None], plan.faces].min(axis=2)
    else:
        pair = np.zeros(plan.hold.shape)
    expected = np.where(plan.on_wall, scenario.wall.friction, np.where(plan.gripped, least * pair, 0.0))
    if plan.standing.any():
        expected = np.where(plan.standing, plan.footholds.friction[plan.foothold, 4], expected)
    for k, limb in np.argwhere(plan.stance & (plan.on_wall | plan.gripped | plan.standing) & (expected <= 0.0)):
        detail = "a face in contact has friction 0, expected more: spines alone do not make a grasp"
        findings.add("hold", 1.0, "", limb=limb, time_s=plan.time_s[k], detail=detail)
    for limb in range(4):
        off = np.abs(plan.friction[:, limb] - expected[:, limb])
        findings.add_series("friction", off, plan.time_s, "", tolerance=tolerances.MATCH_REL, limb=limb)


def _check_faces(
    plan: PlanArrays, patch_radius_m: float, pad_height_m: tuple[float, float], findings: Findings
) -> None:
    """(10a): fingers on their faces, the whole patch on the face, pad height in range; opening axis on normal (9b)."""
    normal, finger = plan.face_normal, plan.finger_position + plan.touch_m
    for limb in range(4):
        gripped = plan.gripped[:, limb]
        if gripped.any():
            holds = plan.hold[gripped, limb]
            foot, size = plan.cuboids.foot_w_m[holds], plan.cuboids.size_m[holds]
            times = plan.time_s[gripped]
            along_y = plan.finger1_face[gripped, limb] >= 2
            depth = np.where(along_y, size[:, 1], size[:, 0])
            width = np.where(along_y, size[:, 0], size[:, 1])
            local = _in_holds(plan, plan.gripper_position[gripped, limb], holds)
            pads_m = local[:, 2]
            for f in (0, 1):
                n, lean = normal[gripped, limb, f], plan.lean[gripped, limb, f]
                offset = finger[gripped, limb, f] - foot
                off_face = np.abs((n * offset).sum(axis=1) - 0.5 * depth * np.cos(lean))
                place, patch = _in_holds(plan, finger[gripped, limb, f], holds), patch_radius_m * np.cos(lean)
                z = place[:, 2]
                along, left, right = _ends(plan, holds, along_y, 0.5 * width, z + patch, place)
                aside = np.maximum(along - left, right - along) + patch_radius_m
                beyond = np.maximum(patch - z, z - (size[:, 2] - patch))
                height = np.maximum(pad_height_m[0] - pads_m, pads_m - pad_height_m[1])
                found = {"contact_face": off_face, "contact_patch": np.maximum(aside, beyond), "pad_height": height}
                for name, values in found.items():
                    findings.add_series(name, values, times, "m", limb=limb, finger=f + 1)
            findings.add_series("finger_axis", _off_axis(plan, gripped, limb), times, "rad", limb=limb)
        on_wall = plan.on_wall[:, limb]
        if on_wall.any():
            height = np.abs(plan.gripper_position[on_wall, limb, 2])
            findings.add_series("contact_face", height, plan.time_s[on_wall], "m", limb=limb)


def _check_places(plan: PlanArrays, scenario: Scenario, findings: Findings) -> None:
    """(10a): on holds that have grips, a gripper is at one of those on its faces, at the start at that named there; it
    is turned about its opening axis as that is, on other holds not at all.
    """
    for k, limb in np.argwhere(plan.gripped & (plan.hold < len(scenario.holds))):
        body, on_y = scenario.holds[plan.hold[k, limb]], plan.finger1_face[k, limb] >= 2
        where: dict[str, Any] = {"limb": limb, "time_s": plan.time_s[k]}
        aslant_rad = _aslant_rad(plan.gripper_z_on_hold[k, limb], on_y)
        if not body.grips:
            findings.add("finger_axis", abs(aslant_rad), "rad", **where)
            continue
        grips = [grip for grip in body.grips if grip.faces == ("y" if on_y else "x")]
        if not grips:
            findings.add("hold", 1.0, "", detail=f"none of the grips of {body.name!r} is on these faces", **where)
            continue
        begun = scenario.start.grasps.get(LIMB_NAMES[limb]) if k == 0 else None
        if begun is not None and begun.grip is not None and begun.grip < len(grips):
            grips = [grips[begun.grip]]
        place = _in_holds(plan, plan.gripper_position[[k], limb], plan.hold[[k], limb])[0]
        offs = [(_off_grip(place, grip), abs(aslant_rad - grip.tilt_rad)) for grip in grips]
        off, turned = min(offs, key=lambda each: each[0] + _HAND_M * each[1])
        detail = f"off the grips of {body.name!r}"
        findings.add("contact_place", off, "m", detail=detail, **where)
        findings.add("finger_axis", turned, "rad", detail=detail, **where)


def _aslant_rad(z: Array, on_y: bool) -> float:
    """Angle of a gripper's z (3,), along its hold's axes, off the hold's, about the plus way of the faces it grips."""
    return float(np.arctan2(z[0] if on_y else -z[1], z[2]))


def _off_grip(place_m: Array, grip: Grip) -> float:
    """How far [m] a gripper's middle is off a grip, along the hold's axes."""
    x, y, z = place_m.tolist()
    aside: float = abs((x if grip.faces == "y" else y) - grip.aside_m)
    return aside if grip.height_m is None else max(aside, abs(z - grip.height_m))


def _in_holds(plan: PlanArrays, place_w_m: Array, holds: Indices) -> Array:
    """Places (n, 3) along the axes of holds (n,), off the middle of their feet."""
    return turned_back(plan.cuboids.rotation[holds], place_w_m - plan.cuboids.foot_w_m[holds])


def _off_axis(plan: PlanArrays, gripped: Flags, limb: int) -> Array:
    """Angles (n,) of the opening axis off the face's normal, its lean left out."""
    turn = rotation_of_gripper(plan.gripper_yaw[gripped, limb], plan.gripper_tilt[gripped, limb])
    up, lean = plan.off_hold[gripped, limb], plan.lean[gripped, limb, :1]
    return _angle(turn[..., 0], (plan.face_normal[gripped, limb, 0] - np.sin(lean) * up) / np.cos(lean))


def _angle(a: Array, b: Array) -> Array:
    """Between unit vectors (n, 3)."""
    return np.asarray(np.arctan2(np.linalg.norm(np.cross(a, b), axis=1), (a * b).sum(axis=1)))


def _ends(
    plan: PlanArrays, holds: Indices, along_y: Flags, half_m: Array, height_m: Array, place_m: Array
) -> tuple[Array, Array, Array]:
    """Of faces gripped (n,): where the pad is along the face, its place (n, 3) along the hold's axes, and the face's
    ends there at a height, where the sides beside it may lean in.
    """
    beside = np.where(along_y[:, None], [0, 1], [2, 3])  # plus and minus
    leans = np.tan(plan.cuboids.lean_rad[holds[:, None], beside])
    ends = np.array([1.0, -1.0]) * (half_m[:, None] - height_m[:, None] * leans)
    return np.where(along_y, place_m[:, 0], place_m[:, 1]), ends[:, 0], ends[:, 1]


def _check_rest(plan: PlanArrays, findings: Findings) -> None:
    """(10a): nothing moves from one stance knot to the next, nor up to the first air knot."""
    finger = plan.finger_position
    for limb in range(4):
        resting = plan.stance[:-1, limb]
        for f in (0, 1):
            moved = np.abs(np.diff(finger[:, limb, f], axis=0)).max(axis=1)
            moved = np.where(resting, moved, -np.inf)
            findings.add_series("contact_motion", moved, plan.time_s[1:], "m", limb=limb, finger=f + 1)
        changed = plan.stance[:-1, limb] & plan.stance[1:, limb]
        changed &= (np.diff(plan.hold[:, limb]) != 0) | (np.diff(plan.finger1_face[:, limb]) != 0)
        for k in np.flatnonzero(changed):
            detail = "hold or face changes without a swing"
            findings.add("contact_motion", 1.0, "m", limb=limb, time_s=plan.time_s[k + 1], detail=detail)


def _check_air(plan: PlanArrays, findings: Findings) -> None:
    """(10b): no force and no moment on a finger in the air."""
    for limb in range(4):
        air = ~plan.stance[:, limb]
        for f in (0, 1):
            loads = ("air_force", plan.finger_force, "N"), ("air_moment", plan.finger_moment, "N m")
            for name, values, unit in loads:
                size = np.where(air, np.linalg.norm(values[:, limb, f], axis=1), -np.inf)
                findings.add_series(name, size, plan.time_s, unit, limb=limb, finger=f + 1)


def _check_swings(plan: PlanArrays, findings: Findings) -> None:
    """A swing has at least two air knots and stance on both sides."""
    for swing in swings(plan):
        where = {"limb": swing.limb, "time_s": plan.time_s[swing.first]}
        if swing.last == swing.first:
            findings.add("swing_structure", 1.0, "knots", detail="a swing needs at least two air knots", **where)
        if swing.last == plan.n_knots - 1:
            detail = "a plan ends with every limb in stance"
            findings.add("swing_structure", 1.0, "knots", detail=detail, **where)


def occupancy(plan: PlanArrays) -> Indices:
    """Hold whose faces a limb's fingers are at during [k, k + 1), or foothold that they are on, -1 for none, (K, 4): in
    stance, at the first air knot (still in the old grasp) and at the last (closing on the new one).
    """
    held = plan.on_place.copy()
    for swing in swings(plan):
        before = plan.on_place[swing.first - 1] if swing.first > 0 else plan.hold_before[0]
        held[swing.first, swing.limb] = before[swing.limb]
        if swing.last < plan.n_knots - 1 and swing.last > swing.first:
            held[swing.last, swing.limb] = plan.on_place[swing.last + 1, swing.limb]
    return held


def _check_sharing(plan: PlanArrays, findings: Findings) -> None:
    """(10c) seen from the hold: at most one limb on each."""
    held = occupancy(plan)
    for first in range(4):
        for second in range(first + 1, 4):
            shared = (held[:, first] == held[:, second]) & (held[:, first] >= 0)
            edges = np.flatnonzero(np.diff(np.concatenate(([False], shared)).astype(np.int8)) == 1)
            for k in edges:
                detail = f"{LIMB_NAMES[first]} is on {plan.place_names[held[k, first]]!r} too"
                findings.add("hold_shared", 1.0, "limbs", limb=second, time_s=plan.time_s[k], detail=detail)
