"""A climb that is going on, heard over LCM, as a recording that grows."""

from __future__ import annotations

import math
import threading
import time
from collections import deque
from collections.abc import Callable, Iterable
from contextlib import suppress
from dataclasses import replace
from pathlib import Path
from typing import Any

import mujoco
import numpy as np
from crux_contracts import LIMB_NAMES, channels
from crux_contracts.lcm_bytes import decoded
from crux_contracts.robot_bounds import JOINTS
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

from crux_tools.lcm_socket import LcmSocket
from crux_tools.log.seen import NS, Event, events_of, grip_of_limbs
from crux_tools.plan_robot import robot_named
from crux_tools.robot3d.robot_model import RobotModel, build_model
from crux_tools.robot3d.start_pose import solve_limb
from crux_tools.telemetry import Channels, Telemetry
from crux_tools.telemetry.actuators import actuators_rad
from crux_tools.telemetry.margins import Grip
from crux_tools.telemetry.rotations import rotations_from_quaternions
from crux_tools.view.recording import Recording, blank, made_telemetry

EVENTS_EVERY_S = 1.0
FIRST_ROWS = 4096
# What anybody may send is bounded: the rest of it is ignored.
QUEUED, QUEUED_BYTES = 4000, 32 << 20  # messages that wait to be looked at; 5 s of a runtime's
LONGEST_PLAN, MOST_HOLDS = 8 << 20, 2000  # bytes, as the runtime takes them
MOST_ROWS = 250_000  # 80 min, and 1 GB; then it begins anew
MOST_TOLD = 5000  # of commands, answers and faults: the newest
LARGEST = 1 << 40  # of any number, in SI units


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


def is_sound(values: Iterable[Any]) -> bool:
    """Whether every number is finite and of a size that something real could have."""
    for value in values:
        if isinstance(value, (tuple, list)):
            if not is_sound(value):
                return False
        elif isinstance(value, (int, float)) and not (math.isfinite(value) and abs(value) < LARGEST):
            return False
    return True


