"""Walls like a given one: its holds are a little elsewhere and turned, so that one wall of any robot gives many."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import yaml
from crux_contracts.scenario_document import foot_of, scenario_document, set_foot
from crux_tools.errors import WorkFailed

from crux_simulation.benchmarks.random_fields import TRIES, stands
from crux_simulation.benchmarks.random_walls import ROUNDING

SCATTER_M, YAW_DEG = 0.01, 5.0


def wall_like(seed: int, *, text: str) -> str:
    """A scenario as YAML text: that of `text` with every hold off by SCATTER_M in x and y and YAW_DEG at most; the same
    seed draws the same. Its start stands, and so does its goal where it names four grasps.

    Raises WorkFailed where no draw does.
    """
    for attempt in range(TRIES):
        random = np.random.default_rng([seed, attempt])
        scene = scenario_document(text)
        scene["name"] = f"{scene['name']}-{seed}"
        for hold in scene["holds"]:
            foot = foot_of(hold)
            x_m, y_m = np.round(foot.position_m + random.uniform(-SCATTER_M, SCATTER_M, 2), ROUNDING).tolist()
            yaw_deg = round(foot.yaw_deg + float(random.uniform(-YAW_DEG, YAW_DEG)), 2)
            set_foot(hold, replace(foot, position_m=(x_m, y_m), yaw_deg=yaw_deg))
        back = {**scene, "start": _as_start(scene["goal"]), "goal": scene["start"]}
        drawn = yaml.safe_dump(scene, sort_keys=False)
        if stands(drawn) and (len(scene["goal"].get("grasps", {})) < 4 or stands(yaml.safe_dump(back))):
            return drawn
    raise WorkFailed(f"no start stands among {TRIES} walls drawn like {scene['name']}")


def _as_start(goal: dict[str, Any]) -> dict[str, Any]:
    """A goal as a place to begin from, which has no tolerances."""
    body = {key: value for key, value in goal["body"].items() if not key.startswith("tolerance_")}
    return {"body": body, "grasps": goal.get("grasps", {})}
