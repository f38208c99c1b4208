"""Random walls like the four-hold scene: a start under the robot's four grippers and four holds further up."""

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
    holds: list[dict[str, Any]] = [
        {
            "name": f"{'start' if index < len(LIMB_NAMES) else 'goal'}{LIMB_NAMES[index % len(LIMB_NAMES)]}",
            "position_m": position.tolist(),
            "size_m": [HOLD_SIZE_M] * 3,
            "yaw_deg": float(yaw),
            "friction": 2.2,
        }
        for index, (position, yaw) in enumerate(zip(xy_m, yaw_deg, strict=True))
    ]
    scenario: dict[str, Any] = {
        "version": 1,
        "name": f"random-wall-{seed}",
        "robot": "scaler",
        "wall": {"slope_deg": slope_deg, "friction": 0.6},
        "contact": {
            "model": "patch",
            "patch_radius_m": 0.02,
            "max_normal_N": 60,
            "spine_shear_N": 5,
            "spine_twist_Nm": 0.05,
        },
        "holds": holds,
        "start": {
            "body": {"position_m": [0.0, 0.0, BODY_HEIGHT_M]},
            "grasps": {name: {"hold": f"start{name}", "faces": "x"} for name in LIMB_NAMES},
        },
        "goal": {"body": {"position_m": [advance_m, lateral_m, BODY_HEIGHT_M]}},
        "horizon": {"steps": 40, "dt_s": 2.0},
    }
    if all_limbs:
        scenario["goal"]["grasps"] = {name: {"hold": f"goal{name}", "faces": "x"} for name in LIMB_NAMES}
    return yaml.safe_dump(scenario, sort_keys=False)
