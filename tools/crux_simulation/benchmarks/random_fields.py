"""Random hold fields: any slope, holds of any yaw and size with slippery faces, a start that stands, any goal.

Only the start is chosen so that it is right (in reach and in equilibrium, else it is the scenario's author who has to
fix it); goals are drawn blindly, so that many of them cannot be reached.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import yaml
from crux_contracts import LIMB_NAMES
from crux_contracts.scenario import ScenarioError, parse_scenario

from crux_simulation.benchmarks.random_walls import BODY_HEIGHT_M, CONTACT, ROUNDING, START_XY_M

HOLDS = (16, 45)
SLOPE_DEG = (0.0, 110.0)
FIELD_X_M, FIELD_Y_M = (-0.35, 0.85), (-0.6, 0.6)
SPACING_M = 0.125  # between hold centres: never overlapping, now and then too near for two grippers
WIDTH_M, HEIGHT_M = (0.05, 0.1), (0.05, 0.07)
FRICTION = (1.2, 2.2)
SLIPPERY_SHARE = 0.3  # of the holds: one pair of their faces carries nothing
START_SCATTER_M = (0.1, 0.05)
GOAL_WAY_M, GOAL_BEARING_DEG = (0.05, 0.5), 120.0  # bearing: off straight up
GOAL_YAW_SHARE, GOAL_YAW_DEG = 0.3, 25.0
GOAL_GRASP_SHARE = 0.2
STEPS = 80
TRIES = 200

Random = np.random.Generator


def random_field(seed: int) -> str:
    """A scenario as YAML text; the same seed draws the same field."""
    for attempt in range(TRIES):
        random = np.random.default_rng([seed, attempt])
        text = yaml.safe_dump(_draw(random, f"random-field-{seed}"), sort_keys=False)
        if stands(text):
            return text
    raise RuntimeError(f"no standing start among {TRIES} fields drawn for seed {seed}")


def _draw(random: Random, name: str) -> dict[str, Any]:
    count, slope = int(random.integers(HOLDS[0], HOLDS[1] + 1)), float(np.round(random.uniform(*SLOPE_DEG), 1))
    holds = [_hold(random, f"h{i:02d}", xy) for i, xy in enumerate(_centres(random, count))]
    way, bearing = random.uniform(*GOAL_WAY_M), math.radians(random.uniform(-GOAL_BEARING_DEG, GOAL_BEARING_DEG))
    goal_xy = np.round([way * math.cos(bearing), way * math.sin(bearing)], ROUNDING).tolist()
    goal: dict[str, Any] = {"body": {"position_m": [*goal_xy, BODY_HEIGHT_M]}}
    if random.random() < GOAL_YAW_SHARE:
        goal["body"]["rpy_deg"] = [0.0, 0.0, float(np.round(random.uniform(-GOAL_YAW_DEG, GOAL_YAW_DEG), 1))]
    if random.random() < GOAL_GRASP_SHARE:
        limb, hold = str(random.choice(LIMB_NAMES)), int(random.integers(count))
        goal["grasps"] = {limb: {"hold": holds[hold]["name"], "faces": str(random.choice(["x", "y"]))}}
    return {
        "version": 1,
        "name": name,
        "robot": "scaler",
        "wall": {"slope_deg": slope},
        "contact": CONTACT,
        "holds": holds,
        "start": {
            "body": {"position_m": [0.0, 0.0, BODY_HEIGHT_M]},
            "grasps": {
                limb: {"hold": holds[i]["name"], "faces": str(random.choice(["x", "y"]))}
                for i, limb in enumerate(LIMB_NAMES)
            },
        },
        "goal": goal,
        "horizon": {"steps": STEPS, "dt_s": 2.0},
    }


def _centres(random: Random, count: int) -> list[list[float]]:
    """Four near the start's grippers, the others anywhere in the field."""
    centres = [xy + random.uniform(-1.0, 1.0, 2) * START_SCATTER_M for xy in START_XY_M]
    while len(centres) < count:
        xy = np.array([random.uniform(*FIELD_X_M), random.uniform(*FIELD_Y_M)])
        if min(float(np.linalg.norm(xy - other)) for other in centres) >= SPACING_M:
            centres.append(xy)
    return [np.round(xy, ROUNDING).tolist() for xy in centres]


def _hold(random: Random, name: str, position_m: list[float]) -> dict[str, Any]:
    size = np.round([*random.uniform(*WIDTH_M, 2), random.uniform(*HEIGHT_M)], 3).tolist()
    hold: dict[str, Any] = {
        "name": name,
        "position_m": position_m,
        "size_m": size,
        "yaw_deg": float(np.round(random.uniform(-180.0, 180.0), 1)),
    }
    friction = float(np.round(random.uniform(*FRICTION), 2))
    if random.random() >= SLIPPERY_SHARE:
        return {**hold, "friction": friction}
    slippery = str(random.choice(["x", "y"]))
    faces = {f"{sign}{axis}": 0.0 if axis == slippery else friction for axis in "xy" for sign in "+-"}
    return {**hold, "friction": {**faces, "top": friction}, "spines": {f"{sign}{slippery}": False for sign in "+-"}}


def stands(text: str) -> bool:
    """Whether the planner accepts the start."""
    from crux_planner.method_report import start_is_well_formed

    try:
        return start_is_well_formed(parse_scenario(text))
    except ScenarioError:
        return False
