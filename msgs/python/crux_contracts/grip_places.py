"""Which of a hold's grips a gripper of a plan is at."""

from __future__ import annotations

import math
from typing import Any

from .gripper_frames import gripper_rotation
from .scenario_types import FACE_NAMES, Grip, Scenario
from .turned_boxes import axes_of

_HAND_M = 0.1  # an angle off a grip counts as much as its place being off by what this turns


def grasp_of(plan: Any, limb: Any, scenario: Scenario) -> dict[str, Any]:
    """What a limb_knot_t of a plan_t grips, as the start of its scenario has it."""
    hold, face = plan.holds[limb.hold], FACE_NAMES[limb.finger1_face]
    grasp = {"hold": hold.name, "faces": face[1:], "finger1": face}
    grips = scenario.holds[scenario.hold_index(hold.name)].grips_on(face[1:])
    if len(grips) > 1:
        off = [float(a - b) for a, b in zip(limb.gripper_position_w_m, hold.position_w_m, strict=True)]
        up = gripper_rotation(limb.gripper_yaw_w_rad, limb.gripper_tilt_w_rad)[:, 2].tolist()
        axes = axes_of((*hold.tilt_rad, hold.yaw_rad))
        place, up = ([sum(a * b for a, b in zip(axis, way, strict=True)) for axis in axes] for way in (off, up))
        grasp["grip"] = min(range(len(grips)), key=lambda number: _off_m(place, up, grips[number]))
    return grasp


def _off_m(place_m: list[float], up: list[float], grip: Grip) -> float:
    """How far a gripper's middle and its way off the hold are from a grip's, along the hold's axes off its foot."""
    x, y, z = place_m
    height_m = z if grip.height_m is None else grip.height_m
    aslant_rad = math.atan2(up[0] if grip.faces == "y" else -up[1], up[2])
    aside_m = (y if grip.faces == "x" else x) - grip.aside_m
    return math.hypot(aside_m, z - height_m) + _HAND_M * abs(aslant_rad - grip.tilt_rad)
