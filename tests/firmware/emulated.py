"""Boards with emulated microcontrollers beside the nodes that a test's host talks to."""

from __future__ import annotations

import struct
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from crux_contracts.robot import Robot
from crux_simulation.sim import crux_emulated
from crux_tools.paths import built

GRIPPER = crux_emulated.GRIPPER


def image(node: int) -> Path:
    """The image of node 1..7."""
    return built(f"firmware/ports/stm32g474/crux_{'gripper' if node == GRIPPER else 'joint'}.elf")


@contextmanager
def board(robot: Robot, limb: int, node: int, file: Path | None = None) -> Iterator[crux_emulated.Board]:
    """A board with its own image, or another file's."""
    around = crux_emulated.world(robot, node)
    library = built("tools/sim/boards/libcrux_emulated.so")
    with crux_emulated.Board(library, file or image(node), limb, node, around) as made:
        yield made


def elf(code: bytes) -> bytes:
    """An image of one segment at the start of the flash."""
    header = (
        b"\x7fELF\x01\x01\x01" + bytes(9) + struct.pack("<HHIIIIIHHHHHH", 2, 40, 1, 0, 52, 0, 0, 52, 32, 1, 0, 0, 0)
    )
    return header + struct.pack("<8I", 1, 84, 0x08000000, 0x08000000, len(code), len(code), 5, 4) + code
