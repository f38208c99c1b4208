"""New firmware over the bus: signed by the library cryptography, sent by can-isotp, judged by the node."""

from __future__ import annotations

import json
import random
import struct
from collections.abc import Iterator
from pathlib import Path

import pytest
from crux_contracts.node_services import number
from crux_contracts.robot import Robot, load_robot
from crux_tools.can.image import read_images, sign, version_number, version_text
from crux_tools.can.node_link import NodeLink, Refused, limb_bus, node_name
from crux_tools.can.update_command import load, slots, wait_until_confirmed
from crux_tools.cli import main
from crux_tools.errors import UsageError
from crux_tools.signing_key import new_key
from host import HOLD, TRACK
from service_host import Desk, desk

TRACKED = {"Mode": TRACK, "Kp_Nm_rad": 100.0, "Kd_Nms_rad": 4.0}
PROGRAM = random.Random(1).randbytes(5001)
UNCOMMANDED = 20  # periods after its start, for the first ten of which a node takes itself for commanded


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_robot("scaler")


@pytest.fixture(scope="module")
def key(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("key") / "key.pem"
    new_key(path)
    return path


@pytest.fixture(scope="module")
def table_top(robot: Robot, key: Path) -> Iterator[Desk]:
    with desk(robot) as running:
        running.nodes.trust(sign(b"x", "joint", 1, key)[1])
        yield running


def link(running: Desk, robot: Robot, node: str) -> NodeLink:
    running.await_periods(UNCOMMANDED)
    name = node_name(node)
    return NodeLink(name, limb_bus(running.base(), robot, name.limb))


def signed(key: Path, version: int, kind: str = "joint", program: bytes = PROGRAM) -> tuple[bytes, bytes]:
    image, _ = sign(program, kind, version, key)
    return image[:192], image[192:]


def test_the_commands_sign_and_update(
    table_top: Desk, key: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    program, image = tmp_path / "program.bin", tmp_path / "joint.img"
    program.write_bytes(PROGRAM)
    words = ["can", "sign", str(program), "--kind", "joint", "--key", str(key), "-o", str(image)]
    assert main([*words, "--firmware-version", "0.2.0", "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["public_key"] == sign(b"x", "joint", 1, key)[1].hex()
    update = ["can", "update", "LF.joint1", str(image), "--bus-base", table_top.base()]
    assert main(update) == 2
    assert "off the wall" in capsys.readouterr().err
    assert main([*update, "--off-the-wall", "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert result["before"]["version"] == 0x000100
    assert result["after"] == {
        "slot": 0, "confirmed": True, "version": 0x000200, "other_version": 0, "capacity": result["after"]["capacity"],
        "address": 0,
    }  # fmt: skip
    assert main([*update, "--off-the-wall"]) == 2
    assert "not newer than 0.2.0" in capsys.readouterr().err
    assert main(["can", "update", "LF.gripper", str(image), "--bus-base", table_top.base(), "--off-the-wall"]) == 2
    assert "is for a joint" in capsys.readouterr().err


@pytest.mark.parametrize(
    "length", [1, 7, 8, 111, 112, 127, 128, 129, 2000, pytest.param(40_000, marks=pytest.mark.sweep)]
)
def test_programs_of_any_length_arrive_whole(table_top: Desk, robot: Robot, key: Path, length: int) -> None:
    with link(table_top, robot, "RF.2") as joint:
        version = slots(joint)["version"] + 1
        load(joint, *signed(key, version, program=PROGRAM[:length] * (1 + length // len(PROGRAM))))
        joint.restart()
        assert slots(joint)["version"] == version
        wait_until_confirmed(joint, version)


def test_a_stranger_s_image_is_refused(table_top: Desk, robot: Robot, tmp_path: Path) -> None:
    new_key(tmp_path / "stranger.pem")
    with link(table_top, robot, "RF.3") as joint:
        with pytest.raises(Refused) as refusal:
            load(joint, *signed(tmp_path / "stranger.pem", 0x000900))
        assert refusal.value.code == number("refusal", "SIGNATURE")


def test_a_node_in_motion_takes_no_image_and_gives_up_one_under_way(table_top: Desk, robot: Robot, key: Path) -> None:
    header, payload = signed(key, 0x000300)
    with link(table_top, robot, "LR.gripper") as gripper, link(table_top, robot, "LR.4") as joint:
        table_top.command(TRACKED)
        with pytest.raises(Refused) as refusal:
            load(joint, header, payload)
        assert refusal.value.code == number("refusal", "CONDITIONS")
        table_top.command(TRACKED | {"Mode": HOLD})
        with pytest.raises(Refused) as refusal:  # at rest, but a host commands it
            load(joint, header, payload)
        assert refusal.value.code == number("refusal", "CONDITIONS")
        table_top.command(None)
        table_top.await_periods(200)
        joint.request("DOWNLOAD", number("acknowledgement", "OFF_THE_WALL").to_bytes(4, "little") + header)
        table_top.command(TRACKED)
        table_top.command(TRACKED | {"Mode": HOLD})
        with pytest.raises(Refused) as refusal:
            joint.request("TRANSFER", b"\1" + payload[:64])
        assert refusal.value.code == number("refusal", "SEQUENCE")
        with pytest.raises(Refused) as refusal:
            gripper.request("DOWNLOAD", bytes(4) + header)
        assert refusal.value.code == number("refusal", "CONDITIONS")
        table_top.command(None)


@pytest.mark.parametrize("operation", [1, 200, 640, *(pytest.param(n, marks=pytest.mark.sweep) for n in (2, 3, 627))])
def test_power_lost_within_an_update_leaves_the_old_firmware_and_room_for_the_new(
    table_top: Desk, robot: Robot, key: Path, operation: int
) -> None:
    limb, node = 3, 1 + operation % 6
    header, payload = signed(key, 0x000500 + operation)
    with link(table_top, robot, f"RR.{node}") as joint:
        before = slots(joint)
        table_top.nodes.cut_power(limb, node, operation)
        with pytest.raises(Refused) as refusal:
            load(joint, header, payload)
        assert refusal.value.code == number("refusal", "MEMORY")
        table_top.nodes.cut_power(limb, node, 0)
        table_top.reset(limb, node)
        table_top.await_periods(UNCOMMANDED)
        assert slots(joint)["version"] == before["version"]
        load(joint, header, payload)
        joint.restart()
        wait_until_confirmed(joint, 0x000500 + operation)


def linked(folder: Path, slot: int) -> Path:
    """An ELF file of a program for slot 0 or 1, in two segments with a gap between."""
    start, code, data = 0x08008200 + slot * 0x38000, b"code" * 5, b"data"
    segments = [(start, code, 116), (start + 32, data, 136)]
    file = b"\x7fELF\1\1\1".ljust(16, b"\0")
    file += struct.pack("<HHIIIIIHHHHHH", 2, 40, 1, start, 52, 0, 0, 52, 32, len(segments), 0, 0, 0)
    for address, content, offset in segments:
        file += struct.pack("<8I", 1, offset, address, address, len(content), len(content), 5, 4)
    path = folder / f"slot{slot}.elf"
    path.write_bytes(file + code + data)
    return path


def test_programs_of_both_slots_are_signed_into_one_file(
    tmp_path: Path, key: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    package, programs = tmp_path / "package", [linked(tmp_path, slot) for slot in (0, 1)]
    words = ["can", "sign", "--kind", "joint", "--firmware-version", "0.3.0", "--key", str(key), "-o", str(package)]
    assert main([*words, *map(str, programs)]) == 0
    images = read_images(package)
    assert [image.address for image in images] == [0x08008200, 0x08040200]
    assert {image.payload for image in images} == {b"code" * 5 + b"\xff" * 12 + b"data"}
    capsys.readouterr()
    assert main([*words, str(programs[0]), str(programs[0])]) == 2
    assert "linked for the same address" in capsys.readouterr().err
    programs[0].write_bytes(programs[0].read_bytes()[:90])
    assert main([*words, str(programs[0])]) == 2
    assert "cut short" in capsys.readouterr().err


def test_a_node_is_not_sent_what_is_linked_for_another_slot(
    table_top: Desk, tmp_path: Path, key: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    package = tmp_path / "package"
    package.write_bytes(sign(PROGRAM, "joint", 0x009900, key, 0x08040200)[0])
    assert main(["can", "update", "LF.joint4", str(package), "--bus-base", table_top.base(), "--off-the-wall"]) == 2
    assert "no image in it is linked for no address" in capsys.readouterr().err


def test_damaged_files_and_wrong_keys_are_told(tmp_path: Path, key: Path) -> None:
    image = tmp_path / "image"
    data = bytearray(sign(PROGRAM, "joint", 1, key)[0])
    data[-1] ^= 1
    image.write_bytes(data)
    with pytest.raises(UsageError, match="damaged"):
        read_images(image)
    image.write_bytes(b"\x7fELF")
    with pytest.raises(UsageError, match="not a signed image"):
        read_images(image)
    with pytest.raises(UsageError, match="no private key"):
        sign(PROGRAM, "joint", 1, image)
    with pytest.raises(UsageError, match=r"right is MAJOR\.MINOR\.PATCH"):
        version_number("1.2")
    assert version_text(version_number("1.20.3")) == "1.20.3"
