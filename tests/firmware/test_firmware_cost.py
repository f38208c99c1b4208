"""What the images' interrupts execute at the worst, and that the count is right."""

from __future__ import annotations

import struct
from pathlib import Path

import pytest
from crux_contracts.robot import Robot, load_robot
from crux_simulation.benchmarks import firmware_cost
from crux_simulation.benchmarks.firmware_cost import SHARE, Load
from emulated import board, elf


@pytest.fixture(scope="module")
def robot() -> Robot:
    return load_robot("scaler")


@pytest.fixture(scope="module")
def loads(robot: Robot) -> dict[tuple[str, str], Load]:
    """Of half as many cycles as `crux bench firmware` lets a case last."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(firmware_cost, "CYCLES", 120)
        return {(load.image, load.interrupt): load for load in firmware_cost.measure(robot)}


def test_every_interrupt_at_its_worst_fits_in_its_share(loads: dict[tuple[str, str], Load]) -> None:
    assert len(loads) == 6
    for load in loads.values():
        assert load.share <= SHARE, load


def test_the_worst_is_found_where_it_should_be(loads: dict[tuple[str, str], Load]) -> None:
    for image in ("joint", "gripper"):
        loop, can = loads[image, "current loop"], loads[image, "CAN"]
        assert can.worst_case == "full FIFO"
        assert can.worst > 3 * can.mean  # three frames, and longer ones
        assert loop.mean < loop.worst < 1.5 * loop.mean
        assert loads[image, "SysTick"].worst < 20


def test_instructions_are_counted_one_by_one(robot: Robot, tmp_path: Path) -> None:
    # movs r0, #0; again: adds r0, #1; cmp r0, #100; bne again; sleep: wfi; b sleep
    code = struct.pack("<II6H", 0x20018000, 0x08000009, 0x2000, 0x3001, 0x2864, 0xD1FC, 0xBF30, 0xE7FD)
    image = tmp_path / "loop.elf"
    image.write_bytes(elf(code))
    with board(robot, 0, 1, image) as emulated:
        emulated.control(0.002, 0.0)
        assert emulated.instructions == 1 + 3 * 100 + 1
