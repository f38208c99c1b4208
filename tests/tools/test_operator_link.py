"""Upload and commands over real LCM against a made-up runtime; ports of runs side by side."""

from __future__ import annotations

import json
import os
import socket
from collections.abc import Iterator

import pytest
from crux_contracts.plan_file import write_plan
from crux_msgs import command_t, fault_t, plan_piece_t, robot_state_t, status_t
from crux_simulation.sim.ports import RunPorts, run_ports
from crux_tools.cli import main
from crux_tools.errors import UsageError
from crux_tools.operator_link import OperatorLink
from crux_tools.operator_status import status_lines
from fake_runtime import FakeRuntime
from hand_plan import climbing_plan, standing_plan

BEFORE_THE_FIRST_CYCLE: dict[str, object] = {
    **dict.fromkeys(("plan_time_s", "plan_end_s", "verified_time_s", "speed_scale", "motion")),
    **dict.fromkeys(("waiting_for", "waiting_limb", "limbs", "fault", "joint_dead_time_s")),
    "faults": [],
    "nodes": {},
    "insecure": True,
    "operator": None,
}


@pytest.fixture
def url() -> Iterator[str]:
    with run_ports() as ports:
        yield ports.lcm_url


def test_a_link_that_ends_gives_its_sockets_back(url: str) -> None:
    # LCM waits with select(), which writes past its end for a descriptor beyond 1023.
    open_before = len(os.listdir("/proc/self/fd"))
    for _ in range(3):
        with OperatorLink(url) as link:
            assert link.command(command_t.STATUS, tries=1, timeout_s=0.01) is None
        del link
    assert len(os.listdir("/proc/self/fd")) == open_before


def test_a_plan_of_several_pieces_arrives_whole(url: str) -> None:
    plan = climbing_plan()
    plan.scenario_yaml += "#" * (3 * plan_piece_t.MAX_BYTES)
    with FakeRuntime(url) as runtime, OperatorLink(url) as link:
        answer = link.upload(plan)
        assert runtime.plan is not None
        assert runtime.plan.encode() == plan.encode()
        assert answer.plan_id == plan.plan_id


def test_lost_messages_are_sent_again(url: str) -> None:
    with FakeRuntime(url, lose=2) as runtime, OperatorLink(url) as link:
        link.upload(standing_plan())
        assert runtime.plan is not None


def test_a_refused_plan_gives_the_runtimes_reason(url: str) -> None:
    refusing = FakeRuntime(url, refuse_plan="made for robot x")
    with refusing, OperatorLink(url) as link, pytest.raises(UsageError, match="made for robot x"):
        link.upload(standing_plan())


def test_commands_carry_their_cycle_and_repeatable_ids(url: str) -> None:
    with FakeRuntime(url) as runtime, OperatorLink(url) as link:
        link.send(command_t.STATUS)
        link.send(command_t.START, "some-id", 1000)
    asked, *rest = runtime.commands
    assert (asked.command, asked.request_id > 1000) == (command_t.STATUS, True)  # nobody can know it beforehand
    assert [(c.request_id, c.command, c.at_cycle, c.plan_id) for c in rest] == [(1, command_t.START, 1000, "some-id")]


def test_nobody_there(url: str) -> None:
    with OperatorLink(url) as link:
        assert link.command(command_t.STATUS, tries=1) is None


def test_a_url_that_is_none() -> None:
    with pytest.raises(UsageError, match=r"cannot open LCM.*ip route add 224"):
        OperatorLink("nonsense://x")


def test_commands_of_the_command_line(url: str, capsys: pytest.CaptureFixture[str], tmp_path: object) -> None:
    plan = standing_plan()
    path = f"{tmp_path}/plan.mcap"
    write_plan(path, plan)
    with FakeRuntime(url) as runtime:
        orders = ["status", "start", "hold", "resume", "step", "reverse", "speed 0.25", "clear-fault"]
        for words in (["upload", path], *map(str.split, orders)):
            assert main([*words, "--lcm", url, "--json"]) == 0
            answer = json.loads(capsys.readouterr().out)
            more: dict[str, object] = dict(BEFORE_THE_FIRST_CYCLE) if words == ["status"] else {}
            assert answer == {"ok": True, "state": "ready", "plan_id": plan.plan_id, **more}
        sent = [(command.command, command.plan_id, command.value) for command in runtime.commands]
    named, asked = plan.plan_id, (command_t.STATUS, "", 0.0)  # each but HOLD asks first what to sign
    assert sent == [
        asked, asked,
        asked, (command_t.START, named, 0.0), (command_t.HOLD, "", 0.0), asked, (command_t.RESUME, "", 0.0),
        asked, (command_t.STEP, named, 0.0), asked, (command_t.REVERSE, "", 0.0), asked, (command_t.SPEED, "", 0.25),
        asked, (command_t.CLEAR_FAULT, "", 0.0), asked,
    ]  # fmt: skip


def test_a_speed_that_is_no_number_is_wrong_usage(url: str, capsys: pytest.CaptureFixture[str]) -> None:
    with FakeRuntime(url) as runtime, pytest.raises(SystemExit) as ended:
        main(["speed", "fast", "--lcm", url])
    assert ended.value.code == 2
    assert "SCALE" in capsys.readouterr().err
    assert runtime.commands == []


def test_what_was_not_told_is_not_taken_for_well(url: str, capsys: pytest.CaptureFixture[str]) -> None:
    with FakeRuntime(url) as runtime, OperatorLink(url) as link:
        link.send(command_t.STATUS)
        assert link.status is not None
        runtime.tells_status = False
        link.send(command_t.STATUS)
        assert link.status is None
        assert main(["status", "--lcm", url, "--json"]) == 0
        assert json.loads(capsys.readouterr().out)["nodes"] is None
        assert main(["status", "--lcm", url]) == 0
        assert "no node or fault status" in capsys.readouterr().err


