"""Climbs over SocketCAN on a real kernel: runtime, four CAN FD interfaces, firmware nodes and physics, at 500 Hz by the
clock or in lockstep; buses that break, nodes that restart, a runtime that is stopped or starved.

Virtual time makes them repeatable: what two climbs put on the buses is the same to the bit and the microsecond.
"""

from __future__ import annotations

import hashlib
import json
from collections import Counter
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from climbs import climb_here
from crux_contracts.plan_file import write_plan
from crux_msgs import plan_t, robot_state_t
from crux_tools.telemetry import Telemetry, read_log
from hand_plan import BODY_HEIGHT_M, Wall, standing_plan
from mcap.reader import make_reader
from short_climb import plan_short_climb
from with_can import BUSES, REALTIME, climb_in_guest

IDLE, READY = robot_state_t.IDLE, robot_state_t.READY
CLIMBING, HOLDING, FAULT = robot_state_t.CLIMBING, robot_state_t.HOLDING, robot_state_t.FAULT
LF, RF, LR, RR = range(4)
SETTLED_CYCLES = 100
HELD_WITHIN_S, MOVED_WITHIN_M = 0.05, 0.002
IN_MID_CLIMB = """
  - {kind: error_passive, limb: LF, at_s: 3.0, for_s: 0.2}
  - {kind: interface_down, limb: RF, at_s: 3.4, for_s: 0.2}
  - {kind: bus_off, limb: LR, at_s: 5.2, for_s: 0.2}
  - {kind: queue_full, limb: RR, at_s: 7.0, for_s: 0.2}
  - {kind: unacknowledged, limb: LF, at_s: 8.8, for_s: 0.2}
"""
BEFORE = """
  - {kind: interface_down, limb: RF, at_s: 1.2, for_s: 0.2}
  - {kind: controller_off, limb: LF, node: 2, at_s: 1.3, for_s: 0.2}
  - {kind: bus_off, limb: LR, at_s: 1.4, for_s: 0.2}
"""
JOINT, GRIPPER = 2, 7
OF_NODES = f"""
  - {{kind: reset, limb: RF, node: {JOINT}, at_s: 2.6, for_s: 0}}
  - {{kind: reset, limb: RF, node: {GRIPPER}, at_s: 2.8, for_s: 0}}
  - {{kind: controller_off, limb: RF, node: {GRIPPER}, at_s: 3.0, for_s: 0.2}}
"""
STOPPED, STARVED = "kind: runtime_stopped", "kind: cpu_starved, share: 0.4"
Result = dict[str, Any]
Climb = tuple[str, Sequence[str | Path], Sequence[str]]


