"""A climb whose runtime dies at a moment and is started again, in lockstep and in this process."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from crux_contracts.robot import Robot
from crux_msgs import command_t, plan_t, robot_state_t, status_t
from crux_tools.errors import WorkFailed
from crux_tools.guide.guide import Attended, Guide
from crux_tools.operator_link import OperatorLink

from crux_simulation.sim.climb import ClimbOptions, plant_of
from crux_simulation.sim.firmware_nodes import FirmwareNodes
from crux_simulation.sim.judge import Verdict, judge
from crux_simulation.sim.loop import START_CYCLE, climbing
from crux_simulation.sim.recorder import recorded
from crux_simulation.sim.runtime_here import RuntimeHere
from crux_simulation.sim.runtime_process import runtime_arguments

LOOKS_EVERY = 25  # cycles
FOUND_WITHIN = 2500  # cycles from the start of a runtime
REST = 250  # cycles after the goal


@dataclass
class Restarting:
    """One robot on its wall. `link` is to the runtime that runs, None while none does."""

    plan: plan_t
    robot: Robot
    folder: Path
    """of the logs, one a runtime"""
    state: Path
    """where a runtime keeps what it needs after a restart"""
    seed: int = 0
    cycle: int = field(default=0, init=False)
    """of physics, over all runs"""
    link: OperatorLink | None = field(default=None, init=False)
    logs: list[Path] = field(default_factory=list, init=False)

    def __post_init__(self) -> None:
        self.plant = plant_of(self.plan, self.robot, ClimbOptions(seed=self.seed))
        self._nodes = FirmwareNodes(["memory:"] * 4, self.robot)
        self._runtime: RuntimeHere | None = None
        self._answered = -1

    def __enter__(self) -> Restarting:
        return self

    def __exit__(self, *_: object) -> None:
        self.die()
        self._nodes.__exit__(None, None, None)

    def start(self) -> None:
        """A runtime comes up."""
        self.logs.append(self.folder / f"log-{len(self.logs) + 1}.mcap")
        arguments = runtime_arguments(self.robot.folder, self.logs[-1], "each", {}, state=self.state)
        self._runtime = RuntimeHere(self._nodes, arguments)
        self._runtime.idle = lambda: self.run(1)
        self.link = OperatorLink(connection=self._runtime)
        self._answered = -1

    def die(self) -> None:
        """The runtime ends as by `kill -9`: no node hears of it."""
        if self._runtime is not None:
            self._nodes.before_sync = lambda: None
            self._runtime.__exit__(None, None, None)
        self._runtime = self.link = None

    def run(self, cycles: int) -> None:
        """Lets so many cycles pass, with a runtime or without."""
        for _ in range(cycles):
            heard = self._nodes.wait_sync(0.2) if self._runtime is not None else None
            if heard is not None and heard == self._answered:  # it wakes the nodes
                self._nodes.publish(self.plant)
                continue
            self._nodes.step(self.plant)
            self.plant.record(self.cycle, climbing(self._nodes.host_state()) if heard is not None else 0)
            self._nodes.publish(self.plant)
            self._answered = self._answered if heard is None else heard
            self.cycle += 1

    def status(self) -> status_t:
        """What the runtime says."""
        assert self.link is not None
        self.link.send(command_t.STATUS)
        assert self.link.status is not None
        return self.link.status

    def until(self, met: Callable[[status_t], bool], cycles: int) -> status_t:
        """Runs until a status meets, for so many cycles at most. Raises WorkFailed where none does."""
        for _ in range(cycles // LOOKS_EVERY):
            self.run(LOOKS_EVERY)
            if met(status := self.status()):
                return status
        state = status.state
        raise WorkFailed(
            f"not reached: state {state.supervisor_state}, fault {state.fault_code} at {state.plan_time_s:.2f} s"
        )

    def climb_until(self, plan_time_s: float) -> status_t:
        """Starts a runtime that climbs the plan until there."""
        self.start()
        assert self.link is not None
        self.link.upload(self.plan)
        self.link.send(command_t.START, self.plan.plan_id, START_CYCLE)
        end = START_CYCLE + round(2.0 * self.plan.knots[-1].time_s / self.plant.dt_s) + 5000
        return self.until(lambda status: status.state.plan_time_s >= plan_time_s, end)

    def restart(self, down_cycles: int) -> status_t:
        """The runtime dies, the nodes are alone for a while, and another one comes up; its status once it has told a
        fault."""
        self.die()
        self.run(down_cycles)
        self.start()
        return self.until(lambda status: status.fault.code != 0, FOUND_WITHIN)

    def guide(self) -> list[str]:
        """A guide leads to the goal, or gives up; what it said."""
        said: list[str] = []
        assert self.link is not None
        guide = Guide(self.link, self.plan, self.robot, said.append)
        for _ in range(4000):
            if guide.attend() in (Attended.DONE, Attended.GAVE_UP, Attended.OPERATOR):
                break
            self.run(LOOKS_EVERY)
        self.run(REST)
        return said

    def verdict(self) -> Verdict:
        """The judge's, over all runs."""
        complete = self.link is not None and self.status().state.plan_complete
        return judge(recorded(self.plant), self.plan, self.plant.robot, bool(complete))


HOLDING = robot_state_t.HOLDING
