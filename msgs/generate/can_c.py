"""C codec of the CAN database: cantools' output with one layout per kind of joint message, and the identifiers.

The broadcast command is cut into its parts (header, one joint, gripper), each with a codec of its own.
"""

from __future__ import annotations

import copy
import re
from dataclasses import dataclass, replace
from pathlib import Path

import cantools
from cantools.database.can import Database, Message, Signal
from cantools.database.can.c_source import camel_to_snake_case, generate
from crux_contracts import N_LIMBS
from crux_contracts.can_codec import GRIPPER_NODE, JOINT_NODES, NODES

PREFIX = "crux_can"
BROADCAST = "Broadcast"
_JOINT_MESSAGE = re.compile(r"Joint([1-9])(\w+)")
_JOINT_SIGNAL = re.compile(r"Joint([1-9])(\w+)")
_GRIPPER_SIGNAL = re.compile(r"Gripper(\w+)")


class CanDatabaseError(Exception):
    """A CAN database that breaks the rules the generated code stands on."""


@dataclass(frozen=True)
class Kind:
    """One layout. `base` is the identifier without the node; joint messages have identifier base + node.

    A part of the broadcast command begins at byte `offset` of it; of joints there are `count`, one every
    `message.length` bytes.
    """

    message: Message
    is_joint: bool
    offset: int | None = None
    count: int = 1


def _layout(message: Message) -> tuple[object, ...]:
    signals = tuple(
        (
            s.name, s.start, s.length, s.byte_order, s.is_signed, s.is_float, s.scale, s.offset,
            s.minimum, s.maximum, s.unit, tuple((s.choices or {}).items()),
        )
        for s in message.signals
    )  # fmt: skip
    return (message.length, message.is_fd, signals)


def load(path: Path) -> Database:
    """The DBC, with the rules of crux checked: CAN FD, little-endian, Crc in bytes 0..1 and Counter in byte 2.

    Frames of ISO-TP are none of ours and have a Pci instead.
    """
    database = cantools.database.load_file(path)
    assert isinstance(database, Database)
    for message in database.messages:
        layout = {s.name: (s.start, s.length, s.byte_order) for s in message.signals}
        is_protected = (layout.get("Crc"), layout.get("Counter")) == (
            (0, 16, "little_endian"),
            (16, 8, "little_endian"),
        )
        if not is_protected and layout != {"Pci": (0, 8, "little_endian")}:
            raise CanDatabaseError(f"{path}: {message.name} must begin with a 16-bit Crc and an 8-bit Counter")
        if not message.is_fd or message.is_extended_frame:
            raise CanDatabaseError(f"{path}: {message.name} must be CAN FD with an 11-bit identifier")
        if any(s.byte_order != "little_endian" for s in message.signals):
            raise CanDatabaseError(f"{path}: {message.name} has a big-endian signal")
    return database


def collapse(database: Database) -> list[Kind]:
    """Messages with Joint1X, Joint2X ... folded into one JointX whose identifier is the one of node 0."""
    kinds: list[Kind] = []
    joints: dict[str, list[Message]] = {}
    for message in database.messages:
        match = _JOINT_MESSAGE.fullmatch(message.name)
        if match is None:
            kinds.append(Kind(message, is_joint=False))
            continue
        group = joints.setdefault(match.group(2), [])
        group.append(message)
        node = int(match.group(1))
        if node != JOINT_NODES[len(group) - 1] or message.frame_id != group[0].frame_id + node - 1:
            raise CanDatabaseError(
                f"{message.name}: nodes and identifiers must both count upwards, without the gripper's"
            )
        if _layout(message) != _layout(group[0]):
            raise CanDatabaseError(f"{message.name}: its layout differs from {group[0].name}'s")
    for message in [kind.message for kind in kinds if kind.message.name == BROADCAST]:
        kinds += _parts(message)
    for name, group in joints.items():
        if len(group) != len(JOINT_NODES):
            raise CanDatabaseError(f"Joint*{name}: {len(group)} messages for {len(JOINT_NODES)} joints")
        first = group[0]
        first.name = f"Joint{name}"
        first.frame_id -= 1
        kinds.append(Kind(first, is_joint=True))
    return sorted(kinds, key=lambda kind: kind.message.frame_id)