def test_a_refused_command_is_exit_status_one(url: str, capsys: pytest.CaptureFixture[str]) -> None:
    with FakeRuntime(url, refuse_commands="not in this state"):
        assert main(["hold", "--lcm", url, "--json"]) == 1
    answer = json.loads(capsys.readouterr().out)
    assert answer["ok"] is False
    assert "not in this state" in answer["error"]


def _bases(count: int) -> list[RunPorts]:
    """Ports of runs that hold theirs at the same time."""
    if count == 0:
        return []
    with run_ports() as ports:
        return [ports, *_bases(count - 1)]


def test_runs_side_by_side_have_ports_of_their_own() -> None:
    used = [port for ports in _bases(20) for port in range(ports.base, ports.base + 5)]
    assert len(set(used)) == len(used)


def test_a_port_somebody_else_uses_is_left_alone(monkeypatch: pytest.MonkeyPatch) -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as other:
        other.bind(("", 0))
        taken = other.getsockname()[1]
        monkeypatch.setattr("crux_simulation.sim.ports.PORTS", range(taken - 3, taken - 2))
        with pytest.raises(OSError, match="no free UDP ports"), run_ports():
            pass


def test_a_fault_of_a_newer_runtime_is_told() -> None:
    status = status_t()
    status.fault = fault_t()
    status.fault.code, status.fault.limb, status.fault.node = 999, 1, 3
    assert "fault 999 unknown: RF node 3 (joint 3): " in status_lines(status)[0]


def test_status_of_a_runtime_that_has_just_started_tells_what_fingers_feel() -> None:
    status = status_t()
    status.state.cycle, status.state.supervisor_state = 100, robot_state_t.IDLE
    status.reference[1].phase = 4
    lines = status_lines(status)
    assert [line.split()[:2] for line in lines[1:4]] == [["LF", "grips"], ["RF", "in"], ["LR", "grips"]]
    assert "RF in the air" in lines[2]


def test_status_tells_all_faults_that_stand_and_drives_that_answer_late() -> None:
    status = status_t()
    status.state.cycle = 1
    status.fault.code, status.fault.limb, status.fault.node, status.fault_age_s = 9, 1, 7, 60.0
    beside = [fault_t(), fault_t()]
    beside[0].code, beside[0].limb, beside[0].node = 9, 3, 7
    beside[1].code, beside[1].limb, beside[1].node = 22, 0, 7
    status.n_beside, status.beside, status.beside_age_s = 2, beside, [60.0, 3.0]
    status.joint_dead_time_s = [0.0] * 26 + [0.002, 0.0]
    lines = status_lines(status)
    told = [line for line in lines if line.startswith("fault ")]
    assert [line.split(": ")[:2] for line in told] == [
        ["fault 9 grip_lost", "RF node 7 (gripper)"],
        ["fault 9 grip_lost", "RR node 7 (gripper)"],
        ["fault 22 slip", "LF node 7 (gripper)"],
    ]
    assert [line.split(", ")[1] for line in lines if line.startswith("  since")] == ["60 s ago", "60 s ago", "3 s ago"]
    assert "drives of 1 joints answer late, RR.6 by 2 ms" in lines


def test_faults_are_cleared_by_name(url: str, capsys: pytest.CaptureFixture[str]) -> None:
    with FakeRuntime(url) as runtime:
        assert main(["clear-fault", "slip", "grip_lost", "--lcm", url]) == 0
        assert main(["clear-fault", "slipped", "--lcm", url]) == 2
        sent = [command.value for command in runtime.commands if command.command == command_t.CLEAR_FAULT]
    assert sent == [22.0, 9.0]
    assert "slipped: no fault has that name" in capsys.readouterr().err


def test_status_tells_place_limbs_and_which_nodes_are_missing() -> None:
    status = status_t()
    state = status.state
    state.cycle, state.plan_time_s, state.plan_end_s, state.verified_time_s = 5000, 12.5, 64.0, 8.0
    state.speed_scale, state.motion, state.waiting_for, state.waiting_limb = 0.3, robot_state_t.REVERSE, 4, 2
    state.supervisor_state = robot_state_t.CLIMBING
    for limb in range(4):
        status.reference[limb].phase = 6 if limb == 2 else 0
        status.telemetry[limb].grasp_force_n, status.telemetry[limb].grasp_force_reference_n = 18.25, 20.0
        status.telemetry[limb].utilisation = 0.5 if limb == 1 else 0.0
    status.fault.code, status.fault.limb, status.fault.node = 9, 1, 7
    status.node_state = [status_t.WELL] * 32
    status.node_state[2] = status.node_state[14] = status.node_state[31] = status_t.SILENT
    lines = status_lines(status)
    assert lines[0] == (
        "plan time 12.50 of 64.00 s, speed 0.3, in reverse; last verified stance at 8.00 s; waits for LR to grip"
    )
    assert [line.split() for line in lines[2:4]] == [
        ["RF", "stance", "grip", "18.2", "of", "20.0", "N,", "50%", "of", "the", "limit", "surface"],
        ["LR", "close", "grip", "18.2", "of", "20.0", "N,", "0%", "of", "the", "limit", "surface"],
    ]
    assert lines[5].startswith("fault 9 grip_lost: RF node 7 (gripper): finger force fell to 0 N")
    assert lines[-1] == "3 nodes silent (LF.3 joint 3, RF.7 gripper, RR.8 joint 7): look at power and cables"
