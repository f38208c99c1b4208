"""A small plan made by hand: RF swings to a hold higher up the wall while the body moves 20 mm.

Wrenches come from a least-norm balance of forces and moments about the whole robot's centre of mass at every knot,
written here from the equations, with pinocchio for the posture, and not with the planner or the checker. Everything a
test needs to spoil is a field of the returned message.
"""

from __future__ import annotations

import hashlib
from functools import cache
from typing import Any

import numpy as np
import pinocchio as pin
from crux_contracts.robot import Limb, load_robot
from crux_msgs import hold_t, limb_knot_t, plan_knot_t, plan_t

MASS_KG = 9.6
DT_S = 2.0
FRICTION = 2.2
PATCH_RADIUS_M = 0.02
PATCH_K_M = 2.0 / 3.0 * PATCH_RADIUS_M
HALF_M = 0.03
PAD_Z_M = 0.035
HIGH_Z_M = 0.1
OPEN_M = 0.048
BODY_Z_M = 0.185
HOLDS = {"a": (0.14, 0.36), "b": (0.14, -0.36), "c": (-0.14, 0.36), "d": (-0.14, -0.36), "e": (0.26, -0.38)}
START = ("a", "b", "c", "d")
RF_NEW = "e"
YAW_RAD = 0.1
FIRST_AIR, LAST_AIR, N_KNOTS = 3, 6, 11
GOAL_X_M = 0.02
GOAL_TOLERANCE_M = 0.005
GOAL_TOLERANCE_DEG = 3.0

SCENARIO = """\
version: 1
name: by-hand
robot: scaler
wall: {{slope_deg: {slope}, friction: 0.6}}
contact: {{model: patch, patch_radius_m: 0.02, max_normal_N: 60, spine_shear_N: 5, spine_twist_Nm: 0.05}}
holds:
{holds}
start:
  body: {{position_m: [0.0, 0.0, 0.185], rpy_deg: [0, 0, 0]}}
  grasps: {{LF: {{hold: a, faces: x}}, RF: {{hold: b, faces: x}}, LR: {{hold: c, faces: x}}, RR: {{hold: d, faces: x}}}}
goal:
  body: {{position_m: [0.02, 0.0, 0.185], rpy_deg: [0, 0, 0], tolerance_m: 0.005, tolerance_deg: 3}}
  grasps: {{RF: {{hold: e, faces: x}}}}
horizon: {{steps: 10, dt_s: 2.0}}
"""


def gravity_w(slope_deg: float) -> np.ndarray:
    """g in the wall's frame."""
    slope = np.deg2rad(slope_deg)
    return 9.81 * np.array([-np.sin(slope), 0.0, -np.cos(slope)])


def scenario_yaml(slope_deg: float, hold_yaw_rad: float = YAW_RAD, faces: str = "x") -> str:
    """The scenario the plan belongs to."""
    line = "  - {{name: {}, position_m: [{}, {}], size_m: [0.06, 0.06, 0.06], yaw_deg: {!r}, friction: 2.2}}"
    holds = "\n".join(line.format(n, x, y, float(np.rad2deg(hold_yaw_rad))) for n, (x, y) in HOLDS.items())
    return SCENARIO.format(slope=slope_deg, holds=holds).replace("faces: x", f"faces: {faces}")


