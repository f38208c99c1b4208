"""Random walls of two bounded planes that meet at an edge, hollow or not, across the climb or along it.

Start and goal stand, the limbs one or two rows of holds farther on at the goal; whether there is a way is not known.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import yaml
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from crux_simulation.benchmarks.random_fields import TRIES, stands
from crux_simulation.benchmarks.random_walls import BODY_HEIGHT_M, CONTACT, HOLD_SIZE_M, ROUNDING

TURN_DEG = (30.0, 110.0)  # between the planes
STEEPEST_DEG = (-15.0, 20.0)  # the steeper plane beyond vertical
PLANE_M = (1.0, 1.6)  # along and across an edge that is across the climb
ROW_M, SCATTER_M, YAW_DEG = 0.14, 0.012, 8.0  # between rows of holds, and how far these are off
COLUMN_M = 0.36  # of holds from the middle on one plane
ASIDE_M, FOOT_M = 0.05, 0.03  # of holds off where limbs have them in reach, where the edge is along the climb
EDGE_M, HOLLOW_M = 0.07, (0.09, 0.04)  # of the nearest holds off it; where the wall is hollow also by the turn [rad]
OVER_M = 0.06  # of the body at least over an edge along the climb
BELOW = (2, 3)  # rows on the lower plane, where the edge is across the climb; the start has the first and the third
ROUNDS = (1, 2)  # of all limbs by one row
STEPS = 100
GRAVITY_M_S2 = 9.81
FRICTION = 2.2

Array = NDArray[np.float64]


def random_planes(seed: int) -> str:
    """A scenario as YAML text; the same seed draws the same wall. The name says how the planes meet."""
    random = np.random.default_rng(seed)
    hollow, across = bool(random.random() < 0.5), bool(random.random() < 0.5)
    for attempt in range(TRIES):
        random = np.random.default_rng([seed, 1 + attempt])  # 0 would repeat the first draws
        turn_deg = float(np.round(random.uniform(*TURN_DEG), 1))
        scene = (_across if across else _along)(random, turn_deg, hollow)
        name = f"{'hollow' if hollow else 'convex'}-{'across' if across else 'along'}-{turn_deg:.0f}-{seed}"
        scene = {"version": 2, "name": name, **scene}
        back = {**scene, "start": scene["goal"], "goal": scene["start"]}
        text = yaml.safe_dump(scene, sort_keys=False)
        if stands(text) and stands(yaml.safe_dump(back)):
            return text
    raise RuntimeError(f"no standing start among {TRIES} walls drawn for seed {seed}")


def _across(random: np.random.Generator, turn_deg: float, hollow: bool) -> dict[str, Any]:
    """Over an edge along y of W."""
    rise = np.radians([-turn_deg, turn_deg] if hollow else [turn_deg, -turn_deg]) / 2.0
    frames = [Rotation.from_euler("y", -angle) for angle in rise]
    below, rounds = (int(random.integers(low, high + 1)) for low, high in (BELOW, ROUNDS))
    nearest_m = HOLLOW_M[0] + HOLLOW_M[1] * np.radians(turn_deg) if hollow else EDGE_M
    holds, grippers = list[tuple[str, Array, Rotation]](), list[Array]()
    for row in range(3 + rounds):
        upper = row >= below
        off_m = nearest_m + ROW_M * (row - below if upper else below - 1 - row)
        for column, y_m in (("left", COLUMN_M), ("right", -COLUMN_M)):
            along_m = (off_m + random.uniform(0.0, 2.0 * SCATTER_M)) * (1.0 if upper else -1.0)
            place = frames[upper].apply([along_m, y_m + random.uniform(-SCATTER_M, SCATTER_M), 0.0])
            holds.append((f"{column}-{row}", place, frames[upper]))
            grippers.append(place + frames[upper].apply([0.0, 0.0, HOLD_SIZE_M / 2.0]))
    ends = [_body([*grippers[2 * row : 2 * row + 2], *grippers[2 * row + 4 : 2 * row + 6]]) for row in (0, rounds)]
    lift = np.array([0.0, 0.0, BODY_HEIGHT_M - min(place[2] for place, _ in ends)])
    surfaces = [
        _rectangle(name, frame.apply([side * PLANE_M[0] / 2.0, 0.0, 0.0]) + lift, frame, PLANE_M)
        for name, side, frame in zip(("lower", "upper"), (-1.0, 1.0), frames, strict=True)
    ]
    blocks = [_hold(random, name, place + lift, frame) for name, place, frame in holds]
    bodies = [_pose(place + lift, turn) for place, turn in ends]
    return _scene(surfaces, blocks, bodies, rounds, np.radians(random.uniform(*STEEPEST_DEG)) - rise.max())


def _along(random: np.random.Generator, turn_deg: float, hollow: bool) -> dict[str, Any]:
    """Up between two planes that meet at an edge along x of W, below the middle of the body or behind it."""
    roll_deg = turn_deg / 2.0 if hollow else -turn_deg / 2.0
    sine, cosine = np.sin(np.radians(roll_deg)), np.cos(np.radians(roll_deg))
    aside_m = COLUMN_M + 0.16 * sine * abs(sine) + random.uniform(-ASIDE_M, ASIDE_M)
    foot_m = (0.235 * (1.0 - cosine) if hollow else 0.12 * sine) + random.uniform(-FOOT_M, FOOT_M)
    rounds = int(random.integers(ROUNDS[0], ROUNDS[1] + 1))
    slope = sine / cosine
    surfaces, holds = [], list[dict[str, Any]]()
    for name, side in (("left", 1.0), ("right", -1.0)):
        frame = Rotation.from_euler("x", side * roll_deg, degrees=True)
        size_m = (1.6, 2.0 * aside_m * float(np.hypot(1.0, slope)))
        surfaces.append(_rectangle(name, np.array([0.1, side * aside_m, foot_m]), frame, size_m))
        for row in range(3 + rounds):
            x_m = (row - 1) * ROW_M + random.uniform(-SCATTER_M, SCATTER_M)
            off_m = random.uniform(-SCATTER_M, SCATTER_M)
            place = np.array([x_m, side * (aside_m + off_m), foot_m + off_m * slope])
            holds.append(_hold(random, f"{name}-{row}", place, frame))
    height_m = max(BODY_HEIGHT_M, foot_m - aside_m * slope + OVER_M)
    ends = [_pose(np.array([x_m, 0.0, height_m]), Rotation.identity()) for x_m in (0.0, rounds * ROW_M)]
    return _scene(surfaces, holds, ends, rounds, np.radians(random.uniform(*STEEPEST_DEG)))


def _body(grippers: list[Array]) -> tuple[Array, Rotation]:
    """Where a body stands on two rows: so far off their middle, pitched as they rise."""
    rear, front = np.mean(grippers[:2], axis=0), np.mean(grippers[2:], axis=0)
    turn = Rotation.from_euler("y", -np.arctan2(front[2] - rear[2], front[0] - rear[0]))
    middle = np.array([(front[0] + rear[0]) / 2.0, 0.0, (front[2] + rear[2]) / 2.0])
    return middle + turn.apply([0.0, 0.0, BODY_HEIGHT_M - HOLD_SIZE_M / 2.0]), turn


def _pose(place_m: Array, turn: Rotation) -> dict[str, Any]:
    rpy_deg = np.round(turn.as_euler("xyz", degrees=True), 3) + 0.0
    return {"position_m": np.round(place_m, ROUNDING).tolist(), "rpy_deg": rpy_deg.tolist()}


def _rectangle(name: str, middle_m: Array, turn: Rotation, size_m: tuple[float, float]) -> dict[str, Any]:
    size = [float(np.round(each, ROUNDING)) for each in size_m]
    return {"name": name, "rectangle": {"pose": _pose(middle_m, turn), "size_m": size}}


def _hold(random: np.random.Generator, name: str, foot_m: Array, frame: Rotation) -> dict[str, Any]:
    """A block, turned a little in its plane."""
    turn = frame * Rotation.from_euler("z", random.uniform(-YAW_DEG, YAW_DEG), degrees=True)
    return {"name": name, "pose": _pose(foot_m, turn), "shape": {"box_m": [HOLD_SIZE_M] * 3}, "friction": FRICTION}


def _scene(
    surfaces: list[dict[str, Any]],
    holds: list[dict[str, Any]],
    bodies: list[dict[str, Any]],
    rounds: int,
    steep_rad: float,
) -> dict[str, Any]:
    """From the first and third row to those so many rounds on, with z = 0 of W as steep, beyond vertical."""
    up = np.array([np.cos(steep_rad), 0.0, -np.sin(steep_rad)])

    def stance(row: int) -> dict[str, Any]:
        rows = {"LF": ("left", row + 2), "RF": ("right", row + 2), "LR": ("left", row), "RR": ("right", row)}
        grasps = {limb: {"hold": f"{side}-{at}", "faces": "x"} for limb, (side, at) in rows.items()}
        return {"body": bodies[0 if row == 0 else 1], "grasps": grasps}

    return {
        "robot": "scaler",
        "gravity_m_s2": (np.round(-GRAVITY_M_S2 * up, ROUNDING) + 0.0).tolist(),
        "surfaces": surfaces,
        "contact": CONTACT,
        "holds": holds,
        "start": stance(0),
        "goal": stance(rounds),
        "horizon": {"steps": STEPS, "dt_s": 2.0},
    }
