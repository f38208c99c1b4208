"""Whole climbs by several processes, ended from outside, flooded, without disk space, by the clock. Needs the build."""

from __future__ import annotations

import math
import os
import signal
import socket
import subprocess
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from climbs import TIMEOUT_S, finish_climb, messages, saved, start_climb
from crux_msgs import command_t
from crux_simulation.sim.lcm_flood import FIRST_REQUEST
from crux_tools.output import alone_with
from crux_tools.telemetry.channels import read_channels
from crux_tools.telemetry.reader import read_log
from hand_plan import BODY_HEIGHT_M, Wall, climbing_plan, standing_plan

PERIOD_S, STALL_S = 0.002, 0.005


def _runtime_of(bench: subprocess.Popen[str]) -> int:
    children = Path(f"/proc/{bench.pid}/task/{bench.pid}/children").read_text(encoding="ascii").split()
    return next(int(child) for child in children if "crux-runtime" in Path(f"/proc/{child}/cmdline").read_text())


def _runs(process: int) -> bool:
    """A zombie, which its parent has not asked about, has ended."""
    try:
        return ") Z " not in Path(f"/proc/{process}/stat").read_text(encoding="ascii")
    except OSError:
        return False


def _wait_for(is_so: Callable[[], bool]) -> None:
    end_s = time.monotonic() + TIMEOUT_S
    while not is_so():
        assert time.monotonic() < end_s
        time.sleep(0.05)


def test_kill_9_of_the_runtime_leaves_the_robot_on_the_wall(tmp_path: Path) -> None:
    """In a climb in which all limbs stand: nobody says when it comes."""
    log = tmp_path / "log.mcap"
    bench = start_climb(saved(tmp_path, standing_plan(Wall(dt_s=15.0))), log, "--bus", "udp")
    enough = 4_500_000  # bytes: the climb begins after 3 million of them, and what was written last is lost
    _wait_for(lambda: bench.poll() is not None or (log.exists() and log.stat().st_size > enough))
    assert bench.poll() is None, bench.communicate()
    os.kill(_runtime_of(bench), signal.SIGKILL)
    status, result = finish_climb(bench)
    assert status == 1
    assert result["ok"] is False
    assert result["robot_on_wall"] is True
    assert "signal 9" in result["reason"]
    told = read_log(log)
    assert len(told.state) > 500
    assert told.end is None
    assert told.verdict is not None  # the simulation lives on, and adds it to what the runtime left
    assert (told.verdict.ok, told.verdict.log_complete, told.verdict.reason) == (False, False, result["reason"])
    assert len(messages(log)["/truth/body"]) > len(told.state) / 5


def test_a_service_manager_is_told_that_the_runtime_runs_and_goes_on(tmp_path: Path) -> None:
    """Nothing before the nodes have answered, then what systemd's Type=notify and WatchdogSec wait for."""
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as manager, pytest.MonkeyPatch.context() as environment:
        manager.bind(str(tmp_path / "notify"))
        environment.setenv("NOTIFY_SOCKET", str(tmp_path / "notify"))
        plan = saved(tmp_path, standing_plan())
        status, _ = finish_climb(start_climb(plan, tmp_path / "log.mcap", "--bus", "udp"))
        manager.setblocking(False)
        told = [manager.recv(100) for _ in range(4)]
    assert status == 0
    assert told == [b"READY=1", b"WATCHDOG=1", b"WATCHDOG=1", b"WATCHDOG=1"]


def test_kill_9_of_the_simulation_ends_the_runtime(tmp_path: Path) -> None:
    log = tmp_path / "log.mcap"
    bench = start_climb(saved(tmp_path, climbing_plan()), log, "--bus", "udp")
    _wait_for(lambda: bench.poll() is not None or log.exists())
    runtime = _runtime_of(bench)
    bench.kill()
    bench.communicate()
    _wait_for(lambda: not _runs(runtime))


def test_a_log_that_finds_no_space_is_said_and_the_climb_judged_all_the_same(tmp_path: Path) -> None:
    words = ["prlimit", "--fsize=1500000"]  # bytes; half of what the log would take
    log = tmp_path / "log.mcap"
    status, result = finish_climb(start_climb(saved(tmp_path, standing_plan()), log, before=words))
    assert status == 1
    assert (result["ok"], result["log_complete"]) == (False, False)
    assert result["reason"] == "log incomplete: file too large"
    assert (result["reached_goal"], result["fell"], result["slips"]) == (True, False, 0)
    assert result["goal_error"]["m"] < 0.01
    told = read_channels(log).messages.get("/truth/verdict", [])  # there may have been space left for it
    assert [verdict.reason for verdict in told] == [result["reason"]] * len(told)


def test_a_flood_of_messages_reaches_the_runtime_and_the_robot_climbs_on(tmp_path: Path) -> None:
    faults, log = tmp_path / "faults.yaml", tmp_path / "log.mcap"
    faults.write_text("version: 1\nfaults: [{kind: lcm_flooded, at_s: 2.2, for_s: 2}]\n")
    body_m = np.array([[x, 0.0, BODY_HEIGHT_M] for x in (0.0, 0.01, 0.02, 0.02)])
    plan = saved(tmp_path, standing_plan(Wall(dt_s=0.8), body_m))
    status, result = finish_climb(start_climb(plan, log, "--bus", "udp", "--faults", str(faults)))
    assert status == 0, result
    assert result["missed_cycles"] == 0
    flood = [command for command in read_log(log).commands if command.request_id >= FIRST_REQUEST]
    assert len(flood) > 100
    assert {command.command for command in flood} == {command_t.START}


def test_a_log_that_is_being_written_is_not_written_by_a_second_climb(tmp_path: Path) -> None:
    plan, log = saved(tmp_path, standing_plan()), tmp_path / "log.mcap"
    log.write_bytes(b"the first one's")
    (tmp_path / "link").symlink_to(tmp_path)
    with alone_with(log):  # as a climb does as long as it runs
        status, second = finish_climb(start_climb(plan, tmp_path / "link" / "log.mcap"))
    assert status == 2
    assert "another command is writing it" in second["error"]
    assert log.read_bytes() == b"the first one's"


def stalled(log: Path, result: dict[str, Any]) -> bool:
    """Whether the machine itself took the processors away (a busy host of a virtual one does): the runtime was woken
    late or never, or the bench came too late for several cycles."""
    woken_late_s = [1e-9 * timing.late_ns for timing in read_channels(log).messages.get("/cycle_timing", [])]
    return max(woken_late_s, default=math.inf) > STALL_S or bool(result["missed_cycles"] * PERIOD_S > STALL_S)


@pytest.mark.alone
def test_by_the_clock(tmp_path: Path) -> None:
    """Where the machine lets it, the climb takes its time by the clock; where not, the robot holds and that is said."""
    plan, log = saved(tmp_path, standing_plan(Wall(dt_s=1.0))), tmp_path / "log.mcap"
    status, result = finish_climb(start_climb(plan, log, "--pace", "realtime"))
    assert not result["fell"]
    if status == 1 and stalled(log, result):
        assert any(cause in result["reason"] for cause in ("cycle_late", "all_nodes_silent", "all_nodes_hold")), result
        return
    assert status == 0, result
    assert result["real_time_factor"] == pytest.approx(1.0, abs=0.05)
