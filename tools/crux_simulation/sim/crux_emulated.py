"""ctypes binding of libcrux_emulated.so: node boards whose microcontroller is emulated (see crux_emulated.h)."""

from __future__ import annotations

import ctypes
import functools
import math
from dataclasses import dataclass
from enum import IntEnum
from pathlib import Path

from crux_contracts.can_codec import GRIPPER_NODE
from crux_contracts.motors import flux_Wb
from crux_contracts.robot import Robot

GRIPPER = GRIPPER_NODE
MAIN_LOOP, SYSTICK = 0, 15
ADC = 16 + 18
FDCAN1 = 16 + 21
CAN_ERRORS, CAN_PROTOCOL = 0x40, 0x44  # registers of FDCAN1


class World(ctypes.Structure):
    """emulated_world of emulated_node.h."""

    _fields_ = [
        ("bit_rate", ctypes.c_double),
        ("data_bit_rate", ctypes.c_double),
        ("pole_pairs", ctypes.c_double),
        ("resistance_ohm", ctypes.c_double),
        ("inductance_H", ctypes.c_double),
        ("flux_Wb", ctypes.c_double),
        ("supply_V", ctypes.c_double),
        ("zero_position", ctypes.c_double),
        ("rotor_turns_per_unit", ctypes.c_double),
        ("coarse_turns_per_unit", ctypes.c_double),
        ("effort_per_Nm", ctypes.c_double),
    ]


class _Count(ctypes.Structure):
    """cortex_count of cortex_m4.h."""

    _fields_ = [(name, ctypes.c_uint64) for name in ("instructions", "least_cycles", "most_cycles")]


class _Cycles(ctypes.Structure):
    """cortex_cycles of cortex_cycles.h."""

    _fields_ = [("least", ctypes.c_uint32), ("most", ctypes.c_uint32)]


class _Cost(ctypes.Structure):
    """cortex_cost of cortex_m4.h."""

    _fields_ = [("calls", ctypes.c_uint64), ("sum", _Count), ("worst", _Count)]


@dataclass(frozen=True)
class Cost:
    """What a handler has cost since the board was made, the way in and out not counted."""

    calls: int
    instructions: int
    worst: int
    """instructions of a call"""
    least_cycles: int
    """of a call when nothing waits; 0 unless measured"""
    most_cycles: int
    """of a call that starts with empty caches, and everything waits"""


class Cut(IntEnum):
    """crux_flash_cut of flash_model.h: where in a flash operation the power fails."""

    BEFORE = 0
    WITHIN = 1
    AFTER = 2


class BoardError(Exception):
    """An image that cannot be loaded, or an engine that refuses."""


def world(robot: Robot, node: int) -> World:
    """What surrounds node 1..8 of a limb, from the robot description."""
    motor = robot.gripper_motor if node == GRIPPER else robot.motor
    electrical = {
        "bit_rate": robot.can.bit_rate,
        "data_bit_rate": robot.can.data_bit_rate,
        "pole_pairs": motor.pole_pairs,
        "resistance_ohm": motor.resistance_ohm,
        "inductance_H": motor.inductance_H,
        "flux_Wb": flux_Wb(motor),
        "supply_V": robot.drive.supply_V,
    }
    if node == GRIPPER:
        lead_m = robot.gripper_motor.screw_lead_m
        return World(
            **electrical,
            zero_position=robot.gripper.opening_m[1],  # the rotor turns forward to close
            rotor_turns_per_unit=-1 / lead_m,
            coarse_turns_per_unit=-1 / robot.gripper_motor.coarse_travel_m,
            effort_per_Nm=2 * math.pi / (2 * lead_m),  # of two fingers, before the screw's friction
        )
    return World(
        **electrical,
        zero_position=0.0,
        rotor_turns_per_unit=robot.motor.gear_ratio / (2 * math.pi),
        coarse_turns_per_unit=1 / (2 * math.pi),
        effort_per_Nm=robot.motor.gear_ratio * robot.motor.gear_efficiency,
    )