class Climbs:
    """What is climbed in one folder, and what came of it."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        plan_short_climb(folder)  # plan.mcap

    def plan(self, name: str, plan: plan_t) -> Path:
        write_plan(self.folder / f"{name}-plan.mcap", plan)
        return self.folder / f"{name}-plan.mcap"

    def faulty(self, name: str, faults: str, *more: str, plan: Path | None = None) -> Climb:
        """The short climb, or another, with faults."""
        file = self.folder / f"{name}.yaml"
        file.write_text(f"version: 1\nfaults:{faults}\n")
        return name, [plan or self.folder / "plan.mcap", *REALTIME, "--faults", file, *more], ()

    def result(self, name: str) -> Result:
        return dict(json.loads((self.folder / f"{name}.json").read_text()))

    def log(self, name: str) -> Telemetry:
        return read_log(self.folder / f"{name}.mcap")

    def frames(self, name: str) -> str:
        (file,) = (self.folder / name).glob("candump-*.log")
        return file.read_text()


def stopped(climbs: Climbs, fault: str, steps: bool) -> Climb:
    """The runtime stands still in the middle of a step, or of a plan in which all limbs stand."""
    plan, at_s = (climbs.folder / "plan.mcap", 7.0) if steps else (climbs.plan("late", standing_plan()), 2.1)
    return climbs.faulty("late", f" [{{{fault}, at_s: {at_s}, for_s: 0.7}}]", plan=plan)


@pytest.fixture(scope="module")
def climbs(tmp_path_factory: pytest.TempPathFactory) -> Climbs:
    """All that are no sweeps, in one guest."""
    made = Climbs(tmp_path_factory.mktemp("over-can"))
    moved = standing_plan(Wall(dt_s=0.5), np.array([[x, 0.0, BODY_HEIGHT_M] for x in (0.0, 0.01, 0.02)]))
    climb_in_guest(
        made.folder,
        ("lockstep", [made.plan("lockstep", standing_plan(Wall(dt_s=1.0))), "--bus", "socketcan"], ()),
        ("by-the-clock", [made.plan("by-the-clock", moved), *REALTIME], ["can0"]),
        made.faulty("broken", IN_MID_CLIMB),
        stopped(made, STOPPED, steps=False),
    )
    return made


Swept = Callable[..., Climbs]


@pytest.fixture
def swept(tmp_path: Path) -> Swept:
    """One climb in a guest of its own: a function of the climbs gives it."""

    def made(climb: Callable[[Climbs], Climb]) -> Climbs:
        climbs = Climbs(tmp_path)
        climb_in_guest(tmp_path, climb(climbs))
        return climbs

    return made


def whole(climbs: Climbs, name: str = "whole") -> Climb:
    """With a step."""
    return name, [climbs.folder / "plan.mcap", *REALTIME], BUSES.split(",")


def states(log: Telemetry) -> list[int]:
    """The supervisor's states in order, without repetition."""
    state = log.state["supervisor_state"]
    return [int(state[0]), *(int(s) for s in state[1:][np.diff(state.astype(int)) != 0])]


def messages(log: Path) -> list[tuple[str, int, bytes]]:
    """Everything in a log, in its order, but what carries wall time."""
    with log.open("rb") as stream:
        found = make_reader(stream).iter_messages(log_time_order=False)
        return [(c.topic, m.log_time, m.data) for _, c, m in found if c.topic != "/cycle_timing"]


def test_in_lockstep_the_log_is_that_of_one_process(climbs: Climbs) -> None:
    status, _ = climb_here(climbs.folder / "lockstep-plan.mcap", climbs.folder / "memory.mcap", "--bus", "memory")
    assert (climbs.result("lockstep")["status"], status) == (0, 0)
    socketcan, memory = (messages(climbs.folder / f"{name}.mcap") for name in ("lockstep", "memory"))
    assert len(memory) > 5_000
    assert socketcan == memory


def reaches_the_goal_without_a_missed_cycle(result: Result) -> None:
    assert result["status"] == 0, result
    assert result["ok"]
    assert result["reached_goal"]
    assert result["missed_cycles"] == 0
    assert 0.99 < result["real_time_factor"] < 1.01


def test_reaches_the_goal_without_a_missed_cycle(climbs: Climbs) -> None:
    reaches_the_goal_without_a_missed_cycle(climbs.result("by-the-clock"))


