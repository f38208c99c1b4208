"""`crux sim`: the operator's own commands against a simulated robot, as on the robot. Needs the build."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import attacks
import numpy as np
import pytest
from crux_contracts.plan_file import write_plan
from crux_msgs import command_t, plan_t, robot_state_t
from crux_simulation.sim.ports import run_ports
from crux_tools.operator_key import OperatorKey
from crux_tools.operator_link import OperatorLink
from crux_tools.telemetry.reader import read_log
from hand_plan import BODY_HEIGHT_M, Wall, standing_plan

PATIENCE_S = 600.0
LED_ON = {
    robot_state_t.IDLE: command_t.CLEAR_FAULT,  # nodes that hold by themselves
    robot_state_t.READY: command_t.START,
    robot_state_t.FAULT: command_t.CLEAR_FAULT,
    robot_state_t.HOLDING: command_t.RESUME,
}
CARRIED_S = 4.0  # longer than the hand goes on where the runtime takes over at once


def hanging_plan() -> plan_t:
    """Under an overhang, where nobody hangs whose grippers do not press."""
    return standing_plan(Wall(slope_deg=110.0), np.array([[0.0, 0.0, BODY_HEIGHT_M]] * 8))


@contextmanager
def practice(folder: Path, *more: str, key: Path | None = None) -> Iterator[tuple[subprocess.Popen[str], OperatorLink]]:
    write_plan(folder / "plan.mcap", hanging_plan())
    with run_ports() as ports:
        words = ["sim", str(folder / "plan.mcap"), "-o", str(folder / "log.mcap"), "--lcm", ports.lcm_url, *more]
        process = subprocess.Popen([sys.executable, "-m", "crux_tools.cli", *words], stderr=subprocess.PIPE, text=True)
        try:
            with OperatorLink(ports.lcm_url, first_request=time.time_ns(), key=key) as link:
                yield process, link
        except AssertionError as error:
            process.kill()
            error.add_note(f"crux sim said: {process.communicate()[1]}")
            raise
        finally:
            process.kill()
            process.wait()


def runtime_of(process: subprocess.Popen[str]) -> int:
    """The process id of the runtime that a `crux sim` has started."""
    children = Path(f"/proc/{process.pid}/task/{process.pid}/children").read_text().split()
    (runtime,) = [int(pid) for pid in children if "crux-runtime" in Path(f"/proc/{pid}/comm").read_text()]
    return runtime


def until(link: OperatorLink, met: Callable[[robot_state_t], bool], led_on: bool = False) -> robot_state_t:
    """The first state that meets; `led_on`: as an operator does where a stalled machine made the robot hold."""
    end_s = time.monotonic() + PATIENCE_S
    while time.monotonic() < end_s:
        if link.command(command_t.STATUS, tries=1) is not None and link.status is not None and met(link.status.state):
            return link.status.state
        if led_on and link.status is not None and (state := link.status.state).supervisor_state in LED_ON:
            stands = state.fault_code != 0
            link.command(command_t.CLEAR_FAULT if stands else LED_ON[state.supervisor_state], hanging_plan().plan_id)
        time.sleep(0.1)
    last = link.status and link.status.state
    told = last and (last.supervisor_state, last.fault_code, last.time_s, last.plan_time_s)
    raise AssertionError(f"not within {PATIENCE_S:g} s; state, fault, time and plan time at last: {told}")


@pytest.mark.alone
def test_the_operators_commands_find_a_robot(tmp_path: Path) -> None:
    plan = hanging_plan()
    with practice(tmp_path) as (process, link):
        until(link, lambda state: state.time_s > CARRIED_S)
        link.upload(plan)
        until(link, lambda state: state.supervisor_state == robot_state_t.READY, led_on=True)
        until(link, lambda state: state.plan_time_s > 1.0, led_on=True)
        link.send(command_t.HOLD)
        held = until(link, lambda state: state.supervisor_state == robot_state_t.HOLDING)
        assert held.fault_code == 0
        until(link, lambda state: state.time_s > held.time_s + 1.2)  # a killed runtime's log lacks its last half second
        assert link.status is not None
        session = link.status.session
        os.kill(runtime_of(process), signal.SIGKILL)
        found = until(
            link,
            lambda state: (
                state.supervisor_state == robot_state_t.HOLDING
                and link.status is not None
                and link.status.session != session
            ),
        )
        assert found.plan_time_s == pytest.approx(held.plan_time_s, abs=0.2)
        until(link, lambda state: state.plan_time_s > held.plan_time_s + 0.5, led_on=True)
        link.send(command_t.FORCE_SHUTDOWN)
        _, said = process.communicate(timeout=PATIENCE_S)
        assert process.returncode == 0, said
        assert "was ended by signal 9; it is started again" in said
        assert "was shut down" in said
    assert read_log(tmp_path / "log-2.mcap").state["plan_time_s"].max() > found.plan_time_s
    assert read_log(tmp_path / "log.mcap").state["plan_time_s"].max() == pytest.approx(held.plan_time_s, abs=0.1)


@pytest.mark.alone
def test_ctrl_c_ends_it_without_a_word_too_much(tmp_path: Path) -> None:
    with practice(tmp_path) as (process, link):
        until(link, lambda state: state.cycle > 100)
        process.send_signal(signal.SIGINT)
        _, said = process.communicate(timeout=PATIENCE_S)
        assert process.returncode == 0, said
        assert said.splitlines()[-1] == f"crux sim: ended; the log is {tmp_path / 'log.mcap'}"


@pytest.mark.sweep
@pytest.mark.parametrize("name", ["fragments", "garbage", "forged_answers", "questions"])
def test_an_attack_costs_no_hold_and_no_cycle_of_the_log(tmp_path: Path, name: str) -> None:
    plan, key = hanging_plan(), tmp_path / "ann.pem"
    (tmp_path / "keys").write_text(OperatorKey.new(key).line("operate", "ann"), encoding="ascii")
    with practice(tmp_path, "--keys", str(tmp_path / "keys"), key=key) as (process, link):
        until(link, lambda state: state.time_s > CARRIED_S)
        attacker = subprocess.Popen([sys.executable, attacks.__file__, name, link.url])
        try:
            link.upload(plan)
            until(link, lambda state: state.supervisor_state == robot_state_t.READY, led_on=True)
            link.send(command_t.START, plan.plan_id)
            link.send(command_t.SPEED, value=0.2)  # the plan lasts longer than the attack
            for _ in range(20):
                assert link.command(command_t.HOLD) is not None
                until(link, lambda state: state.supervisor_state == robot_state_t.HOLDING)
                link.send(command_t.RESUME)
        finally:
            attacker.kill()
            attacker.wait()
        link.send(command_t.FORCE_SHUTDOWN)
        _, said = process.communicate(timeout=PATIENCE_S)
        assert process.returncode == 0, said
    cycles = read_log(tmp_path / "log.mcap").state["cycle"]
    assert (np.diff(cycles) == 1).all()
