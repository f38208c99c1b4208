"""What an emulated board does when something on it breaks: the field stands, and the torque it makes is that of magnets
in a standing field, I Kt N eta times the cosine of the electrical angle that the rotor has turned."""

from __future__ import annotations

import math
import struct
import subprocess
from pathlib import Path

import pytest
from crux_contracts.motors import joint_continuous_torque_Nm
from crux_contracts.robot import Robot, load_robot
from emulated import board, image
from host import TRACK, Host, host

LF = 0
NODE = 2
TRACK_STATE, FAULT_STATE = 2, 4
DRIVER, THERMOMETER = (11, 1 << 1), (12, 1 << 2)  # cause, bit of Faults
OPEN_DEG_C, SHORTED_DEG_C = -200.0, 5000.0  # where the thermistor is as good as that
GRIPPER_COMMAND = {"Mode": TRACK, "Opening_m": 0.03, "SpeedLimit_m_s": 0.02, "ForceLimit_N": 20.0}
COMMAND = {"Mode": TRACK, "Position_rad": 0.25, "Kp_Nm_rad": 40.0, "Kd_Nms_rad": 1.0, "Torque_Nm": 2.0}
UNDEFINED = struct.pack("<H", 0xDE00)  # udf #0
RETURN_FALSE = struct.pack("<HH", 0x2000, 0x4770)  # movs r0, #0; bx lr
START_CYCLES = 120  # in which a board looks which way its motor turns
BOOT_CYCLES = 15  # in which a board gives a silent encoder up
TURN_CYCLES = 20  # in which the rotor turns by an eighth


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_robot("scaler")


def torques(bus: Host, cycles: int) -> list[float]:
    """The joint's torque over bus cycles without commands."""
    found = []
    for _ in range(cycles):
        torque, _ = bus.control()
        bus.publish()
        found.append(float(torque[NODE - 1]))
    return found


def assert_field_stands(robot: Robot, bus: Host, electrical_rad: float | None) -> None:
    """Turns the joint through a whole electrical turn and compares the torque with the standing field's;
    `electrical_rad`: of the rotor, from where the torque is greatest; None: anywhere."""
    motor = robot.motor
    position = bus.plant.joint_position_rad
    eighth_rad = 2 * math.pi / 8 / motor.pole_pairs / motor.gear_ratio
    found = [torques(bus, 10)[-1]]
    for _ in range(8):
        # Slowly: the rotor's voltage is then small beside the one that drives the current.
        for _ in range(TURN_CYCLES):
            position[NODE - 1] += eighth_rad / TURN_CYCLES
            torques(bus, 1)
        found.append(torques(bus, 10)[-1])
    phase = math.atan2(-found[2], found[0]) if electrical_rad is None else electrical_rad
    for eighth, torque in enumerate(found):
        expected = joint_continuous_torque_Nm(motor) * math.cos(phase + eighth / 8 * 2 * math.pi)
        assert torque == pytest.approx(expected, abs=0.03 * joint_continuous_torque_Nm(motor))


def broken_image(folder: Path, function: str, code: bytes) -> Path:
    """The joint's image with other code at the start of a function."""
    whole = image(NODE)
    listing = subprocess.run(["arm-none-eabi-nm", str(whole)], check=True, capture_output=True, text=True).stdout
    address = next(int(row.split()[0], 16) for row in listing.splitlines() if row.split()[-1] == function)
    data = bytearray(whole.read_bytes())
    header, count = struct.unpack_from("<I", data, 28)[0], struct.unpack_from("<H", data, 44)[0]
    for number in range(count):
        kind, offset, start, _, size = struct.unpack_from("<5I", data, header + 32 * number)
        if kind == 1 and start <= address < start + size:
            data[offset + address - start : offset + address - start + len(code)] = code
    file = folder / "broken.elf"
    file.write_bytes(data)
    return file


def test_after_a_processor_fault_the_field_stands(robot: Robot, tmp_path: Path) -> None:
    # The function runs when the first command comes; until then the board holds what it found.
    file = broken_image(tmp_path, "crux_joint_command_accept", UNDEFINED)
    with board(robot, LF, NODE, file) as emulated, host(robot) as bus:
        bus.nodes.replace(LF, NODE, emulated.port)
        bus.plant.joint_position_rad[:] = 0.25
        torques(bus, 50)
        bus.plant.joint_position_rad[NODE - 1] = 0.249
        assert torques(bus, 100)[-1] == pytest.approx(0.1, abs=0.02)
        bus.send_cycle(0, COMMAND, GRIPPER_COMMAND)
        bus.nodes.wait_sync(2.0)
        torques(bus, 50)
        assert emulated.fault != ""
        assert [row for row in bus.heard(LF)["JointStatus", NODE] if row["CycleEcho"] == 0] == []
        assert_field_stands(robot, bus, 0.0)


