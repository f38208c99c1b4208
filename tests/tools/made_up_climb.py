"""A small plan and the log of a made-up climb of it, with errors put in on purpose: tests know what must come out."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from io import BytesIO
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import numpy as np
from crux_contracts import LIMB_NAMES
from crux_contracts.channels import CHANNELS, log_topics
from crux_contracts.robot import Robot, load_robot
from crux_msgs import hold_t, limb_knot_t, plan_knot_t, plan_t
from crux_msgs.tables import SCHEMAS
from crux_tools.telemetry.slots import for_messages
from mcap.writer import CompressionType
from mcap_ros2.writer import Writer

SCENARIO_NAME = "made-up"
DT_S = 0.4  # between knots
CYCLE_S = 0.01
N_KNOTS = 8
PLAN_CYCLES = round((N_KNOTS - 1) * DT_S / CYCLE_S)
WEIGHT_N = 9.6 * 9.81
SLOPE_RAD = math.radians(45)
GRAVITY = [-9.81 * math.sin(SLOPE_RAD), 0.0, -9.81 * math.cos(SLOPE_RAD)]
START = {"LF": (0.14, 0.36), "RF": (0.14, -0.36), "LR": (-0.14, 0.36), "RR": (-0.14, -0.36)}
SWING_KNOTS = (3, 4)  # of LF
LF_GOAL = (0.27, 0.36)
HALF_HOLD_M = 0.03
PAD_HEIGHT_M = 0.04
GRASP_FORCE_N = 30.0
ROUGHER = 2.5  # friction of the -x face of hold b
SCENARIO_YAML = """\
version: 1
name: made-up
robot: scaler
wall: {slope_deg: 45, friction: 0.6}
contact: {model: patch, patch_radius_m: 0.02, max_normal_N: 60, spine_shear_N: 5, spine_twist_Nm: 0.05}
holds:
  - {name: a, position_m: [0.14, 0.36], size_m: [0.06, 0.06, 0.06], yaw_deg: 0, friction: 2.2}
  - {name: b, position_m: [0.14, -0.36], size_m: [0.06, 0.06, 0.06], yaw_deg: 0, friction: 2.2}
  - {name: c, position_m: [-0.14, 0.36], size_m: [0.06, 0.06, 0.06], yaw_deg: 0, friction: 2.2}
  - {name: d, position_m: [-0.14, -0.36], size_m: [0.06, 0.06, 0.06], yaw_deg: 0, friction: 2.2}
  - {name: e, position_m: [0.27, 0.36], size_m: [0.06, 0.06, 0.06], yaw_deg: 0, friction: 2.2}
obstacles:
  - {name: pillar, position_m: [0.6, 0.0], size_m: [0.06, 0.06, 0.06], yaw_deg: 0}
start:
  body: {position_m: [0.0, 0.0, 0.185], rpy_deg: [0, 0, 0]}
  grasps: {LF: {hold: a, faces: x}, RF: {hold: b, faces: x}, LR: {hold: c, faces: x}, RR: {hold: d, faces: x}}
goal:
  body: {position_m: [0.05, 0.0, 0.185], rpy_deg: [0, 0, 0], tolerance_m: 0.01, tolerance_deg: 3}
