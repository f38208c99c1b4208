"""A shipped wall with its holds turned out of its plane, for tests of the planner and of physics; plans changed."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from typing import Any

import yaml
from crux_contracts.plan_file import plan_id
from crux_contracts.robot import Robot
from crux_msgs import plan_t
from crux_planner.checker import check_plan
from crux_tools.paths import SCENARIOS

ROLL_DEG, FOOT_Z_M = 20.0, 0.01  # a foot's edge would be 10 mm in the wall
VOLUME: dict[str, Any] = {  # in front of the body, its nearest edge about 0.05 m off the wall
    "name": "volume",
    "pose": {"position_m": [0.42, 0.0, 0.06], "rpy_deg": [0, -35, 0]},
    "shape": {"box_m": [0.1, 0.3, 0.06]},
}


def turned(roll_deg: float = ROLL_DEG) -> dict[str, Any]:
    """One move on a vertical wall, the left holds rolled so and the right ones the other way, by a turned volume."""
    scene: dict[str, Any] = yaml.safe_load((SCENARIOS / "climb-one-step.yaml").read_text(encoding="utf-8"))
    del scene["wall"]
    for hold in scene["holds"]:
        roll = roll_deg if hold["name"].startswith("left") else -roll_deg
        hold["pose"] = {"position_m": [*hold.pop("position_m"), FOOT_Z_M], "rpy_deg": [roll, 0.0, 0.0]}
        hold["shape"] = {"box_m": hold.pop("size_m")}
    surface = {"name": "wall", "plane": {"point_m": [0, 0, 0], "normal": [0, 0, 1]}}
    more = {"version": 2, "name": "turned-holds", "gravity_m_s2": [-9.81, 0, 0], "surfaces": [surface]}
    return scene | more | {"obstacles": [VOLUME]}


def changed_violations(
    plan: plan_t, robot: Robot, change: Callable[[plan_t], None], old: str = "", new: str = ""
) -> set[str]:
    """Of a plan with something changed, also in its scenario's text."""
    plan = plan_t.decode(plan.encode())
    assert old in plan.scenario_yaml
    plan.scenario_yaml = plan.scenario_yaml.replace(old, new)
    plan.scenario_sha256 = hashlib.sha256(plan.scenario_yaml.encode()).hexdigest()
    change(plan)
    plan.plan_id = plan_id(plan)
    return {violation.constraint for violation in check_plan(plan, robot).violations}
