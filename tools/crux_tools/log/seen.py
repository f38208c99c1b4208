"""What other tools draw of a log: frames, joints, wrenches and margins as arrays, at a rate they bear; events in words.

Computed from the log alone: the robot description it carries, the joints as measured, the body as the runtime
estimated it. Frame "world" is W.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from datetime import datetime
from typing import Any

import numpy as np
from crux_contracts import LIMB_NAMES
from crux_contracts.channels import SUPERVISOR_STATES
from crux_contracts.robot import Robot
from crux_contracts.urdf import Joint
from crux_msgs import acknowledgement_t, command_t
from scipy.spatial.transform import Rotation

from crux_tools.errors import UsageError
from crux_tools.telemetry import Channels, Telemetry
from crux_tools.telemetry.actuators import joint_speeds_rad_s, joint_torques_Nm, joints_rad
from crux_tools.telemetry.margins import Grip, measured_grip
from crux_tools.telemetry.summary import WAIT_NAMES, is_realtime, name_of, runs, summarise
from crux_tools.telemetry.wording import fault_line

LARGEST = 1e9  # rad or m: beyond it no joint has ever been
WORLD = "world"
BODY_REFERENCE = "body_reference"
NS = 10**9
Clock = Callable[[np.ndarray], np.ndarray]  # from log times [ns] to those that other tools are told
INFO, WARN, ERROR = 20, 30, 40  # of rcl_interfaces/Log
COMMAND_WORDS = {getattr(command_t, name): name for name in dir(command_t) if name.isupper()}


def contact_frame(limb: str) -> str:
    """The frame of a limb's wrenches: where its gripper is, axes of W."""
    return f"{limb}_contact"


@dataclass(frozen=True)
class Event:
    """Something that happened, in words; `level` as in rcl_interfaces/Log."""

    log_ns: int
    time_ns: int  # by the clock
    level: int
    text: str


@dataclass(frozen=True)
class Seen:
    """n moments of a climb. Transforms are x, y, z [m] and quaternion x, y, z, w of a child in its parent."""

    log: Telemetry
    robot: Robot
    clock: Clock
    rows: np.ndarray  # (n,) of the log
    times_ns: np.ndarray  # (n,) by the clock
    moving: list[tuple[str, str]]  # (parent, child): world to body, joints, references, contacts
    moving_at: np.ndarray  # (n, len(moving), 7)
    fixed: list[tuple[str, str]]
    fixed_at: np.ndarray  # (len(fixed), 7)
    joints: list[str]
    joint_state: np.ndarray  # (n, len(joints), 3): position, velocity, effort
    margin_n: np.ndarray  # (n, 4) the least of a limb's two fingers since the moment before; NaN: not in full stance
    used: np.ndarray  # (n, 4) the largest share of the limit surface that they used since then
    events: list[Event]

    def limb_of_joint(self, joint: int) -> str:
        """The name of the limb that joint number `joint` of `joints` moves."""
        name = self.joints[joint]
        return next(limb.name for limb in self.robot.limbs if name in (*limb.joint_names, *limb.finger_joints))

    def block(self, first: int, end: int) -> Seen:
        """Some of the moments."""
        names = ("rows", "times_ns", "moving_at", "joint_state", "margin_n", "used")
        return replace(self, **{name: getattr(self, name)[first:end] for name in names})

    def wrench(self, kind: str) -> np.ndarray:
        """(n, 4, 6) forces and moments on the robot at the gripper's centre, axes of W; kind "" or "_reference"."""
        limbs = self.log.limbs[self.rows]
        return np.concatenate([limbs[f"force{kind}_w_n"], limbs[f"moment{kind}_w_nm"]], axis=2)


