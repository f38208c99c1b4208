"""Walls whose holds have faces that lean, for the planner's tests."""

from __future__ import annotations

import math
from typing import Any

from walls import two_rows


def leaning(lean_deg: dict[str, float], wall: dict[str, Any] | None = None, foot_m: float = 0.09) -> dict[str, Any]:
    """The wall (two rows on a vertical one) as a file of version 2 whose holds lean so."""
    first = two_rows(slope_deg=90.0) if wall is None else wall
    slope = math.radians(first["wall"]["slope_deg"])
    plane = {"point_m": [0, 0, 0], "normal": [0, 0, 1]}
    holds = [
        {
            "name": hold["name"],
            "pose": {"position_m": [*hold["position_m"], 0.0], "rpy_deg": [0, 0, hold.get("yaw_deg", 0)]},
            "shape": {"box_m": [foot_m, *hold["size_m"][1:]], "lean_deg": lean_deg},
            "friction": hold["friction"],
        }
        for hold in first["holds"]
    ]
    rest = {key: value for key, value in first.items() if key != "wall"}
    return rest | {
        "version": 2,
        "gravity_m_s2": [-9.81 * math.sin(slope), 0.0, -9.81 * math.cos(slope)],
        "surfaces": [{"name": "wall", "plane": plane}],
        "holds": holds,
    }
