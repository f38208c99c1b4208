"""What the page edits of a scenario, the same for both versions of the file, and the scenario with it.

A file's content is what its YAML says. A sketch is what the page has: slope, friction, start, goal, steps and a list of
bodies, each with a number `id` that it keeps; places say where in the file's lists they are.
"""

from __future__ import annotations

import math
from copy import deepcopy
from typing import Any

from crux_contracts import LIMB_NAMES
from crux_contracts.robot import Robot
from crux_contracts.scenario import Scenario, Wall, parse_scenario
from crux_contracts.scenario_document import Foot, foot_of, set_foot

Content = dict[str, Any]
Sketch = dict[str, Any]
Places = dict[int, tuple[str, int]]  # by the id of a body, the list and its number in it
LISTS = ("holds", "obstacles")
STEPS, DT_S = 200, 2.0
SPINE_SHEAR_N, SPINE_TWIST_NM = 5, 0.05
SLOPE_DIGITS = 4
WALL_FRICTION = 0.6


def empty_wall(name: str, robot: Robot, slope_deg: float) -> Content:
    """A wall without holds, start and goal."""
    contact = {
        "model": "patch",
        "patch_radius_m": robot.gripper.pad_radius_m,
        "max_normal_N": robot.gripper.max_finger_force_N,
        "spine_shear_N": SPINE_SHEAR_N,
        "spine_twist_Nm": SPINE_TWIST_NM,
    }
    head = {"version": 1, "name": name, "robot": robot.name, "wall": {"slope_deg": slope_deg}, "contact": contact}
    return {**head, "holds": [], "horizon": {"steps": STEPS, "dt_s": DT_S}}


def scenario_of(content: Content, robot: Robot, path: str) -> Scenario:
    """The scenario; where start or goal are still missing, of a robot in the air that stays where it is. Raises
    ScenarioError.
    """
    height_m = sum(robot.body.height_m) / 2.0
    whole = {**content}
    if whole.get("start") is None:
        place = {"position_m": [0.0, 0.0, height_m], "opening_m": robot.gripper.opening_m[1]}
        body = {"position_m": [0.0, 0.0, height_m]}
        whole["start"] = {"body": body, "grasps": {}, "air": dict.fromkeys(LIMB_NAMES, place)}
    if whole.get("goal") is None:
        start = whole["start"].get("body", {}) if isinstance(whole["start"], dict) else {}
        whole["goal"] = {"body": deepcopy(start)}
    return parse_scenario(whole, path)


def missing(content: Content) -> list[str]:
    """What a plan needs that is not there yet."""
    return [end for end in ("start", "goal") if content.get(end) is None]


def places_of(content: Content) -> Places:
    """Of a file that has just been read."""
    every = [(kind, index) for kind in LISTS for index in range(len(content.get(kind) or []))]
    return dict(enumerate(every))


def sketch_of(content: Content, scenario: Scenario, places: Places) -> Sketch:
    """What the page begins with."""
    bodies = [
        {"id": number, "obstacle": kind == "obstacles", **_body(content[kind][index])}
        for number, (kind, index) in places.items()
    ]
    return {
        "slope_deg": round(scenario.wall.slope_deg, SLOPE_DIGITS),
        "friction": scenario.wall.friction,
        "steps": scenario.horizon.steps,
        "bodies": bodies,
        "start": content.get("start"),
        "goal": content.get("goal"),
    }


def _body(item: Content) -> Content:
    foot, lean_deg = foot_of(item), item.get("shape", {}).get("lean_deg", {})
    body = {"position_m": list(foot.position_m), "size_m": list(foot.size_m), "yaw_deg": foot.yaw_deg}
    rest = {"lean_deg": lean_deg, "friction": item.get("friction"), "grips": item.get("grips", [])}
    return {"name": item["name"], **body, **rest}


def content_with(
    content: Content, places: Places, sketch: Sketch
) -> tuple[Content, dict[str, list[int | None]], Places]:
    """The content as the page has it, of each list of bodies which item of the old one each is (None: a new one), and
    the new places. What the page does not edit stays. Raises KeyError, TypeError, ValueError for a sketch that is none.
    """
    version, new = content["version"], deepcopy(content)
    if version == 1:
        _set(new["wall"], "slope_deg", sketch["slope_deg"])
        _set(new["wall"], "friction", sketch["friction"], WALL_FRICTION)
    else:
        _set_version_2(new, sketch)
    _set(new["horizon"], "steps", sketch["steps"])
    for end in ("start", "goal"):
        new.pop(end, None)
        if sketch[end] is not None:
            new[end] = sketch[end]
    kept: dict[str, list[int | None]] = {}
    found: Places = {}
    for kind in LISTS:
        bodies = [each for each in sketch["bodies"] if bool(each["obstacle"]) == (kind == "obstacles")]
        known = [(places[each["id"]][1], each) for each in bodies if places.get(each["id"], ("", 0))[0] == kind]
        known.sort(key=lambda pair: pair[0])
        added = [each for each in bodies if places.get(each["id"], ("", 0))[0] != kind]
        kept[kind] = [*(index for index, _ in known), *(None for _ in added)]
        made = [_changed(content[kind][index], each, version) for index, each in known]
        made += [_changed(None, each, version) for each in added]
        if made or kind in content:
            new[kind] = made
        found |= {each["id"]: (kind, index) for index, each in enumerate([*(each for _, each in known), *added])}
    return new, kept, found


def _set(mapping: Content, key: str, value: Any, default: Any = None) -> None:
    """Unless it says so already."""
    if mapping.get(key, default) != value:
        mapping[key] = value


def _set_version_2(content: Content, sketch: Sketch) -> None:
    x, y, z = content["gravity_m_s2"]
    slope_deg = math.degrees(math.atan2(math.hypot(x, y), -z))
    if round(slope_deg, SLOPE_DIGITS) != sketch["slope_deg"]:
        content["gravity_m_s2"] = [round(each, SLOPE_DIGITS) for each in Wall(sketch["slope_deg"]).gravity_w_m_s2]
    _set(content["surfaces"][0], "friction", sketch["friction"], WALL_FRICTION)


def _changed(item: Content | None, body: Content, version: int) -> Content:
    """An item of a file's list with what the page has of it."""
    (x, y), size = body["position_m"], body["size_m"]
    if item is not None:
        new = deepcopy(item)
    elif version == 1:
        new = {"name": body["name"], "position_m": [x, y], "size_m": size}
    else:
        new = {"name": body["name"], "pose": {"position_m": [x, y, 0.0]}, "shape": {"box_m": size}}
    _set(new, "name", body["name"])
    set_foot(new, Foot((x, y), tuple(size), body["yaw_deg"]))
    if not body["obstacle"]:
        _set(new, "friction", body["friction"])
    return new
