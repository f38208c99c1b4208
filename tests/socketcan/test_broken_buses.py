"""Buses that break in mid-climb and before it, on a real kernel: counted, told, held, and back without a step; and a
runtime that is stopped or starved, which no Sync tells of."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from crux_contracts.plan_file import write_plan
from crux_msgs import robot_state_t
from crux_tools.telemetry import Telemetry, read_log
from hand_plan import standing_plan
from short_climb import plan_short_climb
from with_can import BUSES, CRUX, can_run

READY, CLIMBING, HOLDING, FAULT = (
    robot_state_t.READY,
    robot_state_t.CLIMBING,
    robot_state_t.HOLDING,
    robot_state_t.FAULT,
)
IDLE = robot_state_t.IDLE
LF, RF, LR, RR = range(4)
IN_MID_CLIMB = """
version: 1
faults:
  - {kind: error_passive, limb: LF, at_s: 3.0, for_s: 0.2}
  - {kind: interface_down, limb: RF, at_s: 3.4, for_s: 0.2}
  - {kind: bus_off, limb: LR, at_s: 5.2, for_s: 0.2}
  - {kind: queue_full, limb: RR, at_s: 7.0, for_s: 0.2}
  - {kind: unacknowledged, limb: LF, at_s: 8.8, for_s: 0.2}
"""
BEFORE = """
version: 1
faults:
  - {kind: interface_down, limb: RF, at_s: 1.2, for_s: 0.2}
  - {kind: controller_off, limb: LF, node: 2, at_s: 1.3, for_s: 0.2}
  - {kind: bus_off, limb: LR, at_s: 1.4, for_s: 0.2}
"""
HELD_WITHIN_S = 0.05


Run = tuple[dict[str, Any], Telemetry]


def broken_climb(plan: Path, faults: str, name: str) -> Run:
    """Its result and its log."""
    file, log = plan.with_name(f"{name}.yaml"), plan.with_name(f"{name}.mcap")
    file.write_text(faults)
    climb = [*CRUX, "climb", str(plan), "-o", str(log), "--bus", "socketcan", "--pace", "realtime", "--json"]
    done = can_run("--virtual-time", "-i", BUSES, "--", *climb, "--faults", str(file))
    assert done.stdout, done.stderr.decode()
    return json.loads(done.stdout), read_log(log)


def states(log: Telemetry) -> list[int]:
    """The supervisor's states in order, without repetition."""
    state = log.state["supervisor_state"]
    return [int(state[0]), *(int(s) for s in state[1:][np.diff(state.astype(int)) != 0])]


def test_every_break_is_told_counted_and_held(tmp_path: Path) -> None:
    result, log = broken_climb(plan_short_climb(tmp_path), IN_MID_CLIMB, "mid")
    assert result["robot_on_wall"]
    assert result["slips"] == 0
    for fault in result["faults"]:
        assert fault["held_s"] <= HELD_WITHIN_S, fault
        assert not fault["moved_on"]
    told = [(int(fault["code"]), int(fault["limb"])) for fault in log.faults]
    assert told == [(12, LF), (17, RF), (16, LR), (14, RR), (13, LF)]
    climbing = states(log).index(CLIMBING)
    # Held, then thrown out by a graver fault and back by itself, four times; never again climbing.
    assert states(log)[climbing:] == [CLIMBING, HOLDING, *[FAULT, HOLDING] * 4]
    last = {int(row["limb"]): row for row in log.buses[-4:]}
    assert last[LF]["error_passive"] == 1
    assert last[LF]["unacknowledged"] == 1
    assert last[RF]["interface_down"] == 1
    assert last[RF]["send_failed"] > 0
    assert (last[LR]["bus_off"], last[LR]["restarts"]) == (1, 1)
    assert last[RR]["queue_full"] > 0
    assert [int(row["state"]) for row in last.values()] == [0, 0, 0, 0]


@pytest.mark.sweep
def test_before_the_climb_a_bus_that_is_back_leads_to_ready_and_no_further(tmp_path: Path) -> None:
    result, log = broken_climb(plan_short_climb(tmp_path), BEFORE, "before")
    assert result["robot_on_wall"]
    assert states(log)[-4:] == [READY, FAULT, IDLE, READY]
    assert {int(row["limb"]): int(row["bus_off"]) for row in log.buses[-4:]} == {LF: 0, RF: 0, LR: 1, RR: 0}
    assert CLIMBING not in states(log), "START was for a cycle in which the fault stood"


STOPPED, STARVED = "kind: runtime_stopped", "kind: cpu_starved, share: 0.4"


@pytest.mark.parametrize(
    ("fault", "steps"),
    [
        (STOPPED, False),
        pytest.param(STOPPED, True, marks=pytest.mark.sweep),
        pytest.param(STARVED, True, marks=pytest.mark.sweep),
    ],
)
def test_while_the_runtime_stands_still_the_nodes_hold_and_it_tells_that_it_was_late(
    fault: str, steps: bool, tmp_path: Path
) -> None:
    """In the middle of a step, or of a plan in which all limbs stand."""
    plan = plan_short_climb(tmp_path) if steps else tmp_path / "plan.mcap"
    if not steps:
        write_plan(plan, standing_plan())
    at_s = 7.0 if steps else 2.0
    result, log = broken_climb(plan, f"version: 1\nfaults: [{{{fault}, at_s: {at_s}, for_s: 0.7}}]\n", "late")
    assert result["robot_on_wall"]
    assert result["slips"] == 0
    (course,) = result["faults"]
    runs_on_s = 0.0 if fault == STOPPED else 0.04
    assert course["held_s"] <= runs_on_s + HELD_WITHIN_S
    assert course["cause"] == "26 cycle_late"
    assert course["moved_m"] < 0.005
    assert not course["moved_on"]
    asleep_s = 0.7 if fault == STOPPED else 0.06
    assert log.timing["late_ns"].max() * 1e-9 == pytest.approx(asleep_s, abs=0.005)
