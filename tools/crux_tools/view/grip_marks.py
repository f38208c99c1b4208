"""Small marks where the pads of holds' grips touch, for drawings of walls."""

from __future__ import annotations

from typing import Any

import numpy as np
from crux_contracts.robot import Robot
from crux_contracts.scenario import Hold, parse_scenario
from crux_planner import Faces

from crux_tools.telemetry.rotations import hold_rotation
from crux_tools.view.bodies import Shape, numbers

SIZE_M = 0.012
RGB = [91, 42, 134]


def touched(hold: Hold, faces: str, robot: Robot, patch_radius_m: float) -> list[list[float]]:
    """By pad of every grip on a pair of faces, where it is on them, along the hold's own axes off its foot [m]."""
    found = []
    pair = "xy".index(faces)
    for grip in hold.grips_on(faces):
        at = Faces.of(hold, pair, robot, patch_radius_m, grip)
        if at is None:
            continue
        for side in (1.0, -1.0):
            place = np.array([grip.aside_m, grip.aside_m, at.height_m])
            place[pair] = at.off_m + side * at.half_m
            found.append(numbers(place))
    return found


def marks_of(plan: Any, robot: Robot) -> list[Shape]:
    """Those of a plan_t, in W."""
    scenario = parse_scenario(plan.scenario_yaml, any_robot=True)
    holds, found = {hold.name: hold for hold in scenario.holds}, []
    for body in plan.holds:
        for faces in "xy" if body.name in holds else "":
            for place in touched(holds[body.name], faces, robot, scenario.contact.patch_radius_m):
                at = np.array(body.position_w_m) + hold_rotation(body) @ np.array(place)
                still = {"wxyz": [1.0, 0.0, 0.0, 0.0], "rgb": RGB, "body": -1, "hold": -1}
                found.append({"kind": "sphere", "size": [SIZE_M] * 3, "position": numbers(at), **still})
    return found
