"""Random walls: like the four-hold scene, a start under the four grippers and four holds further up; and ladders."""

from __future__ import annotations

from typing import Any

import numpy as np
import yaml
from crux_contracts import LIMB_NAMES
from numpy.typing import NDArray

START_XY_M = np.array([[0.14, 0.36], [0.14, -0.36], [-0.14, 0.36], [-0.14, -0.36]])  # middle of the limbs' workspace
SCATTER_M = 0.02
YAW_DEG = 9.0
ADVANCE_M = (0.12, 0.20)
LATERAL_M = 0.03
SPACING_M = 0.12  # between hold centres: two grippers side by side
BODY_HEIGHT_M = 0.185
HOLD_SIZE_M = 0.06
RUNG_M, COLUMN_M = 0.15, 0.36  # of a ladder: between two rungs, and of its columns from the middle
RUNG_SCATTER_M = 0.015
OBSTACLE_LONG_M, OBSTACLE_WIDE_M, OBSTACLE_HIGH_M = 0.03, (0.04, 0.16), (0.05, 0.18)
OBSTACLE_ASIDE_M = 0.06  # of its column, to either side
OBSTACLE_GAP_M = 0.06  # by which rungs are further apart where one stands
RUNGS, START_RUNGS = 8, 3  # of a ladder, usually, and those below the start's body or beside it
CONTACT = {  # micro-spines and sandpaper, as on the paper's walls
    "model": "patch",
    "patch_radius_m": 0.02,
    "max_normal_N": 60,
    "spine_shear_N": 5,
    "spine_twist_Nm": 0.05,
}
SPARE_AWAY_M = (0.125, 0.15)  # of a spare hold from the one that it stands in for
ROUNDING = 4  # digits, so that the file is what was drawn


def draw_holds(random: np.random.Generator) -> tuple[NDArray[np.float64], float, float]:
    """Hold centres (8, 2), start holds first, and the way (up, to the left) to the goal [m]."""
    while True:
        advance = float(random.uniform(*ADVANCE_M))
        lateral = float(random.uniform(-LATERAL_M, LATERAL_M))
        start = START_XY_M + random.uniform(-SCATTER_M, SCATTER_M, (4, 2))
        goal = START_XY_M + np.array([advance, lateral]) + random.uniform(-SCATTER_M, SCATTER_M, (4, 2))
        xy = np.round(np.vstack([start, goal]), ROUNDING)
        distance = np.linalg.norm(xy[:, None] - xy[None], axis=2) + SPACING_M * np.eye(len(xy))
        if distance.min() >= SPACING_M:
            return xy, round(advance, ROUNDING), round(lateral, ROUNDING)


def random_wall(seed: int, slope_deg: float = 45.0, *, all_limbs: bool = False) -> str:
    """A scenario as YAML text; the same seed draws the same wall. `all_limbs`: each limb must end on its goal hold."""
    random = np.random.default_rng(seed)
    xy_m, advance_m, lateral_m = draw_holds(random)
    yaw_deg = np.round(random.uniform(-YAW_DEG, YAW_DEG, len(xy_m)), 2)
    names = [f"{place}{limb}" for place in ("start", "goal") for limb in LIMB_NAMES]
    start = {name: f"start{name}" for name in LIMB_NAMES}
    scenario = _scenario(f"random-wall-{seed}", slope_deg, _holds(names, xy_m, yaw_deg), start)
    scenario["goal"] = {"body": {"position_m": [advance_m, lateral_m, BODY_HEIGHT_M]}}
    if all_limbs:
        scenario["goal"]["grasps"] = {name: {"hold": f"goal{name}", "faces": "x"} for name in LIMB_NAMES}
    return yaml.safe_dump(scenario, sort_keys=False)


