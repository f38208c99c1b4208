"""Plans written by hand for the tools' tests: no planner involved, wrenches by least squares on the equilibrium."""

from __future__ import annotations

import hashlib
from dataclasses import dataclass, field

import numpy as np
import yaml
from crux_contracts import LIMB_NAMES
from crux_contracts.robot import load_robot
from crux_msgs import hold_t, limb_knot_t, plan_knot_t, plan_t
from numpy.typing import NDArray

ROBOT = "scaler"
MASS_KG = 9.6
SPINE_N, SPINE_NM = 5.0, 0.05
NOMINAL_M = np.array([[0.14, 0.36], [0.14, -0.36], [-0.14, 0.36], [-0.14, -0.36]])
HALF_HOLD_M = 0.03
PAD_HEIGHT_M = 0.035
BODY_HEIGHT_M = 0.185
LIFT_M = 0.14
LEAN_M = 0.03  # of the body away from the limb that swings
OPEN_M = 0.048
Floats = NDArray[np.float64]


@dataclass
class Wall:
    """Holds of a hand-written plan; `xy_m` and `yaw_rad` have one row a hold."""

    xy_m: Floats = field(default_factory=NOMINAL_M.copy)
    yaw_rad: Floats = field(default_factory=lambda: np.zeros(4))
    slope_deg: float = 45.0
    friction: tuple[float, ...] = (2.2,) * 5
    spines: tuple[int, ...] = (1,) * 5
    dt_s: float = 2.0  # between the plan's knots

    @property
    def gravity(self) -> Floats:
        """In frame W."""
        slope = np.radians(self.slope_deg)
        return 9.81 * np.array([-np.sin(slope), 0.0, -np.cos(slope)])


def _hold(wall: Wall, index: int) -> hold_t:
    hold = hold_t()
    hold.name = f"h{index}"
    hold.graspable = 1
    hold.position_w_m = [*wall.xy_m[index], 0.0]
    hold.size_m = [2 * HALF_HOLD_M] * 3
    hold.yaw_rad = float(wall.yaw_rad[index])
    hold.friction = list(wall.friction)
    hold.spines = list(wall.spines)
    return hold


def grasp_position(wall: Wall, hold: int) -> Floats:
    """Gripper centre on a hold."""
    return np.array([*wall.xy_m[hold], PAD_HEIGHT_M])


def share_weight(gravity: Floats, body_m: Floats, grippers_m: Floats) -> Floats:
    """Smallest forces (n, 3) of the grippers that carry the robot."""
    n = len(grippers_m)
    equilibrium = np.zeros((6, 3 * n))
    for i, lever in enumerate(grippers_m - body_m):
        equilibrium[:3, 3 * i : 3 * i + 3] = np.eye(3)
        x, y, z = lever
        equilibrium[3:, 3 * i : 3 * i + 3] = [[0, -z, y], [z, 0, -x], [-y, x, 0]]
    load = np.concatenate([-MASS_KG * gravity, np.zeros(3)])
    return np.asarray(np.linalg.lstsq(equilibrium, load, rcond=None)[0]).reshape(n, 3)


@dataclass
class _Limb:
    hold: int
    position: Floats
    yaw: float
    opening: float = HALF_HOLD_M
    air: bool = False


def _knot(wall: Wall, time_s: float, body_m: Floats, limbs: list[_Limb]) -> plan_knot_t:
    knot = plan_knot_t()
    knot.time_s = time_s
    knot.body_position_w_m = body_m.tolist()
    knot.body_rpy_rad = [0.0] * 3
    knot.body_velocity_w_m_s = [0.0] * 3
    knot.body_angular_velocity_b_rad_s = [0.0] * 3
    stance = [limb for limb in limbs if not limb.air]
    forces = iter(share_weight(wall.gravity, body_m, np.array([limb.position for limb in stance])))
    for index, limb in enumerate(limbs):
        part: limb_knot_t = knot.limbs[index]
        part.phase = limb_knot_t.AIR if limb.air else limb_knot_t.STANCE
        part.hold = -1 if limb.air else limb.hold
        part.finger1_face = limb_knot_t.FACE_NONE if limb.air else limb_knot_t.FACE_PLUS_X
        part.friction = 0.0 if limb.air else min(wall.friction[:2])
        part.gripper_position_w_m = limb.position.tolist()
        part.gripper_yaw_w_rad = limb.yaw
        part.finger_separation_m = 2 * limb.opening
        half = np.zeros(3) if limb.air else next(forces) / 2
        squeeze = 0.0 if limb.air else 20.0
        opening_axis = np.array([np.cos(limb.yaw), np.sin(limb.yaw), 0.0])
        part.finger_force_w_n = [*(half + squeeze * opening_axis), *(half - squeeze * opening_axis)]
        part.finger_moment_w_nm = [0.0] * 6
    return knot


