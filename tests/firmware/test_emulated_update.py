"""An emulated board starts by its boot stage, takes a new image over ISO-TP and starts that."""

from __future__ import annotations

import subprocess
import time
from pathlib import Path

import pytest
from crux_contracts.node_services import number
from crux_contracts.robot import Robot, load_robot
from crux_tools.can.image import new_key, sign
from crux_tools.can.node_link import NodeLink, Refused, limb_bus, node_name
from crux_tools.can.update_command import load, slots, wait_until_confirmed
from crux_tools.paths import built
from emulated import board, elf
from host import host
from service_host import Desk

LF, JOINT = 0, 2
START = 0x08000000
KEY, SLOTS, SLOT_BYTES, PAYLOAD = 0x7800, (0x8000, 0x40000), 0x38000, 512


def program(name: str, folder: Path) -> bytes:
    binary = folder / f"{name}.bin"
    image = built(f"firmware/ports/stm32g474/{name}.elf")
    subprocess.run(["arm-none-eabi-objcopy", "-O", "binary", str(image), str(binary)], check=True)
    return binary.read_bytes()


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_robot("scaler")


def signed(slot: int, version: int, key: Path, folder: Path) -> tuple[bytes, bytes, bytes]:
    """Header, payload, public key."""
    payload = program(f"crux_joint_slot{slot}", folder)
    image, public = sign(payload, "joint", version, key, START + SLOTS[slot] + PAYLOAD)
    return image[:192], image[192:], public


def test_a_board_takes_a_new_image_and_starts_it(robot: Robot, tmp_path: Path) -> None:
    key = tmp_path / "key.pem"
    new_key(key)
    header, payload, public = signed(0, 1, key, tmp_path)
    flash = program("crux_boot", tmp_path).ljust(KEY, b"\xff") + public
    flash = flash.ljust(SLOTS[0], b"\xff") + header.ljust(PAYLOAD, b"\xff") + payload
    (tmp_path / "board.elf").write_bytes(elf(flash))
    with board(robot, LF, JOINT, tmp_path / "board.elf") as emulated, host(robot) as spoken:
        spoken.nodes.replace(LF, JOINT, emulated.port)
        desk = Desk(spoken)
        try:
            time.sleep(2.0)  # the boot stage checks signatures
            with NodeLink(node_name("LF.2"), limb_bus(desk.base(), robot, LF), 1.0) as joint:
                wait_until_confirmed(joint, 1)
                assert slots(joint)["slot"] == 0
                new_header, new_payload, _ = signed(1, 2, key, tmp_path)
                other_header, other_payload, _ = signed(0, 2, key, tmp_path)
                with pytest.raises(Refused) as refusal:  # linked for the slot that runs
                    load(joint, other_header, other_payload)
                assert refusal.value.code == number("refusal", "NOT_ACCEPTED")
                with pytest.raises(Refused):
                    load(joint, new_header, new_payload[:4000])
                desk.nodes.reset(LF, JOINT)  # the power goes in the middle
                time.sleep(2.0)
                assert slots(joint)["slot"] == 0
                load(joint, new_header, new_payload)
                assert slots(joint)["other_version"] == 2
                joint.restart()
                wait_until_confirmed(joint, 2)
                assert slots(joint)["slot"] == 1
        finally:
            desk.end()
        assert emulated.fault == ""
