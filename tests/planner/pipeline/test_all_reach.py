"""Where limbs' boxes leave a hold out, a level body is planned with all of their inner reach."""

from __future__ import annotations

from typing import Any

import pytest
from crux_contracts.robot import load_robot
from crux_contracts.scenario import load_scenario
from crux_planner.pipeline import climb
from crux_planner.pipeline.entry import plan
from crux_planner.pipeline.restart import edited
from crux_tools.paths import SCENARIOS

Y_M = 0.43  # of both columns of holds: beyond the boxes, and within reach


def test_holds_beyond_the_boxes_are_reached(monkeypatch: pytest.MonkeyPatch) -> None:
    """Where the map finds nothing."""

    def apart(content: dict[str, Any]) -> None:
        for hold in content["holds"]:
            x, y = hold["position_m"]
            hold["position_m"] = [x, Y_M if y > 0.0 else -Y_M]

    monkeypatch.setattr(climb, "plan_by_map", lambda *_, **__: None)
    found = plan(edited(load_scenario(SCENARIOS / "climb-four-holds.yaml"), apart), load_robot("scaler"))
    assert found.check.ok
