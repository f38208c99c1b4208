"""Services of the nodes through the library can-isotp and the command line: parameters and what must be refused."""

from __future__ import annotations

import json
import struct
from collections.abc import Iterator

import pytest
from crux_contracts.node_parameters import table
from crux_contracts.node_services import number
from crux_contracts.robot import Robot, load_robot
from crux_tools.can.node_link import NodeLink, Refused, limb_bus, node_name
from crux_tools.can.param_command import describe, run_routine, write
from crux_tools.cli import main
from crux_tools.errors import UsageError, WorkFailed
from host import HOLD, TRACK
from service_host import Desk, desk

TRACKED = {"Mode": TRACK, "Kp_Nm_rad": 100.0, "Kd_Nms_rad": 4.0}


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_robot("scaler")


@pytest.fixture(scope="module")
def table_top(robot: Robot) -> Iterator[Desk]:
    with desk(robot) as running:
        yield running


def link(running: Desk, robot: Robot, node: str) -> NodeLink:
    name = node_name(node)
    return NodeLink(name, limb_bus(running.base(), robot, name.limb))


def test_a_node_tells_the_values_of_the_robot_description(table_top: Desk, robot: Robot) -> None:
    with link(table_top, robot, "LR.joint4") as joint:
        entries = describe(joint)
        assert list(entries) == [parameter.name for parameter in table()["joint"]]
        assert entries["torque_limit_Nm"].value == pytest.approx(robot.limbs[2].joints[3].effort)
        assert not entries["torque_limit_Nm"].writable
        assert entries["setpoint_time_constant_s"].value == pytest.approx(robot.servo.setpoint_time_constant_s)
        assert (entries["watchdog_cycles"].least, entries["watchdog_cycles"].greatest) == (2, 10)
        version = joint.read(number("data", "VERSION"))
        assert struct.unpack("<I", version[4:8])[0] == int(robot.hash[:8], 16)
    with link(table_top, robot, "RR.gripper") as gripper:
        assert describe(gripper)["stiffness_N_m"].value == pytest.approx(robot.gripper.stiffness_N_m)


def test_written_values_are_kept_over_a_restart_only_when_saved(table_top: Desk, robot: Robot) -> None:
    with link(table_top, robot, "LF.2") as joint:
        for saved in (False, True):
            write(joint, describe(joint)["setpoint_time_constant_s"], 0.03)
            if saved:
                run_routine(joint, "SAVE")
            table_top.reset(0, 2)
            expected = 0.03 if saved else robot.servo.setpoint_time_constant_s
            assert describe(joint)["setpoint_time_constant_s"].value == pytest.approx(expected)
        run_routine(joint, "FORGET")
        table_top.reset(0, 2)
        assert describe(joint)["setpoint_time_constant_s"].value == pytest.approx(robot.servo.setpoint_time_constant_s)


@pytest.mark.parametrize(
    ("name", "bits"),
    [
        ("torque_limit_Nm", struct.pack("<f", 1.0)),
        ("position_gain_Nm_rad", struct.pack("<f", 0.0)),
        ("position_gain_Nm_rad", struct.pack("<f", float("nan"))),
        ("velocity_limit_rad_s", struct.pack("<f", float("inf"))),
        ("watchdog_cycles", struct.pack("<I", 0xFFFFFFFF)),
    ],
)
def test_a_node_refuses_what_could_harm_whatever_the_tool(
    table_top: Desk, robot: Robot, name: str, bits: bytes
) -> None:
    with link(table_top, robot, "RF.1") as joint:
        entry = describe(joint)[name]
        with pytest.raises(Refused) as refusal:
            joint.request("WRITE", struct.pack(">H", number("data", "VALUE") + entry.id) + bits)
        assert refusal.value.code == number("refusal", "RANGE")
        assert describe(joint)[name].value == entry.value


def test_nothing_is_written_while_a_node_tracks(table_top: Desk, robot: Robot) -> None:
    with link(table_top, robot, "RF.3") as joint:
        table_top.command(TRACKED)
        entry = describe(joint)["setpoint_time_constant_s"]  # reading is allowed
        attempts = (
            lambda: write(joint, entry, 0.03),
            lambda: run_routine(joint, "SAVE"),
            lambda: run_routine(joint, "FORGET"),
            lambda: joint.request("RESET", struct.pack("<BI", 1, number("acknowledgement", "OFF_THE_WALL"))),
        )
        for attempt in attempts:
            with pytest.raises(Refused) as refusal:
                attempt()
            assert refusal.value.code == number("refusal", "CONDITIONS")
        table_top.command(TRACKED | {"Mode": HOLD})
        write(joint, entry, 0.03)
        run_routine(joint, "FORGET")
        table_top.command(None)


