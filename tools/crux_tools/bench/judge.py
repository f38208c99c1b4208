"""Judges a climb on what happened in physics; the runtime's log only tells what it meant to do at each cycle.

A slip: a pad that moved more than 5 mm along its face while loaded, counted from the pose in which the load began.
On point feet: more than 10 mm along the wall, for a foot that comes down late or early rubs a little.
A fall: the body more than 100 mm off its reference, or a limb in stance whose pad lost its hold. Goal: the body at rest
within the scenario's tolerance of the goal pose, on truth, not on the runtime's estimate.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from crux_contracts import LIMB_NAMES
from crux_contracts.interpolation import PlanReference
from crux_contracts.scenario import parse_scenario
from numpy.typing import NDArray

from crux_tools.bench.plant import CONTACT_PERIOD
from crux_tools.bench.recorder import Truth
from crux_tools.bench.robot_model import RobotModel
from crux_tools.bench.start_pose import rotation_from_rpy

SLIP_M = 0.005
WALK_SLIP_M = 0.010  # of a point foot
FALL_M = 0.100
LOST_HOLD_S = 0.1  # without contact in stance; shorter is chatter of one pad
UNLOADED_SHARE = 0.4  # of the contact force: below it a loaded pad counts as unloaded again
FULL_LOAD = 0.98  # share of the planned wrench from which on the wrench error counts
STANCE = 0  # LimbPhase

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]
Bools = NDArray[np.bool_]


@dataclass(frozen=True)
class Verdict:
    """How a climb went; lengths in metres, forces in newtons."""

    reached_goal: bool
    fell: bool
    fall_reason: str
    slips: int
    largest_slip_m: float
    body_max_m: float
    body_rms_m: float
    finger_max_m: float
    force_rms_n: float
    goal_error_m: float
    goal_error_rad: float
    link_contact_force_n: float


def goal_pose(plan: Any) -> tuple[Floats, Floats]:
    """Goal position (3,) and rotation (3, 3) of the body in W, from the scenario the plan carries."""
    body = parse_scenario(plan.scenario_yaml).goal.body
    return np.array(body.position_m), rotation_from_rpy(body.rpy_rad)


def rotations_from_quaternions(quaternion: Floats) -> Floats:
    """(n, 4) w, x, y, z -> (n, 3, 3)."""
    w, x, y, z = quaternion.T
    return np.stack(
        [
            np.stack([1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)], axis=-1),
            np.stack([2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)], axis=-1),
            np.stack([2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)], axis=-1),
        ],
        axis=-2,
    )


def angle_between(a: Floats, b: Floats) -> float:
    """Angle of the rotation from a to b, (3, 3) each [rad]."""
    turn = a.T @ b
    skew = np.array([turn[2, 1] - turn[1, 2], turn[0, 2] - turn[2, 0], turn[1, 0] - turn[0, 1]])
    return float(np.arctan2(np.linalg.norm(skew), np.trace(turn) - 1))


def pad_travel(truth: Truth, face_hold: Ints, contact_force_n: float, point_feet: bool = False) -> list[float]:
    """Largest tangential travel [m] of every loaded episode of every pad.

    An episode begins when a pad on a hold (point feet: on the wall) presses with `contact_force_n` and ends when it all
    but lets go.
    """
    travels: list[float] = []
    for pad in range(truth.pad_force_n.shape[1]):
        start: Floats | None = None
        normal = np.zeros(3)
        furthest = 0.0
        force, face = truth.pad_force_n[:, pad], truth.pad_face[:, pad]
        on_hold = (face >= 0) & ((face_hold[face] < 0) == point_feet)
        for i in range(len(force)):
            position = truth.pad_position_m[i, pad]
            if start is None:
                if on_hold[i] and force[i] >= contact_force_n:
                    start, furthest = position, 0.0
                    # pads press along the gripper's opening axis, feet along its z
                    normal = truth.gripper_rotation[i, pad // 2, :, 2 if point_feet else 0]
                continue
            if not on_hold[i] or force[i] < UNLOADED_SHARE * contact_force_n:
                travels.append(furthest)
                start = None
                continue
            moved = position - start
            furthest = max(furthest, float(np.linalg.norm(moved - normal * (normal @ moved))))
        if start is not None:
            travels.append(furthest)
    return travels


def longest_run(flags: Bools) -> int:
    """Length of the longest run of True."""
    padded = np.concatenate([[False], flags, [False]])
    edges = np.flatnonzero(padded[1:] != padded[:-1])
    return int((edges[1::2] - edges[::2]).max(initial=0))


def contact_forces_w(truth: Truth, plan: Any, hand_mass_kg: Floats) -> Floats:
    """Forces of the holds on the grippers, frame W, (n, 4, 3): the hand's weight taken off."""
    force_w = np.einsum("nlij,nlj->nli", truth.gripper_rotation, truth.hand_wrench_g[:, :, :3])
    return np.asarray(force_w - hand_mass_kg[None, :, None] * np.array(plan.gravity_w_m_s2))


