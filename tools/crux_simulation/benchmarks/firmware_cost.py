"""`crux bench firmware`: instructions the images' interrupts execute at the worst, on emulated boards, and the least
and the most cycles they can take on a real chip, against the time there is between two of the drive's periods.

The bounds are counted along the instructions that are executed: cortex_account.h says what goes into them.
"""

from __future__ import annotations

import argparse
import math
from collections.abc import Iterator
from contextlib import ExitStack
from dataclasses import asdict, dataclass
from typing import Any

from crux_contracts import can_codec
from crux_contracts.can_codec import Values
from crux_contracts.robot import Robot, load_robot
from crux_tools.output import note, print_json

from crux_simulation.sim import crux_emulated
from crux_simulation.sim.emulated_boards import GRIPPER, EmulatedBoards, Place

CORE_HZ = 170e6
PERIOD_S = 50e-6  # of the current loop
BUDGET_CYCLES = CORE_HZ * PERIOD_S
SHARE = 0.4  # of the budget
# The way into a handler and out of it: 12 cycles each; at most the floating-point registers are stacked too, 17 words,
# and vector and code wait for the flash.
LEAST_ENTRY_AND_EXIT_CYCLES = 2 * 12
MOST_ENTRY_AND_EXIT_CYCLES = 2 * (12 + 17 + 4)
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
    least_cycles: int
    """of the longest call, nothing waits; with the way in and out"""
    most_cycles: int
    """of the longest call, everything waits"""

    @property
    def share(self) -> float:
        """Of the budget, at the most."""
        return self.most_cycles / BUDGET_CYCLES

    @property
    def least_share(self) -> float:
        """Of the budget, at the least."""
        return self.least_cycles / BUDGET_CYCLES

    def as_json(self) -> dict[str, Any]:
        """One entry of `loads` in `crux bench firmware --json`."""
        return {**asdict(self), "share": self.share, "least_share": self.least_share}


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
        limits, index = robot.limbs[place.limb].actuators, can_codec.JOINT_NODES.index(place.node)
        low, high, fastest = (float(e[index]) for e in (limits.low_rad, limits.high_rad, limits.speed_rad_s))
    middle, reach = 0.5 * (low + high), 0.4 * (high - low)
    share = {"swinging": 0.2, "at full speed": 1.0}.get(case, 0.0)
    return middle + reach * math.sin(share * fastest / reach * time_s)


def _live(board: Any, place: Place, robot: Robot, case: str) -> None:
    """One case after power-on."""
    dt_s = robot.dt_s
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
    loads = []
    for image, place in (("joint", Place(0, 2)), ("gripper", Place(0, GRIPPER))):
        costs: dict[int, dict[str, Any]] = {}
        interrupts = {"current loop": crux_emulated.ADC, "CAN": crux_emulated.FDCAN1, "SysTick": crux_emulated.SYSTICK}
        for case in CASES:
            with ExitStack() as stack:
                boards = stack.enter_context(EmulatedBoards([place], robot))
                board = boards.board(place)
                board.measure(True)
                _live(board, place, robot, case)
                boards.check()
                for number in interrupts.values():
                    costs.setdefault(number, {})[case] = board.cost(number)
        loads += [_load(image, name, costs[number]) for name, number in interrupts.items()]
    return loads


def _load(image: str, interrupt: str, costs: dict[str, Any]) -> Load:
    """Of an interrupt whose costs are known by case."""
    worst, worst_case = max((cost.worst, case) for case, cost in costs.items())
    calls = sum(cost.calls for cost in costs.values())
    return Load(
        image=image,
        interrupt=interrupt,
        worst=worst,
        worst_case=worst_case,
        mean=sum(cost.instructions for cost in costs.values()) / max(1, calls),
        least_cycles=max(cost.least_cycles for cost in costs.values()) + LEAST_ENTRY_AND_EXIT_CYCLES,
        most_cycles=max(cost.most_cycles for cost in costs.values()) + MOST_ENTRY_AND_EXIT_CYCLES,
    )


def run(options: argparse.Namespace) -> int:
    """Exit status 0 when every interrupt at its worst fits in its share of the period."""
    loads = measure(load_robot("scaler"))
    good = all(load.share <= SHARE for load in loads)
    if options.json:
        budget = {"cycles": BUDGET_CYCLES, "share": SHARE}
        print_json({"ok": good, "budget": budget, "loads": [load.as_json() for load in loads]})
        return 0 if good else 1
    period_us = PERIOD_S * 1e6
    note(f"{period_us:.0f} us are {BUDGET_CYCLES:.0f} cycles; least: nothing waits; most: caches are empty, all waits")
    for load in loads:
        note(
            f"  {load.image:8}{load.interrupt:13}{load.worst:5} instructions at the worst ({load.worst_case}), "
            f"{load.mean:.0f} in the mean; {load.least_cycles}..{load.most_cycles} cycles at the worst, "
            f"{100 * load.least_share:.1f}..{100 * load.share:.1f} % of the period"
        )
    note(f"{'all' if good else 'not all'} within {100 * SHARE:.0f} %")
    return 0 if good else 1
