"""A robot on its wall gets its runtime whatever is the matter with the log; the log begins as soon as it can."""

from __future__ import annotations

import json
import resource
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from crux_msgs import robot_state_t
from crux_simulation.sim.ports import run_ports
from crux_tools.cli import main
from crux_tools.errors import UsageError
from crux_tools.replay.recompute import recompute
from crux_tools.telemetry.channels import read_channels
from hand_plan import standing_plan
from own_runtime import Starter
from robot_on_wall import PATIENCE_S, RobotOnWall

STATE = "/robot_state"


def await_true(wanted: Callable[[], bool]) -> None:
    end_s = time.monotonic() + PATIENCE_S
    while not wanted():
        assert time.monotonic() < end_s
        time.sleep(0.05)


def test_it_starts_without_a_log_and_begins_one_as_soon_as_it_can(start: Starter, tmp_path: Path) -> None:
    log = tmp_path / "missing" / "climb.mcap"
    runtime = start("--log", str(log), pace="clock")  # which waits for its answer
    log.parent.mkdir()
    await_true(log.exists)
    runtime.process.terminate()
    status, said = runtime.end()
    assert status == 1, "the log is not whole"
    assert f"log {log}: cannot be created: No such file or directory; the control goes on without a log" in said
    assert f"there is a log again, {log}" in said
    assert read_channels(log, {STATE}).end is not None


@pytest.mark.alone  # its nodes have to answer by the clock
def test_a_log_that_ended_goes_on_in_another_file(start: Starter, capsys: pytest.CaptureFixture[str]) -> None:
    def told() -> object:
        capsys.readouterr()
        assert main(["status", "--lcm", runtime.ports.lcm_url, "--json"]) == 0
        fault = json.loads(capsys.readouterr().out)["fault"]
        return fault and fault["name"]

    plan = standing_plan()
    with run_ports() as ports, RobotOnWall(ports, plan) as robot:
        runtime = start(ports=ports, pace="clock")
        runtime.link.upload(plan)
        robot.await_state(robot_state_t.READY)
        full = runtime.log.stat().st_size
        resource.prlimit(runtime.process.pid, resource.RLIMIT_FSIZE, (full, full))
        second = runtime.log.with_stem(f"{runtime.log.stem}-2")
        await_true(lambda: second.exists() and second.stat().st_size >= full)
        await_true(lambda: told() != "log_ended")  # it is of the past
        runtime.process.terminate()
        status, said = runtime.end()
    assert status == 1
    assert "file too large" in said.lower()
    first, later = (read_channels(log, {STATE}).tables[STATE]["cycle"] for log in (runtime.log, second))
    assert first[0] == 1
    assert later[0] > first[-1]
    with pytest.raises(UsageError, match=rf"begins in cycle {later[0]} of a run whose control core had worked before"):
        recompute(second)
