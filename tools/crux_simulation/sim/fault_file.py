"""Scheduled faults of the buses and of the runtime's process, as `crux climb --faults FILE` reads them.

version: 1
faults:
  - {kind: cut, limb: RF, at_s: 8.0, for_s: 1.0}
  - {kind: reset, limb: LF, node: 3, at_s: 12.0, for_s: 0.2}
  - {kind: power_lost, at_s: 13.0, for_s: 0.3}
  - {kind: runtime_stopped, at_s: 14.0, for_s: 1.0}

Times count from the first control cycle; a climb starts at 2 s. README.md of the tools says what each kind does.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from crux_contracts import LIMB_NAMES
from crux_contracts.can_codec import NODES
from crux_contracts.records import REQUIRED, Records, key, keys_of
from crux_contracts.yaml_document import DocumentError, Node, parse_mapping, read_bytes

VERSION = 1
MAX_FAULTS = 100
MAX_TIME_S = 3600.0
SHARE = 0.3  # of `loss` and `cpu_starved`, unless told

NODE_TWICE = "node_twice"
ON_ANY_BUS = ("cut", "loss", "crc", "stale", "forged", "ahead", "second_master", "reset", "controller_off", NODE_TWICE)
ON_SOCKETCAN = ("bus_off", "error_passive", "unacknowledged", "queue_full", "interface_down")
OF_THE_SUPPLY = "power_lost"  # of all nodes, of a limb's or of one
MOTORS = ("braked", "free")  # without power: windings in short circuit or open
FOR_GOOD = ("runtime_killed", "disk_full")
BY_THE_CLOCK = ("runtime_stopped", "cpu_starved")  # in lockstep physics waits for the runtime
OF_THE_RUNTIME = (*FOR_GOOD, *BY_THE_CLOCK, "lcm_flooded")  # of its process, on no limb
KINDS = (*ON_ANY_BUS, OF_THE_SUPPLY, *ON_SOCKETCAN, *OF_THE_RUNTIME)


@dataclass(frozen=True)
class Fault:
    """One thing that goes wrong on one limb's bus, with the nodes' supply, or with the runtime's process."""

    kind: str = key(REQUIRED, words=KINDS)
    limb: int = key(REQUIRED, words=LIMB_NAMES, reader="limb")
    """0..3; -1: of the runtime, or of all limbs' supply"""
    at_s: float = key(REQUIRED, 0.0, MAX_TIME_S, "s")
    for_s: float = key(0.0, 0.0, MAX_TIME_S, "s")
    node: int = key(0, 1, NODES)
    """0: every one of the limb; of its supply"""
    share: float = key(SHARE, 0.0, 1.0)
    motors: str = key(MOTORS[0], words=MOTORS)

    @property
    def end_s(self) -> float:
        """When it is over; infinite: never."""
        return self.at_s + self.for_s


class _Reader(Records):
    def limb(self, node: Node) -> int:
        return LIMB_NAMES.index(self.check.choice(node, LIMB_NAMES))

    def fault(self, node: Node) -> Fault:
        word = node.content["kind"].content if isinstance(node.content, dict) and "kind" in node.content else ""
        needed: tuple[str, ...] = ("kind", "limb", "at_s", "for_s")
        optional: tuple[str, ...] = ("node", "share")
        if word in OF_THE_RUNTIME:
            needed = ("kind", "at_s") if word in FOR_GOOD else ("kind", "at_s", "for_s")
            optional = ("share",) if word == "cpu_starved" else ()
        if word == OF_THE_SUPPLY:
            needed, optional = ("kind", "at_s"), ("limb", "node", "for_s", "motors")
        members, keys = self.check.members(node, needed, optional), keys_of(Fault)
        if "node" in members and "limb" not in members:
            self.check.note(members["node"], "expected its limb beside it")
        usual: dict[str, Any] = {"kind": "", "limb": -1, "at_s": 0.0, "node": 1}
        if word == OF_THE_SUPPLY:
            usual |= {"for_s": math.inf, "node": 0}
        return Fault(**usual | {name: self.value(keys[name], member) for name, member in members.items()})


def read_faults(path: Path) -> list[Fault]:
    """The faults of a file, by time. Raises DocumentError, OSError."""
    reader, faults = _Reader(str(path)), list[Fault]()
    root = reader.check.members(parse_mapping(read_bytes(path), str(path)), ("version", "faults"))
    if "version" in root:
        reader.check.integer(root["version"], VERSION, VERSION)
    if "faults" in root:
        faults = [reader.fault(node) for node in reader.check.items(root["faults"], MAX_FAULTS)]
    reader.check.finish(DocumentError)
    return sorted(faults, key=lambda fault: fault.at_s)
