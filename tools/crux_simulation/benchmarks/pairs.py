"""Start and goal pairs like the paper's ten: seeded draws, feasible by construction, as scenario YAML.

Plans keep the paper's N steps (`planner.idle: keep`), so that J and gaps of different methods are of the same problem.

`pair(task, seed)` is one scenario; the same seed draws the same one everywhere, so that tables made by different
benches speak of the same pairs. Climbing is the four-hold scene with every hold moved and turned; walking is a walk of
some length, direction and turn from feet that stand a little off their places, on the floor or on a slope.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import yaml
from crux_contracts import LIMB_NAMES

from crux_simulation.benchmarks.random_walls import BODY_HEIGHT_M, ROUNDING, START_XY_M, random_wall

TASKS = ("climbing", "walking")
CLIMB_SLOPE_DEG = 45.0
WALK_WAY_M = (0.05, 0.20)
WALK_DIRECTION_RAD = (-0.8, 0.8)  # off straight ahead
WALK_TURN_DEG = (-6.0, 6.0)
WALK_SLOPES_DEG = (0.0, 5.0, 10.0)
WALK_SCATTER_M = 0.015
KEEP = "planner: {idle: keep}\n"


def pair(task: str, seed: int) -> str:
    """Scenario of one pair as YAML text; `task` is one of TASKS."""
    if task == "climbing":
        return random_wall(seed, CLIMB_SLOPE_DEG, all_limbs=True) + KEEP
    if task == "walking":
        return walking_pair(seed)
    raise ValueError(f"task {task!r}: expected one of {', '.join(TASKS)}")


def pairs(task: str, count: int, first_seed: int = 1) -> list[tuple[int, str]]:
    """`count` pairs (seed, YAML text), seeds first_seed, first_seed + 1, ..."""
    return [(seed, pair(task, seed)) for seed in range(first_seed, first_seed + count)]


def walking_pair(seed: int) -> str:
    """A walk on point feet, N 40 knots of 0.08 s as the paper has it."""
    random = np.random.default_rng(seed)
    way, direction = float(random.uniform(*WALK_WAY_M)), float(random.uniform(*WALK_DIRECTION_RAD))
    turn, slope = float(random.uniform(*WALK_TURN_DEG)), float(random.choice(WALK_SLOPES_DEG))
    feet = np.round(START_XY_M + random.uniform(-WALK_SCATTER_M, WALK_SCATTER_M, (4, 2)), ROUNDING)
    goal = np.round([way * np.cos(direction), way * np.sin(direction)], ROUNDING).tolist()
    scenario: dict[str, Any] = {
        "version": 1,
        "name": f"walk-{seed}",
        "robot": "scaler",
        "wall": {"slope_deg": slope, "friction": 0.6},
        "contact": {"model": "point", "max_normal_N": 60},
        "start": {
            "body": {"position_m": [0.0, 0.0, BODY_HEIGHT_M]},
            "feet": {name: foot.tolist() for name, foot in zip(LIMB_NAMES, feet, strict=True)},
        },
        "goal": {"body": {"position_m": [*goal, BODY_HEIGHT_M], "rpy_deg": [0.0, 0.0, round(turn, 2)]}},
        "horizon": {"steps": 40, "dt_s": 0.08},
    }
    return yaml.safe_dump(scenario, sort_keys=False) + KEEP
