"""A scenario's document and the places of its bodies, for tools that change it."""

from __future__ import annotations

from copy import deepcopy
from dataclasses import replace
from typing import Any

import pytest
from crux_contracts.scenario import ScenarioError
from crux_contracts.scenario_document import Foot, as_obstacle, foot_of, scenario_document, set_foot

FIRST: dict[str, Any] = {"name": "a", "position_m": [0.1, 0.2], "size_m": [0.06, 0.05, 0.04], "friction": 2}
SECOND: dict[str, Any] = {
    "name": "a",
    "pose": {"position_m": [0.1, 0.2, 0.03], "rpy_deg": [10, -20, 30]},
    "shape": {"box_m": [0.06, 0.05, 0.04], "lean_deg": {"+x": 5}},
    "friction": 2,
}
LEVEL: dict[str, Any] = {**SECOND, "pose": {"position_m": [0.1, 0.2, 0.0]}}


@pytest.mark.parametrize(("body", "yaw_deg"), [(FIRST, 0.0), (SECOND, 30), (LEVEL, 0.0)])
def test_only_what_differs_is_written(body: dict[str, Any], yaw_deg: float) -> None:
    foot, changed = foot_of(body), deepcopy(body)
    assert foot == Foot((0.1, 0.2), (0.06, 0.05, 0.04), yaw_deg)
    set_foot(changed, foot)
    assert changed == body
    moved = replace(foot, position_m=(0.5, 0.6), size_m=(0.07, 0.05, 0.04), yaw_deg=-4.0)
    set_foot(changed, moved)
    assert foot_of(changed) == moved
    set_foot(changed, foot)
    assert {**changed, "yaw_deg": 0.0, "pose": 0} == {**body, "yaw_deg": 0.0, "pose": 0}
    roll, pitch = body.get("pose", {}).get("rpy_deg", (0.0, 0.0))[:2]
    if "pose" in body:
        assert changed["pose"] == {"position_m": body["pose"]["position_m"], "rpy_deg": [roll, pitch, yaw_deg]}


def test_an_obstacle_is_the_box_around_a_hold() -> None:
    assert as_obstacle(FIRST) == {key: FIRST[key] for key in ("name", "position_m", "size_m")}
    assert as_obstacle(SECOND) == {"name": "a", "pose": SECOND["pose"], "shape": {"box_m": SECOND["shape"]["box_m"]}}


def test_a_document_is_read_as_scenarios_are() -> None:
    text = "name: on\nsteps: 1e1\n"
    first = scenario_document(text)
    first["name"] = "changed"
    assert scenario_document(text) == {"name": "on", "steps": 10.0}
    with pytest.raises(ScenarioError, match=r"wall\.yaml:1: .*expected a mapping"):
        scenario_document("[1]", "wall.yaml")
