"""`crux guide` as an operator has it: on a terminal, beside a runtime that is a process of its own. Needs the build."""

from __future__ import annotations

import os
import pty
import select
import subprocess
import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest
from crux_contracts.plan_file import write_plan
from crux_contracts.robot import load_robot
from crux_msgs import command_t, plan_t, robot_state_t
from crux_simulation.benchmarks.world_faults import START_S
from crux_simulation.sim.climb import ClimbOptions, plant_of
from crux_simulation.sim.disturbance import STATE_MASK
from crux_simulation.sim.firmware_nodes import FirmwareNodes
from crux_simulation.sim.loop import START_CYCLE
from crux_simulation.sim.plant import Plant
from crux_simulation.sim.ports import run_ports
from crux_simulation.sim.practice import Practice
from crux_simulation.sim.runtime_process import GUARD_TIME_S, RuntimeProcess, runtime_arguments
from crux_simulation.sim.world_file import parse_world
from crux_tools.operator_link import OperatorLink
from crux_tools.replay.recompute import recompute
from shared_plans import SharedPlans
from short_climb import with_a_spare_hold

WORLD = "version: 1\nname: test\nholds: {{right-rear-low: {{breaks_at_s: {at_s}}}}}\n"
HOLDING_S = 0.005  # that a cycle takes at least
PATIENCE_S = 600.0  # the machine may be busy
GOAL_M = 0.01


@dataclass
class Terminal:
    """`crux` on a terminal of its own."""

    words: list[str]
    said: str = field(default="", init=False)

    def __enter__(self) -> Terminal:
        self._master, slave = pty.openpty()
        command = [sys.executable, "-m", "crux_tools.cli", *self.words]
        self.process = subprocess.Popen(command, stdin=slave, stdout=slave, stderr=slave, start_new_session=True)
        os.close(slave)
        return self

    def __exit__(self, *_: object) -> None:
        self.process.kill()
        self.process.wait()
        os.close(self._master)

    def until(self, text: str) -> None:
        """Reads until it has said `text`."""
        end_s = time.monotonic() + PATIENCE_S
        while text not in self.said:
            assert time.monotonic() < end_s, self.said
            if not select.select([self._master], [], [], 1.0)[0]:
                continue
            try:
                self.said += os.read(self._master, 4096).decode()
            except OSError:  # nobody is at the other end any more
                assert text in self.said, self.said

    def answers(self, word: str) -> None:
        """Types a line."""
        os.write(self._master, f"{word}\n".encode())


@dataclass
class Climb:
    """A robot whose hold breaks in the first stance; `link` is another operator's."""

    plant: Plant
    link: OperatorLink
    lcm: str

    def until(self, met: Callable[[robot_state_t], bool]) -> robot_state_t:
        """The first state that meets."""
        end_s = time.monotonic() + PATIENCE_S
        while time.monotonic() < end_s:
            self.link.send(command_t.STATUS)
            assert self.link.status is not None
            if met(self.link.status.state):
                return self.link.status.state
            time.sleep(0.1)
        raise AssertionError(f"not within {PATIENCE_S:g} s")

    def plan_id(self) -> str:
        """What the runtime climbs."""
        return str(self.link.send(command_t.STATUS).plan_id)


class Patient(Practice):
    """Leaves the processor to the guide as long as the robot holds: no plan's clock runs then."""

    def _step(self, cycle: int, heard: bool = True) -> None:
        super()._step(cycle, heard)
        if self.nodes.host_state() & STATE_MASK == robot_state_t.HOLDING:
            time.sleep(HOLDING_S)


@contextmanager
def climbing(plan: plan_t, log: Path) -> Iterator[Climb]:
    """Runtime, nodes and physics in lockstep over UDP; physics is a thread of this process."""
    breaks_s = START_S + plan.knots[1].time_s / 4  # all limbs are in stance
    robot, world = load_robot("scaler"), parse_world(WORLD.format(at_s=breaks_s).encode()).draw(0, plan)
    plant = plant_of(plan, robot, ClimbOptions(world=world))
    with ExitStack() as stack:
        ports = stack.enter_context(run_ports())
        buses = ports.bus_urls()
        arguments = runtime_arguments(robot.folder, log, "each", {})
        runtime = stack.enter_context(RuntimeProcess(buses, "bus", ports.lcm_url, GUARD_TIME_S, arguments))
        link = stack.enter_context(OperatorLink(ports.lcm_url))
        runtime.await_answer(link)
        link.upload(plan)
        link.send(command_t.START, plan.plan_id, START_CYCLE)
        nodes = stack.enter_context(FirmwareNodes(buses, robot, world=world))
        physics = threading.Thread(target=Patient(nodes, plant, runtime.is_alive, lambda _time_s: None, 0).run)
        stack.callback(physics.join)
        stack.callback(runtime.end)
        physics.start()
        yield Climb(plant, link, ports.lcm_url)


def held(state: robot_state_t) -> bool:
    return bool(state.supervisor_state == robot_state_t.HOLDING)


@pytest.mark.parametrize("whole", [False, pytest.param(True, marks=pytest.mark.sweep)])
def test_an_operator_is_asked_and_the_plan_is_climbed_though_the_guide_is_killed(
    tmp_path: Path, planned: SharedPlans, whole: bool
) -> None:
    """For three seconds more; or first the operator does not want the plan, and it is climbed to its end."""
    plan: plan_t = planned(with_a_spare_hold(), load_robot("scaler")).plan
    write_plan(tmp_path / "plan.mcap", plan)
    log = tmp_path / "log.mcap"
    with climbing(plan, log) as run:
        words = ["guide", str(tmp_path / "plan.mcap"), "--ask", "--lcm", run.lcm]
        run.until(lambda state: held(state) and state.fault_code != 0)
        if whole:
            with Terminal(words) as terminal:
                terminal.until("climb that? [y/N]")
                terminal.answers("n")
                terminal.until("the operator does not want it")
                assert terminal.process.wait(PATIENCE_S) == 1
            assert held(run.until(lambda _: True))
            assert run.plan_id() == plan.plan_id
        with Terminal(words) as terminal:
            terminal.until("climb that? [y/N]")
            assert "right-rear-low is no hold any more" in terminal.said
            assert "RR to right-rear-high" in terminal.said
            terminal.answers("y")
            run.until(lambda state: state.supervisor_state == robot_state_t.CLIMBING and state.plan_time_s > 1.0)
            assert terminal.process.poll() is None
        assert run.plan_id() != plan.plan_id
        killed_s = run.until(lambda _: True).plan_time_s
        enough_s = np.inf if whole else killed_s + 3.0
        state = run.until(lambda state: bool(state.plan_complete) or held(state) or state.plan_time_s > enough_s)
        assert (state.plan_complete, state.fault_code) == (whole, 0)
        if whole:
            assert run.plant.limbs_on_holds().all()
            goal_m = np.array(plan.knots[-1].body_position_w_m)
            assert np.linalg.norm(run.plant.data.qpos[:3] - goal_m) < GOAL_M
        else:
            assert state.supervisor_state == robot_state_t.CLIMBING
    assert recompute(log).ok