def test_an_encoder_that_never_answers_lets_the_field_stand(robot: Robot, tmp_path: Path) -> None:
    file = broken_image(tmp_path, "crux_as5047p_valid", RETURN_FALSE)
    with board(robot, LF, NODE, file) as emulated, host(robot) as bus:
        bus.nodes.replace(LF, NODE, emulated.port)
        bus.plant.joint_position_rad[:] = 0.25
        torques(bus, BOOT_CYCLES)
        for cycle in range(50):
            bus.run(cycle, COMMAND, GRIPPER_COMMAND)
            status = bus.heard(LF)["JointStatus", NODE][-1]
            assert status["CycleEcho"] == cycle  # it goes on answering
        assert status["State"] == FAULT_STATE
        assert emulated.fault == ""
        # The rotor was never seen: it may stand anywhere in the field.
        assert_field_stands(robot, bus, None)


@pytest.mark.parametrize("for_s", [0.1, 0.0005])
def test_a_fault_of_the_gate_driver_is_told_and_the_torque_comes_back(robot: Robot, for_s: float) -> None:
    with board(robot, LF, NODE) as emulated, host(robot) as bus:
        bus.nodes.replace(LF, NODE, emulated.port)
        bus.plant.joint_position_rad[:] = 0.25
        for cycle in range(START_CYCLES):
            torque, _ = bus.run(cycle, COMMAND, GRIPPER_COMMAND)
        assert torque[NODE - 1] == pytest.approx(2.0, abs=0.05)
        bus.heard(LF)
        emulated.break_driver(True)
        if for_s < 0.001:
            emulated.break_driver(False)  # too short for anybody to see the line itself
        faults = []
        for cycle in range(START_CYCLES, START_CYCLES + 50):
            torque, _ = bus.run(cycle, COMMAND, GRIPPER_COMMAND)
            heard = bus.heard(LF)
            faults += [row["Cause"] for row in heard["JointEmergency", NODE]]
            status = heard["JointStatus", NODE][-1]
        assert faults == [DRIVER[0]]
        assert status["Faults"] == DRIVER[1]
        assert status["State"] == TRACK_STATE
        assert torque[NODE - 1] == pytest.approx(2.0 if for_s < 0.001 else 0.0, abs=0.05)
        emulated.break_driver(False)
        for cycle in range(START_CYCLES + 50, START_CYCLES + 110):
            torque, _ = bus.run(cycle, COMMAND, GRIPPER_COMMAND)
            status = bus.heard(LF)["JointStatus", NODE][-1]
        assert torque[NODE - 1] == pytest.approx(2.0, abs=0.05)
        assert status["Faults"] == 0


@pytest.mark.parametrize("degC", [OPEN_DEG_C, SHORTED_DEG_C])
def test_a_thermistor_that_is_open_or_shorted_is_a_fault_and_no_cold_motor(robot: Robot, degC: float) -> None:
    with board(robot, LF, NODE) as emulated, host(robot) as bus:
        bus.nodes.replace(LF, NODE, emulated.port)
        bus.plant.joint_position_rad[:] = 0.25
        for now_degC, temperature, faults, told in (
            (25.0, 25, 0, []),
            (degC, -128, THERMOMETER[1], [THERMOMETER[0]]),
            (-20.0, -20, 0, []),
        ):
            bus.nodes.set_temperature(LF, NODE, now_degC)
            bus.run(0, COMMAND, GRIPPER_COMMAND)
            bus.heard(LF)
            causes = []
            for cycle in range(1, 6):
                bus.run(cycle, COMMAND, GRIPPER_COMMAND)
                heard = bus.heard(LF)
                causes += [row["Cause"] for row in heard["JointEmergency", NODE]]
            status = heard["JointStatus", NODE][-1]
            assert status["Temperature_degC"] == pytest.approx(temperature, abs=1)
            assert status["Faults"] == faults
            assert set(told) >= set(causes)
