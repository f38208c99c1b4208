"""The joint image on an emulated microcontroller, on the same bus as nodes of the host's library."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import pytest
from crux_contracts import can_codec
from crux_contracts.robot import Robot, load_robot
from crux_simulation.sim import crux_emulated
from crux_simulation.sim.emulated_boards import EmulatedBoards, Place
from crux_tools.errors import UsageError
from emulated import board, elf, image
from host import TRACK, Host, host

LF = 0
NODE = 2
BOOT_STATE, HOLD_STATE, TRACK_STATE = 0, 1, 2
BUS_OFF = 7  # cause of an emergency
CAN_CONTROL = 0x18
GRIPPER_COMMAND = {"Mode": TRACK, "Opening_m": 0.03, "SpeedLimit_m_s": 0.02, "ForceLimit_N": 20.0}


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_robot("scaler")


@pytest.fixture
def boards(robot: Robot) -> Iterator[tuple[Host, crux_emulated.Board]]:
    """LF's second joint is emulated."""
    with board(robot, LF, NODE) as emulated, host(robot) as bus:
        bus.nodes.replace(LF, NODE, emulated.port)
        yield bus, emulated


def command(position_rad: float) -> dict[str, float]:
    return {"Mode": TRACK, "Position_rad": position_rad, "Kp_Nm_rad": 40.0, "Kd_Nms_rad": 1.0, "Torque_Nm": 1.5}


def test_answers_every_sync_with_what_it_measures(boards: tuple[Host, crux_emulated.Board]) -> None:
    bus, emulated = boards
    bus.plant.joint_position_rad[:] = 0.25
    for cycle in range(20):
        bus.run(cycle, command(0.3), GRIPPER_COMMAND)
        heard = bus.heard(LF)
        (status,) = heard["JointStatus", NODE]
        assert status["CycleEcho"] == cycle
        if cycle == 0:
            (identity,) = heard["JointIdentity", NODE]
            assert identity["Limb"] == LF
    assert status["State"] == TRACK_STATE
    assert status["Position_rad"] == pytest.approx(0.25, abs=2e-5)  # a count behind the gear
    assert emulated.fault == ""


def test_image_and_library_make_the_same_torque(boards: tuple[Host, crux_emulated.Board]) -> None:
    bus, _ = boards
    bus.plant.joint_position_rad[:] = 0.25
    for cycle in range(200):
        torque, _ = bus.run(cycle, command(0.3), GRIPPER_COMMAND)
    assert torque[NODE] == pytest.approx(40.0 * 0.05 + 1.5, abs=1e-3)  # the next joint, of the library
    assert torque[NODE - 1] == pytest.approx(40.0 * 0.05 + 1.5, abs=0.05)  # a few counts of the converter


def test_silence_makes_it_hold_and_keep_its_torque(boards: tuple[Host, crux_emulated.Board]) -> None:
    bus, _ = boards
    bus.plant.joint_position_rad[:] = 0.25
    for cycle in range(100):
        before, _ = bus.run(cycle, command(0.3), GRIPPER_COMMAND)
        bus.heard(LF)
    for _ in range(50):
        after, _ = bus.control()
        bus.publish()
    assert after[NODE - 1] == pytest.approx(before[NODE - 1], abs=0.05)
    bus.send_cycle(100, command(0.9), GRIPPER_COMMAND)
    bus.nodes.wait_sync(2.0)
    for _ in range(2):
        after, _ = bus.control()
        bus.publish()
    status = bus.heard(LF)["JointStatus", NODE][-1]
    assert status["State"] == HOLD_STATE
    assert after[NODE - 1] == pytest.approx(before[NODE - 1], abs=0.05)


def test_restart_forgets_and_says_so(boards: tuple[Host, crux_emulated.Board]) -> None:
    bus, _ = boards
    for cycle in range(10):
        bus.run(cycle, command(0.0), GRIPPER_COMMAND)
    bus.heard(LF)
    bus.nodes.reset(LF, NODE)
    for cycle in range(10, 20):
        bus.run(cycle, command(0.0), GRIPPER_COMMAND)
    heard = bus.heard(LF)
    assert len(heard["JointIdentity", NODE]) == 1
    assert len(heard["JointIdentity", NODE + 1]) == 0
    assert heard["JointStatus", NODE][-1]["CycleEcho"] == 19


@pytest.mark.parametrize("node", [NODE, crux_emulated.GRIPPER])
def test_says_who_it_is_when_it_is_asked(robot: Robot, node: int) -> None:
    name = "GripperIdentity" if node == crux_emulated.GRIPPER else "JointIdentity"
    with board(robot, LF, node) as emulated, host(robot) as bus:
        bus.nodes.replace(LF, node, emulated.port)
        bus.run(0, command(0.0), GRIPPER_COMMAND)
        assert len(bus.heard(LF)[name, node]) == 1  # at its start
        for cycle, (asked, answers) in enumerate([(0, 0), (node - 1, 0), (node, 1), (0, 0), (node, 1)], start=1):
            bus.send(LF, "HostHeartbeat", {"HostState": 1, "Identify": asked})
            bus.run(cycle, command(0.0), GRIPPER_COMMAND)
            said = bus.heard(LF)[name, node]
            assert len(said) == answers
    assert (said[0]["NodeId"], said[0]["Limb"], said[0]["ParameterHash"]) == (node, LF, int(robot.hash[:8], 16))