def make_plan(slope_deg: float = 45.0) -> plan_t:
    """The valid plan."""
    plan = plan_t()
    plan.format = plan_t.FORMAT
    plan.scenario_name, plan.robot_name, plan.method = "by-hand", "scaler", "by hand"
    plan.scenario_yaml = scenario_yaml(slope_deg)
    plan.dt_s, plan.gravity_w_m_s2 = DT_S, gravity_w(slope_deg).tolist()
    plan.patch_k_m = PATCH_K_M
    plan.max_normal_n, plan.spine_shear_n, plan.spine_twist_nm = 60.0, 5.0, 0.05
    plan.goal_tolerance_m, plan.goal_tolerance_rad = GOAL_TOLERANCE_M, float(np.deg2rad(GOAL_TOLERANCE_DEG))
    plan.holds = [_hold(name, x, y) for name, (x, y) in HOLDS.items()]
    plan.n_holds = len(plan.holds)
    speed = np.zeros(N_KNOTS)
    speed[1:9] = GOAL_X_M / (8 * DT_S)
    x = np.concatenate([[0.0], np.cumsum(DT_S * speed)[:-1]])
    plan.knots = [_knot(k, x[k], speed) for k in range(N_KNOTS)]
    plan.n_knots = N_KNOTS
    for k in range(N_KNOTS):
        at = min(k, N_KNOTS - 2)
        acceleration = np.array([(speed[at + 1] - speed[at]) / DT_S, 0.0, 0.0])
        source = plan.knots[at]
        if k == at:
            _balance(source, MASS_KG * (acceleration - gravity_w(slope_deg)))
        else:
            for limb, before in zip(plan.knots[k].limbs, source.limbs, strict=True):
                limb.finger_force_w_n = list(before.finger_force_w_n)
                limb.finger_moment_w_nm = list(before.finger_moment_w_nm)
    return sign(plan)


def balance(plan: plan_t, k: int) -> None:
    """Balance a knot anew, where limbs have been moved."""
    now, after = (np.array(plan.knots[at].body_velocity_w_m_s) for at in (k, k + 1))
    _balance(plan.knots[k], MASS_KG * ((after - now) / plan.dt_s - np.array(plan.gravity_w_m_s2)))


def sign(plan: plan_t) -> plan_t:
    """Put the hashes of robot, scenario and the plan itself into it."""
    plan.robot_sha256 = load_robot("scaler").hash
    plan.scenario_sha256 = hashlib.sha256(plan.scenario_yaml.encode()).hexdigest()
    plan.plan_id = ""
    plan.plan_id = hashlib.sha256(plan.encode()).hexdigest()
    return plan


def _hold(name: str, x: float, y: float) -> hold_t:
    hold = hold_t()
    hold.name, hold.graspable = name, 1
    hold.position_w_m, hold.size_m, hold.yaw_rad = [x, y, 0.0], [0.06, 0.06, 0.06], YAW_RAD
    hold.friction, hold.spines = [FRICTION] * 5, [1] * 5
    return hold


def _knot(k: int, x: float, speed: np.ndarray) -> plan_knot_t:
    knot = plan_knot_t()
    knot.time_s = k * DT_S
    knot.body_position_w_m, knot.body_rpy_rad = [float(x), 0.0, BODY_Z_M], [0.0, 0.0, 0.0]
    knot.body_velocity_w_m_s, knot.body_angular_velocity_b_rad_s = [float(speed[k]), 0.0, 0.0], [0.0, 0.0, 0.0]
    names = list(HOLDS)
    for limb in range(4):
        message = limb_knot_t()
        name = RF_NEW if limb == 1 and k > LAST_AIR else START[limb]
        hx, hy = HOLDS[name]
        air = limb == 1 and FIRST_AIR <= k <= LAST_AIR
        message.phase = limb_knot_t.AIR if air else limb_knot_t.STANCE
        message.hold = -1 if air else names.index(name)
        message.finger1_face = limb_knot_t.FACE_NONE if air else limb_knot_t.FACE_PLUS_X
        message.friction = 0.0 if air else FRICTION
        message.gripper_position_w_m, message.gripper_yaw_w_rad = [hx, hy, PAD_Z_M], YAW_RAD
        message.finger_separation_m = 2 * HALF_M
        message.finger_force_w_n, message.finger_moment_w_nm = [0.0] * 6, [0.0] * 6
        if air and k > FIRST_AIR:
            share = (k - FIRST_AIR - 1) / (LAST_AIR - FIRST_AIR - 1)
            old, new = np.array(HOLDS[START[1]]), np.array(HOLDS[RF_NEW])
            message.gripper_position_w_m = [*(old + share * (new - old)).tolist(), HIGH_Z_M]
            message.finger_separation_m = 2 * OPEN_M
        knot.limbs[limb] = message
    return knot


