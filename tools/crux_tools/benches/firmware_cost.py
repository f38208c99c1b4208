"""`crux bench firmware`: instructions the images' interrupts execute at the worst, on emulated boards, against the time
there is between two of the drive's periods."""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Any

from crux_contracts import can_codec
from crux_contracts.can_codec import Values
from crux_contracts.robot import Robot, load_robot

from crux_tools.bench.emulated_boards import GRIPPER, EmulatedBoards, Place
from crux_tools.bench.firmware_binding import binding
from crux_tools.output import note, print_json

CORE_HZ = 170e6
PERIOD_S = 50e-6  # of the current loop
BUDGET_CYCLES = CORE_HZ * PERIOD_S
SHARE = 0.4  # of the budget
# Cycles an instruction takes: most take one, loads two, taken branches two to four, divisions and roots fourteen, and
# the flash answers after four waits where its cache and prefetch miss. Real control code on this core stays below 1.6.
CYCLES_PER_INSTRUCTION = 2.0
ENTRY_AND_EXIT_CYCLES = 2 * 29  # with the floating-point registers
FIFO = 3
LONGEST = bytes(64)
CYCLES = 250  # bus cycles a case lasts
CALM_CYCLES = 40
TRACK, HOLD = 1, 0
CASES = ("still", "swinging", "at full speed", "full FIFO", "encoder broken", "bus off")


@dataclass(frozen=True)
class Load:
    """Of one interrupt of one image, over every case."""

    image: str
    interrupt: str
    worst: int
    worst_case: str
    mean: float

    @property
    def cycles(self) -> float:
        """Assumed at the worst."""
        return self.worst * CYCLES_PER_INSTRUCTION + ENTRY_AND_EXIT_CYCLES

    @property
    def share(self) -> float:
        """Of the budget."""
        return self.cycles / BUDGET_CYCLES

    def as_json(self) -> dict[str, Any]:
        """One entry of `loads` in `crux bench firmware --json`."""
        values = {name: getattr(self, name) for name in ("image", "interrupt", "worst", "worst_case", "mean")}
        return {**values, "cycles": self.cycles, "share": self.share}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `crux bench firmware`: none."""
    del parser


def _frames(place: Place, cycle: int, target: float) -> Iterator[can_codec.Frame]:
    counter = (cycle + 1) % 256
    if place.node == GRIPPER:
        grip: Values = {"Mode": TRACK, "Opening_m": target, "SpeedLimit_m_s": 0.02, "ForceLimit_N": 30.0}
        yield can_codec.encode("GripperCommand", grip, counter)
    else:
        joint: Values = {"Mode": TRACK, "Position_rad": target, "Kp_Nm_rad": 100.0, "Kd_Nms_rad": 4.0}
        yield can_codec.encode("JointCommand", joint, counter, place.node)
    yield can_codec.encode("Sync", {"Cycle": cycle}, counter)


def _path(case: str, place: Place, robot: Robot, time_s: float) -> float:
    """Where the shaft is: within the limits, as fast as the case says."""
    if place.node == GRIPPER:
        low, high = robot.gripper.opening_m
        fastest = robot.gripper.max_finger_speed_m_s
    else:
        joint = robot.limbs[place.limb].joints[place.node - 1]
        low, high, fastest = joint.lower, joint.upper, joint.velocity
    middle, reach = 0.5 * (low + high), 0.4 * (high - low)
    share = {"swinging": 0.2, "at full speed": 1.0}.get(case, 0.0)
    return middle + reach * math.sin(share * fastest / reach * time_s)


def _live(board: Any, place: Place, robot: Robot, case: str) -> None:
    """One case after power-on."""
    dt_s = robot.can.dt_s
    for cycle in range(CYCLES):
        calm = cycle < CALM_CYCLES
        position = _path(case, place, robot, 0.0 if calm else (cycle - CALM_CYCLES) * dt_s)
        for frame in _frames(place, cycle, position):
            board.hear(frame.identifier, frame.data)
            if case == "full FIFO" and not calm:
                board.flood(frame.identifier, LONGEST, FIFO)
        if not calm:
            board.break_encoder(case == "encoder broken" and cycle % 50 < 25)
            board.disturb(case == "bus off" and cycle % 50 < 25)
        board.control(dt_s, position)


def measure(robot: Robot) -> list[Load]:
    """Both images through every case. Raises WorkFailed when an image goes wrong."""
    emulated = binding("emulated", "crux_emulated")
    loads = []
    for image, place in (("joint", Place(0, 2)), ("gripper", Place(0, GRIPPER))):
        worst: dict[int, tuple[int, str]] = {}
        sums: dict[int, list[int]] = {}
        interrupts = {"current loop": emulated.ADC, "CAN": emulated.FDCAN1, "SysTick": emulated.SYSTICK}
        for case in CASES:
            with ExitStack() as stack:
                boards = stack.enter_context(EmulatedBoards([place], robot))
                _live(boards.board(place), place, robot, case)
                boards.check()
                for number in interrupts.values():
                    cost = boards.board(place).cost(number)
                    worst[number] = max(worst.get(number, (0, case)), (cost.worst, case))
                    total = sums.setdefault(number, [0, 0])
                    total[0] += cost.instructions
                    total[1] += cost.calls
        for name, number in interrupts.items():
            mean = sums[number][0] / max(1, sums[number][1])
            loads.append(Load(image, name, *worst[number], mean))
    return loads


def run(options: argparse.Namespace) -> int:
    """Exit status 0 when every interrupt at its worst fits in its share of the period."""
    loads = measure(load_robot("scaler"))
    good = all(load.share <= SHARE for load in loads)
    if options.json:
        budget = {"cycles": BUDGET_CYCLES, "share": SHARE, "cycles_per_instruction": CYCLES_PER_INSTRUCTION}
        print_json({"ok": good, "budget": budget, "loads": [load.as_json() for load in loads]})
        return 0 if good else 1
    period_us = PERIOD_S * 1e6
    note(f"{period_us:.0f} us are {BUDGET_CYCLES:.0f} cycles; {CYCLES_PER_INSTRUCTION:g} are assumed an instruction")
    for load in loads:
        note(
            f"  {load.image:8}{load.interrupt:13}{load.worst:5} instructions at the worst ({load.worst_case}), "
            f"{load.mean:.0f} in the mean: {100 * load.share:.1f} % of the period at the worst"
        )
    note(f"{'all' if good else 'not all'} within {100 * SHARE:.0f} %")
    return 0 if good else 1
