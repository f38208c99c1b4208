"""What the viewer shows, in one form: a log, a plan as a climb without any error, or a climb that is going on."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from crux_contracts import LIMB_NAMES
from crux_contracts.channels import BY_TOPIC, SCHEMAS
from crux_contracts.interpolation import PlanReference
from crux_contracts.plan_series import PlanSeries, plan_series
from crux_contracts.robot_bounds import JOINTS

from crux_tools.log.seen import INFO, NS, Event, events_of, grip_of_limbs
from crux_tools.plan_robot import robot_of_plan
from crux_tools.report.evidence import evidence, moment_of, stories
from crux_tools.robot3d.robot_model import build_model
from crux_tools.robot3d.start_pose import RobotPose, take_pose
from crux_tools.telemetry import Channels, Telemetry, is_log, read_channels, telemetry_of
from crux_tools.telemetry.actuators import actuators_rad
from crux_tools.telemetry.cdr_table import fixed_dtype
from crux_tools.telemetry.description import robot_of
from crux_tools.telemetry.margins import Grip, planned_grip
from crux_tools.telemetry.slots import of_robot
from crux_tools.telemetry.summary import CLIMBING, STANCE, SWING, summarise

PLAN_STEP_S = 0.1
MOST_TOLD = 2  # sentences a fault; the report has all
PLAN_ROWS = 2000  # at most: a longer plan is shown in longer steps


@dataclass(frozen=True)
class Recording:
    """`log` has a plan; its limbs and references are those of every row."""

    log: Telemetry
    grip: Grip  # (n, 4) of the finger nearer to slipping; NaN: not in full stance
    events: list[Event]
    what: str = "log"  # log, plan or live

    def row_at(self, time_s: float) -> int:
        """The last row that is not after a time."""
        return max(int(np.searchsorted(self.log.time_s, time_s + 1e-9, side="right")) - 1, 0)


def blank(topic: str, shape: int | tuple[int, ...], slots: int = JOINTS) -> np.ndarray:
    """Records of a logged message of fixed size, all zero, of a robot with `slots` joints a limb."""
    dtype = fixed_dtype(SCHEMAS[BY_TOPIC[topic].type].definition)
    assert dtype is not None
    return np.zeros(shape, of_robot(dtype, slots))


def made_telemetry(
    path: Path, plan: Any, time_s: np.ndarray, tables: tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]
) -> Telemetry:
    """A Telemetry of what is in no log: `tables` are states, inputs, references and limbs."""
    state, inputs, references, limbs = tables
    return Telemetry(
        path=path, plan=plan, plans=[], time_s=time_s, state=state, inputs=inputs,
        outputs=blank("/control_output", len(time_s)), references=references, limbs=limbs,
        limbs_fresh=np.ones(len(time_s), dtype=bool), timing=np.empty(0),
        faults=blank("/fault", 0), buses=np.empty(0), acknowledgements=[], commands=[], metadata={}, robot_files={},
        end={}, notes=[], verdict=None,
    )  # fmt: skip


def recording_of(path: Path) -> Recording | None:
    """Of a log or a plan file; None of a log without a plan. Raises LogError or a plan's errors."""
    channels = read_channels(path)
    if is_log(channels):
        return recording_of_log(telemetry_of(path, channels), channels)
    from crux_contracts.plan_file import read_plan

    return recording_of_plan(path, read_plan(path))


def recording_of_log(log: Telemetry, channels: Channels) -> Recording | None:
    """None where no plan was accepted, so that there is no wall to show."""
    if log.plan is None:
        return None
    with robot_of(log.plan.robot_name, log.robot_files) as robot:
        grip = grip_of_limbs(log, robot)
    events = events_of(log, channels, lambda times_ns: times_ns) + _causes(log)
    return Recording(log, grip, sorted(events, key=lambda event: event.log_ns))


def _causes(log: Telemetry) -> list[Event]:
    """What the log shows of the second before a fault, told with it."""
    firsts = [moment_of(log, story[0]) for story in stories(summarise(log).faults)]
    told = [(round(at.fault.time_s * NS), words) for at in firsts for words in evidence(at)[:MOST_TOLD]]
    return [Event(time_ns, time_ns, INFO, f"the log shows: {words}") for time_ns, words in told]