class Live:
    """Listens in threads of its own for as long as the process lives; sends nothing. What it shows is not signed."""

    def __init__(self, url: str, plan: plan_t | None) -> None:
        """Raises UsageError."""
        self._lcm = LcmSocket(url, longest=LONGEST_PLAN)
        self.ignored = 0
        """messages so far that were none"""
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
            (channels.CRUX_FAULT, fault_t, self._take_fault),
            (channels.CRUX_COMMAND, command_t, lambda m: self._tell("/command", m)),
            (channels.CRUX_SIGNED, signed_t, self._take_signed),
            (channels.CRUX_ACKNOWLEDGEMENT, acknowledgement_t, lambda m: self._tell("/acknowledgement", m)),
        ]
        self._takers = {channel: (kind, take) for channel, kind, take in heard}
        self._queue: deque[tuple[str, bytes]] = deque()
        self._queued_bytes = 0
        self._more = threading.Condition()
        for name in ("_listen", "_look"):
            threading.Thread(target=getattr(self, name), name=name, daemon=True).start()

    def _listen(self) -> None:
        """Empties the socket: the kernel keeps less of what comes than a second's."""
        while True:
            heard = self._lcm.receive(1.0, lambda channel, _data: channel in self._takers)
            if heard is None:
                continue
            with self._more:
                if len(self._queue) < QUEUED and self._queued_bytes + len(heard[1]) <= QUEUED_BYTES:
                    self._queue.append(heard[:2])
                    self._queued_bytes += len(heard[1])
                    self._more.notify()

    def _look(self) -> None:
        while True:
            with self._more:
                while not self._queue:
                    self._more.wait()
                channel, data = self._queue.popleft()
                self._queued_bytes -= len(data)
            self.take(channel, data)

    def take(self, channel: str, data: bytes) -> None:
        """One message, whoever sent it; what is none is ignored."""
        kind, take = self._takers[channel]
        try:
            message = decoded(kind, data)
            if kind is not plan_t and not is_sound(getattr(message, name) for name in message.__slots__):
                raise ValueError(f"no {kind.__name__}: a number is out of range")
            with self._lock:
                take(message)
        except Exception:  # a plan that is no wall, say: nobody can tell what all is in one
            self.ignored += 1

    def _clear(self) -> None:
        """Before the first message, and when another runtime begins."""
        shape = (FIRST_ROWS, len(LIMB_NAMES))
        slots = self._robot.robot.slots if self._robot is not None else JOINTS
        self._states = Table(blank("/robot_state", FIRST_ROWS))
        self._inputs = Table(blank("/control_input", FIRST_ROWS, slots))
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
        if len(plan.holds) > MOST_HOLDS:
            raise ValueError(f"{len(plan.holds)} holds")
        self._use(plan)
        self._tell("/plan", None)

    def _use(self, plan: plan_t) -> None:
        """The wall stays that of the first plan; those made on the way are for the same."""
        self._plan = plan
        if self._robot is None:
            self._robot = build_model(robot_named(plan.robot_name), plan)
            self._data = mujoco.MjData(self._robot.model)
            self._inputs = Table(blank("/control_input", FIRST_ROWS, self._robot.robot.slots))

    def _tell(self, topic: str, message: Any) -> None:
        """Keeps what has no cycle of its own, at the time of the newest state."""
        time_ns = 0 if self._state is None else round(float(self._state["time_s"]) * NS)
        messages, times_ns = self._told.messages, self._told.times_ns
        messages[topic] = [*messages.get(topic, []), message][-MOST_TOLD:]
        times_ns[topic] = np.append(times_ns.get(topic, np.empty(0, np.int64)), time_ns)[-MOST_TOLD:]

    def _take_fault(self, message: fault_t) -> None:
        if self._faults.count == MOST_TOLD:
            self._faults = Table(blank("/fault", FIRST_ROWS))
        self._faults.add(_record("/fault", message))

    def _take_signed(self, message: signed_t) -> None:
        """A command is told; a piece of a plan, or the wish for the lease, is none."""
        with suppress(ValueError):
            self._tell("/command", decoded(command_t, bytes(message.data)))

    def _take_limb(self, topic: str, message: Any) -> None:
        if 0 <= message.limb < len(LIMB_NAMES):
            self._newest[topic][message.limb] = _record(topic, message)[0]
            self._came.append((topic, message.limb))

    def _take_state(self, message: robot_state_t) -> None:
        """What came with the state before becomes a row, unless the network lost a part of it."""
        before, complete = self._state, len(self._came) == len(set(self._came)) == 2 * len(LIMB_NAMES)
        self._came.clear()
        if before is not None and (message.cycle < before["cycle"] or self._states.count == MOST_ROWS):
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
        for limb, turned in enumerate(rotations_from_quaternions(limbs["gripper_quaternion_w"])):
            # Where nothing reaches, the search ends soon: anybody may have said that a gripper is there.
            solve_limb(robot, data, limb, limbs["gripper_position_w_m"][limb], turned, near=True, starts=1)
        row = blank("/control_input", 1, robot.robot.slots)
        row["cycle"], row["dt_s"] = state["cycle"], robot.robot.dt_s
        row["joint_position_rad"] = actuators_rad(robot.robot, data.qpos[robot.joint_qpos])
        row["finger_opening_m"] = self._newest["/limb_reference"]["finger_opening_m"]
        row["finger_force_n"] = limbs["grasp_force_n"]
        return row

    def wait_for_first(self) -> None:
        """Until there is a row to show."""
        while self._states.count < 2:
            time.sleep(0.05)

    def recording(self, _from_s: float = 0.0, _to_s: float = 0.0) -> Recording:
        """Up to now; the same object while nothing new came."""
        with self._lock, np.errstate(all="ignore"):  # of numbers that nobody has measured
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