def seen(log: Telemetry, channels: Channels, robot: Robot, rate_Hz: float, clock: Clock) -> Seen:
    """The log at `rate_Hz` at most. Its plan may be missing; then there are no margins."""
    times_ns = clock(np.round(log.time_s * NS).astype(np.int64))
    bins = np.floor((log.time_s - log.time_s[0]) * rate_Hz + 1e-6)
    rows = np.unique(bins, return_index=True)[1]
    names, values = _joint_values(log, robot, rows)
    moved = {name: values[:, i, 0] for i, name in enumerate(names)}
    joints = list(robot.urdf.joints.values())
    moving = [joint for joint in joints if joint.name in moved]
    fixed = [joint for joint in joints if joint.name not in moved]
    state = log.state[rows]
    margin_n, used = _grips(log, robot, rows)
    body = [(WORLD, robot.body_link, "body"), (WORLD, BODY_REFERENCE, "body_reference")]
    bodies = [_pose(state[f"{field}_position_w_m"], state[f"{field}_quaternion_w"]) for *_, field in body]
    contacts = np.zeros((len(rows), len(LIMB_NAMES), 7))
    contacts[..., :3], contacts[..., 6] = log.limbs["gripper_position_w_m"][rows], 1.0
    return Seen(
        log=log,
        robot=robot,
        clock=clock,
        rows=rows,
        times_ns=times_ns[rows],
        moving=[
            *((parent, child) for parent, child, _ in body),
            *((WORLD, contact_frame(limb)) for limb in LIMB_NAMES),
            *((joint.parent, joint.child) for joint in moving),
        ],
        moving_at=np.concatenate(
            [np.stack(bodies, axis=1), contacts, np.stack([_at(joint, moved[joint.name]) for joint in moving], axis=1)],
            axis=1,
        ),
        fixed=[(joint.parent, joint.child) for joint in fixed],
        fixed_at=np.array([_at(joint, np.zeros(1))[0] for joint in fixed]).reshape(-1, 7),
        joints=names,
        joint_state=values,
        margin_n=margin_n,
        used=used,
        events=events_of(log, channels, clock),
    )


def _pose(position: np.ndarray, quaternion_wxyz: np.ndarray) -> np.ndarray:
    return np.concatenate([position, quaternion_wxyz[:, 1:], quaternion_wxyz[:, :1]], axis=1)


def _at(joint: Joint, value: np.ndarray) -> np.ndarray:
    """(n, 7) the child link in the parent, for joint values (n,) in rad or m; NaN where a value is none."""
    origin = Rotation.from_euler("xyz", joint.rpy_rad)
    axis = np.array(joint.axis)
    slides = joint.kind == "prismatic"
    known = np.abs(value) < LARGEST
    value = np.where(known, value, 0.0)
    along = origin.apply(np.outer(value, axis)) if slides else np.zeros((len(value), 3))
    turn = Rotation.identity(len(value)) if slides else Rotation.from_rotvec(np.outer(value, axis))
    poses = np.concatenate([np.array(joint.xyz_m) + along, (origin * turn).as_quat()], axis=1)
    poses[~known] = np.nan
    return poses


def _joint_values(log: Telemetry, robot: Robot, rows: np.ndarray) -> tuple[list[str], np.ndarray]:
    """Names, and (n, len(names), 3): joints as measured, both fingers of a gripper as its opening."""
    inputs = log.inputs[rows]
    told_rad = inputs["joint_position_rad"]
    joints = np.stack(
        [
            joints_rad(robot, told_rad),
            joint_speeds_rad_s(robot, told_rad, inputs["joint_velocity_rad_s"]),
            joint_torques_Nm(robot, told_rad, inputs["joint_torque_nm"]),
        ],
        axis=2,
    )
    fingers = np.stack([inputs[name] for name in ("finger_opening_m", "finger_speed_m_s", "finger_force_n")], axis=2)
    names = [name for limb in robot.limbs for name in limb.joint_names]
    names += [name for limb in robot.limbs for name in limb.finger_joints]
    there = [robot.slots * i + j for i, limb in enumerate(robot.limbs) for j in range(len(limb.joints))]
    return names, np.concatenate([joints[:, there], np.repeat(fingers, 2, axis=1)], axis=1)


def grip_of_limbs(log: Telemetry, robot: Robot) -> Grip:
    """(n, 4) of every cycle; NaN: not in full stance. The log has a plan."""
    return measured_grip(log, robot.control.force_filter_s).limbs()


def _grips(log: Telemetry, robot: Robot, rows: np.ndarray) -> Grip:
    """(n, 4) so that a dip of one cycle between two rows is seen."""
    if log.plan is None:
        return Grip(*np.full((2, len(rows), len(LIMB_NAMES)), np.nan))
    grip = grip_of_limbs(log, robot)
    return Grip(np.fmin.reduceat(grip.margin_n, rows), np.fmax.reduceat(grip.used, rows))