@functools.cache
def _load(path: Path) -> ctypes.CDLL:
    library = ctypes.CDLL(str(path))
    handle, integer = ctypes.c_void_p, ctypes.c_int
    signatures: dict[str, tuple[object, list[object]]] = {
        "open": (handle, [ctypes.c_char_p, integer, integer, ctypes.POINTER(World)]),
        "close": (None, [handle]),
        "error": (ctypes.c_char_p, []),
        "power_on": (None, [handle, ctypes.c_double]),
        "port": (handle, [handle]),
        "fault": (ctypes.c_char_p, [handle]),
        "instructions": (ctypes.c_uint64, [handle]),
        "cost": (_Cost, [handle, ctypes.c_uint32]),
        "control": (ctypes.c_double, [handle, ctypes.c_double, ctypes.c_double]),
        "measure": (None, [handle, integer]),
        "cycles": (_Cycles, [ctypes.c_uint16, ctypes.c_uint16]),
        "hear": (None, [handle, ctypes.c_uint16, ctypes.c_char_p, integer]),
        "flood": (None, [handle, ctypes.c_uint16, ctypes.c_char_p, integer, integer]),
        "disturb": (None, [handle, integer]),
        "break_encoder": (None, [handle, integer]),
        "break_driver": (None, [handle, integer]),
        "flag_encoder": (None, [handle]),
        "stick_amplifier": (None, [handle, integer, ctypes.c_double]),
        "swap_phases": (None, [handle, integer]),
        "turn_magnets": (None, [handle, ctypes.c_double]),
        "blank": (None, [handle]),
        "cut_power": (None, [handle, ctypes.c_uint32, integer]),
        "record": (integer, [handle]),
        "recorded": (ctypes.c_uint32, [handle]),
        "replay": (None, [handle, ctypes.c_uint32, integer]),
        "look_into": (None, [handle, ctypes.c_char_p]),
        "vectors": (ctypes.c_uint32, [handle]),
        "can_register": (ctypes.c_uint32, [handle, ctypes.c_uint32]),
    }
    for name, (result, arguments) in signatures.items():
        function = getattr(library, f"crux_emulated_{name}")
        function.restype = result
        function.argtypes = arguments
    return library


def cycles(library: Path, first: int, second: int) -> tuple[int, int]:
    """Least and most cycles of an instruction of one or two halves; see cortex_cycles.h."""
    bounds = _load(library).crux_emulated_cycles(first, second)
    return bounds.least, bounds.most


