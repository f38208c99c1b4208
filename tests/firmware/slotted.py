"""Boards with a boot stage and signed images in their slots."""

from __future__ import annotations

import zlib
from dataclasses import dataclass, field
from pathlib import Path

from crux_tools.can.image import read_program, sign
from crux_tools.paths import built
from crux_tools.signing_key import new_key
from emulated import elf

START = 0x08000000
KEY, SLOTS, SLOT_BYTES, PAYLOAD = 0x7800, (0x8000, 0x40000), 0x38000, 512
PAGE, KEPT_MARK = 2048, 3 * 8  # behind the marks of three tries
VECTORS = tuple(START + slot + PAYLOAD for slot in SLOTS)


def program_file(name: str) -> Path:
    return built(f"firmware/ports/stm32g474/{name}.elf")


@dataclass
class Maker:
    """Signs what a test needs, with a key of its own."""

    folder: Path
    kind: str = "joint"
    key: Path = field(init=False)

    def __post_init__(self) -> None:
        self.key = self.folder / "key.pem"
        new_key(self.key)

    def image(self, slot: int, version: int, payload: bytes | None = None) -> tuple[bytes, bytes]:
        """Header and payload: the node's own program, or another one."""
        program = payload or read_program(program_file(f"crux_{self.kind}_slot{slot}")).payload
        data, _ = sign(program, self.kind, version, self.key, VECTORS[slot])
        return data[:192], data[192:]

    def board_file(self, version: int = 1, on_trial: tuple[bytes, bytes] | None = None) -> Path:
        """A flash with boot stage, key and an image in slot 0 that has confirmed itself: a mark with its CRC-32.

        `on_trial` is an image for slot 1.
        """
        header, payload = self.image(0, version)
        _, public = sign(b"x", self.kind, version, self.key)
        kept = b"KEPT" + (zlib.crc32(header + payload) ^ 0xFFFFFFFF).to_bytes(4, "little")
        flash = read_program(program_file("crux_boot")).payload.ljust(KEY, b"\xff") + public
        flash = flash.ljust(SLOTS[0], b"\xff") + header.ljust(PAYLOAD, b"\xff") + payload
        flash = flash.ljust(SLOTS[0] + SLOT_BYTES - PAGE + KEPT_MARK, b"\xff") + kept
        if on_trial:
            flash = flash.ljust(SLOTS[1], b"\xff") + on_trial[0].ljust(PAYLOAD, b"\xff") + on_trial[1]
        file = self.folder / f"{self.kind}.elf"
        file.write_bytes(elf(flash))
        return file


def endless(slot: int, length: int) -> bytes:
    """A program that hangs as soon as it starts."""
    stack, here = 0x20018000, VECTORS[slot] + 16 * 4
    vectors = [stack, *[here | 1] * 15]
    code = b"".join(word.to_bytes(4, "little") for word in vectors) + b"\xfe\xe7"  # b .
    return code.ljust(length, b"\x5a")
