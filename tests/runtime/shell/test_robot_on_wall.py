"""What a runtime that controls a robot on its wall refuses, and what it says when its nodes are dead."""

from __future__ import annotations

import json
import re
import resource
import time
from collections.abc import Iterator
from contextlib import contextmanager
from datetime import UTC, datetime, timedelta
from typing import Any

import numpy as np
import pytest
import yaml
from crux_contracts import LIMB_NAMES
from crux_msgs import command_t, plan_t, robot_state_t
from crux_simulation.sim.ports import run_ports
from crux_tools.cli import main
from crux_tools.errors import UsageError, WorkFailed
from hand_plan import BODY_HEIGHT_M, NOMINAL_M, Wall, standing_plan
from own_runtime import ROBOT, Runtime, Starter
from robot_on_wall import RobotOnWall

ASIDE_M = 0.1
SAG_M = 0.01  # of a robot that stands where it was put
DESCRIPTION = yaml.safe_load((ROBOT / "robot.yaml").read_text(encoding="utf-8"))


@pytest.fixture(scope="module")
def plan() -> plan_t:
    return standing_plan()


def plan_along(*body_x_m: float, first_hold_x_m: float = NOMINAL_M[0, 0]) -> plan_t:
    """On the same holds, but for the first one; the body at other places."""
    xy_m = NOMINAL_M.copy()
    xy_m[0, 0] = first_hold_x_m
    path = np.array([[x, 0.0, BODY_HEIGHT_M] for x in body_x_m])
    return standing_plan(Wall(xy_m=xy_m), body_path_m=path)


@contextmanager
def taken_over(start: Starter, plan: plan_t, guard_s: str = "30") -> Iterator[tuple[Runtime, RobotOnWall]]:
    """A runtime in READY, and its robot."""
    with run_ports() as ports, RobotOnWall(ports, plan) as robot:
        runtime = start("--guard-time", guard_s, ports=ports)
        runtime.link.upload(plan)
        robot.await_state(robot_state_t.READY)
        yield runtime, robot


def state(runtime: Runtime) -> int:
    return int(runtime.link.send(command_t.STATUS).supervisor_state)


def test_the_end_is_refused_on_the_wall_unless_forced(
    start: Starter, plan: plan_t, capsys: pytest.CaptureFixture[str]
) -> None:
    with taken_over(start, plan) as (runtime, _):
        for command in (None, command_t.START, command_t.HOLD):
            if command is not None:
                runtime.link.send(command, plan.plan_id)
            with pytest.raises(WorkFailed, match=r"on the wall.*--force.*own watchdogs"):
                runtime.link.send(command_t.SHUTDOWN)
        assert main(["shutdown", "--lcm", runtime.ports.lcm_url]) == 1
        assert state(runtime) == robot_state_t.HOLDING
        capsys.readouterr()
        assert main(["shutdown", "--force", "--lcm", runtime.ports.lcm_url]) == 0
        assert capsys.readouterr().err == "runtime: shuts down; the nodes hold by themselves from now on\n"
        assert runtime.end() == (0, "")


@pytest.mark.parametrize("holding", [False, True])
def test_a_plan_that_begins_elsewhere_is_refused_with_numbers(start: Starter, plan: plan_t, holding: bool) -> None:
    with taken_over(start, plan) as (runtime, robot):
        if holding:
            runtime.link.send(command_t.START, plan.plan_id)
            robot.await_state(robot_state_t.CLIMBING)
            runtime.link.send(command_t.HOLD)
            robot.await_state(robot_state_t.HOLDING)
        before = state(runtime)
        for other, where, limit_m in (
            (plan_along(ASIDE_M, ASIDE_M), "the body", DESCRIPTION["control"]["max_body_correction_m"]),
            (
                plan_along(0.0, 0.0, first_hold_x_m=NOMINAL_M[0, 0] + ASIDE_M),
                "LF: the gripper",
                DESCRIPTION["supervisor"]["start_tolerance_m"],
            ),
        ):
            with pytest.raises(UsageError, match=where) as refused:
                runtime.link.upload(other)
            numbers = re.search(r"is (\S+) m from the plan's start pose \(limit: (\S+) m\)", str(refused.value))
            assert numbers is not None
            assert float(numbers[1]) == pytest.approx(ASIDE_M, abs=SAG_M)
            assert float(numbers[2]) == limit_m
            status = runtime.link.send(command_t.STATUS)
            assert (status.supervisor_state, status.plan_id) == (before, plan.plan_id)
        onward = plan_along(0.0, 0.02)
        assert runtime.link.upload(onward).plan_id == onward.plan_id
        robot.await_state(robot_state_t.READY)


