"""Services of the images: parameters and a restart, asked over ISO-TP of emulated boards."""

from __future__ import annotations

import struct
from collections.abc import Iterator

import pytest
from crux_contracts.node_parameters import table
from crux_contracts.node_services import number
from crux_contracts.robot import Robot, load_robot
from crux_contracts.robot_bounds import MOST_JOINTS
from crux_simulation.sim import crux_emulated
from crux_tools.can.node_link import NodeLink, Refused, limb_bus, node_name
from crux_tools.can.param_command import describe, run_routine, write
from emulated import GRIPPER, board
from host import HOLD, TRACK, host
from service_host import Desk

LF = 0
JOINT = 2
PAGE_BYTES = 2048
ANSWER_S = 20.0  # an emulated board is slower than a real one, on a busy machine too
TRACKED = {"Mode": TRACK, "Kp_Nm_rad": 100.0, "Kd_Nms_rad": 4.0}


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_robot("scaler")


@pytest.fixture(scope="module")
def boards(robot: Robot) -> Iterator[tuple[Desk, list[crux_emulated.Board]]]:
    """LF's second joint and its gripper are emulated."""
    with board(robot, LF, JOINT) as joint, board(robot, LF, GRIPPER) as gripper, host(robot) as spoken:
        spoken.nodes.replace(LF, JOINT, joint.port)
        spoken.nodes.replace(LF, GRIPPER, gripper.port)
        running = Desk(spoken)
        try:
            yield running, [joint, gripper]
        finally:
            running.end()


def link(desk: Desk, robot: Robot, node: str) -> NodeLink:
    name = node_name(node)
    return NodeLink(name, limb_bus(desk.base(), robot, name.limb), ANSWER_S)


@pytest.mark.parametrize(("node", "kind"), [("LF.2", "joint"), ("LF.gripper", "gripper")])
def test_an_image_tells_the_values_of_the_robot_description(
    boards: tuple[Desk, list[crux_emulated.Board]], robot: Robot, node: str, kind: str
) -> None:
    desk, emulated = boards
    with link(desk, robot, node) as asked:
        entries = describe(asked)
        assert list(entries) == [parameter.name for parameter in table()[kind]]
        version = asked.read(number("data", "VERSION"))
    assert struct.unpack("<I", version[4:8])[0] == int(robot.hash[:8], 16)
    if kind == "joint":
        assert entries["torque_limit_Nm"].value == pytest.approx(robot.limbs[LF].joints[JOINT - 1].effort)
    else:
        assert entries["stiffness_N_m"].value == pytest.approx(robot.gripper.stiffness_N_m)
    assert [one.fault for one in emulated] == ["", ""]


def test_an_image_writes_at_rest_only_and_forgets_over_a_restart(
    boards: tuple[Desk, list[crux_emulated.Board]], robot: Robot
) -> None:
    desk, emulated = boards
    described = robot.servo.setpoint_time_constant_s
    with link(desk, robot, "LF.2") as joint:
        desk.command(TRACKED)
        entry = describe(joint)["setpoint_time_constant_s"]
        with pytest.raises(Refused) as refusal:
            write(joint, entry, 0.03)
        assert refusal.value.code == number("refusal", "CONDITIONS")
        desk.command(TRACKED | {"Mode": HOLD})
        write(joint, entry, 0.03)
        assert describe(joint)["setpoint_time_constant_s"].value == pytest.approx(0.03)
        desk.command(None)
        with pytest.raises(Refused):
            joint.request("RESET", struct.pack("<BI", 1, 0))  # nobody says that the robot is off the wall
        assert describe(joint)["setpoint_time_constant_s"].value == pytest.approx(0.03)
        joint.restart()
        assert describe(joint)["setpoint_time_constant_s"].value == pytest.approx(described)
    assert [one.fault for one in emulated] == ["", ""]


def power_off_and_on(desk: Desk) -> None:
    desk.reset(LF, JOINT)
    desk.await_periods(50)  # it boots, and hears nothing meanwhile