horizon: {steps: 8, dt_s: 0.4}
"""


def _hold(name: str, x: float, y: float, graspable: int = 1) -> hold_t:
    hold = hold_t()
    hold.name, hold.graspable = name, graspable
    hold.position_w_m, hold.size_m, hold.yaw_rad = [x, y, 0.0], [2 * HALF_HOLD_M] * 3, 0.0
    hold.friction, hold.spines = [2.2] * 5, [1] * 5
    return hold


def _limb_knot(index: int, knot: int) -> limb_knot_t:
    names = list(START)
    limb = limb_knot_t()
    swings = index == 0
    in_air = swings and SWING_KNOTS[0] <= knot <= SWING_KNOTS[1]
    landed = swings and knot > SWING_KNOTS[1]
    x, y = LF_GOAL if landed or (in_air and knot == SWING_KNOTS[1]) else START[names[index]]
    limb.phase = limb.AIR if in_air else limb.STANCE
    limb.hold = -1 if in_air else 4 if landed else index
    limb.finger1_face = limb.FACE_NONE if in_air else limb.FACE_PLUS_X
    limb.friction = 0.0 if in_air else 2.2
    limb.gripper_position_w_m = [x, y, PAD_HEIGHT_M]
    limb.gripper_yaw_w_rad = 0.0
    limb.finger_separation_m = 2 * (0.048 if in_air else HALF_HOLD_M)
    if not in_air:
        stance = 3 if SWING_KNOTS[0] <= knot <= SWING_KNOTS[1] else 4
        fx, fz = WEIGHT_N * math.sin(SLOPE_RAD) / stance, WEIGHT_N * math.cos(SLOPE_RAD) / stance
        limb.finger_force_w_n = [GRASP_FORCE_N + fx / 2, 0, fz / 2, -GRASP_FORCE_N + fx / 2, 0, fz / 2]
    return limb


def made_up_plan() -> plan_t:
    """LF goes from hold a to hold e while the others stay and the body rises by 5 cm."""
    plan = plan_t()
    plan.format = plan.FORMAT
    plan.scenario_name, plan.scenario_yaml, plan.robot_name = SCENARIO_NAME, SCENARIO_YAML, "scaler"
    plan.plan_id, plan.method, plan.dt_s = "ab" * 32, "made up", DT_S
    plan.robot_sha256 = load_robot("scaler").hash
    plan.gravity_w_m_s2 = GRAVITY
    plan.patch_k_m, plan.max_normal_n = 0.0134, 60.0
    plan.spine_shear_n, plan.spine_twist_nm = 5.0, 0.05
    plan.goal_tolerance_m, plan.goal_tolerance_rad = 0.01, math.radians(3)
    plan.holds = [_hold(name, x, y) for name, (x, y) in zip("abcd", START.values(), strict=True)]
    plan.holds += [_hold("e", *LF_GOAL), _hold("pillar", 0.6, 0.0, graspable=0)]
    plan.holds[1].friction = [2.2, ROUGHER, 2.2, 2.2, 2.2]
    plan.n_holds = len(plan.holds)
    for k in range(N_KNOTS):
        knot = plan_knot_t()
        knot.time_s = k * DT_S
        share = k / (N_KNOTS - 1)
        knot.body_position_w_m = [0.05 * share, 0.0, 0.185]
        knot.limbs = [_limb_knot(index, k) for index in range(4)]
        plan.knots.append(knot)
    plan.n_knots = N_KNOTS
    return plan


@dataclass(frozen=True)
class Story:
    """What happens in the made-up climb; errors are constant so that their root mean square is known."""

    ready_cycles: int = 50
    holding_cycles: int = 20
    wait_cycles: int = 30  # LF, for its fingers to open
    body_error_m: tuple[float, float, float] = (0.003, 0.0, 0.004)
    force_error_n: dict[int, tuple[float, float, float]] = field(
        default_factory=lambda: {0: (0.6, 0.0, 0.8), 1: (0.0, 0.5, 0.0), 2: (0.0, 0.0, 0.0), 3: (0.0, 0.0, 0.25)}
    )
    faults: tuple[tuple[int, int, int], ...] = ()  # (cycle, code, limb)
    pace: str = "bus"
    late_ns: int = 0
    dropped: int = 0
    slack: tuple[int, int, float] | None = None  # (cycle, limb, newtons): a squeeze that is so small for one cycle
    joint_torque_nm: tuple[float, ...] = (0.0,) * 24
    silent: tuple[int, int] | None = None  # (cycle, joint): one that did not answer
    metadata: dict[str, str] = field(default_factory=dict)  # what the runtime says of itself besides
    whole_file: bool = False  # has a summary without an orderly end, as after each of the runtime's flushes


def write_log(path: Path, story: Story | None = None, finish: bool = True, attached: bool = True) -> int:
    """Writes the log, with the robot description `attached` or not; returns the number of control cycles.

    finish=False leaves it as a killed runtime does.
    """
    story, robot = story or Story(), load_robot("scaler")
    key = repr((story, finish, attached, robot.folder, robot.hash, SCHEMAS))
    if key not in _WRITTEN:
        _WRITTEN[key] = _log(story, robot, finish, attached)
    path.write_bytes(_WRITTEN[key])
    return _cycles(story)


_WRITTEN: dict[str, bytes] = {}  # many tests look at the same story


def _cycles(story: Story) -> int:
    return story.ready_cycles + PLAN_CYCLES + story.wait_cycles + story.holding_cycles


def _log(story: Story, robot: Robot, finish: bool, attached: bool) -> bytes:
    plan, file = made_up_plan(), BytesIO()
    # The CDR bytes come from mcap-ros2-support: an encoder that shares nothing with the reader under test.
    writer = Writer(file, chunk_size=240_000, compression=CompressionType.LZ4)
    said = {"version": "0", "robot": "scaler", "robot_sha256": robot.hash, "pace": story.pace, **story.metadata}
    writer.add_metadata("crux", said)
    for described in (robot.folder / "robot.yaml", robot.urdf_path) if attached else ():
        writer.add_attachment(0, 0, described.name, "text/plain", described.read_bytes())
    schemas = {
        topic: writer.register_msgdef(*SCHEMAS[channel.type])
        for channel in CHANNELS
        if channel.writer != "simulation"
        for topic in log_topics(channel)
    }

    def put(topic: str, at: int, /, **fields: Any) -> None:
        writer.write_message(topic, schemas[topic], SimpleNamespace(**fields), log_time=at * int(CYCLE_S * 1e9))

    writer.write_message("/plan", schemas["/plan"], plan, log_time=0)
    put("/acknowledgement", 0, subject=2, request_id=1, piece=-1, verdict=1, supervisor_state=1,
        plan_id="", reason="not ready yet")  # fmt: skip
    for cycle in range(_cycles(story)):
        _put_cycle(put, plan, story, cycle, PLAN_CYCLES)
    for cycle, code, limb in story.faults:
        put("/fault", cycle, cycle=cycle, code=code, limb=limb, node=0, value=0.07, limit=0.06)
    if finish:
        writer.add_metadata("crux_end", {"cycles": str(_cycles(story)), "dropped_records": str(story.dropped)})
    if finish or story.whole_file:
        writer.finish()  # type: ignore[no-untyped-call]
    return file.getvalue()


def plan_time(story: Story, cycle: int, plan_cycles: int) -> tuple[float, bool]:
    """Plan time in a cycle, and whether its clock stands still (waiting for LF)."""
    since = cycle - story.ready_cycles
    wait_from = round((SWING_KNOTS[0] + 0.5) * DT_S / CYCLE_S)
    if since < 0:
        return 0.0, False
    if since <= wait_from:
        return since * CYCLE_S, False
    if since < wait_from + story.wait_cycles:
        return wait_from * CYCLE_S, True
    return min(since - story.wait_cycles, plan_cycles) * CYCLE_S, False


def _put_cycle(put: Any, plan: plan_t, story: Story, cycle: int, plan_cycles: int) -> None:
    time, waiting = plan_time(story, cycle, plan_cycles)
    running = cycle >= story.ready_cycles
    done = time >= plan_cycles * CYCLE_S
    state = 3 if done else 2 if running else 1
    knot = plan.knots[min(int(time / DT_S), N_KNOTS - 1)]
    squeeze = [GRASP_FORCE_N] * 4
    if story.slack is not None and cycle == story.slack[0]:
        squeeze[story.slack[1]] = story.slack[2]
    fresh = for_messages([int((cycle, joint) != story.silent) for joint in range(24)])
    body = np.array([0.05 * time / ((N_KNOTS - 1) * DT_S), 0.0, 0.185])
    put("/robot_state", cycle, cycle=cycle, time_s=cycle * CYCLE_S, supervisor_state=state, plan_complete=int(done),
        waiting_for=2 if waiting else 0, waiting_limb=0 if waiting else -1, fault_code=0, missed_cycles=cycle // 100,
        plan_time_s=time, plan_end_s=plan_cycles * CYCLE_S, body_position_w_m=(body + story.body_error_m).tolist(),
        body_quaternion_w=[1.0, 0, 0, 0], body_reference_position_w_m=body.tolist(),
        body_reference_quaternion_w=[1.0, 0, 0, 0], centre_of_mass_w_m=body.tolist())  # fmt: skip
    put("/control_input", cycle, cycle=cycle, dt_s=CYCLE_S, operator_command=0, joint_fresh=fresh,
        joint_state=[2] * 28, joint_faults=[0] * 28, joint_position_rad=[0.5] * 28, joint_velocity_rad_s=[0.0] * 28,
        joint_torque_nm=for_messages(story.joint_torque_nm), gripper_fresh=[1] * 4, gripper_state=[2] * 4,
        gripper_faults=[0] * 4, finger_opening_m=[0.03] * 4, finger_speed_m_s=[0.0] * 4, finger_force_n=squeeze,
        ft_fresh=[1] * 4, ft_status=[0] * 4, ft_force_g_n=[0.0] * 12, ft_moment_g_nm=[0.0] * 12)  # fmt: skip
    put("/control_output", cycle, cycle=cycle, joint_mode=[2] * 28, joint_position_rad=[0.5] * 28,
        joint_velocity_rad_s=[0.0] * 28, joint_torque_nm=[0.0] * 28, gripper_mode=[2] * 4, finger_opening_m=[0.03] * 4,
        finger_speed_limit_m_s=[0.02] * 4, finger_force_limit_n=[GRASP_FORCE_N] * 4)  # fmt: skip
    put("/cycle_timing", cycle, cycle=cycle, wall_ns=cycle * 2_000_000, wait_ns=1_000_000, compute_ns=100_000 + cycle,
        send_ns=50_000, late_ns=story.late_ns)  # fmt: skip
    for index in range(4):
        limb = knot.limbs[index]
        stance = limb.phase == limb.STANCE
        force = np.array(limb.finger_force_w_n).reshape(2, 3).sum(axis=0) * stance
        pose = {"gripper_position_w_m": list(limb.gripper_position_w_m)}
        put(f"/{LIMB_NAMES[index]}/limb_reference", cycle, limb=index, phase=0 if stance else 4, load=float(stance),
            **pose, gripper_yaw_w_rad=limb.gripper_yaw_w_rad, finger_opening_m=limb.finger_separation_m / 2,
            force_w_n=force.tolist(), moment_w_nm=[0.0] * 3, friction=limb.friction)  # fmt: skip
        put(f"/{LIMB_NAMES[index]}/limb_telemetry", cycle, limb=index, **pose, gripper_quaternion_w=[1.0, 0, 0, 0],
            force_w_n=(force + story.force_error_n[index]).tolist(), moment_w_nm=[0.0] * 3,
            force_reference_w_n=force.tolist(), moment_reference_w_nm=[0.0] * 3, admittance_offset_m=[0.0] * 3,
            admittance_rotation_rad=[0.0] * 3, tare_force_g_n=[0.0] * 3, tare_moment_g_nm=[0.0] * 3,
            grasp_force_reference_n=GRASP_FORCE_N * stance, grasp_force_n=squeeze[index] * stance,
            ik_limited=0)  # fmt: skip
