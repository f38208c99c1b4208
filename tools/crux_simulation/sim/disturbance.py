"""Carries out scheduled faults while a climb runs, and watches how long the robot takes to hold."""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np
from crux_contracts import LIMB_NAMES
from crux_contracts.can_codec import NODES, Frame
from crux_msgs import robot_state_t
from crux_tools.errors import UsageError
from crux_tools.telemetry.summary import FaultNote

from crux_simulation.sim import can_interface
from crux_simulation.sim.fault_file import MOTORS, NODE_TWICE, OF_THE_RUNTIME, OF_THE_SUPPLY, ON_SOCKETCAN, Fault
from crux_simulation.sim.process_faults import ProcessFaults
from crux_simulation.sim.recorder import Truth
from crux_simulation.sim.rogue_hosts import SENDERS, second_node

WATCHED_S = 4.0  # after a fault is over: time to settle, to recover, and to fall
CLIMBING, HOLDING, FAULT = robot_state_t.CLIMBING, robot_state_t.HOLDING, robot_state_t.FAULT
SILENT = -1
STATE_MASK = 0x07
TRACK, DECELERATE = 2, 3  # DBC: JointStatus.State
ALL_FRAMES = 0xFFFFFFFF


class Injector(Protocol):
    """What the firmware's nodes let be done to them; see crux_nodes.Nodes."""

    def lose(self, limb: int, share: float, seed: int = 1) -> None: ...
    def connect(self, limb: int, connected: bool) -> None: ...
    def intrude(self, limb: int, identifier: int, data: bytes) -> None: ...
    def reset(self, limb: int, node: int) -> None: ...
    def power(self, limb: int, node: int, supply: int) -> None: ...
    def disturb(self, limb: int, node: int, on: bool) -> None: ...
    def drop_received(self, limb: int, node: int, count: int) -> None: ...
    def drop_sent(self, limb: int, node: int, count: int) -> None: ...
    def corrupt_received(self, limb: int, node: int, count: int) -> None: ...
    def states(self) -> tuple[bytes, bytes, bytes, bytes]: ...
    def host_state(self) -> int: ...


@dataclass
class Course:
    """What became of one fault; times from its beginning, None: did not happen while it was watched."""

    fault: Fault
    runtime_s: float | None = None
    """until the runtime stopped climbing"""
    held_s: float | None = None
    """until the robot held: no node still slows down, and the nodes hold or the runtime controls the stance"""
    moved_on: bool = field(default=False)
    """the runtime climbed again by itself after it had stopped: it never may"""
    moved_m: float | None = None
    """largest distance of the body from where it was at the beginning, until the next fault or the end"""
    cause: str | None = None
    """number and name of the first fault the runtime reported in that time"""

    def as_json(self) -> dict[str, Any]:
        """One entry of `faults` in `crux climb --json`."""
        return {
            "kind": self.fault.kind,
            "limb": LIMB_NAMES[self.fault.limb] if self.fault.limb >= 0 else None,
            "at_s": self.fault.at_s,
            "for_s": self.fault.for_s if math.isfinite(self.fault.for_s) else None,
            "runtime_s": self.runtime_s,
            "held_s": self.held_s,
            "moved_on": self.moved_on,
            "moved_m": self.moved_m,
            "cause": self.cause,
        }


def look_back(courses: Sequence[Course], truth: Truth, reported: Sequence[FaultNote], dt_s: float) -> None:
    """Adds to each course what physics and log say about the time until the next fault; courses are in order."""
    time_s = (truth.cycle + 1) * dt_s
    for number, course in enumerate(courses):
        begin_s = course.fault.at_s
        end_s = courses[number + 1].fault.at_s if number + 1 < len(courses) else np.inf
        path_m = truth.body_position_m[(time_s >= begin_s) & (time_s < end_s)]
        if len(path_m):
            course.moved_m = float(np.linalg.norm(path_m - path_m[0], axis=1).max())
        causes = [f"{fault.code} {fault.name}" for fault in reported if begin_s <= fault.time_s < end_s]
        course.cause = causes[0] if causes else None