def events_of(log: Telemetry, channels: Channels, clock: Clock) -> list[Event]:
    """Faults, changes of state, waits, slips, plans, commands and answers, in the order of time."""
    found: list[tuple[int, int, str]] = []
    times_ns = np.round(log.time_s * NS).astype(np.int64)
    for topic, words in (("/command", _command_words), ("/acknowledgement", _answer_words)):
        times = channels.times_ns.get(topic, np.empty(0))
        for time_ns, message in zip(times, channels.messages.get(topic, []), strict=True):
            found.append((int(time_ns), *words(message)))
    found += [(int(at_ns), INFO, "planned anew") for at_ns in channels.times_ns.get("/plan", np.empty(0))[1:]]
    found += _slips(log, times_ns)
    for fault in summarise(log).faults:
        found.append((round(fault.time_s * NS), ERROR, "fault " + fault_line(fault).partition(": ")[2]))
    state = log.state["supervisor_state"].astype(int)
    for first, _ in runs(state)[1:]:
        before, now = (name_of(SUPERVISOR_STATES, int(state[row])) for row in (first - 1, first))
        found.append((int(times_ns[first]), WARN if now == "FAULT" else INFO, f"{before} → {now}"))
    limb, reason = log.state["waiting_limb"].astype(int), log.state["waiting_for"].astype(int)
    for first, _ in runs((limb + 1) * len(WAIT_NAMES) + reason):
        if reason[first] > 0:
            who = name_of(LIMB_NAMES, int(limb[first])) if limb[first] >= 0 else "all limbs"
            what = f"the plan's clock waits for {who} to {name_of(WAIT_NAMES, int(reason[first]))}"
            found.append((int(times_ns[first]), INFO, what))
    found.sort(key=lambda told: told[0])
    by_clock = clock(np.array([log_ns for log_ns, *_ in found], dtype=np.int64)).tolist()
    return [Event(log_ns, time_ns, level, text) for (log_ns, level, text), time_ns in zip(found, by_clock, strict=True)]


def _slips(log: Telemetry, times_ns: np.ndarray) -> list[tuple[int, int, str]]:
    """As the runtime felt them."""
    if "slip_m" not in (log.limbs.dtype.names or ()):  # an older log
        return []
    return [
        (int(times_ns[first]), WARN, f"{name} slips by {slid_m[first:end].max() * 1e3:.1f} mm")
        for name, slid_m in zip(LIMB_NAMES, log.limbs["slip_m"].T, strict=True)
        for first, end in runs(slid_m > 0)
        if slid_m[first] > 0
    ]


def _command_words(command: Any) -> tuple[int, str]:
    name = COMMAND_WORDS.get(command.command, f"#{command.command}")
    return INFO, f"operator: {name}" + (f" {command.value:g}" if command.command == command_t.SPEED else "")


def _answer_words(answer: Any) -> tuple[int, str]:
    what = "plan" if answer.subject == acknowledgement_t.PLAN else "command"
    if answer.verdict == acknowledgement_t.ACCEPTED:
        return INFO, answer.reason or f"{what} accepted"
    return WARN, f"{what} refused: {answer.reason}"


def utc_clock(log: Telemetry) -> Clock:
    """Nanoseconds since 1970: by the clock of every cycle where that paced the runtime, else counted from its start.

    Raises UsageError for a log that does not say when it was made.
    """
    timing, offset = log.timing, log.metadata.get("utc_minus_monotonic_ns")
    if is_realtime(log) and offset is not None and len(timing):
        cycle_ns = np.round(timing["cycle"] * log.inputs["dt_s"][0] * NS)
        begin_ns = int(timing["wall_ns"][0])
        since_ns = timing["wall_ns"] - begin_ns
        return lambda times_ns: (
            np.interp(times_ns, cycle_ns, since_ns).round().astype(np.int64) + begin_ns + int(offset)
        )
    try:
        start = datetime.fromisoformat(log.metadata.get("started_utc", ""))
    except ValueError:
        raise UsageError(f"{log.path}: does not say when it was made (an older crux): leave --utc out") from None
    return lambda times_ns: times_ns + round(start.timestamp() * 1e6) * 1000
