"""An operator beside a runtime that is in this process: clears what the robot holds for and has it go on."""

from __future__ import annotations

from crux_msgs import acknowledgement_t, command_t
from crux_tools.operator_link import OperatorLink
from crux_tools.telemetry.summary import STANDS_UP

from crux_simulation.sim.loop import Loop
from crux_simulation.sim.runtime_here import RuntimeHere

TRIES = 3
LOOKS_EVERY_S, SETTLES_S = 0.05, 1.0
STANDS_WITHIN_S = 30.0  # a robot that takes longer hangs there


class Resumed:
    """What Loop.guided asks."""

    def __init__(self, link: OperatorLink, runtime: RuntimeHere, loop: Loop) -> None:
        self._link, self._runtime, self._loop = link, runtime, loop
        self._tries = 0
        self._waited_s = 0.0  # for it to stand

    def __call__(self) -> bool:
        self._runtime.idle = lambda: self._loop.cycles(1)
        try:
            return self._goes_on()
        finally:
            self._runtime.idle = None

    def _goes_on(self) -> bool:
        self._link.command(command_t.STATUS)
        status = self._link.status
        if status is None or self._tries == TRIES:
            return False
        if status.state.waiting_for == STANDS_UP:
            self._pass(LOOKS_EVERY_S)
            self._waited_s += LOOKS_EVERY_S
            return self._waited_s < STANDS_WITHIN_S
        self._tries += 1
        self._waited_s = 0.0
        self._link.command(command_t.CLEAR_FAULT)
        self._pass(SETTLES_S)
        answer = self._link.command(command_t.RESUME)
        accepted = answer is not None and answer.verdict == acknowledgement_t.ACCEPTED
        self._pass(LOOKS_EVERY_S if accepted else SETTLES_S)
        return True

    def _pass(self, time_s: float) -> None:
        self._loop.cycles(round(time_s / self._loop.plant.dt_s))