def _part(message: Message, name: str, signals: dict[str, Signal], byte: int, end_byte: int) -> Kind:
    """The bytes byte .. end_byte of a message as a message, its signals under the names given."""
    moved = []
    for short, signal in signals.items():
        if signal.start < 8 * byte or signal.start + signal.length > 8 * end_byte:
            raise CanDatabaseError(f"{message.name}: {signal.name} is not within bytes {byte} .. {end_byte - 1}")
        copied = copy.copy(signal)
        copied.name = short
        copied.start = signal.start - 8 * byte
        moved.append(copied)
    # Codecs want identifiers that differ; nobody uses those of the parts.
    part = Message(message.frame_id + byte, f"{message.name}{name}", end_byte - byte, moved, is_fd=True)
    return Kind(part, is_joint=False, offset=byte)


def _parts(message: Message) -> list[Kind]:
    """Header, joint and gripper of the broadcast command. Joints follow the header at equal distances, alike."""
    joints: dict[int, dict[str, Signal]] = {}
    gripper: dict[str, Signal] = {}
    header: dict[str, Signal] = {}
    for signal in message.signals:
        if match := _JOINT_SIGNAL.fullmatch(signal.name):
            joints.setdefault(int(match.group(1)), {})[match.group(2)] = signal
        elif match := _GRIPPER_SIGNAL.fullmatch(signal.name):
            gripper[match.group(1)] = signal
        else:
            header[signal.name] = signal
    starts = [min(signal.start for signal in joint.values()) // 8 for joint in joints.values()]
    first, length = starts[0], starts[1] - starts[0]
    end = first + len(joints) * length
    kinds = [
        _part(message, "Joint", joint, first + i * length, first + (i + 1) * length)
        for i, joint in enumerate(joints.values())
    ]
    if any(_layout(kind.message) != _layout(kinds[0].message) for kind in kinds):
        raise CanDatabaseError(f"{message.name}: the joints' layouts differ")
    return [
        _part(message, "Header", header, 0, first),
        replace(kinds[0], count=len(kinds)),
        _part(message, "Gripper", gripper, end, message.length),
    ]


def _coded(kinds: list[Kind]) -> list[Kind]:
    """Layouts with a codec of their own: the broadcast command has them by its parts."""
    return [kind for kind in kinds if kind.message.name != BROADCAST]


def codec(kinds: list[Kind]) -> tuple[str, str]:
    """Header and source by cantools: float quantities, encoded values rounded. The date is taken out."""
    header, source, _, _ = generate(
        Database(messages=[kind.message for kind in _coded(kinds)]),
        PREFIX,
        f"{PREFIX}.h",
        f"{PREFIX}.c",
        f"{PREFIX}_fuzzer.c",
        use_float=True,
        use_round=True,
    )
    stamp = re.compile(r"(generated by cantools version \S+) [^\n]*\d{4}\.")
    return stamp.sub(r"\1.", header), stamp.sub(r"\1.", source)


def _snake(name: str) -> str:
    snake: str = camel_to_snake_case(name)
    return snake


def identifiers(kinds: list[Kind], database: Database) -> str:
    """crux_can_ids.h: identifiers, lengths, nodes, protocol version and encoders that clip to the signal's range."""
    assert database.dbc is not None
    protocol = int(database.dbc.attributes["ProtocolVersion"].value)
    lines = []
    for kind in kinds:
        name = _snake(kind.message.name).upper()
        if kind.offset is not None:
            lines.append(f"#define CRUX_CAN_OFFSET_{name} {kind.offset}u")
            if kind.count > 1:
                lines.append(f"#define CRUX_CAN_{name}S {kind.count}u // a broadcast has room for")
        elif kind.is_joint:
            lines.append(f"#define CRUX_CAN_ID_{name}_BASE 0x{kind.message.frame_id:03X}u")
            lines.append(f"#define CRUX_CAN_ID_{name}(node) (CRUX_CAN_ID_{name}_BASE + (uint32_t)(node))")
        else:
            lines.append(f"#define CRUX_CAN_ID_{name} 0x{kind.message.frame_id:03X}u")
        lines.append(f"#define CRUX_CAN_LENGTH_{name} {kind.message.length}u")
    longest = max(kind.message.length for kind in kinds)
    clipped = "\n".join(
        _clipped_encoder(kind.message, signal) for kind in _coded(kinds) for signal in _scaled(kind.message)
    )
    defines = "\n".join(lines)
    return f"""// Generated from msgs/can/crux.dbc by msgs/generate. Do not edit.
#ifndef CRUX_CAN_IDS_H
#define CRUX_CAN_IDS_H

#include <stdint.h>

#include "crux_can.h"

#define CRUX_CAN_PROTOCOL_VERSION {protocol}u
#define CRUX_CAN_LIMBS {N_LIMBS}u // each with a bus of its own
#define CRUX_CAN_JOINTS {len(JOINT_NODES)}u // of a limb at most
#define CRUX_CAN_NODE_GRIPPER {GRIPPER_NODE}u
// Joints have the nodes 1 .. CRUX_CAN_NODES but the gripper's, from the shoulder outwards; they count from 0.
#define CRUX_CAN_NODE_OF_JOINT(joint) ((joint) + (((joint) + 1u < CRUX_CAN_NODE_GRIPPER) ? 1u : 2u))
#define CRUX_CAN_JOINT_OF_NODE(node) ((node) - (((node) < CRUX_CAN_NODE_GRIPPER) ? 1u : 2u))
// Bit of a status' Faults that a cause has: n - 1, and of causes 11, 12, 13 the bits of 2, 3, 8, which are events.
#define CRUX_CAN_FAULT_BIT(cause) (1u << ((cause) - (((cause) > 12u) ? 6u : ((cause) > 10u) ? 10u : 1u)))
#define CRUX_CAN_NODES {NODES}u
#define CRUX_CAN_MAX_LENGTH {longest}u

{defines}

#ifdef __cplusplus
extern "C" {{
#endif

// A number outside the signal's range goes out as the nearest end of the range, not-a-number as 0.
{clipped}

#ifdef __cplusplus
}}
#endif

#endif
"""


def _scaled(message: Message) -> list[cantools.database.can.Signal]:
    return [s for s in message.signals if not s.is_float and s.scale != 1]


def _c_type(signal: cantools.database.can.Signal) -> str:
    bits = next(size for size in (8, 16, 32) if signal.length <= size)
    return f"{'' if signal.is_signed else 'u'}int{bits}_t"


def _clipped_encoder(message: Message, signal: cantools.database.can.Signal) -> str:
    full = f"{PREFIX}_{_snake(message.name)}_{_snake(signal.name)}"
    c_type = _c_type(signal)
    low = -(1 << (signal.length - 1)) if signal.is_signed else 0
    high = (1 << (signal.length - 1)) - 1 if signal.is_signed else (1 << signal.length) - 1
    return (
        f"static inline {c_type} {full}_encode_clipped(float value)\n{{\n"
        f"    if (value != value) {{\n        return 0;\n    }}\n"
        f"    if (value <= {_literal(low * signal.scale)}) {{\n        return ({c_type})({low});\n    }}\n"
        f"    if (value >= {_literal(high * signal.scale)}) {{\n        return ({c_type}){high};\n    }}\n"
        f"    return {full}_encode(value);\n}}\n"
    )


def _literal(number: float) -> str:
    text = f"{number:.9g}"
    return f"{text}f" if "." in text or "e" in text else f"{text}.0f"
