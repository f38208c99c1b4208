"""A climb that is going on, heard over LCM, as a recording that grows."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from crux_contracts import LIMB_NAMES, channels
from crux_msgs import (
    acknowledgement_t,
    command_t,
    fault_t,
    limb_reference_t,
    limb_telemetry_t,
    plan_t,
    robot_state_t,
    signed_t,
)

from crux_tools.errors import UsageError
from crux_tools.lcm_binding import lcm
from crux_tools.log.seen import NS, Event, events_of, grip_of_limbs
from crux_tools.operator_link import NO_NETWORK
from crux_tools.plan_robot import robot_named
from crux_tools.robot3d.robot_model import RobotModel, build_model
from crux_tools.robot3d.start_pose import solve_limb
from crux_tools.telemetry import Channels, Telemetry
from crux_tools.telemetry.margins import Grip
from crux_tools.telemetry.rotations import rotations_from_quaternions
from crux_tools.view.recording import Recording, blank, made_telemetry

EVENTS_EVERY_S = 1.0
FIRST_ROWS = 4096
QUEUED = 1000  # messages of a channel, 5 s of the limbs; of the usual 30 some are lost in a pause of 0.15 s


class Table:
    """Rows that grow; `view` is what is there, without a copy."""

    def __init__(self, empty: np.ndarray) -> None:
        self._rows, self.count = empty, 0

    def add(self, row: Any) -> None:
        """One row behind the others."""
        if self.count == len(self._rows):
            self._rows = np.concatenate([self._rows, np.zeros_like(self._rows)])
        self._rows[self.count] = row
        self.count += 1

    @property
    def view(self) -> np.ndarray:
        """(count, …)"""
        return self._rows[: self.count]


def _record(topic: str, message: Any) -> np.ndarray:
    """An LCM message as a record of its table, (1,)."""
    row = blank(topic, 1)
    for name in row.dtype.names or ():
        row[name] = getattr(message, name)
    return row


class Live:
    """Listens in a thread of its own for as long as the process lives; sends nothing."""

    def __init__(self, url: str, plan: plan_t | None) -> None:
        try:
            self._lcm = lcm.LCM(url)
        except RuntimeError as error:
            raise UsageError(f"--lcm {url}: cannot be opened: {error} ({NO_NETWORK})") from error
        self._plan: plan_t | None = None
        self._robot: RobotModel | None = None
        self._data: Any = None
        if plan is not None:
            self._use(plan)
        self._lock = threading.Lock()
        self._known: Recording | None = None  # of a runtime that has ended, until the next one's first row
        self._clear()
        heard: list[tuple[str, type[Any], Callable[[Any], None]]] = [
            (channels.CRUX_PLAN, plan_t, self._take_plan),
            (channels.CRUX_ROBOT_STATE, robot_state_t, self._take_state),
            (channels.CRUX_LIMB_REFERENCE, limb_reference_t, lambda m: self._take_limb("/limb_reference", m)),
            (channels.CRUX_LIMB_TELEMETRY, limb_telemetry_t, lambda m: self._take_limb("/limb_telemetry", m)),
            (channels.CRUX_FAULT, fault_t, lambda m: self._faults.add(_record("/fault", m))),
            (channels.CRUX_COMMAND, command_t, lambda m: self._tell("/command", m)),
            (channels.CRUX_SIGNED, signed_t, self._take_signed),
            (channels.CRUX_ACKNOWLEDGEMENT, acknowledgement_t, lambda m: self._tell("/acknowledgement", m)),
        ]
        for channel, kind, take in heard:
            self._lcm.subscribe(channel, self._handler(kind, take)).set_queue_capacity(QUEUED)
        threading.Thread(target=self._listen, name="lcm", daemon=True).start()

    def _handler(self, kind: Any, take: Callable[[Any], None]) -> Callable[[str, bytes], None]:
        def handle(_channel: str, data: bytes) -> None:
            with self._lock:
                take(kind.decode(data))

        return handle

    def _listen(self) -> None:
        while True:
            self._lcm.handle()

    def _clear(self) -> None:
        """Before the first message, and when another runtime begins."""
        shape = (FIRST_ROWS, len(LIMB_NAMES))
        self._states, self._inputs = (Table(blank(topic, FIRST_ROWS)) for topic in ("/robot_state", "/control_input"))
        self._references, self._limbs = (Table(blank(topic, shape)) for topic in ("/limb_reference", "/limb_telemetry"))
        self._newest = {topic: blank(topic, len(LIMB_NAMES)) for topic in ("/limb_reference", "/limb_telemetry")}
        self._faults = Table(blank("/fault", FIRST_ROWS))
        self._grip = Table(np.zeros(shape)), Table(np.zeros(shape))
        self._told = Channels({}, {}, {}, {}, {}, None, [])
        self._came = list[tuple[str, int]]()  # of `_newest`, since the last state
        self._state: Any = None
        self._shown = 0
        self._events: list[Event] = []
        self._events_at = -EVENTS_EVERY_S

    def _take_plan(self, plan: plan_t) -> None:
        self._tell("/plan", plan)
        self._use(plan)

    def _use(self, plan: plan_t) -> None:
        """The wall stays that of the first plan; those made on the way are for the same."""
        self._plan = plan
        if self._robot is None:
            self._robot = build_model(robot_named(plan.robot_name), plan)
            self._data = mujoco.MjData(self._robot.model)

    def _tell(self, topic: str, message: Any) -> None:
        """Keeps what has no cycle of its own, at the time of the newest state."""
        time_ns = 0 if self._state is None else round(float(self._state["time_s"]) * NS)
        self._told.messages.setdefault(topic, []).append(message)
        self._told.times_ns[topic] = np.append(self._told.times_ns.get(topic, np.empty(0, np.int64)), time_ns)

    def _take_signed(self, message: signed_t) -> None:
        """A command is told; a piece of a plan, or the wish for the lease, is none."""
        with suppress(ValueError):
            self._tell("/command", command_t.decode(bytes(message.data)))

    def _take_limb(self, topic: str, message: Any) -> None:
        if 0 <= message.limb < len(LIMB_NAMES):
            self._newest[topic][message.limb] = _record(topic, message)[0]
            self._came.append((topic, message.limb))

    def _take_state(self, message: robot_state_t) -> None:
        """What came with the state before becomes a row, unless the network lost a part of it."""
        before, complete = self._state, len(self._came) == len(set(self._came)) == 2 * len(LIMB_NAMES)
        self._came.clear()
        if before is not None and message.cycle < before["cycle"]:
            self._clear()
        elif before is not None and self._robot is not None and complete:
            self._states.add(before)
            self._references.add(self._newest["/limb_reference"])
            self._limbs.add(self._newest["/limb_telemetry"])
            self._inputs.add(self._joints(self._robot, before))
        self._state = _record("/robot_state", message)[0]

    def _joints(self, robot: RobotModel, state: Any) -> np.ndarray:
        """A control_input with the joints that put the grippers where the runtime says that they are."""
        data, limbs = self._data, self._newest["/limb_telemetry"]
        data.qpos[:3], data.qpos[3:7] = state["body_position_w_m"], state["body_quaternion_w"]
        axes = rotations_from_quaternions(limbs["gripper_quaternion_w"])[:, :, 0]
        for limb, axis in enumerate(axes):
            yaw_rad = float(np.arctan2(axis[1], axis[0]))
            solve_limb(robot, data, limb, limbs["gripper_position_w_m"][limb], yaw_rad, near=True)
        row = blank("/control_input", 1)
        row["cycle"], row["dt_s"] = state["cycle"], robot.robot.can.dt_s
        row["joint_position_rad"] = data.qpos[robot.joint_qpos]
        row["finger_opening_m"] = self._newest["/limb_reference"]["finger_opening_m"]
        row["finger_force_n"] = limbs["grasp_force_n"]
        return row

    def wait_for_first(self) -> None:
        """Until there is a row to show."""
        while self._states.count < 2:
            time.sleep(0.05)

    def recording(self, _from_s: float = 0.0, _to_s: float = 0.0) -> Recording:
        """Up to now; the same object while nothing new came."""
        with self._lock:
            count = self._states.count
            if self._known is not None and count in {0, self._shown}:
                return self._known
            self._shown = count
            log = self._telemetry()
            assert self._robot is not None
            new = grip_of_limbs(_rows_from(log, self._grip[0].count), self._robot.robot)
            for table, rows in zip(self._grip, new, strict=True):
                for row in rows:
                    table.add(row)
            if time.monotonic() - self._events_at > EVENTS_EVERY_S:
                self._events = events_of(log, self._told, lambda times_ns: times_ns)
                self._events_at = time.monotonic()
            self._known = Recording(log, Grip(*(table.view for table in self._grip)), self._events, "live")
            return self._known

    def _telemetry(self) -> Telemetry:
        state = self._states.view
        tables = (state, self._inputs.view, self._references.view, self._limbs.view)
        log = made_telemetry(Path("live"), self._plan, state["time_s"], tables)
        return replace(log, faults=self._faults.view)


def _rows_from(log: Telemetry, first: int) -> Telemetry:
    names = ("time_s", "state", "inputs", "outputs", "references", "limbs", "limbs_fresh")
    return replace(log, **{name: getattr(log, name)[first:] for name in names})