def test_while_it_restarts_its_joint_is_limp_for_a_few_milliseconds(boards: tuple[Host, crux_emulated.Board]) -> None:
    bus, _ = boards
    bus.plant.joint_position_rad[:] = 0.25
    for cycle in range(50):
        before, _ = bus.run(cycle, command(0.3), GRIPPER_COMMAND)
    assert bus.nodes.states()[0][NODE - 1] == TRACK_STATE
    assert before[NODE - 1] > 1.0
    bus.nodes.reset(LF, NODE)
    torques = []
    for _ in range(20):
        bus.plant.joint_position_rad[NODE - 1] -= 0.001  # it sags
        torque, _ = bus.control()
        bus.publish()
        torques.append(float(torque[NODE - 1]))
        assert bus.nodes.states()[0][NODE - 1] == BOOT_STATE
    limp_cycles = sum(abs(torque) < 0.05 for torque in torques)
    assert 1 <= limp_cycles <= 3  # open bridge: crystal, encoders, converters
    assert torques[-1] > 1.0  # then it holds where it found itself


def test_controller_goes_off_the_bus_and_comes_back(boards: tuple[Host, crux_emulated.Board]) -> None:
    bus, emulated = boards
    off, initialising = 1 << 7, 1 << 0
    bus.plant.joint_position_rad[:] = 0.25
    for cycle in range(50):
        before, _ = bus.run(cycle, command(0.3), GRIPPER_COMMAND)
        bus.heard(LF)
    assert emulated.can_register(crux_emulated.CAN_ERRORS) == 0

    bus.nodes.disturb(LF, NODE, True)
    seen_off, seen_errors = 0, 0
    for cycle in range(50, 150):
        during, _ = bus.run(cycle, command(0.9), GRIPPER_COMMAND)
        assert not bus.heard(LF)["JointStatus", NODE]
        seen_off += (emulated.can_register(crux_emulated.CAN_PROTOCOL) & off) != 0
        seen_errors = max(seen_errors, emulated.can_register(crux_emulated.CAN_ERRORS) & 0xFF)
    assert seen_off > 0
    assert seen_errors >= 128  # through error passive
    assert during[NODE - 1] == pytest.approx(before[NODE - 1], abs=0.05)  # it never heard of 0.9 rad

    assert bus.nodes.states()[0][NODE - 1] == HOLD_STATE, "the bench sees it though no status says so"
    bus.nodes.disturb(LF, NODE, False)
    causes: set[str] = set()
    last: can_codec.Values = {}
    for cycle in range(150, 200):
        after, _ = bus.run(cycle, command(0.9), GRIPPER_COMMAND)
        heard = bus.heard(LF)
        causes |= {str(emergency["Cause"]) for emergency in heard["JointEmergency", NODE]}
        last = (heard["JointStatus", NODE] or [last])[-1]
    assert last["CycleEcho"] == 199
    assert last["State"] == HOLD_STATE  # latched by its watchdog
    assert str(BUS_OFF) in causes
    assert emulated.can_register(crux_emulated.CAN_PROTOCOL) & off == 0
    assert emulated.can_register(CAN_CONTROL) & initialising == 0
    assert after[NODE - 1] == pytest.approx(before[NODE - 1], abs=0.05)


def test_two_runs_execute_the_same_instructions_and_make_the_same_torque(robot: Robot) -> None:
    def run() -> tuple[int, list[float]]:
        with board(robot, LF, NODE) as emulated, host(robot) as bus:
            bus.nodes.replace(LF, NODE, emulated.port)
            torques = []
            for cycle in range(50):
                bus.plant.joint_position_rad[:] = 0.25 + 1e-3 * cycle
                torque, _ = bus.run(cycle, command(0.3), GRIPPER_COMMAND)
                torques.append(float(torque[NODE - 1]))
            return emulated.instructions, torques

    one = run()
    assert one == run()
    assert one[0] > 1_000_000


@pytest.mark.parametrize(
    ("instruction", "address", "told"),
    [
        (0x6801, 0x40005C00, "nothing to read at 0x40005C00"),  # ldr r1, [r0]
        (0x6001, 0x0807F800, "programs flash that is locked or busy at 0x0007F800"),  # str r1, [r0]
    ],
)
def test_an_image_that_touches_what_it_should_not_is_told_of(
    robot: Robot, tmp_path: Path, instruction: int, address: int, told: str
) -> None:
    broken = tmp_path / "broken.elf"
    # Vectors; then ldr r0, =address; the instruction; b .
    code = struct.pack("<IIHHHHI", 0x20018000, 0x08000009, 0x4801, instruction, 0xE7FE, 0xBF00, address)
    broken.write_bytes(elf(code))
    with board(robot, LF, NODE, broken) as emulated, host(robot) as bus:
        bus.nodes.replace(LF, NODE, emulated.port)
        bus.control()
        assert emulated.fault.startswith(told)


def test_what_is_no_image_is_refused(robot: Robot, tmp_path: Path) -> None:
    text = tmp_path / "text.elf"
    text.write_text("not an image", encoding="utf-8")
    with pytest.raises(crux_emulated.BoardError, match="not an ELF image"), board(robot, LF, NODE, text):
        pass
    with pytest.raises(crux_emulated.BoardError, match="cannot be opened"), board(robot, LF, NODE, tmp_path / "none"):
        pass
    with pytest.raises(crux_emulated.BoardError, match="no node 9"), board(robot, LF, 9, image(NODE)):
        pass


def test_boards_of_another_robot_are_refused_with_what_to_do(robot: Robot) -> None:
    """Their images carry scaler's numbers: the runtime would wait for them for ever."""
    places = (Place(LF, NODE),)
    with EmulatedBoards(places, robot):
        pass
    with pytest.raises(UsageError, match="built for scaler, the plan is for other: climb without --emulate, or"):
        EmulatedBoards(places, replace(robot, name="other", hash="0" * 64))
    with pytest.raises(UsageError, match="older than the description of scaler: make build"):
        EmulatedBoards(places, replace(robot, hash="0" * 64))