def test_saved_values_outlive_the_power(boards: tuple[Desk, list[crux_emulated.Board]], robot: Robot) -> None:
    desk, emulated = boards
    described = robot.servo.setpoint_time_constant_s
    with link(desk, robot, "LF.2") as joint:
        for value in (0.03, 0.025):  # the second snapshot goes behind the first
            write(joint, describe(joint)["setpoint_time_constant_s"], value)
            run_routine(joint, "SAVE")
            power_off_and_on(desk)
            assert describe(joint)["setpoint_time_constant_s"].value == pytest.approx(value)
        run_routine(joint, "FORGET")
        power_off_and_on(desk)
        assert describe(joint)["setpoint_time_constant_s"].value == pytest.approx(described)
    assert [one.fault for one in emulated] == ["", ""]


def await_rest(desk: Desk) -> None:
    """Waits until the joint's torque has stayed the same for 50 periods."""
    torques_Nm = [0.0, 1.0]
    while max(torques_Nm) - min(torques_Nm) > 1e-3 * max(torques_Nm):
        desk.await_periods(50)
        torques_Nm = [torque_Nm[LF * MOST_JOINTS + JOINT - 1] for torque_Nm in desk.torques_Nm[-50:]]


def test_a_joint_keeps_its_torque_while_a_page_is_erased(
    boards: tuple[Desk, list[crux_emulated.Board]], robot: Robot
) -> None:
    desk, emulated = boards
    flash = emulated[0]
    with link(desk, robot, "LF.2") as joint:
        entry = describe(joint)["setpoint_time_constant_s"]
        write(joint, entry, entry.least)  # a snapshot is two units: its head and this value

        def erases() -> bool:
            """Whether the next snapshot begins a page."""
            flash.record()
            run_routine(joint, "SAVE")
            return flash.recorded == 3

        assert any(erases() for _ in range(2 * PAGE_BYTES // 16))
        for _ in range(PAGE_BYTES // 16 - 2):
            assert not erases()
        loaded = TRACKED | {"Position_rad": desk.host.plant.joint_position_rad[LF * MOST_JOINTS + JOINT - 1] + 0.05}
        desk.command(loaded)
        await_rest(desk)
        desk.command(loaded | {"Mode": HOLD})
        await_rest(desk)
        begin = len(desk.torques_Nm)
        assert [erases(), erases()] == [False, True]
        torques_Nm = [torque_Nm[LF * MOST_JOINTS + JOINT - 1] for torque_Nm in desk.torques_Nm[begin:]]
        desk.command(None)
        run_routine(joint, "FORGET")
    power_off_and_on(desk)
    assert torques_Nm[0] > 4.0
    assert max(abs(torque_Nm - torques_Nm[0]) for torque_Nm in torques_Nm) < 0.01 * torques_Nm[0]
    assert [one.fault for one in emulated] == ["", ""]


def test_pages_are_erased_when_they_are_full_and_the_calibration_stays(
    boards: tuple[Desk, list[crux_emulated.Board]], robot: Robot
) -> None:
    desk, emulated = boards
    with link(desk, robot, "LF.2") as joint:
        writable = [entry for entry in describe(joint).values() if entry.writable]
        snapshot_bytes = 8 * (1 + len(writable))
        for entry in writable:
            write(joint, entry, entry.least)
        for _ in range(2 * PAGE_BYTES // snapshot_bytes + 2):  # both pages, and the first one again
            run_routine(joint, "SAVE")
        power_off_and_on(desk)
        entries = describe(joint)
        assert [entries[entry.name].value for entry in writable] == [entry.least for entry in writable]
        run_routine(joint, "FORGET")
    power_off_and_on(desk)
    desk.command(TRACKED)  # with no calibration it would be in FAULT
    desk.command(TRACKED | {"Mode": HOLD})
    desk.command(None)
    assert [one.fault for one in emulated] == ["", ""]
