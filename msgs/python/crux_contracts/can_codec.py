"""The CAN database in Python: frames by message name and node, with end-to-end protection (see msgs/can/e2e.h)."""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from functools import cache
from typing import TYPE_CHECKING, Any, cast

from . import robot_bounds
from .places import MSGS

if TYPE_CHECKING:
    from cantools.database.can import Database, Message

DBC = MSGS / "can" / "crux.dbc"
GRIPPER_NODE = robot_bounds.GRIPPER_NODE
NODES = robot_bounds.MOST_JOINTS + 1
JOINT_NODES = tuple(node for node in range(1, NODES + 1) if node != GRIPPER_NODE)  # from the shoulder outwards
HEADER_LENGTH = 3

Values = dict[str, float | int]


class CanCodecError(ValueError):
    """A message name, node or signal that the database does not know, or a value outside its signal's range."""


class Verdict(Enum):
    """As crux_e2e_verdict in e2e.h."""

    OK = 0
    LOST = 1
    REPEATED = 2
    CORRUPT = 3


@dataclass(frozen=True)
class Frame:
    """A CAN FD frame with an 11-bit identifier."""

    identifier: int
    data: bytes


@dataclass(frozen=True)
class Decoded:
    """`name` is the kind without the joint's number ("JointStatus"); `node` is None for the host's messages."""

    name: str
    node: int | None
    values: Values


@dataclass
class Receiver:
    """What a receiver remembers of one identifier."""

    counter: int | None = None


@cache
def database() -> Database:
    """The parsed crux.dbc."""
    from cantools.database import load_file  # loads python-can, too, which few commands need

    return cast("Database", load_file(DBC))


def message(name: str, node: int | None = None) -> Message:
    """The database's message of a kind: ("JointCommand", 3), ("GripperStatus"), ("Sync"). Raises CanCodecError."""
    full = f"Joint{node}{name.removeprefix('Joint')}" if name.startswith("Joint") else name
    try:
        return database().get_message_by_name(full)
    except KeyError:
        raise CanCodecError(f"no message {full} in {DBC.name}") from None


def fault_causes(faults: int) -> list[str]:
    """Names of the causes whose bits a status' `Faults` has; bit 8 is the runtime's own (node_protocol.hpp)."""
    causes: dict[int, Any] = message("JointEmergency", 1).get_signal_by_name("Cause").choices or {}
    numbers = {bit: bit + 1 for bit in range(7)} | {1: 11, 2: 12, 7: 13}
    names = {bit: str(causes[number]) for bit, number in numbers.items()} | {8: "TWO_SENDERS"}
    return [name for bit, name in sorted(names.items()) if faults >> bit & 1]


def crc(identifier: int, payload: bytes | bytearray) -> int:
    """CRC-16, polynomial 0x1021, initial 0xFFFF, over payload[2:] and the identifier, low byte first."""
    value = 0xFFFF
    for byte in (*payload[2:], identifier & 0xFF, identifier >> 8 & 0xFF):
        value ^= byte << 8
        for _ in range(8):
            value = (value << 1 ^ 0x1021 if value & 0x8000 else value << 1) & 0xFFFF
    return value


def encode(name: str, values: Values, counter: int = 0, node: int | None = None) -> Frame:
    """A protected frame. Signals left out are 0; Crc and Counter are filled in. Raises CanCodecError."""
    from cantools.database import EncodeError

    kind = message(name, node)
    known = {signal.name for signal in kind.signals}
    unknown = sorted(set(values) - known)
    if unknown:
        raise CanCodecError(f"{kind.name} has no signal {unknown[0]}; it has {', '.join(sorted(known))}")
    full = {signal.name: 0 for signal in kind.signals} | values | {"Crc": 0, "Counter": counter % 256}
    try:
        payload = bytearray(kind.encode(full, scaling=True, strict=True))
    except (EncodeError, OverflowError, ValueError) as error:
        raise CanCodecError(f"{kind.name}: {error}") from None
    payload[0:2] = crc(kind.frame_id, payload).to_bytes(2, "little")
    return Frame(kind.frame_id, bytes(payload))


def decode(frame: Frame) -> Decoded:
    """Physical values, without any check of the protection. Raises CanCodecError for an unknown or short frame."""
    from cantools.database import DecodeError

    try:
        kind = database().get_message_by_frame_id(frame.identifier)
        values = kind.decode(frame.data, decode_choices=False)
    except KeyError:
        raise CanCodecError(f"no message with identifier 0x{frame.identifier:03X}") from None
    except DecodeError as error:
        raise CanCodecError(f"0x{frame.identifier:03X}: {error}") from None
    name, node = kind.name, None
    if name.startswith("Joint"):
        node, name = int(name[5]), f"Joint{name[6:]}"
    elif name.startswith("Gripper") or name == "ForceTorque":
        node = GRIPPER_NODE
    return Decoded(name, node, cast(Values, values))


def check(frame: Frame, receiver: Receiver) -> Verdict:
    """Judges a received frame as crux_e2e_check does."""
    if len(frame.data) < HEADER_LENGTH or int.from_bytes(frame.data[:2], "little") != crc(frame.identifier, frame.data):
        return Verdict.CORRUPT
    counter = frame.data[2]
    if receiver.counter == counter:
        return Verdict.REPEATED
    is_next = receiver.counter is None or counter == (receiver.counter + 1) % 256
    receiver.counter = counter
    return Verdict.OK if is_next else Verdict.LOST