def _scenario(wall: Wall, knots: list[plan_knot_t]) -> str:
    """The scenario such a plan could have come from."""
    faces = ("+x", "-x", "+y", "-y", "top")
    return yaml.safe_dump(
        {
            "version": 1,
            "name": "by-hand",
            "robot": ROBOT,
            "wall": {"slope_deg": wall.slope_deg, "friction": 0.6},
            "contact": {"model": "patch", "spine_shear_N": SPINE_N, "spine_twist_Nm": SPINE_NM},
            "holds": [
                {
                    "name": f"h{index}",
                    "position_m": xy.tolist(),
                    "size_m": [2 * HALF_HOLD_M] * 3,
                    "yaw_deg": float(np.degrees(yaw)),
                    "friction": dict(zip(faces, wall.friction, strict=True)),
                    "spines": dict(zip(faces, map(bool, wall.spines), strict=True)),
                }
                for index, (xy, yaw) in enumerate(zip(wall.xy_m, wall.yaw_rad, strict=True))
            ],
            "start": {
                "body": {"position_m": list(knots[0].body_position_w_m)},
                "grasps": {name: {"hold": f"h{i}", "faces": "x"} for i, name in enumerate(LIMB_NAMES)},
            },
            "goal": {"body": {"position_m": list(knots[-1].body_position_w_m)}},
            "horizon": {"steps": len(knots) - 1, "dt_s": wall.dt_s},
        }
    )


def finish(wall: Wall, knots: list[plan_knot_t], robot_sha256: str = "") -> plan_t:
    """A plan_t around the knots, with a scenario and its own hash; for the present robot if not told otherwise."""
    plan = plan_t()
    plan.format = plan_t.FORMAT
    plan.scenario_name = "by-hand"
    plan.scenario_yaml = _scenario(wall, knots)
    plan.scenario_sha256 = hashlib.sha256(plan.scenario_yaml.encode()).hexdigest()
    plan.robot_name = ROBOT
    plan.robot_sha256 = robot_sha256 or load_robot(ROBOT).hash
    plan.method = "by hand"
    plan.dt_s = wall.dt_s
    plan.gravity_w_m_s2 = wall.gravity.tolist()
    plan.patch_k_m = 2 / 3 * 0.02
    plan.max_normal_n = 60.0
    plan.spine_shear_n = SPINE_N
    plan.spine_twist_nm = SPINE_NM
    plan.goal_tolerance_m = 0.01
    plan.goal_tolerance_rad = float(np.radians(3))
    plan.holds = [_hold(wall, i) for i in range(len(wall.xy_m))]
    plan.n_holds = len(plan.holds)
    plan.knots = knots
    plan.n_knots = len(knots)
    plan.plan_id = ""
    plan.plan_id = hashlib.sha256(plan.encode()).hexdigest()
    return plan


def standing_plan(wall: Wall | None = None, body_path_m: Floats | None = None) -> plan_t:
    """All four limbs keep their holds (the wall's first four); the body follows `body_path_m`, (knots, 3)."""
    wall = wall or Wall()
    path = np.array([[0.0, 0.0, BODY_HEIGHT_M]] * 2) if body_path_m is None else body_path_m
    limbs = [_Limb(i, grasp_position(wall, i), float(wall.yaw_rad[i])) for i in range(4)]
    return finish(wall, [_knot(wall, k * wall.dt_s, body, limbs) for k, body in enumerate(path)])


def climbing_plan(
    advance_m: float = 0.13,
    slope_deg: float = 45.0,
    limbs_to_move: tuple[int, ...] = (0, 1, 2, 3),
    dt_s: float = 1.0,
    until: int | None = None,
) -> plan_t:
    """The limbs move up one after the other, the body a share of the way before each; of that so many knots."""
    xy = np.vstack([NOMINAL_M, NOMINAL_M + np.array([advance_m, 0.0])])
    yaw_rad = np.array([0.1, -0.05, 0.0, 0.08, -0.1, 0.05, 0.1, 0.0])
    wall = Wall(xy_m=xy, yaw_rad=yaw_rad, slope_deg=slope_deg, dt_s=dt_s)
    limbs = [_Limb(i, grasp_position(wall, i), float(wall.yaw_rad[i])) for i in range(4)]
    body = np.array([0.0, 0.0, BODY_HEIGHT_M])
    knots: list[plan_knot_t] = []

    def add(count: int = 1) -> None:
        for _ in range(count):
            knots.append(_knot(wall, len(knots) * wall.dt_s, body, limbs))

    add(2)
    for moving in limbs_to_move:
        share = (limbs_to_move.index(moving) + 1) / (len(limbs_to_move) + 1)
        body = np.array([advance_m * share, 0.0, BODY_HEIGHT_M])
        body[:2] -= LEAN_M * np.sign(NOMINAL_M[moving])
        add(3)
        limb = limbs[moving]
        limb.air = True
        add()
        new_hold = moving + 4
        over, yaw = grasp_position(wall, new_hold), float(wall.yaw_rad[new_hold])
        limb.opening = OPEN_M
        limb.position = np.array([*limb.position[:2], LIFT_M])
        add()
        old, old_yaw = limb.position, limb.yaw
        for share in (0.25, 0.5, 0.75, 1.0):
            limb.position = np.array([*(old[:2] + share * (over[:2] - old[:2])), LIFT_M])
            limb.yaw = old_yaw + share * (yaw - old_yaw)
            add()
        limbs[moving] = _Limb(new_hold, over, yaw)
        add(2)
    body = np.array([advance_m * len(limbs_to_move) / 4, 0.0, BODY_HEIGHT_M])
    add(2)
    return finish(wall, knots[:until])