@pytest.mark.sweep
def test_two_climbs_with_a_step_put_the_same_on_the_buses(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    hashes = set()
    for number in ("one", "two"):  # each in a guest of its own, which begins at the same time
        (tmp_path / number).mkdir()
        for home in ("XDG_CONFIG_HOME", "XDG_STATE_HOME"):  # a runtime that finds its key starts sooner
            monkeypatch.setenv(home, str(tmp_path / number / home.lower()))
        climbs = Climbs(tmp_path / number)
        climb_in_guest(climbs.folder, whole(climbs))
        reaches_the_goal_without_a_missed_cycle(climbs.result("whole"))
        hashes.add(hashlib.sha256(climbs.frames("whole").encode()).hexdigest())
    assert len(hashes) == 1


def test_every_cycle_has_its_frames_on_every_bus(climbs: Climbs) -> None:
    """16 frames a cycle and bus: 7 commands, Sync, 7 statuses, force/torque; looked at one by one on can0."""
    counts: Counter[str] = Counter()
    for line in climbs.frames("by-the-clock").splitlines():
        _, bus, frame = line.split()
        identifier, _, payload = frame.partition("##")
        assert (bus, payload[0]) == ("can0", "5"), f"not CAN FD with bit rate switch: {line}"  # FDF | BRS
        counts[identifier] += 1
    result = climbs.result("by-the-clock")
    for identifier in [f"{base + node:03X}" for base in (0x100, 0x180) for node in range(1, 8)] + ["010", "1C7"]:
        assert result["cycles"] <= counts[identifier] <= result["cycles"] + SETTLED_CYCLES, identifier
    assert result["frames"]["can0"] == counts.total()
    for bus in BUSES.split(","):
        assert result["frames"][bus] == pytest.approx(counts.total(), abs=SETTLED_CYCLES), bus


def test_the_log_says_that_the_buses_were_well(climbs: Climbs) -> None:
    log = climbs.log("by-the-clock")
    assert (log.inputs["bus_state"] == 0).all()
    assert set(log.buses["limb"]) == {0, 1, 2, 3}
    for count in ("error_frames", "queue_full", "send_failed", "receive_lost", "crc_errors", "repeated", "foreign"):
        assert (log.buses[count] == 0).all(), count


def stays(result: Result) -> None:
    """It holds at once, slips nowhere and does not climb on by itself."""
    assert result["robot_on_wall"], result
    assert result["slips"] == 0
    for fault in result["faults"]:
        assert fault["held_s"] <= HELD_WITHIN_S, fault
        assert not fault["moved_on"], fault


def test_every_break_is_told_counted_and_held(climbs: Climbs) -> None:
    stays(climbs.result("broken"))
    log = climbs.log("broken")
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
def test_before_the_climb_a_bus_that_is_back_leads_to_ready_and_no_further(swept: Swept) -> None:
    climbs = swept(lambda climbs: climbs.faulty("before", BEFORE))
    assert climbs.result("before")["robot_on_wall"]
    log = climbs.log("before")
    assert states(log)[-4:] == [READY, FAULT, IDLE, READY]
    assert {int(row["limb"]): int(row["bus_off"]) for row in log.buses[-4:]} == {LF: 0, RF: 0, LR: 1, RR: 0}
    assert CLIMBING not in states(log), "START was for a cycle in which the fault stood"


def while_it_stands_still_the_nodes_hold_and_it_tells_that_it_was_late(climbs: Climbs, fault: str) -> None:
    result, log = climbs.result("late"), climbs.log("late")
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


def test_while_the_runtime_stands_still_the_nodes_hold_and_it_tells_that_it_was_late(climbs: Climbs) -> None:
    while_it_stands_still_the_nodes_hold_and_it_tells_that_it_was_late(climbs, STOPPED)


@pytest.mark.sweep
@pytest.mark.parametrize("fault", [STOPPED, STARVED])
def test_in_mid_step_as_well(fault: str, swept: Swept) -> None:
    climbs = swept(lambda climbs: stopped(climbs, fault, steps=True))
    while_it_stands_still_the_nodes_hold_and_it_tells_that_it_was_late(climbs, fault)


@pytest.mark.sweep
def test_where_emulated_nodes_restart_or_leave_the_bus_the_robot_holds_and_never_climbs_on(swept: Swept) -> None:
    """Nodes that run their image on an emulated microcontroller."""
    climbs = swept(lambda climbs: climbs.faulty("nodes", OF_NODES, "--emulate", f"RF.{JOINT},RF.{GRIPPER}"))
    result, log = climbs.result("nodes"), climbs.log("nodes")
    stays(result)
    for fault in result["faults"]:
        assert fault["moved_m"] <= MOVED_WITHIN_M, fault
    passed = states(log)
    assert passed[passed.index(CLIMBING) + 1 :] == [HOLDING, FAULT, HOLDING]
    told = [(int(row["code"]), int(row["limb"]), int(row["node"])) for row in log.faults]
    assert told[0] == (3, RF, JOINT)
    assert (1, RF, GRIPPER) in told
    assert {limb for _, limb, _ in told} == {RF}