def recording_of_plan(path: Path, plan: Any) -> Recording:
    """The plan played as it stands, joints by inverse kinematics; what only a climb has is zero."""
    robot = build_model(robot_of_plan(plan, path), plan)
    reference, series = PlanReference(plan), plan_series(plan)
    end_s = reference.end_s
    time_s = np.linspace(0, end_s, min(round(end_s / PLAN_STEP_S), PLAN_ROWS) + 1)
    n = len(time_s)
    state, inputs = blank("/robot_state", n), blank("/control_input", n, robot.robot.slots)
    references, limbs = (blank(topic, (n, len(LIMB_NAMES))) for topic in ("/limb_reference", "/limb_telemetry"))
    body_position, body_rpy = reference.body(time_s)
    lift = robot.robot.gripper.pad_radius_m if robot.point_feet else 0.0
    data = mujoco.MjData(robot.model)
    inputs["dt_s"] = time_s[1] - time_s[0]
    state["cycle"] = inputs["cycle"] = np.arange(n)
    state["time_s"] = state["plan_time_s"] = time_s
    state["plan_end_s"], state["supervisor_state"], state["waiting_limb"] = end_s, CLIMBING, -1
    for row, at_s in enumerate(time_s):
        k, u = reference.at(at_s)
        grips = [reference.limb(limb, k, u) for limb in range(len(LIMB_NAMES))]
        position = np.array([grip.position_w_m for grip in grips]) + np.array([0, 0, lift])
        yaw, opening = np.array([grip.yaw_w_rad for grip in grips]), np.array([grip.opening_m for grip in grips])
        tilt = np.array([grip.tilt_w_rad for grip in grips])
        take_pose(robot, data, RobotPose(body_position[row], body_rpy[row], position, yaw, tilt, opening), near=row > 0)
        inputs["joint_position_rad"][row] = actuators_rad(robot.robot, data.qpos[robot.joint_qpos])
        inputs["finger_opening_m"][row] = opening
        state["body_quaternion_w"][row] = data.qpos[3:7]
        references["phase"][row] = np.where(reference.air[k], SWING, STANCE)
        references["gripper_position_w_m"][row], references["gripper_yaw_w_rad"][row] = position, yaw
        references["gripper_tilt_w_rad"][row] = tilt
        wrench = np.array([reference.wrench(limb, k, u) for limb in range(len(LIMB_NAMES))])
        limbs["force_w_n"][row], limbs["moment_w_nm"][row] = wrench[:, :3], wrench[:, 3:]
    state["body_position_w_m"] = state["body_reference_position_w_m"] = body_position
    state["body_reference_quaternion_w"] = state["body_quaternion_w"]
    references["finger_opening_m"] = inputs["finger_opening_m"]
    references["force_w_n"], references["moment_w_nm"] = limbs["force_w_n"], limbs["moment_w_nm"]
    limbs["gripper_position_w_m"] = references["gripper_position_w_m"]
    limbs["force_reference_w_n"], limbs["moment_reference_w_nm"] = limbs["force_w_n"], limbs["moment_w_nm"]
    knot = series.knot_at(time_s)
    along = (series.finger_force_n * series.opening_axis[:, :, None]).sum(axis=-1)
    limbs["grasp_force_n"] = ((along[..., 0] - along[..., 1]) / 2)[knot]
    log = made_telemetry(path, plan, time_s, (state, inputs, references, limbs))
    grip = Grip(*(values[knot] for values in planned_grip(plan).limbs()))
    return Recording(log, grip, _swings(series), "plan")


def _swings(series: PlanSeries) -> list[Event]:
    """A plan's events: a limb lets its hold go, for another one."""
    found = []
    for swing in series.swings():
        time_ns = round(float(series.time_s[swing.first]) * NS)
        text = f"{LIMB_NAMES[swing.limb]} from {swing.from_hold or '?'} to {swing.to_hold or '?'}"
        found.append(Event(time_ns, time_ns, INFO, text))
    return found