def judge(truth: Truth, log: Any, plan: Any, robot: RobotModel) -> Verdict:
    """The verdict on a run from its first climbing cycle to its end.

    `log` is a telemetry.Telemetry of the same run, `robot` the model it ran on.
    """
    cycles = truth.cycle
    row = np.clip(np.searchsorted(log.state["cycle"], cycles), 0, len(log.state) - 1)
    state, references, limbs = log.state[row], log.references[row], log.limbs[row]
    period_s = CONTACT_PERIOD * float(robot.model.opt.timestep)
    begun = np.flatnonzero(log.state["supervisor_state"] == 2)
    first = int(np.searchsorted(cycles, log.state["cycle"][begun[0]])) if len(begun) else len(cycles)
    run = np.arange(len(cycles)) >= first

    body_reference_m, _ = PlanReference(plan).body(state["plan_time_s"])
    body_error = np.linalg.norm(truth.body_position_m - body_reference_m, axis=1)[run]
    fresh = run & log.limbs_fresh[row] & (state["cycle"] == cycles)
    gripper_error = np.linalg.norm(truth.gripper_position_m - references["gripper_position_w_m"], axis=2)[fresh]
    stance = (references["phase"] == STANCE) & run[:, None]
    loaded = stance & fresh[:, None] & (references["load"] > FULL_LOAD)
    force_error = (
        contact_forces_w(truth, plan, robot.model.body_subtreemass[robot.gripper_bodies]) - limbs["force_reference_w_n"]
    )
    square = np.sum(force_error**2, axis=2)[loaded]

    reasons = []
    if np.any(body_error > FALL_M):
        at = float(state["time_s"][run][np.argmax(body_error > FALL_M)])
        reasons.append(f"the body was more than {FALL_M * 1e3:.0f} mm off its reference at {at:.1f} s")
    off = truth.pad_face.reshape(-1, 4, 2) < 0
    without = (off.all(axis=2) if robot.point_feet else off.any(axis=2)) & stance  # a foot stands on one pad too
    for limb, name in enumerate(LIMB_NAMES):
        if longest_run(without[:, limb]) * period_s > LOST_HOLD_S:
            at = float(state["time_s"][np.argmax(without[:, limb])])
            reasons.append(f"limb {name} lost its hold in stance at {at:.1f} s")
    travels = pad_travel(truth, robot.face_hold, robot.robot.control.contact_force_N, robot.point_feet)
    slip_m = WALK_SLIP_M if robot.point_feet else SLIP_M
    goal_position, goal_rotation = goal_pose(plan)
    goal_error_m = float(np.linalg.norm(truth.body_position_m[-1] - goal_position))
    goal_error_rad = angle_between(goal_rotation, rotations_from_quaternions(truth.body_quaternion[-1:])[0])
    complete = bool(log.state["plan_complete"][-1])
    return Verdict(
        reached_goal=complete and goal_error_m <= plan.goal_tolerance_m and goal_error_rad <= plan.goal_tolerance_rad,
        fell=bool(reasons),
        fall_reason="; ".join(reasons),
        slips=sum(travel > slip_m for travel in travels),
        largest_slip_m=max(travels, default=0.0),
        body_max_m=float(body_error.max(initial=0.0)),
        body_rms_m=float(np.sqrt(np.mean(body_error**2))) if len(body_error) else 0.0,
        finger_max_m=float(gripper_error.max(initial=0.0)),
        force_rms_n=float(np.sqrt(square.mean())) if len(square) else 0.0,
        goal_error_m=goal_error_m,
        goal_error_rad=goal_error_rad,
        link_contact_force_n=float(truth.link_contact_force_n.max(initial=0.0)),
    )
