"""Uploads the parts of a route one after the other while the robot climbs, to a runtime in this process."""

from __future__ import annotations

from collections.abc import Sequence

from crux_msgs import command_t, plan_t
from crux_tools.operator_link import OperatorLink

from crux_simulation.sim.loop import START_CYCLE, Loop, climbing
from crux_simulation.sim.runtime_here import RuntimeHere

AHEAD_S = 20.0  # of the end of what the runtime has; the robot is never ahead of the time since its start
SETTLED_S = 0.5  # since START, which was scheduled: no plan is taken before it


class Streamed:
    """What Loop.between calls in every cycle."""

    def __init__(
        self, link: OperatorLink, runtime: RuntimeHere, loop: Loop, first: plan_t, parts: Sequence[plan_t]
    ) -> None:
        self._link, self._runtime, self._loop = link, runtime, loop
        self._left = list(parts)
        self._end_s = float(first.knots[-1].time_s)
        self._busy = False

    def __call__(self) -> None:
        """Uploads the next part when it is time. Raises UsageError with the runtime's reason where it is refused."""
        since_start_s = (self._loop.cycle - START_CYCLE) * self._loop.plant.dt_s
        climbs = climbing(self._loop.nodes.host_state()) == 1
        if self._busy or not self._left or not climbs or since_start_s < max(SETTLED_S, self._end_s - AHEAD_S):
            return
        part = self._left.pop(0)
        self._busy = True  # cycles pass while the runtime decides
        self._runtime.idle = lambda: self._loop.cycles(1)
        try:
            self._link.command(command_t.STATUS)  # after an answer it looks at what cycles have said
            self._link.upload(part)
        finally:
            self._runtime.idle, self._busy = None, False
        self._end_s += float(part.knots[-1].time_s)
