"""`crux can param`: parameters of a node, listed, read, written, saved."""

from __future__ import annotations

import argparse
import math
import struct
from dataclasses import dataclass
from typing import Any

from crux_contracts.node_parameters import table
from crux_contracts.node_services import number
from crux_contracts.terminal import say

from crux_tools.arguments import taught
from crux_tools.can.node_link import DEFAULT_BUSES, NodeLink, limb_bus, node_name
from crux_tools.errors import UsageError
from crux_tools.output import add_json_option, note, print_json

_DESCRIPTION = """Lists, reads, writes and saves parameters of a node over ISO-TP. Values come from the robot
description; what is written stands in for them and is kept without power only after --save. A node takes a
value when it is at rest (HOLD, or not commanded since its start), and only within its range; what carries
the robot is read-only."""
_EXAMPLES = (
    "crux can param LF.joint3",
    "crux can param LF.joint3 setpoint_time_constant_s 0.03 --save",
    "crux can param LF.joint3 --forget",
)


def add_node_options(parser: argparse.ArgumentParser) -> None:
    """NODE, and where its bus is."""
    parser.add_argument("node", metavar="NODE", help="LF.joint1 .. RR.joint7, LF.gripper …")
    parser.add_argument(
        "--bus-base",
        default=DEFAULT_BUSES,
        metavar="URL",
        help="first of the limbs' buses, socketcan:can0 or udp:GROUP:PORT (default: %(default)s)",
    )
    parser.add_argument("--robot", default="scaler", metavar="NAME", help="whose limbs (default: %(default)s)")


def open_link(options: argparse.Namespace) -> NodeLink:
    """The link to the node that the options name."""
    from crux_tools.plan_robot import robot_named

    robot = robot_named(options.robot)
    name = node_name(options.node)
    return NodeLink(name, limb_bus(options.bus_base, robot, name.limb))


def add_param(actions: Any) -> None:
    """crux can param."""
    parser = actions.add_parser(
        "param",
        help="list, read, write and save parameters of a node",
        **taught(_DESCRIPTION, *_EXAMPLES),
    )
    add_node_options(parser)
    parser.add_argument("name", nargs="?", metavar="NAME", help="which parameter (default: list all)")
    parser.add_argument("value", nargs="?", metavar="VALUE", help="write this value")
    keep = parser.add_mutually_exclusive_group()
    keep.add_argument("--save", action="store_true", help="keep what is written without power")
    keep.add_argument("--forget", action="store_true", help="go back to the robot description, also without power")
    add_json_option(parser)
    parser.set_defaults(action=run)


@dataclass(frozen=True)
class Entry:
    """A parameter as the node describes it."""

    id: int
    name: str
    unit: str
    is_integer: bool
    writable: bool
    acts_now: bool
    value: float
    described: float
    least: float
    greatest: float

    def packed(self, value: float) -> bytes:
        """A value as it goes over the bus."""
        return struct.pack("<I", round(value)) if self.is_integer else struct.pack("<f", value)


def _entry(raw: bytes) -> Entry:
    flags = raw[1]
    is_integer = bool(flags & number("flag", "INTEGER"))
    values = struct.unpack("<4I" if is_integer else "<4f", raw[2:18])
    name, unit = (text.decode() for text in raw[18:].split(b"\0")[:2])
    return Entry(
        raw[0],
        name,
        unit,
        is_integer,
        bool(flags & number("flag", "WRITABLE")),
        bool(flags & number("flag", "ACTS_NOW")),
        *values,
    )


def describe(link: NodeLink) -> dict[str, Entry]:
    """All parameters of the node, by name, as the node tells them."""
    entries = [_entry(link.read(number("data", "DESCRIPTION") + parameter.id)) for parameter in table()[link.name.kind]]
    return {entry.name: entry for entry in entries}


def _chosen(entries: dict[str, Entry], name: str, node: str) -> Entry:
    if name not in entries:
        raise UsageError(f"{node} has no parameter {name}; it has {', '.join(entries)}")
    return entries[name]


def _number(entry: Entry, text: str) -> float:
    """The value to write. Raises UsageError where the node would refuse it."""
    try:
        value = float(text)
    except ValueError:
        raise UsageError(f"{entry.name} {text}: not a number") from None
    if not entry.writable:
        raise UsageError(f"{entry.name} is read-only: it carries the robot or fits its mechanics")
    if entry.is_integer and value != round(value):
        raise UsageError(f"{entry.name} {text}: right is a whole number")
    # The node compares single-precision numbers.
    single = (
        struct.unpack("<f", struct.pack("<f", value))[0] if math.isfinite(value) and abs(value) < 1e38 else math.nan
    )
    if not entry.least <= single <= entry.greatest:
        raise UsageError(f"{entry.name} {text}: right is {entry.least:.6g} .. {entry.greatest:.6g} {entry.unit}")
    return value


def write(link: NodeLink, entry: Entry, value: float) -> None:
    """Writes a value and reads it back. Raises Refused."""
    data = number("data", "VALUE") + entry.id
    link.request("WRITE", struct.pack(">H", data) + entry.packed(value))
    link.read(data)


def run_routine(link: NodeLink, name: str) -> None:
    """SAVE or FORGET. Raises Refused."""
    link.request("ROUTINE", struct.pack(">BH", 1, number("routine", name)))


def _line(entry: Entry) -> str:
    number_text = f"{entry.value:d}" if entry.is_integer else f"{entry.value:.6g}"
    text = f"{entry.name:26} {number_text:>10} {entry.unit:7}"
    if not entry.writable:
        return f"{text} read-only"
    changed = "" if entry.value == entry.described else f", description {entry.described:.6g}"
    start = "" if entry.acts_now else ", from the next start"
    return f"{text} {entry.least:.6g} .. {entry.greatest:.6g}{changed}{start}"


def run(options: argparse.Namespace) -> int:
    """Exit status 0 when done, 1 when the node refuses or does not answer."""
    with open_link(options) as link:
        if options.forget:
            if options.value is not None:
                raise UsageError("--forget takes all values back: no VALUE beside it")
            run_routine(link, "FORGET")
        entries = describe(link)
        if options.value is not None:
            entry = _chosen(entries, options.name, str(link.name))
            write(link, entry, _number(entry, options.value))
        if options.save:
            run_routine(link, "SAVE")
        if options.value is not None:
            entries = describe(link)
    shown = entries.values() if options.name is None else [_chosen(entries, options.name, str(link.name))]
    if options.json:
        print_json({"ok": True, "node": str(link.name), "parameters": [vars(entry) for entry in shown]})
        return 0
    for entry in shown:
        say(_line(entry))
    if options.value is not None and not options.save:
        note("not saved: gone at the node's next start; --save keeps it")
    return 0
