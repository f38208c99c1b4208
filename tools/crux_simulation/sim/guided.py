"""A guide beside a runtime that is in this process: the simulation goes on while it waits for answers."""

from __future__ import annotations

from typing import Any

from crux_contracts.robot import Robot
from crux_msgs import plan_t, robot_state_t
from crux_tools.guide.guide import Attended, Guide
from crux_tools.operator_link import OperatorLink
from crux_tools.output import note

from crux_simulation.sim.loop import Loop
from crux_simulation.sim.runtime_here import RuntimeHere

THINKS_S = 1.0  # of simulated time, for planning, whatever that takes: runs are the same on every machine
LOOKS_EVERY_S = 0.05


class Guided:
    """What Loop.guided asks.

    `legs`: the plans climbed, each with the cycle in which it was taken; `stood_s`: how long the robot stood before
    each but the first, from the fault on, where planning takes what it took; `said`: what the guide said.
    """

    def __init__(self, link: OperatorLink, runtime: RuntimeHere, loop: Loop, plan: plan_t, robot: Robot) -> None:
        self._runtime, self._loop = runtime, loop
        self._guide = Guide(link, plan, robot, self._say, agrees=self._thinks)
        self.legs = [(0, plan)]
        self.stood_s: list[float] = []
        self.said: list[str] = []
        self._holds_since = 0  # cycle; 0: it does not

    def as_json(self) -> dict[str, Any]:
        """What `crux climb --json` prints of it."""
        return {"plans": len(self.stood_s), "stood_s": self.stood_s, "said": self.said}

    def _say(self, line: str) -> None:
        self.said.append(line)
        note(f"guide: {line}")

    def __call__(self) -> bool:
        self._holds_since = self._holds_since or self._loop.cycle
        self._runtime.idle = lambda: self._loop.cycles(1)
        try:
            attended = self._guide.attend()
        finally:
            self._runtime.idle = None
        if attended is Attended.STARTED:
            stood_s = (self._loop.cycle - self._holds_since) * self._loop.plant.dt_s
            self.stood_s.append(stood_s - THINKS_S + self._guide.planning_s)
            self._holds_since = 0
            self.legs.append((self._loop.cycle, self._guide.plan))
            return True
        if attended is Attended.RESUMED:
            self._holds_since = 0
            return True
        status = self._guide.link.status
        holds = status is not None and status.state.supervisor_state == robot_state_t.HOLDING
        if attended is Attended.WAITING or (attended is Attended.NOTHING and not holds):
            self._pass(LOOKS_EVERY_S)
            return True
        return False

    def _thinks(self) -> bool:
        self._pass(THINKS_S)
        return True

    def _pass(self, time_s: float) -> None:
        self._loop.cycles(round(time_s / self._loop.plant.dt_s))