class Disturbance:
    """The faults of one run."""

    def __init__(
        self,
        faults: Sequence[Fault],
        nodes: Injector,
        dt_s: float,
        interfaces: Sequence[str] | None,
        seed: int,
        process: ProcessFaults | None = None,
        broadcast: bool = False,
    ) -> None:
        """`interfaces`: of LF, RF, LR, RR; None on UDP buses. `process`: where the runtime is one of its own.
        `broadcast`: one frame commands all nodes of a bus. Raises UsageError for faults that need interfaces."""
        for fault in faults:
            if fault.kind in ON_SOCKETCAN and interfaces is None:
                raise UsageError(f"fault '{fault.kind}' needs a CAN interface: --bus socketcan")
        self.courses = [Course(fault) for fault in faults]
        self._nodes = nodes
        self._dt_s = dt_s
        self._interfaces = interfaces
        self._seed = seed
        self._process = process
        self._broadcast = broadcast
        self._begun: set[int] = set()
        self._ended: set[int] = set()

    def begin_cycle(self, cycle: int) -> None:
        """Begins, goes on with and ends what is due; `cycle` counts in physics. Before the nodes control."""
        for number, course in enumerate(self.courses):
            fault = course.fault
            if number not in self._begun and cycle >= self._cycle(fault.at_s):
                self._begun.add(number)
                self._switch(fault, True)
            if number in self._begun and number not in self._ended:
                if cycle * self._dt_s > fault.end_s - 0.5 * self._dt_s:
                    self._ended.add(number)
                    self._switch(fault, False)
                elif self._process is not None and fault.kind in OF_THE_RUNTIME:
                    self._process.go_on(fault, (cycle - self._cycle(fault.at_s)) * self._dt_s)
                else:
                    self._intrude(fault, cycle)

    def _intrude(self, fault: Fault, cycle: int) -> None:
        frames: Iterable[Frame] = ()
        if fault.kind == NODE_TWICE:
            frames = second_node(cycle, fault.node, self._broadcast)
        elif fault.kind in SENDERS:
            frames = SENDERS[fault.kind](cycle)
        for frame in frames:
            self._nodes.intrude(fault.limb, frame.identifier, frame.data)

    def end_cycle(self, cycle: int, heard: bool = True) -> None:
        """Watches; after the nodes have controlled. `heard`: the runtime has sent this cycle's Sync."""
        now_s = (cycle + 1) * self._dt_s
        state = self._nodes.host_state() & STATE_MASK if heard else SILENT
        joints, _, grippers, _ = self._nodes.states()
        nodes = joints + grippers
        held = state != CLIMBING and DECELERATE not in nodes and (state == HOLDING or TRACK not in nodes)
        for number in self._begun:
            course = self.courses[number]
            since_s = now_s - course.fault.at_s
            if course.runtime_s is None and state in (HOLDING, FAULT):
                course.runtime_s = round(since_s, 6)
            elif course.runtime_s is not None and state == CLIMBING:
                course.moved_on = True
            if course.held_s is None and held:
                course.held_s = round(since_s, 6)

    def end(self) -> None:
        """The climb is over: what is done to the runtime's process ends."""
        if self._process is not None:
            self._process.end()

    def over(self, cycle: int) -> bool:
        """All faults are over and have been watched long enough."""
        faults = [course.fault for course in self.courses]
        last_s = max(fault.end_s if math.isfinite(fault.end_s) else fault.at_s for fault in faults)
        return cycle >= self._cycle(last_s + WATCHED_S)

    def _cycle(self, time_s: float) -> int:
        return round(time_s / self._dt_s)

    def _switch(self, fault: Fault, on: bool) -> None:
        if self._process is not None and fault.kind in OF_THE_RUNTIME:
            self._process.switch(fault, on)
        elif fault.kind in ("cut", "loss"):
            share = 0.0 if not on else 1.0 if fault.kind == "cut" else fault.share
            self._nodes.lose(fault.limb, share, self._seed + 1)
        elif fault.kind == "reset":  # it hears and says nothing meanwhile
            if on:
                self._nodes.reset(fault.limb, fault.node)
            deaf = on and fault.for_s > 0
            self._nodes.drop_received(fault.limb, fault.node, ALL_FRAMES if deaf else 0)
            self._nodes.drop_sent(fault.limb, fault.node, ALL_FRAMES if deaf else 0)
        elif fault.kind == OF_THE_SUPPLY:
            for limb in range(len(LIMB_NAMES)) if fault.limb < 0 else [fault.limb]:
                for node in [fault.node] if fault.node else range(1, NODES + 1):
                    self._nodes.power(limb, node, 1 + MOTORS.index(fault.motors) if on else 0)
        elif fault.kind == "controller_off":
            self._nodes.disturb(fault.limb, fault.node, on)
        elif fault.kind == "crc":
            for node in range(1, NODES + 1):
                self._nodes.corrupt_received(fault.limb, node, ALL_FRAMES if on else 0)
        elif self._interfaces is not None and fault.kind in ON_SOCKETCAN:
            self._switch_interface(fault, on, self._interfaces[fault.limb])

    def _switch_interface(self, fault: Fault, on: bool, interface: str) -> None:
        if fault.kind == "error_passive":
            level = can_interface.TX_PASSIVE if on else can_interface.ERROR_ACTIVE
            can_interface.report(interface, can_interface.CONTROLLER, level)
        elif fault.kind == "unacknowledged":  # the host is alone on its bus until the nodes speak again
            self._nodes.lose(fault.limb, 1.0 if on else 0.0)
            if on:
                can_interface.report(interface, can_interface.ACKNOWLEDGE)
        elif fault.kind == "bus_off":
            self._nodes.lose(fault.limb, 1.0 if on else 0.0)
            can_interface.report(interface, can_interface.BUS_OFF if on else can_interface.RESTARTED)
        else:
            if on:
                self._nodes.connect(fault.limb, False)
            if fault.kind == "interface_down":
                can_interface.set_up(interface, not on)
            else:
                can_interface.jam(interface, on)
            if not on:
                self._nodes.connect(fault.limb, True)