class Board:
    """One emulated node; use as a context manager, and leave it after the nodes it belongs to."""

    def __init__(self, library: Path, image: Path, limb: int, node: int, around: World) -> None:
        """Raises BoardError when the image cannot be loaded."""
        self._library = _load(library)
        self._handle = self._library.crux_emulated_open(str(image).encode(), limb, node, ctypes.byref(around))
        if not self._handle:
            raise BoardError(self._library.crux_emulated_error().decode(errors="replace"))

    def __enter__(self) -> Board:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """Ends the emulation; the second time nothing happens."""
        if self._handle:
            self._library.crux_emulated_close(self._handle)
            self._handle = None

    def power_on(self, position: float) -> None:
        """Boots with the shaft at `position` [rad, m]; otherwise the first control period does it."""
        self._library.crux_emulated_power_on(self._handle, position)

    @property
    def port(self) -> int:
        """Address of the crux_outside_node, for Nodes.replace."""
        return int(self._library.crux_emulated_port(self._handle))

    @property
    def fault(self) -> str:
        """What the image did wrong first; empty when it did nothing wrong."""
        return bytes(self._library.crux_emulated_fault(self._handle)).decode()

    @property
    def instructions(self) -> int:
        """Executed since power-on."""
        return int(self._library.crux_emulated_instructions(self._handle))

    def measure(self, on: bool) -> None:
        """While on, bounds of the cycles are counted."""
        self._library.crux_emulated_measure(self._handle, int(on))

    def cost(self, exception: int) -> Cost:
        """Of an exception's handler, or of MAIN_LOOP from one sleep to the next."""
        cost = self._library.crux_emulated_cost(self._handle, exception)
        worst = cost.worst
        return Cost(cost.calls, cost.sum.instructions, worst.instructions, worst.least_cycles, worst.most_cycles)

    def control(self, dt_s: float, position: float) -> float:
        """A control period without crux_nodes, in which the shaft goes to `position` [rad, m]."""
        return float(self._library.crux_emulated_control(self._handle, dt_s, position))

    def hear(self, identifier: int, data: bytes) -> None:
        """A frame at the start of the next period."""
        self._library.crux_emulated_hear(self._handle, identifier, data, len(data))

    def flood(self, identifier: int, data: bytes, count: int) -> None:
        """So many frames in the FIFO at once, which no bus can bring."""
        self._library.crux_emulated_flood(self._handle, identifier, data, len(data), count)

    def disturb(self, on: bool) -> None:
        """While on, no frame passes; sending fails until the controller is off the bus."""
        self._library.crux_emulated_disturb(self._handle, int(on))

    def break_encoder(self, on: bool) -> None:
        """While on, the motor's encoder does not answer."""
        self._library.crux_emulated_break_encoder(self._handle, int(on))

    def flag_encoder(self) -> None:
        """The motor's encoder finds an error in a command; its answers say so until it is asked which."""
        self._library.crux_emulated_flag_encoder(self._handle)

    def stick_amplifier(self, phase: int, current_A: float = math.nan) -> None:
        """The amplifier of phase 0 (a) or 1 (b) says so whatever flows; without a current it works."""
        self._library.crux_emulated_stick_amplifier(self._handle, phase, current_A)

    def swap_phases(self, on: bool) -> None:
        """While on, phases b and c of the motor are swapped."""
        self._library.crux_emulated_swap_phases(self._handle, int(on))

    def turn_magnets(self, electrical_rad: float) -> None:
        """The magnets are so far from where the calibration has them."""
        self._library.crux_emulated_turn_magnets(self._handle, electrical_rad)

    def blank(self) -> None:
        """The board has never been calibrated; before its power comes on."""
        self._library.crux_emulated_blank(self._handle)

    def break_driver(self, on: bool) -> None:
        """While on, the gate driver reports a fault."""
        self._library.crux_emulated_break_driver(self._handle, int(on))

    def can_register(self, offset: int) -> int:
        """Of FDCAN1."""
        return int(self._library.crux_emulated_can_register(self._handle, offset))

    def cut_power(self, operation: int, cut: Cut = Cut.WITHIN) -> None:
        """The power fails in that write or erase of the flash, counted from 1 now on, until a restart; 0: never."""
        self._library.crux_emulated_cut_power(self._handle, operation, cut)

    def record(self) -> None:
        """Writes and erases of the flash are recorded from now on. Raises MemoryError."""
        if not self._library.crux_emulated_record(self._handle):
            raise MemoryError

    @property
    def recorded(self) -> int:
        """Writes and erases since `record`."""
        return int(self._library.crux_emulated_recorded(self._handle))

    def replay(self, operation: int, cut: Cut) -> None:
        """The flash as if the power had failed in that recorded operation, counted from 1; then `power_on`."""
        self._library.crux_emulated_replay(self._handle, operation, cut)

    def look_into(self, program: Path) -> None:
        """The programs in the slots are those of this ELF file, where the board's state is looked up."""
        self._library.crux_emulated_look_into(self._handle, str(program).encode())

    @property
    def vectors(self) -> int:
        """Address of the vectors of the program that runs."""
        return int(self._library.crux_emulated_vectors(self._handle))
