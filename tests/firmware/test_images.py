"""The microcontroller images: they link, fit, hold the robot's own parameters, and need neither heap nor doubles."""

from __future__ import annotations

import ctypes
import math
import re
import struct
import subprocess
from collections.abc import Sequence
from pathlib import Path

import crux_nodes
import drive_parameters
import image_report
import pytest
from crux_contracts.robot import load_robot
from crux_contracts.robot_bounds import MOST_JOINTS
from crux_tools.paths import BUILD_DIR

KINDS = ("joint", "gripper")
FLASH_START, FLASH_BYTES = 0x08000000, 512 << 10
RAM_START, RAM_BYTES = 0x20000000, 96 << 10


@pytest.fixture(scope="module")
def report() -> str:
    """What `make firmware` prints; it builds the images where that is still to be done."""
    command = ["cmake", "--build", str(BUILD_DIR), "-j", "2", "--target", "crux_firmware"]
    run = subprocess.run(command, capture_output=True, text=True, check=False)
    assert run.returncode == 0, run.stdout + run.stderr
    return run.stdout


def image(kind: str) -> Path:
    return BUILD_DIR / "firmware" / "ports" / "stm32g474" / f"crux_{kind}.elf"


def symbols(kind: str) -> dict[str, tuple[int, int]]:
    """Address and size by name."""
    listing = subprocess.run(
        ["arm-none-eabi-nm", "-S", str(image(kind))], check=True, capture_output=True, text=True
    ).stdout
    rows = [line.split() for line in listing.splitlines()]
    return {row[-1]: (int(row[0], 16), int(row[1], 16) if len(row) == 4 else 0) for row in rows if len(row) >= 3}


def flash(kind: str, folder: Path) -> bytes:
    binary = folder / f"{kind}.bin"
    subprocess.run(["arm-none-eabi-objcopy", "-O", "binary", str(image(kind)), str(binary)], check=True)
    return binary.read_bytes()


@pytest.mark.parametrize("kind", KINDS)
def test_image_fits_with_room_to_spare(report: str, kind: str) -> None:
    found = re.search(rf"crux_{kind}.elf: flash (\d+) of \d+ B, RAM (\d+) B, stack (\d+) B \+ (\d+) B", report)
    assert found is not None, report
    flash_bytes, ram_bytes, stack_bytes, interrupt_bytes = map(int, found.groups())
    assert 4096 < flash_bytes < FLASH_BYTES // 8
    assert 1024 < ram_bytes < RAM_BYTES // 8
    assert 100 < stack_bytes + interrupt_bytes < RAM_BYTES // 8


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.usefixtures("report")
def test_vectors_point_where_they_should(kind: str, tmp_path: Path) -> None:
    vectors = struct.unpack("<118I", flash(kind, tmp_path)[: 118 * 4])
    known = symbols(kind)
    assert vectors[0] == RAM_START + RAM_BYTES
    assert vectors[1] == known["reset_handler"][0] | 1
    assert vectors[15] == known["board_on_systick"][0] | 1
    assert vectors[16 + 18] == known["drive_port_on_sample"][0] | 1
    assert vectors[16 + 21] == known["fdcan_on_interrupt"][0] | 1
    assert all(vectors[n] & 1 for n in range(1, 7))


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.usefixtures("report")
def test_parameters_in_flash_are_those_of_the_robot(kind: str, tmp_path: Path) -> None:
    robot = load_robot("scaler")
    tables: dict[str, Sequence[ctypes.Structure]] = {
        "joints": crux_nodes.joint_parameters(robot),
        "grippers": crux_nodes.gripper_parameters(robot),
        "joint_drives": drive_parameters.joint_drive_parameters(robot),
        "gripper_drives": drive_parameters.gripper_drive_parameters(robot),
    }
    content = flash(kind, tmp_path)
    for name in (f"{kind}s", f"{kind}_drives"):
        address, size = symbols(kind)[f"node_table_{name}"]
        wanted = b"".join(bytes(entry) for entry in tables[name])
        assert content[address - FLASH_START : address - FLASH_START + size] == wanted
    at = symbols(kind)["node_table_hash"][0] - FLASH_START
    assert struct.unpack_from("<I", content, at) == (crux_nodes.parameter_hash(robot),)


def test_drives_make_what_the_description_promises() -> None:
    robot = load_robot("scaler")
    slots = drive_parameters.joint_drive_parameters(robot)
    drives = [drive for slot, drive in enumerate(slots) if slot % MOST_JOINTS < 6]
    joints = [joint for limb in robot.limbs for joint in limb.joints]
    for drive, joint, number in zip(drives, joints, list(range(6)) * 4, strict=True):
        motor, gear = drive.motor, drive.gear
        joint_Nm_A = 1.5 * motor.pole_pairs * motor.flux_Wb * gear.ratio * gear.efficiency
        assert joint_Nm_A * motor.peak_current_A == pytest.approx(joint.effort)
        assert joint_Nm_A * motor.continuous_current_A >= robot.servo.continuous_torque_Nm[number]
        assert motor.continuous_current_A <= motor.peak_current_A
        assert 1 / motor.bandwidth_rad_s == pytest.approx(robot.servo.torque_time_constant_s)
    for gripper in drive_parameters.gripper_drive_parameters(robot):
        motor, screw = gripper.motor, gripper.screw
        rotor_Nm = 1.5 * motor.pole_pairs * motor.flux_Wb * motor.peak_current_A
        # Work of a turn of the rotor, less the screw's loss, at both fingers.
        finger_N = rotor_Nm * 2 * math.pi * screw.efficiency / (2 * screw.lead_m)
        assert finger_N == pytest.approx(robot.gripper.max_finger_force_N)


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.usefixtures("report")
def test_no_heap_no_doubles_no_text_output(kind: str) -> None:
    forbidden = re.compile(r"malloc|sbrk|__aeabi_d|printf")
    assert [name for name in symbols(kind) if forbidden.search(name)] == []


def call_graph(folder: Path, calls: str) -> image_report.CallGraph:
    lines = [f'node: {{ title: "{name}" label: "{name}\\nx.c:1:1\\n{size} bytes (static)" }}'
             for name, size in (("main", 8), ("a", 100), ("b", 16), ("c", 200))]  # fmt: skip
    edges = (pair.split(">") for pair in calls.split())
    lines += [f'edge: {{ sourcename: "{source}" targetname: "{target}" label: "x.c" }}' for source, target in edges]
    file = folder / "x.ci"
    file.write_text("\n".join(lines), encoding="utf-8")
    return image_report.CallGraph([file])


def test_stack_report_takes_the_deepest_chain(tmp_path: Path) -> None:
    assert call_graph(tmp_path, "main>a main>b b>c").deepest("main") == 8 + 16 + 200
    assert call_graph(tmp_path, "main>a a>c main>memcpy").deepest("main") == 8 + 100 + 200


def test_stack_report_refuses_recursion(tmp_path: Path) -> None:
    with pytest.raises(ValueError, match="recursion through main"):
        call_graph(tmp_path, "main>a a>b b>main").deepest("main")
