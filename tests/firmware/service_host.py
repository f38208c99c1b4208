"""Nodes that run by themselves on buses of their own, for tests of their services."""

from __future__ import annotations

import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager

import crux_nodes
from crux_contracts import can_codec
from crux_contracts.robot import Robot
from host import HOLD, TRACK, Host, host

PERIOD_S = 0.001
LEFT_TO_READERS = 3.0  # times what a period takes
STATE_HOLD, STATE_TRACK = 1, 2


class Desk:
    """A robot that lies on a desk: time passes, nobody commands it unless asked to."""

    def __init__(self, spoken: Host) -> None:
        self.host = spoken
        self.nodes = spoken.nodes
        self.joint: can_codec.Values | None = None  # sent every cycle from now on
        self.gripper: can_codec.Values = {"Mode": 0, "Opening_m": 0.03, "SpeedLimit_m_s": 0.02, "ForceLimit_N": 20.0}
        self.torques_Nm: list[crux_nodes.Array] = []  # of all joints, a period each
        self.forces_N: list[crux_nodes.Array] = []  # of all grippers
        self._cycle = 0
        self.periods = 0  # that have passed for the nodes
        self._to_reset: tuple[int, int] | None = None
        self._end = threading.Event()
        self._thread = threading.Thread(target=self._run, daemon=True)
        self._thread.start()

    def _run(self) -> None:
        while not self._end.is_set():
            begun_s = time.monotonic()
            if self._to_reset is not None:
                self.nodes.reset(*self._to_reset)
                self._to_reset = None
            if self.joint is not None:
                self._cycle += 1
                self.host.send_cycle(self._cycle, self.joint, self.gripper)
            self.nodes.wait_sync(PERIOD_S)
            torque_Nm, force_N = self.host.control()
            self.torques_Nm.append(torque_Nm.copy())
            self.forces_N.append(force_N.copy())
            self.host.publish()
            self.periods += 1
            if self.joint is not None:  # its own Syncs wake it: leave time for those who read all these frames
                time.sleep(LEFT_TO_READERS * (time.monotonic() - begun_s))

    def reset(self, limb: int, node: int) -> None:
        """Starts a node anew, between two periods: the nodes are one thread's alone."""
        self._to_reset = (limb, node)
        while self._to_reset is not None:
            time.sleep(0.001)

    def await_periods(self, number: int) -> None:
        """Waits until so many more have passed for the nodes, however slow the machine is."""
        last = self.periods + number
        while self.periods < last:
            time.sleep(0.01)

    def command(self, joint: can_codec.Values | None) -> None:
        """Sends this every cycle; waits until all joints have obeyed."""
        self.joint = joint
        wanted = None if joint is None else {HOLD: STATE_HOLD, TRACK: STATE_TRACK}[int(joint["Mode"])]
        deadline_s = time.monotonic() + 600.0
        while wanted is not None and set(self.nodes.states()[0]) != {wanted}:
            assert time.monotonic() < deadline_s
            time.sleep(0.01)

    def base(self) -> str:
        """For --bus-base."""
        return self.host.urls[0]

    def end(self) -> None:
        self._end.set()
        self._thread.join()


@contextmanager
def desk(robot: Robot) -> Iterator[Desk]:
    """Nodes that live until the block ends."""
    with host(robot) as spoken:
        running = Desk(spoken)
        try:
            yield running
        finally:
            running.end()
