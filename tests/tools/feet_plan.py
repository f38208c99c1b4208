"""A plan written by hand in which two limbs grip holds and two stand on footholds of a slope; one foot steps on."""

from __future__ import annotations

import hashlib
from typing import Any

import numpy as np
import yaml
from crux_contracts import LIMB_NAMES
from crux_contracts.robot import load_robot
from crux_msgs import hold_t, limb_knot_t, plan_knot_t, plan_t
from hand_plan import (
    BODY_HEIGHT_M,
    HALF_HOLD_M,
    MASS_KG,
    NOMINAL_M,
    PAD_HEIGHT_M,
    Floats,
    Wall,
    finish,
)

FRICTION = 0.8
STEP_M = 0.05  # of the foot, up the slope
SHIFT_M = 0.02  # of the body, likewise
ASIDE_M, STRIP_M = 0.06, 0.03  # of a step to the left, and half as wide as the strip on which it ends
LIFT_M = 0.05  # of the gripper, over where it stood
FOOT_OPENING_M = 0.03
SQUEEZE_N = 20.0
ARM_M = 0.1  # a moment of a hand counts as a force on it
FEET = (2, 3)
MOVES = 3  # the limb that steps
HANDS_FROM = 2  # index of the first foothold: behind the holds


def share(wall: Wall, body_m: Floats, places_m: dict[int, Floats]) -> dict[int, Floats]:
    """Least forces and moments (6,) of the limbs that carry the robot; feet have no moment."""
    limbs = sorted(places_m)
    weight = np.array([1.0] * 3 + [1.0 / ARM_M] * 3)
    columns = []
    for limb in limbs:
        x, y, z = places_m[limb] - body_m
        column = np.zeros((6, 6))
        column[:3, :3] = column[3:, 3:] = np.eye(3)
        column[3:, :3] = [[0, -z, y], [z, 0, -x], [-y, x, 0]]
        columns.append(column / weight if limb not in FEET else column[:, :3])
    load = np.concatenate([-MASS_KG * wall.gravity, np.zeros(3)])
    answer = np.linalg.lstsq(np.hstack(columns), load, rcond=None)[0]
    found, at = {}, 0
    for limb, column in zip(limbs, columns, strict=True):
        part = answer[at : at + column.shape[1]]
        found[limb] = np.concatenate([part, np.zeros(3)]) if limb in FEET else part / weight
        at += column.shape[1]
    return found


class _Plan:
    """Collects knots; `up_m` (2,) is how far the stepping foot and the body have come."""

    def __init__(self, wall: Wall, dt_s: float) -> None:
        self.wall, self.dt_s = wall, dt_s
        self.knots: list[plan_knot_t] = []

    def add(self, body_m: Floats, foot_at: Floats, foothold: int) -> None:
        """`foothold` is that of the limb that moves, -1 while it is in the air with its gripper at `foot_at`."""
        places = {i: np.array([*NOMINAL_M[i], 0.0 if i in FEET else PAD_HEIGHT_M]) for i in range(4)}
        places[MOVES] = foot_at
        bearing = {i: place for i, place in places.items() if i != MOVES or foothold >= 0}
        wrenches = share(self.wall, body_m, bearing)
        knot = plan_knot_t()
        knot.time_s = len(self.knots) * self.dt_s
        knot.body_position_w_m, knot.body_rpy_rad = body_m.tolist(), [0.0] * 3
        for limb in range(4):
            part: limb_knot_t = knot.limbs[limb]
            part.gripper_position_w_m = places[limb].tolist()
            part.gripper_yaw_w_rad = 0.0
            part.finger_separation_m = 2 * (FOOT_OPENING_M if limb in FEET else HALF_HOLD_M)
            part.finger_force_w_n, part.finger_moment_w_nm = [0.0] * 6, [0.0] * 6
            if limb not in wrenches:
                part.phase, part.hold, part.finger1_face, part.friction = (
                    limb_knot_t.AIR,
                    -1,
                    limb_knot_t.FACE_NONE,
                    0.0,
                )
                continue
            foot = limb in FEET
            part.phase = limb_knot_t.STANCE
            part.hold = foothold if limb == MOVES else limb
            part.finger1_face = limb_knot_t.FACE_WALL if foot else limb_knot_t.FACE_PLUS_X
            part.friction = FRICTION if foot else self.wall.friction[0]
            squeeze = np.zeros(3) if foot else np.array([SQUEEZE_N, 0.0, 0.0])
            half = wrenches[limb][:3] / 2
            part.finger_force_w_n = [*(half + squeeze), *(half - squeeze)]
            part.finger_moment_w_nm = [*(wrenches[limb][3:] / 2)] * 2
        self.knots.append(knot)


