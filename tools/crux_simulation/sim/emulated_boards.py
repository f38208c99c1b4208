"""Node boards whose microcontroller is emulated: the images for the Cortex-M4F run instead of the host's library."""

from __future__ import annotations

import json
from collections.abc import Iterator, Sequence
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Any

from crux_contracts import LIMB_NAMES, can_codec
from crux_contracts.robot import Robot
from crux_contracts.robot_bounds import JOINTS
from crux_tools.errors import UsageError, WorkFailed
from crux_tools.paths import built

from crux_simulation.sim import crux_emulated
from crux_simulation.sim.firmware_binding import crux_nodes
from crux_simulation.sim.plant import Plant

LIBRARY = "tools/sim/boards/libcrux_emulated.so"
IMAGES = "firmware/ports/stm32g474"
GRIPPER = can_codec.GRIPPER_NODE


@dataclass(frozen=True, order=True)
class Place:
    """A node of the robot: limb 0..3, node 1..8, of which 7 is the gripper."""

    limb: int
    node: int

    def joint(self, slots: int) -> int | None:
        """Of all joints, limb-major, so many slots a limb; None: a gripper."""
        return None if self.node == GRIPPER else self.limb * slots + can_codec.JOINT_NODES.index(self.node)

    def __str__(self) -> str:
        return f"{LIMB_NAMES[self.limb]}.{self.node}"


def read_places(text: str, slots: int = JOINTS) -> tuple[Place, ...]:
    """Of "LF,RF.7": every node of LF and the gripper of RF; "all": every node; of a robot with `slots` joints a limb.
    Raises UsageError.
    """
    nodes = sorted({*can_codec.JOINT_NODES[:slots], GRIPPER})
    places: set[Place] = set()
    for part in LIMB_NAMES if text == "all" else text.split(","):
        name, _, number = part.partition(".")
        if name not in LIMB_NAMES or (number and number not in map(str, nodes)):
            joints = ", ".join(str(node) for node in nodes if node != GRIPPER)
            raise UsageError(
                f"--emulate: '{part}' is no node: give limbs ({', '.join(LIMB_NAMES)}), nodes such as LF.3 "
                f"({joints} joints, {GRIPPER} gripper), or all"
            )
        places.update(Place(LIMB_NAMES.index(name), node) for node in ([int(number)] if number else nodes))
    return tuple(sorted(places))


def _check_built_for(robot: Robot) -> None:
    """An image carries its robot's numbers: nodes of another robot would never be the runtime's. Raises UsageError."""
    built_for = json.loads(built(f"{IMAGES}/generated/built_for.json").read_text(encoding="utf-8"))
    if built_for["parameter_hash"] == crux_nodes().parameter_hash(robot):
        return
    if built_for["robot"] == robot.name:
        raise UsageError(f"--emulate: the images are older than the description of {robot.name}: make build")
    raise UsageError(
        f"--emulate: the images are built for {built_for['robot']}, the plan is for {robot.name}: climb without "
        f"--emulate, or name {robot.name} in firmware/ports/stm32g474/CMakeLists.txt and make build"
    )


class EmulatedBoards:
    """The boards of some nodes; leaving the context ends their emulation."""

    def __init__(self, places: Sequence[Place], robot: Robot) -> None:
        """Raises UsageError when images or library are not built, or not for this robot, WorkFailed when a board cannot
        be made."""
        _check_built_for(robot)
        self._boards: dict[Place, Any] = {}
        self._held = ExitStack()
        images = {kind: built(f"{IMAGES}/crux_{kind}.elf") for kind in ("joint", "gripper")}
        try:
            for place in places:
                image = images["gripper" if place.node == GRIPPER else "joint"]
                around = crux_emulated.world(robot, place.node)
                board = crux_emulated.Board(built(LIBRARY), image, place.limb, place.node, around)
                self._boards[place] = self._held.enter_context(board)
        except crux_emulated.BoardError as error:
            self._held.close()
            raise WorkFailed(f"emulated boards: {error}") from error

    def __enter__(self) -> EmulatedBoards:
        return self

    def __exit__(self, *_: object) -> None:
        self._held.close()

    def power_on(self, plant: Plant) -> None:
        """Boots them all where the plant stands, so that none is late for the runtime's first Sync."""
        for place, board in self._boards.items():
            joint = place.joint(plant.robot.robot.slots)
            board.power_on(
                float(plant.finger_opening_m[place.limb] if joint is None else plant.joint_position_rad[joint])
            )

    def ports(self) -> Iterator[tuple[Place, int]]:
        """Where each board plugs in: the address of its crux_outside_node."""
        for place, board in self._boards.items():
            yield place, board.port

    def board(self, place: Place) -> Any:
        """The crux_emulated.Board of a node."""
        return self._boards[place]

    def worst_interrupts(self) -> dict[str, int]:
        """Most instructions an interrupt took on any board, by its name."""
        return {
            name: max(board.cost(number).worst for board in self._boards.values())
            for name, number in (("current_loop", crux_emulated.ADC), ("can", crux_emulated.FDCAN1))
        }

    def check(self) -> None:
        """Raises WorkFailed when an image has done something wrong."""
        faults = [f"{place}: {board.fault}" for place, board in self._boards.items() if board.fault]
        if faults:
            raise WorkFailed(f"emulated boards: {'; '.join(faults)}")