def centre_of_mass(knot: Any) -> np.ndarray:
    """Of the whole robot in W, with its grippers where the knot has them: inverse kinematics by pinocchio."""
    model, data = _robot()
    q = pin.neutral(model)
    body = pin.SE3(pin.rpy.rpyToMatrix(*knot.body_rpy_rad), np.array(knot.body_position_w_m))
    q[:7] = pin.SE3ToXYZQUAT(body)
    for limb, wanted in zip(load_robot("scaler").limbs, knot.limbs, strict=True):
        turn = pin.rpy.rpyToMatrix(0.0, 0.0, wanted.gripper_yaw_w_rad)
        _reach(model, data, q, limb, pin.SE3(turn, np.array(wanted.gripper_position_w_m)))
        for finger in limb.finger_joints:
            q[model.joints[model.getJointId(finger)].idx_q] = wanted.finger_separation_m / 2
    return np.array(pin.centerOfMass(model, data, q))


@cache
def _robot() -> tuple[Any, Any]:
    model = pin.buildModelFromUrdf(str(load_robot("scaler").urdf_path), pin.JointModelFreeFlyer())
    return model, model.createData()


def _reach(model: Any, data: Any, q: np.ndarray, limb: Limb, wanted: Any) -> None:
    """Newton's method from a bent elbow, by the frame's own Jacobian."""
    frame = model.getFrameId(limb.gripper_link, pin.FrameType.BODY)
    joints = [model.joints[model.getJointId(name)] for name in limb.joint_names]
    at, by = [joint.idx_q for joint in joints], [joint.idx_v for joint in joints]
    q[at] = [0.0, 0.6, 1.6, -0.6, 0.0, 0.0]
    for _ in range(100):
        pin.framesForwardKinematics(model, data, q)
        error = pin.log6(data.oMf[frame].actInv(wanted)).vector
        if np.abs(error).max() < 1e-11:
            return
        by_angle = pin.computeFrameJacobian(model, data, q, frame, pin.ReferenceFrame.LOCAL)[:, by]
        step = np.linalg.solve(by_angle.T @ by_angle + 1e-9 * np.eye(6), by_angle.T @ error)
        q[at] += step * min(1.0, 0.3 / np.abs(step).max())
    raise AssertionError(f"{limb.name} does not reach")


def _balance(knot: plan_knot_t, total_force: np.ndarray) -> None:
    """Least-norm wrenches that give the robot the total force and no moment about its centre of mass."""
    r = centre_of_mass(knot)
    stance = [limb for limb in knot.limbs if limb.phase == limb_knot_t.STANCE]
    up = np.array([0.0, 0.0, 1.0])
    columns = []
    for limb in stance:
        e = np.array([np.cos(limb.gripper_yaw_w_rad), np.sin(limb.gripper_yaw_w_rad), 0.0])
        t = np.array([-e[1], e[0], 0.0])
        arm = np.array(limb.gripper_position_w_m) - r
        for force in (2 * t, 2 * up, e):
            columns.append(np.concatenate([force, np.cross(arm, force)]))
        columns.append(np.concatenate([np.zeros(3), 2 * 0.02 * e]))  # twist in units of 0.02 m times a force
    wanted = np.concatenate([total_force, np.zeros(3)])
    solution = np.linalg.lstsq(np.array(columns).T, wanted, rcond=None)[0].reshape(-1, 4)
    for limb, (shear_t, shear_z, pull, twist) in zip(stance, solution, strict=True):
        e = np.array([np.cos(limb.gripper_yaw_w_rad), np.sin(limb.gripper_yaw_w_rad), 0.0])
        t = np.array([-e[1], e[0], 0.0])
        demand = np.sqrt(shear_t**2 + shear_z**2 + (0.02 * twist / PATCH_K_M) ** 2)
        squeeze = demand / FRICTION + 3.0 + abs(pull) / 2
        shear = shear_t * t + shear_z * up
        first, second = shear + (squeeze + pull / 2) * e, shear - (squeeze - pull / 2) * e
        limb.finger_force_w_n = [*first.tolist(), *second.tolist()]
        limb.finger_moment_w_nm = [*(0.02 * twist * e).tolist()] * 2