def _foothold(name: str, place_m: Floats, radius_m: float) -> hold_t:
    made = hold_t()
    made.name, made.graspable = name, hold_t.FOOTHOLD
    made.position_w_m, made.size_m = place_m.tolist(), [2 * radius_m, 2 * radius_m, 0.0]
    made.friction = [0.0] * 4 + [FRICTION]
    return made


def _surfaces(higher_m: float) -> list[dict[str, Any]]:
    """The slope, in three strips where that in which RR lands sideways is higher than planned."""
    if higher_m == 0.0:
        return [
            {"name": "slope", "plane": {"point_m": [0.0, 0.0, 0.0], "normal": [0.0, 0.0, 1.0]}, "friction": FRICTION}
        ]
    lands = float(NOMINAL_M[MOVES][1]) + ASIDE_M
    ends = [-0.7, lands - STRIP_M, lands + STRIP_M, 0.7]
    strips = zip(("right", "landing", "left"), ends[:-1], ends[1:], (0.0, higher_m, 0.0), strict=True)
    return [
        {
            "name": name,
            "rectangle": {"pose": {"position_m": [0.0, (low + high) / 2, z]}, "size_m": [1.0, high - low]},
            "friction": FRICTION,
        }
        for name, low, high, z in strips
    ]


def stepping_plan(step_m: tuple[float, float] = (STEP_M, 0.0), higher_m: float = 0.0, dt_s: float = 1.0) -> plan_t:
    """The front limbs grip holds of a 45 degree slope, the rear ones stand on footholds; RR steps by `step_m`, up and
    aside, and the body follows by SHIFT_M. RR's surface is `higher_m` than planned where it lands, ASIDE_M aside.
    """
    wall = Wall(xy_m=NOMINAL_M[:2].copy(), yaw_rad=np.zeros(2), dt_s=dt_s)
    radius_m = load_robot("scaler").gripper.pad_radius_m
    old = np.array([*NOMINAL_M[MOVES], 0.0])
    new = old + np.array([*step_m, 0.0])
    up = np.array([0.0, 0.0, 1.0])
    collected = _Plan(wall, dt_s)
    body = np.array([0.0, 0.0, BODY_HEIGHT_M])
    for _ in range(3):
        collected.add(body, old, MOVES)
    collected.add(body, old + radius_m * up, -1)  # k0: the gripper's frame, where it stood
    collected.add(body, old + (radius_m + LIFT_M) * up, -1)
    collected.add(body, new + (radius_m + LIFT_M) * up, -1)
    for _ in range(2):
        collected.add(body, new, MOVES + 1)
    body = body + np.array([SHIFT_M, 0.0, 0.0])
    for _ in range(2):
        collected.add(body, new, MOVES + 1)
    plan = finish(wall, collected.knots)
    places = [np.array([*NOMINAL_M[2], 0.0]), old, new]
    return with_footholds(plan, [_foothold(f"f{i}", place, radius_m) for i, place in enumerate(places)], higher_m)


def _hold_of_version_2(hold: dict[str, Any]) -> dict[str, Any]:
    pose = {"position_m": [*hold["position_m"], 0.0], "rpy_deg": [0.0, 0.0, hold["yaw_deg"]]}
    return {key: hold[key] for key in ("name", "friction", "spines")} | {
        "pose": pose,
        "shape": {"box_m": hold["size_m"]},
    }


def with_footholds(plan: plan_t, footholds: list[hold_t], higher_m: float = 0.0) -> plan_t:
    """Of format 5, with a scenario that has them."""
    plan.format = plan_t.FORMAT_FEET
    plan.holds = [*plan.holds, *footholds]
    plan.n_holds = len(plan.holds)
    scenario = yaml.safe_load(plan.scenario_yaml)
    del scenario["wall"]
    scenario["version"] = 2
    scenario["gravity_m_s2"] = plan.gravity_w_m_s2
    scenario["surfaces"] = _surfaces(higher_m)
    scenario["holds"] = [_hold_of_version_2(hold) for hold in scenario["holds"]]
    off_m = [0.0] * (len(footholds) - 1) + [higher_m]
    scenario["footholds"] = [
        {"name": each.name, "position_m": [*each.position_w_m[:2], off]}
        for each, off in zip(footholds, off_m, strict=True)
    ]
    scenario["start"]["grasps"] = {
        name: {"hold": f"h{i}", "faces": "x"} if i not in FEET else {"foothold": f"f{i - HANDS_FROM}"}
        for i, name in enumerate(LIMB_NAMES)
    }
    plan.scenario_yaml = yaml.safe_dump(scenario)
    plan.scenario_sha256 = hashlib.sha256(plan.scenario_yaml.encode()).hexdigest()
    return signed(plan)


def signed(plan: plan_t) -> plan_t:
    """With the plan_id that goes with it."""
    plan.plan_id = ""
    plan.plan_id = hashlib.sha256(plan.encode()).hexdigest()
    return plan