@pytest.mark.sweep
def test_an_operator_takes_the_robot_step_by_step_slowly_and_back(
    start: Starter, capsys: pytest.CaptureFixture[str]
) -> None:
    plan = plan_along(0.0, 0.01, 0.02, 0.01)
    with taken_over(start, plan) as (runtime, _):
        url = runtime.ports.lcm_url

        def crux(*words: str) -> tuple[int, str]:
            capsys.readouterr()
            status = main([*words, "--lcm", url])
            return status, "".join(capsys.readouterr())

        def told_when_holding() -> dict[str, Any]:
            """What it says of itself once it holds and plan time stands still."""
            before_s = None
            while True:
                told: dict[str, Any] = json.loads(crux("status", "--json")[1])
                if told["state"] == "holding" and told["plan_time_s"] == before_s:
                    return told
                before_s = told["plan_time_s"]
                time.sleep(0.1)

        status, said = crux("speed", "1.2")
        assert status == 1
        assert "the speed scale would be 1.2, right is 0 (stand still) to 1 (as planned)" in said
        assert crux("speed", "0.5")[0] == 0
        status, said = crux("reverse")
        assert status == 1
        assert "only a robot that is holding can go backward" in said
        status, said = crux("step", "--plan-id", "other")
        assert status == 1
        assert "STEP names plan 'other'" in said
        for end_s in (2.0, 4.0):
            assert crux("step")[0] == 0
            told = told_when_holding()
            assert (told["plan_time_s"], told["plan_end_s"]) == pytest.approx((end_s, 6.0))
        assert (told["speed_scale"], told["motion"], told["waiting_for"]) == (0.5, "single step", None)
        assert list(told["limbs"]) == list(LIMB_NAMES)
        for limb in told["limbs"].values():
            assert limb["phase"] == "stance"
            assert limb["grasp_force_N"] == pytest.approx(limb["grasp_force_reference_N"], abs=1.0)
            assert 0.0 < limb["utilisation"] < 1.0
        assert crux("reverse")[0] == 0
        told = told_when_holding()
        assert (told["plan_time_s"], told["verified_time_s"], told["motion"]) == (2.0, 2.0, "in reverse")
        _, said = crux("status")
        assert "plan time 2.00 of 6.00 s, speed 0.5, in reverse; last verified stance at 2.00 s" in said
        assert re.search(r"RR stance +grip +\d+\.\d of +\d+\.\d N, +\d+% of the limit surface", said)


def test_dead_nodes_are_told_and_clear_fault_does_not_pass_over_them(
    start: Starter, plan: plan_t, capsys: pytest.CaptureFixture[str]
) -> None:
    with taken_over(start, plan, guard_s="0.01") as (runtime, robot):
        url = runtime.ports.lcm_url
        robot.power_off()
        while state(runtime) != robot_state_t.FAULT:
            pass
        dead = datetime.now(UTC)
        capsys.readouterr()

        assert main(["clear-fault", "--lcm", url]) == 1
        refusal = capsys.readouterr()
        assert re.search(r"no valid status from any node, for \d+ cycles \(limit: 10\)", refusal.err)
        assert "holding" not in refusal.err + refusal.out

        assert main(["status", "--lcm", url]) == 0
        said = "".join(capsys.readouterr())
        assert "fault 30 all_nodes_silent: no valid status from any node, for 11 cycles (limit: 10)" in said
        assert "since 20" in said
        assert "do: check the emergency stop and the nodes' supply" in said
        assert "28 nodes silent (all)" in said

        assert main(["status", "--lcm", url, "--json"]) == 0
        told = json.loads(capsys.readouterr().out)
        assert told["state"] == "fault"
        assert (told["fault"]["name"], told["fault"]["limb"], told["fault"]["node"]) == ("all_nodes_silent", None, None)
        assert told["fault"]["do"]
        assert abs(datetime.fromisoformat(told["fault"]["since"]) - dead) < timedelta(minutes=1)
        assert told["nodes"] == {"silent": [f"{limb}.{node}" for limb in LIMB_NAMES for node in range(1, 8)]}


def test_nodes_that_never_were_there_are_silent(start: Starter, capsys: pytest.CaptureFixture[str]) -> None:
    runtime = start()
    assert main(["status", "--lcm", runtime.ports.lcm_url]) == 0
    assert "28 nodes silent (all)" in "".join(capsys.readouterr())


def test_a_log_that_ends_is_told_and_the_robot_controlled_all_the_same(
    start: Starter, plan: plan_t, capsys: pytest.CaptureFixture[str]
) -> None:
    with taken_over(start, plan) as (runtime, _):
        full = runtime.log.stat().st_size
        resource.prlimit(runtime.process.pid, resource.RLIMIT_FSIZE, (full, full))
        told = None
        while told is None:
            capsys.readouterr()
            assert main(["status", "--lcm", runtime.ports.lcm_url, "--json"]) == 0
            said = json.loads(capsys.readouterr().out)
            told = said["fault"]
        assert told["name"] == "log_ended"
        assert "space" in told["do"]
        assert said["state"] == "ready"
