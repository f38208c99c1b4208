"""The simulated robot on its wall, held by the firmware's own nodes, for a runtime that comes later."""

from __future__ import annotations

import threading
import time
from collections.abc import Callable
from typing import Self

from crux_contracts.robot import load_robot
from crux_msgs import plan_t
from crux_simulation.sim.disturbance import STATE_MASK
from crux_simulation.sim.firmware_nodes import FirmwareNodes
from crux_simulation.sim.plant import Plant
from crux_simulation.sim.ports import RunPorts
from crux_tools.robot3d.robot_model import build_model

PATIENCE_S = 600.0  # a busy machine is slow; no test waits for it when all is well
POLL_S = 0.005


class RobotOnWall:
    """Answers every Sync with one step of physics, in a thread of its own, until the context is left.

    Entering it, the nodes say who they are, before anybody can hear it: they were there before the runtime.
    """

    def __init__(self, ports: RunPorts, plan: plan_t, cables: tuple[int, ...] = (0, 1, 2, 3)) -> None:
        """`cables`: the bus that each limb, LF RF LR RR, is plugged into."""
        robot = load_robot("scaler")
        self._plant = Plant(build_model(robot, plan), plan, 0)
        self._nodes = FirmwareNodes([ports.bus_urls()[bus] for bus in cables], robot)
        self._stop = threading.Event()
        self._thread = threading.Thread(target=self._serve)
        self.cycle = -1

    def __enter__(self) -> Self:
        self._nodes.publish(self._plant)
        self._thread.start()
        return self

    def __exit__(self, *_: object) -> None:
        self.power_off()
        self._nodes.__exit__(None, None, None)

    def power_off(self) -> None:
        """All 28 nodes are silent from now on."""
        self._stop.set()
        self._thread.join()

    @property
    def host_state(self) -> int:
        """Supervisor state of the last heartbeat, as in robot_state_t."""
        return self._nodes.host_state() & STATE_MASK

    def await_state(self, state: int) -> None:
        """Waits for a supervisor state."""
        self._await(lambda: self.host_state == state, f"state {state}")

    def await_cycle(self, cycle: int) -> None:
        """Waits until a cycle has been answered."""
        self._await(lambda: self.cycle >= cycle, f"cycle {cycle}")

    def _await(self, wanted: Callable[[], bool], what: str) -> None:
        end_s = time.monotonic() + PATIENCE_S
        while not wanted():
            assert time.monotonic() < end_s, f"no {what}: cycle {self.cycle}, state {self.host_state}"
            time.sleep(POLL_S)

    def _serve(self) -> None:
        while not self._stop.is_set():
            cycle = self._nodes.wait_sync(0.05)
            if cycle is None:
                continue
            if cycle != self.cycle:  # the runtime repeats its first Sync until all nodes have answered
                self._nodes.step(self._plant)
            self._nodes.publish(self._plant)
            self.cycle = cycle
