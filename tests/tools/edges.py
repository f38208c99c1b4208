"""Walls of two planes, which meet at an edge along y of W or face each other, for tests of planner and physics."""

from __future__ import annotations

from typing import Any

import numpy as np
import yaml
from crux_tools.paths import SCENARIOS

CONVEX, CONCAVE = (0.0, -30.0, 0.0), (0.0, 30.0, -0.02)  # arguments of edge()
CONVEX_60 = (30.0, -30.0, 0.05, 0.07)
CHIMNEY = (0.515, 0.235, 90.0)  # of chimney()
SIZE_M = [1.0, 1.6]  # of each plane
COLUMNS = {"left": 0.36, "right": -0.36}
ROWS_M = (-0.14, 0.0, 0.14, 0.28)  # of holds along x


def edge(lower_deg: float, upper_deg: float, edge_z_m: float = 0.0, edge_x_m: float = 0.21) -> dict[str, Any]:
    """A vertical climb of one round, from a plane below an edge to one above it, by holds 60 mm high. The planes rise
    away from z = 0 of W up the wall by these angles; at the edge they are at a height.
    """
    planes = {"lower": (-1.0, lower_deg), "upper": (1.0, upper_deg)}

    def place(name: str, off_m: float, y_m: float) -> dict[str, Any]:
        rise = np.radians(planes[name][1])
        at = [edge_x_m + off_m * np.cos(rise), y_m, edge_z_m + off_m * np.sin(rise)]
        return {"position_m": [float(each) for each in at], "rpy_deg": [0.0, -planes[name][1], 0.0]}

    surfaces = [
        {"name": name, "rectangle": {"pose": place(name, side * SIZE_M[0] / 2, 0.0), "size_m": list(SIZE_M)}}
        for name, (side, _) in planes.items()
    ]
    holds = [
        {
            "name": f"{column}-{row}",
            "pose": place("upper" if x_m > edge_x_m else "lower", x_m - edge_x_m, y_m),
            "shape": {"box_m": [0.06, 0.06, 0.06]},
            "friction": 2.2,
        }
        for column, y_m in COLUMNS.items()
        for row, x_m in enumerate(ROWS_M)
    ]

    return _scene(surfaces, holds, "edge")


def over_a_ledge() -> dict[str, Any]:
    """A round down a vertical wall, from above a ledge under the trunk to beside it, where the body ends lower."""
    scene = edge(0.0, 0.0)
    top_m = 0.155
    ledge = {"pose": {"position_m": [0.41, 0.0, top_m]}, "size_m": [0.38, 0.2], "depth_m": top_m}
    scene["surfaces"].append({"name": "ledge", "rectangle": ledge})
    scene["start"], scene["goal"] = scene["goal"], scene["start"]
    scene["start"]["body"]["position_m"], scene["goal"]["body"]["position_m"] = [0.14, 0.0, 0.2], [0.0, 0.0, 0.16]
    return scene


def chimney(half_m: float, z_m: float, roll_deg: float) -> dict[str, Any]:
    """A vertical climb of one round between two walls so far left and right of the body, turned towards each other by
    an angle out of W's plane, with nothing behind: their middles at z.
    """
    surfaces, holds = [], []
    for name, side in (("left", 1.0), ("right", -1.0)):
        turn, y_m = [side * roll_deg, 0.0, 0.0], side * half_m
        middle = {"position_m": [0.1, y_m, z_m], "rpy_deg": list(turn)}
        surfaces.append({"name": name, "rectangle": {"pose": middle, "size_m": [1.6, 0.5]}})
        for row, x_m in enumerate(ROWS_M):
            pose = {"position_m": [x_m, y_m, z_m], "rpy_deg": list(turn)}
            holds.append({"name": f"{name}-{row}", "pose": pose, "shape": {"box_m": [0.06] * 3}, "friction": 2.2})
    return _scene(surfaces, holds, "chimney")


def _scene(surfaces: list[dict[str, Any]], holds: list[dict[str, Any]], name: str) -> dict[str, Any]:
    scene: dict[str, Any] = yaml.safe_load((SCENARIOS / "climb-one-step.yaml").read_text(encoding="utf-8"))

    def stance(front: int, x_m: float) -> dict[str, Any]:
        rows = {"LF": ("left", front), "RF": ("right", front), "LR": ("left", front - 2), "RR": ("right", front - 2)}
        grasps = {limb: {"hold": f"{column}-{row}", "faces": "x"} for limb, (column, row) in rows.items()}
        return {"body": {"position_m": [x_m, 0.0, 0.185]}, "grasps": grasps}

    del scene["wall"]
    more = {"version": 2, "name": name, "gravity_m_s2": [-9.81, 0, 0], "surfaces": surfaces, "holds": holds}
    goal = stance(3, 0.14)
    return scene | more | {"start": stance(2, 0.0), "goal": goal, "horizon": {"steps": 40, "dt_s": 2.0}}
