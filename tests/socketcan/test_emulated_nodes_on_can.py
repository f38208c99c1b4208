"""Nodes that run their image on an emulated microcontroller, on a real kernel's CAN: what the robot does when one of
them restarts or its controller leaves the bus in mid-climb."""

from __future__ import annotations

import json
from typing import Any

import numpy as np
import pytest
from crux_msgs import robot_state_t
from crux_tools.telemetry import Telemetry, read_log
from short_climb import plan_short_climb
from with_can import BUSES, CRUX, can_run

RF = 1
JOINT, GRIPPER = 2, 7
FAULTS = f"""
version: 1
faults:
  - {{kind: reset, limb: RF, node: {JOINT}, at_s: 2.6, for_s: 0}}
  - {{kind: reset, limb: RF, node: {GRIPPER}, at_s: 2.8, for_s: 0}}
  - {{kind: controller_off, limb: RF, node: {GRIPPER}, at_s: 3.0, for_s: 0.2}}
"""
HELD_WITHIN_S = 0.05
MOVED_WITHIN_M = 0.002


@pytest.fixture(scope="module")
def climb(tmp_path_factory: pytest.TempPathFactory) -> tuple[dict[str, Any], Telemetry]:
    """Its result and its log."""
    plan = plan_short_climb(tmp_path_factory.mktemp("emulated"))
    faults, log = plan.with_name("faults.yaml"), plan.with_name("log.mcap")
    faults.write_text(FAULTS)
    words = [*CRUX, "climb", str(plan), "-o", str(log), "--bus", "socketcan", "--pace", "realtime", "--json"]
    emulated = f"RF.{JOINT},RF.{GRIPPER}"
    done = can_run("--virtual-time", "-i", BUSES, "--", *words, "--faults", str(faults), "--emulate", emulated)
    assert done.stdout, done.stderr.decode()
    return json.loads(done.stdout), read_log(log)


def test_the_robot_holds_stays_and_never_climbs_on(climb: tuple[dict[str, Any], Telemetry]) -> None:
    result, log = climb
    assert result["robot_on_wall"]
    assert result["slips"] == 0
    for fault in result["faults"]:
        assert fault["held_s"] <= HELD_WITHIN_S, fault
        assert fault["moved_m"] <= MOVED_WITHIN_M, fault
        assert not fault["moved_on"], fault
    state = log.state["supervisor_state"].astype(int)
    passed = state[np.flatnonzero(np.diff(state, prepend=-1))].tolist()
    holding, fault_state = robot_state_t.HOLDING, robot_state_t.FAULT
    climbing = passed.index(robot_state_t.CLIMBING)
    assert passed[climbing + 1 :] == [holding, fault_state, holding]


def test_each_is_told_with_its_node(climb: tuple[dict[str, Any], Telemetry]) -> None:
    _, log = climb
    told = [(int(row["code"]), int(row["limb"]), int(row["node"])) for row in log.faults]
    assert told[0] == (3, RF, JOINT)
    assert (1, RF, GRIPPER) in told
    assert {limb for _, limb, _ in told} == {RF}