def random_ladder(
    seed: int,
    rungs: int = RUNGS,
    slope_deg: float = 45.0,
    steps: int = 120,
    *,
    obstacles: int = 0,
    spares: bool = False,
) -> str:
    """A scenario as YAML text: two columns of holds, scattered and turned; the body goes up to the last rungs.

    So many `obstacles`, at most `most_obstacles`, stand in gaps above the start's rungs, by turns in one column and in
    the other: sills that limbs step over and posts that they go round. `spares`: beside each hold there is another.
    """
    random = np.random.default_rng(seed)
    names = [f"{side}-{rung}" for side in ("left", "right") for rung in range(1, rungs + 1)]
    xy = np.array([[(rung - 1) * RUNG_M - 0.14, side * COLUMN_M] for side in (1, -1) for rung in range(1, rungs + 1)])
    xy += random.uniform(-RUNG_SCATTER_M, RUNG_SCATTER_M, xy.shape)
    yaw_deg = np.round(random.uniform(-YAW_DEG, YAW_DEG, len(xy)), 2)
    start = {"LF": "left-3", "RF": "right-3", "LR": "left-1", "RR": "right-1"}
    parts = _obstacles(random, xy.reshape(2, rungs, 2), obstacles)
    if spares:
        xy, names = _with_spares(random, xy), [*names, *(f"spare-{name}" for name in names)]
        yaw_deg = np.append(yaw_deg, np.round(random.uniform(-YAW_DEG, YAW_DEG, len(yaw_deg)), 2))
    goal_m = (rungs - START_RUNGS) * RUNG_M + obstacles // 2 * OBSTACLE_GAP_M
    holds = _holds(names, np.round(xy, ROUNDING), yaw_deg)
    scenario = _scenario(f"random-ladder-{seed}", slope_deg, holds, start, steps)
    scenario["goal"] = {"body": {"position_m": [round(goal_m, ROUNDING), 0.0, BODY_HEIGHT_M]}}
    if parts:
        scenario["obstacles"] = parts
    return yaml.safe_dump(scenario, sort_keys=False)


def _with_spares(random: np.random.Generator, xy_m: NDArray[np.float64]) -> NDArray[np.float64]:
    """Centres of `xy_m` (n, 2), and of one more hold beside each (n, 2) [m]."""
    xy = xy_m
    for hold in xy_m:
        while True:
            turn_rad = random.uniform(0.0, 2.0 * np.pi)
            spare = hold + random.uniform(*SPARE_AWAY_M) * np.array([np.cos(turn_rad), np.sin(turn_rad)])
            if np.linalg.norm(xy - spare, axis=1).min() >= SPACING_M:
                xy = np.vstack([xy, spare])
                break
    return xy


def most_obstacles(rungs: int) -> int:
    """One in every gap of either column above the start's rungs."""
    return 2 * max(rungs - START_RUNGS, 0)


def _obstacles(random: np.random.Generator, columns: NDArray[np.float64], count: int) -> list[dict[str, Any]]:
    """Each half way between two rungs of a column (2, rungs, 2) of holds, whose upper ones give way to it."""
    above = [random.permutation(np.arange(START_RUNGS, columns.shape[1])) for _ in columns]
    gaps = [(columns[number % 2], above[number % 2][number // 2]) for number in range(count)]
    for column, rung in gaps:
        column[rung:, 0] += OBSTACLE_GAP_M
    parts = []
    for number, (column, rung) in enumerate(gaps, 1):
        place = column[rung - 1 : rung + 1].mean(axis=0)
        place[1] += random.uniform(-OBSTACLE_ASIDE_M, OBSTACLE_ASIDE_M)
        size = np.array([OBSTACLE_LONG_M, random.uniform(*OBSTACLE_WIDE_M), random.uniform(*OBSTACLE_HIGH_M)])
        rounded = {"position_m": place.round(ROUNDING).tolist(), "size_m": size.round(ROUNDING).tolist()}
        parts.append({"name": f"obstacle-{number}", **rounded})
    return parts


def _holds(names: list[str], xy_m: NDArray[np.float64], yaw_deg: NDArray[np.float64]) -> list[dict[str, Any]]:
    return [
        {
            "name": name,
            "position_m": position.tolist(),
            "size_m": [HOLD_SIZE_M] * 3,
            "yaw_deg": float(yaw),
            "friction": 2.2,
        }
        for name, position, yaw in zip(names, xy_m, yaw_deg, strict=True)
    ]


def _scenario(
    name: str, slope_deg: float, holds: list[dict[str, Any]], start: dict[str, str], steps: int = 40
) -> dict[str, Any]:
    """All of a scenario but its goal."""
    return {
        "version": 1,
        "name": name,
        "robot": "scaler",
        "wall": {"slope_deg": slope_deg, "friction": 0.6},
        "contact": CONTACT,
        "holds": holds,
        "start": {
            "body": {"position_m": [0.0, 0.0, BODY_HEIGHT_M]},
            "grasps": {limb: {"hold": hold, "faces": "x"} for limb, hold in start.items()},
        },
        "horizon": {"steps": steps, "dt_s": 2.0},
    }
