"""The bench's control cycle: a Sync arrives, the firmware cores control, physics moves on, the nodes answer.

In lockstep the runtime waits for the answers: a run is as fast as the machine allows and always the same. In real time
physics and nodes go on by a clock of their own, also while no Sync comes.
"""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, field
from enum import Enum
from typing import Protocol

import numpy as np
from crux_msgs import robot_state_t

from crux_simulation.sim.disturbance import STATE_MASK, Disturbance
from crux_simulation.sim.plant import Plant

START_CYCLE = 1000  # the external support has released at 1.5 s, then half a second to settle
REST_CYCLES = 250  # physics after the end, so that "at rest" means something
START_GRACE_CYCLES = 100
SYNC_TIMEOUT_S = 0.2
LOST_PERIODS = 3  # the simulation itself was late: no Sync is waited for so long
SILENCE_S = 30.0  # of wall time, more than the runtime waits for its nodes
FREE_RUN_S = 3.0  # of physics after the runtime died: do the nodes hold?
STAYED_M = 0.02  # of the body in that time
REPORT_CYCLES = 250
IN_REVERSE, PLAN_COMPLETE = 0x08, 0x10  # flags in HostState, above the supervisor state
READY, CLIMBING = robot_state_t.READY, robot_state_t.CLIMBING
HOLDING, FAULT = robot_state_t.HOLDING, robot_state_t.FAULT
UNKNOWN = 0xFF


def climbing(host_state: int) -> int:
    """1 where the runtime says that it climbs, -1 where it does so in reverse, else 0."""
    if host_state & STATE_MASK != CLIMBING:
        return 0
    return -1 if host_state & IN_REVERSE else 1


class Nodes(Protocol):
    """The firmware's nodes on their buses; see firmware_nodes.FirmwareNodes."""

    def wait_sync(self, timeout_s: float) -> int | None:
        """Cycle of the next Sync, None after `timeout_s`."""

    def step(self, plant: Plant) -> None:
        """One control period of every node, and of the physics with what they command."""

    def publish(self, plant: Plant) -> None:
        """Sends what the nodes owe: status and force/torque."""

    def host_state(self) -> int:
        """HostState of the last heartbeat, 0xFF before the first."""


class Ending(Enum):
    """Why the loop ended."""

    COMPLETE = "the plan is complete"
    STOPPED = "the runtime stopped climbing"
    NOT_STARTED = "the runtime did not start the climb"
    TIMEOUT = "the climb took too long"
    SILENT = "the runtime lives but sends no Sync"
    RUNTIME_DIED = "the runtime died"


@dataclass
class WorldClock:
    """Real time of nodes and physics: a period a step.

    A Sync that comes within a period of its time makes the step, so that the nodes answer with what they measured after
    it; a step that no Sync makes is made a period late. What the simulation itself comes too late for is lost: physics
    does not catch up, for the nodes would take that for a silent runtime.
    """

    period_s: float
    now_s: Callable[[], float] = time.monotonic
    _due_s: float | None = field(default=None, init=False)
    """of the next step; None: before the first"""

    def patience_s(self) -> float:
        """How long to wait for a Sync."""
        return SYNC_TIMEOUT_S if self._due_s is None else max(0.0, self._due_s + self.period_s - self.now_s())

    def moves_on(self, heard: bool) -> bool:
        """Whether a step is to be made now; then it counts. `heard`: a Sync has come."""
        now_s = self.now_s()
        if self._due_s is None:
            self._due_s = now_s
        late_s = now_s - self._due_s
        if late_s < (-self.period_s if heard else self.period_s):
            return False
        self._due_s = now_s if late_s > LOST_PERIODS * self.period_s else self._due_s + self.period_s
        return True


@dataclass
class Outcome:
    """How the loop ended."""

    ending: Ending
    cycles: int
    wall_s: float
    missed: int = 0
    """cycles the bench came too late for (pace clock)"""
    robot_on_wall: bool | None = None
    """after the runtime died"""


