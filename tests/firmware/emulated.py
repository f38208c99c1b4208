"""Boards with emulated microcontrollers beside the nodes that a test's host talks to."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

import crux_emulated
from crux_contracts.robot import Robot
from crux_tools.paths import built

GRIPPER = crux_emulated.GRIPPER


def image(node: int) -> Path:
    """The image of node 1..7."""
    return built(f"firmware/ports/stm32g474/crux_{'gripper' if node == GRIPPER else 'joint'}.elf")


@contextmanager
def board(robot: Robot, limb: int, node: int, file: Path | None = None) -> Iterator[crux_emulated.Board]:
    """A board with its own image, or another file's."""
    around = crux_emulated.world(robot, node)
    library = built("firmware/libcrux_emulated.so")
    with crux_emulated.Board(library, file or image(node), limb, node, around) as made:
        yield made