def test_a_restart_wants_an_acknowledgement(table_top: Desk, robot: Robot) -> None:
    with link(table_top, robot, "LR.5") as joint:
        with pytest.raises(Refused):
            joint.request("RESET", struct.pack("<BI", 1, 0))
        write(joint, describe(joint)["max_deceleration_rad_s2"], 40.0)
        joint.restart()
        assert describe(joint)["max_deceleration_rad_s2"].value == pytest.approx(robot.servo.max_deceleration_rad_s2)


@pytest.mark.parametrize("length", [1, 7, 8, 61, 62, 63, 500, 1022])
def test_requests_of_any_length_are_heard_whole(table_top: Desk, robot: Robot, length: int) -> None:
    with link(table_top, robot, "LF.6") as joint:
        with pytest.raises(Refused) as refusal:
            joint.request("WRITE", bytes(length))
        expected = "RANGE" if length == 6 else "LENGTH"
        assert refusal.value.code == number("refusal", expected)


def test_a_request_too_long_for_the_node_ends_at_once(table_top: Desk, robot: Robot) -> None:
    with link(table_top, robot, "LF.6") as joint:
        with pytest.raises(WorkFailed):
            joint.request("WRITE", bytes(2000))
        assert describe(joint)


def test_a_node_without_power_is_told_of(table_top: Desk) -> None:
    table_top.nodes.lose(3, 1.0)
    with (
        NodeLink(node_name("RR.1"), table_top.host.urls[3], 0.2) as joint,
        pytest.raises(WorkFailed, match=r"RR\.joint1"),
    ):
        joint.read(number("data", "VERSION"))
    table_top.nodes.lose(3, 0.0)


def run(capsys: pytest.CaptureFixture[str], *words: str) -> tuple[int, str, str]:
    status = main(["can", "param", *words])
    captured = capsys.readouterr()
    return status, captured.out, captured.err


def test_the_command_lists_reads_writes_and_forgets(table_top: Desk, capsys: pytest.CaptureFixture[str]) -> None:
    base = ("--bus-base", table_top.base())
    status, out, _ = run(capsys, "RR.gripper", *base)
    assert status == 0
    assert len(out.splitlines()) == len(table()["gripper"])
    assert "force_limit_N" in out
    status, out, _ = run(capsys, "RR.gripper", "damping_Ns_m", "150", "--save", "--json", *base)
    assert status == 0
    assert json.loads(out)["parameters"][0]["value"] == 150.0
    status, out, _ = run(capsys, "rr.7", "damping_Ns_m", *base)
    assert "description 200" in out
    status, out, _ = run(capsys, "RR.gripper", "damping_Ns_m", "--forget", *base)
    assert "description" not in out


@pytest.mark.parametrize(
    ("words", "says"),
    [
        (["RR.gripper", "force_limit_N", "10"], "read-only"),
        (["RR.gripper", "speed_limit_m_s", "1"], "right is 0.002 .. 0.02 m/s"),
        (["RR.gripper", "speed_limit_m_s", "nan"], "right is"),
        (["RR.gripper", "speed_limit_m_s", "fast"], "not a number"),
        (["RR.gripper", "watchdog_cycles", "2.5"], "whole number"),
        (["RR.gripper", "colour"], "it has opening_min_m"),
        (["RR.joint9"], "LIMB.joint1"),
    ],
)
def test_mistakes_are_told_without_a_trace(
    table_top: Desk, capsys: pytest.CaptureFixture[str], words: list[str], says: str
) -> None:
    status, _, err = run(capsys, *words, "--bus-base", table_top.base())
    assert status == 2
    assert says in err


def test_buses_are_counted_from_the_first(robot: Robot) -> None:
    assert limb_bus("socketcan:can0", robot, 3) == "socketcan:can3"
    assert limb_bus("udp:239.1.2.3:500", robot, 1) == "udp:239.1.2.3:501"
    with pytest.raises(UsageError):
        limb_bus("can0", robot, 1)
