"""Logs in which nothing climbs take no more than they may; a climb's log stays, and can be computed again."""

from __future__ import annotations

import os
import time
from collections.abc import Callable
from pathlib import Path

import pytest
from crux_msgs import command_t, robot_state_t
from crux_simulation.sim.ports import run_ports
from crux_tools.errors import UsageError
from crux_tools.replay.recompute import recompute
from crux_tools.telemetry.channels import read_channels
from hand_plan import standing_plan
from own_runtime import Runtime, Starter
from robot_on_wall import PATIENCE_S, RobotOnWall

MOST_GB = 0.001
SLACK_BYTES = 2 << 20  # a log that is written runs ahead of what is in it, and ends with its index


def await_true(wanted: Callable[[], bool]) -> None:
    end_s = time.monotonic() + PATIENCE_S
    while not wanted():
        assert time.monotonic() < end_s
        time.sleep(0.05)


def number(log: Path) -> int:
    return int(log.name.split(".")[0].partition("-")[2] or "1")


def idle(runtime: Runtime) -> list[Path]:
    return sorted(runtime.log.parent.glob(f"{runtime.log.stem}-*.idle.mcap"), key=number)


def metadata(log: Path) -> dict[str, str]:
    return read_channels(log, {"/robot_state"}).metadata


def why_kept(log: Path) -> set[str]:
    """Of what is worth keeping, what a log tells of besides the plan that came: on a machine that stalls, more than ten
    quiet seconds may lie between that and the climb, which is in the next log then.
    """
    tables = read_channels(log, {"/fault", "/robot_state"}).tables
    climbs = (tables["/robot_state"]["supervisor_state"] == robot_state_t.CLIMBING).any()
    return {name for name, there in (("a fault", len(tables["/fault"]) > 0), ("a climb", climbs)) if there}


def bring_to(state: int, command: int, runtime: Runtime, robot: RobotOnWall, plan_id: str = "") -> None:
    """By a command, which is given again once faults are cleared: nodes of a busy machine may answer too late."""

    def there() -> bool:
        faulty = robot.host_state == robot_state_t.FAULT
        if robot.host_state != state:
            runtime.link.command(command_t.CLEAR_FAULT if faulty else command, "" if faulty else plan_id)
        return robot.host_state == state

    await_true(there)


@pytest.mark.alone  # its nodes have to answer by the clock
def test_idle_logs_are_bounded_and_a_climb_is_kept_and_can_be_computed_again(start: Starter, tmp_path: Path) -> None:
    plan = standing_plan()
    other, older = tmp_path / "log1x.idle.mcap", tmp_path / "log1.idle.mcap"
    other.write_bytes(bytes(8 << 20))
    older.write_bytes(bytes(8 << 20))  # of an earlier run
    os.utime(older, (0, 0))
    kept = tmp_path / "log1-2.mcap"
    kept.write_text("of an earlier climb")
    with run_ports() as ports, RobotOnWall(ports, plan) as robot:
        runtime = start("--idle-logs", str(MOST_GB), ports=ports, pace="clock")
        await_true(lambda: bool(idle(runtime)) and number(idle(runtime)[-1]) >= 10)
        assert not older.exists()
        assert kept.exists()
        assert other.exists(), "it is no log of this runtime"
        logs = idle(runtime)
        assert number(logs[0]) > 1, "the oldest are gone"
        assert sum(log.stat().st_size for log in logs) <= 1e9 * MOST_GB + SLACK_BYTES
        runtime.link.upload(plan)
        robot.await_state(robot_state_t.READY)
        bring_to(robot_state_t.CLIMBING, command_t.START, runtime, robot, plan.plan_id)
        bring_to(robot_state_t.HOLDING, command_t.HOLD, runtime, robot)

        def climbs() -> list[Path]:
            return [
                log
                for log in sorted(tmp_path.glob("log1-*.mcap"), key=number)
                if ".idle" not in log.name and log != kept
            ]

        await_true(lambda: bool(climbs()) and number(idle(runtime)[-1]) > number(climbs()[0]) + 1)
        climb, holding = climbs()[0], number(idle(runtime)[-1])
        await_true(lambda: number(idle(runtime)[-1]) > holding + 1)  # it holds for a while
        assert climb.exists()
        later = [log for log in climbs()[1:] if number(log) < number(idle(runtime)[-1])]
        reasons = {log.name: why_kept(log) for log in later}
        assert all(reasons.values()), reasons
        robot.power_off()
        runtime.process.terminate()
        runtime.end()
        last = idle(runtime)[-1]  # one named while logs are written may be deleted by now
    assert metadata(climb)["new_core"] == "yes"
    assert int(metadata(climb)["first_cycle"]) > 1
    found = recompute(climb)
    assert found.ok, found
    assert metadata(last)["new_core"] == "no"
    with pytest.raises(UsageError, match="had worked before"):
        recompute(last)
