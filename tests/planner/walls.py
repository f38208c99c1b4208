"""Walls for the planner's tests, as scenario text."""

from __future__ import annotations

from typing import Any

import numpy as np
import yaml
from crux_contracts import LIMB_NAMES
from crux_contracts.scenario import Scenario, parse_scenario

FEET = {"LF": (0.14, 0.36), "RF": (0.14, -0.36), "LR": (-0.14, 0.36), "RR": (-0.14, -0.36)}


def hold(name: str, x: float, y: float, **more: Any) -> dict[str, Any]:
    """A hold of 60 mm, friction 2.2."""
    return {"name": name, "position_m": [x, y], "size_m": [0.06, 0.06, 0.06], "friction": 2.2, **more}


def two_rows(
    advance_m: float = 0.15, *, slope_deg: float = 45.0, steps: int = 40, all_limbs: bool = True
) -> dict[str, Any]:
    """A start hold under every gripper and one `advance_m` further up for each."""
    near = {limb: hold(f"{limb}-low", x, y) for limb, (x, y) in FEET.items()}
    far = {limb: hold(f"{limb}-high", x + advance_m, y + 0.01, yaw_deg=4) for limb, (x, y) in FEET.items()}
    goal: dict[str, Any] = {"body": {"position_m": [advance_m, 0.0, 0.185]}}
    if all_limbs:
        goal["grasps"] = {limb: {"hold": f"{limb}-high", "faces": "x"} for limb in LIMB_NAMES}
    return {
        "version": 1,
        "name": "two-rows",
        "robot": "scaler",
        "wall": {"slope_deg": slope_deg},
        "contact": {"model": "patch", "max_normal_N": 60, "spine_shear_N": 5, "spine_twist_Nm": 0.05},
        "holds": [*near.values(), *far.values()],
        "start": {
            "body": {"position_m": [0.0, 0.0, 0.185]},
            "grasps": {limb: {"hold": f"{limb}-low", "faces": "x"} for limb in LIMB_NAMES},
        },
        "goal": goal,
        "horizon": {"steps": steps, "dt_s": 2.0},
    }


def one_move(advance_m: float = 0.15, *, slope_deg: float = 45.0, steps: int = 40) -> dict[str, Any]:
    """Two rows of which only LF has a hold to go to: quick to plan."""
    wall = two_rows(advance_m, slope_deg=slope_deg, steps=steps, all_limbs=False)
    wall["holds"] = wall["holds"][:5]
    goal = {"position_m": [0.02, 0.0, 0.185]}
    wall["goal"] = {"body": goal, "grasps": {"LF": {"hold": "LF-high", "faces": "x"}}}
    return wall


def three_rows() -> dict[str, Any]:
    """The start holds and a third row 0.28 m above the upper ones: the front limbs must climb to it."""
    wall = two_rows(0.28, all_limbs=False, steps=60)
    wall["holds"] = [part for part in wall["holds"] if part["name"] not in ("LR-high", "RR-high")]
    return wall


def ladder(rows: int, *, pitch_m: float = 0.17, steps: int = 120, turned_deg: float = 6.0) -> dict[str, Any]:
    """Two columns of `rows` holds each, every other one turned; the body climbs to where the last two rows carry it."""
    wall = two_rows(steps=steps, all_limbs=False)
    wall["holds"] = [
        hold(f"{side}-{i}", round(-0.14 + i * pitch_m, 3), y, yaw_deg=turned_deg * (-1) ** i)
        for side, y in (("left", 0.36), ("right", -0.36))
        for i in range(rows)
    ]
    start = {"LF": "left-2", "RF": "right-2", "LR": "left-0", "RR": "right-0"}
    wall["start"] = {
        "body": {"position_m": [0.02, 0.0, 0.185]},
        "grasps": {limb: {"hold": name, "faces": "x"} for limb, name in start.items()},
    }
    wall["goal"] = {"body": {"position_m": [round(0.02 + (rows - 3) * pitch_m, 3), 0.0, 0.185]}}
    return wall


def blocked(share: float) -> dict[str, Any]:
    """One move, and a tall slab, or a share of it, between the hold that LF has and the next one."""
    wall = one_move(0.17)
    size = [round(share * edge, 4) for edge in (0.012, 0.2, 0.2)]
    return wall | {"obstacles": [{"name": "slab", "position_m": [0.225, 0.36], "size_m": size}]}


class _Plain(yaml.SafeDumper):
    def ignore_aliases(self, data: Any) -> bool:  # noqa: ARG002
        return True


def scenario(content: dict[str, Any]) -> Scenario:
    """Read a wall as the planner would from its file."""
    return parse_scenario(text(content), "wall.yaml")


def text(content: dict[str, Any]) -> str:
    """The wall as YAML."""
    return str(yaml.dump(content, Dumper=_Plain, sort_keys=False))


def scattered(seed: int, *, rise_m: float = 0.8, count: int = 44) -> dict[str, Any]:
    """Holds anywhere on a strip, 0.12 m apart, turned anyhow, and four to start on; the body climbs straight."""
    random = np.random.default_rng(seed)
    places = [np.array(place) for place in FEET.values()]
    while len(places) < count:
        place = random.uniform([-0.3, -0.6], [rise_m + 0.5, 0.6])
        if min(float(np.linalg.norm(place - other)) for other in places) > 0.12:
            places.append(place)
    wall = two_rows(steps=40 * round(10 * rise_m), all_limbs=False)
    wall["holds"] = [
        hold(f"h{i}", *np.round(place, 3).tolist(), yaw_deg=0.0 if i < 4 else float(random.integers(-90, 90)))
        for i, place in enumerate(places)
    ]
    for i, limb in enumerate(LIMB_NAMES):
        wall["start"]["grasps"][limb]["hold"] = f"h{i}"
    wall["goal"] = {"body": {"position_m": [rise_m, 0.0, 0.185]}}
    return wall