@dataclass
class Loop:
    """One run of the bench."""

    nodes: Nodes
    plant: Plant
    runtime_alive: Callable[[], bool]
    progress: Callable[[float], None]
    max_cycles: int
    disturbance: Disturbance | None = None
    """faults to live through: a climb that stops is then watched until they are over"""
    watched_s: float = 0.0
    """how long the robot is watched besides, after it has stopped climbing"""
    clock: WorldClock | None = None
    """real time; None: lockstep"""
    guided: Callable[[], bool] = lambda: False
    """asked where the robot holds: whether somebody leads it on; lets cycles pass by `cycles`"""
    between: Callable[[], None] = lambda: None
    """called between two cycles"""
    cycle: int = field(default=-1, init=False)
    """of the last Sync answered"""

    def cycles(self, count: int) -> None:
        """Lets so many Syncs come and answers them: in lockstep, for whoever waits for the runtime meanwhile."""
        end = self.cycle + count
        while self.cycle < end and (cycle := self.nodes.wait_sync(SYNC_TIMEOUT_S)) is not None:
            if cycle == self.cycle:
                self.nodes.publish(self.plant)
                continue
            self._step(cycle)
            self.cycle = cycle

    def serve(self, until: Callable[[], bool]) -> None:
        """Goes on answering Syncs, unjudged, until `until()`: in real time silent nodes would be a fault."""
        while not until():
            if self.nodes.wait_sync(SYNC_TIMEOUT_S) is not None:
                self.nodes.step(self.plant)
                self.nodes.publish(self.plant)

    def _step(self, cycle: int, heard: bool = True) -> None:
        """One period of nodes and physics, and what goes wrong in it; `cycle` is the runtime's count, `heard` whether
        it has sent its Sync."""
        if self.disturbance is not None:
            self.disturbance.begin_cycle(self.plant.cycle)
        self.nodes.step(self.plant)
        self.plant.record(cycle, climbing(self.nodes.host_state()) if heard else 0)
        if self.disturbance is not None:
            self.disturbance.end_cycle(self.plant.cycle - 1, heard)
        self.nodes.publish(self.plant)

    def _moves_on(self, heard: bool) -> bool:
        """Whether nodes and physics make a step now: in lockstep with every Sync, in real time by the clock."""
        return heard if self.clock is None else self.clock.moves_on(heard)

    def run(self) -> Outcome:
        """Answers Syncs until the climb is over."""
        end_cycle: int | None = None
        ending = Ending.COMPLETE
        missed = 0
        began_s = heard_s = time.monotonic()
        while True:
            cycle = self.nodes.wait_sync(SYNC_TIMEOUT_S if self.clock is None else self.clock.patience_s())
            if cycle is None:
                wall_s = time.monotonic() - began_s
                if not self.runtime_alive():
                    held = self._free_run(self.cycle)
                    return Outcome(Ending.RUNTIME_DIED, self.cycle + 1, wall_s, missed, robot_on_wall=held)
                if time.monotonic() - heard_s > SILENCE_S:
                    return Outcome(Ending.SILENT, self.cycle + 1, wall_s, missed)
                if self.cycle > 0 and self._moves_on(heard=False):
                    self._step(self.cycle, heard=False)
                continue
            heard_s = time.monotonic()
            if cycle == self.cycle:  # the runtime repeats its first Sync until all nodes have answered
                self.nodes.publish(self.plant)
                continue
            if self.cycle < 0:
                began_s = time.monotonic()
            missed += cycle - self.cycle - 1  # the bench came too late: physics stands still, no watchdog counts
            if cycle <= 0 or self._moves_on(heard=True):
                self._step(cycle)
            else:
                self.nodes.publish(self.plant)
            self.cycle = cycle
            if cycle % REPORT_CYCLES == 0:
                self.progress(self.plant.time_s)
            self.between()
            if end_cycle is None:
                over = self.over(cycle)
                if over is not None:
                    watched_s = self.watched_s if over is Ending.STOPPED else 0.0
                    ending, end_cycle = over, cycle + REST_CYCLES + round(watched_s / self.plant.dt_s)
            elif cycle >= end_cycle:
                return Outcome(ending, cycle + 1, time.monotonic() - began_s, missed)

    def over(self, cycle: int) -> Ending | None:
        """How the run ends, None: it goes on. Decided by bus and cycle count alone, so that two runs end in the same
        cycle."""
        host = self.nodes.host_state()
        state = host & STATE_MASK
        if host != UNKNOWN:
            if host & PLAN_COMPLETE:
                return Ending.COMPLETE
            lived_through = self.disturbance is None or self.disturbance.over(self.plant.cycle - 1)
            if cycle > START_CYCLE + START_GRACE_CYCLES and lived_through:
                if state in (HOLDING, FAULT):
                    return None if state == HOLDING and self.guided() else Ending.STOPPED
                if state != CLIMBING:
                    return Ending.NOT_STARTED
        return Ending.TIMEOUT if cycle >= self.max_cycles else None

    def _free_run(self, last: int) -> bool:
        """The nodes alone: their watchdogs must hold the robot. True when it is still where it was."""
        before = self.plant.data.qpos[:3].copy()
        held = self.plant.limbs_on_holds()
        for step in range(int(FREE_RUN_S / self.plant.dt_s)):
            self._step(last + 1 + step, heard=False)
        moved_m = float(np.linalg.norm(self.plant.data.qpos[:3] - before))
        return moved_m < STAYED_M and bool(np.all(self.plant.limbs_on_holds()[held]))
