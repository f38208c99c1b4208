"""Plans again on the way beside a runtime that is in this process: the simulation goes on meanwhile."""

from __future__ import annotations

from crux_contracts.robot import Robot
from crux_msgs import command_t, plan_t, status_t
from crux_tools.guide.replanner import Replanner
from crux_tools.operator_link import OperatorLink
from crux_tools.output import note

from crux_simulation.sim.guided import THINKS_S
from crux_simulation.sim.loop import START_CYCLE, Loop, climbing
from crux_simulation.sim.runtime_here import RuntimeHere

LOOKS_EVERY_S = 0.1


class Replanned:
    """What Loop.between calls in every cycle. Planning takes `THINKS_S` of simulated time, whatever it really takes."""

    def __init__(self, link: OperatorLink, runtime: RuntimeHere, loop: Loop, plan: plan_t, robot: Robot) -> None:
        self._link, self._runtime, self._loop = link, runtime, loop
        self.replanner = Replanner(link, plan, robot, lambda line: note(f"replan: {line}"), self._pass)
        self._next_cycle, self._busy = START_CYCLE, False

    def __call__(self) -> None:
        """Looks at the runtime when it is time."""
        if self._busy or self._loop.cycle < self._next_cycle or climbing(self._loop.nodes.host_state()) != 1:
            return
        self._busy = True  # cycles pass while the runtime answers
        self._runtime.idle = lambda: self._loop.cycles(1)
        try:
            self.replanner.attend(self._ask)
        finally:
            self._runtime.idle, self._busy = None, False
        self._next_cycle = self._loop.cycle + round(LOOKS_EVERY_S / self._loop.plant.dt_s)

    def _ask(self) -> status_t | None:
        self._link.command(command_t.STATUS)
        return self._link.status

    def _pass(self) -> None:
        self._loop.cycles(round(THINKS_S / self._loop.plant.dt_s))
