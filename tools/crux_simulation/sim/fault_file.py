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

from crux_contracts import LIMB_NAMES
from crux_contracts.can_codec import GRIPPER_NODE
from crux_contracts.reading import Checker
from crux_contracts.yaml_document import DocumentError, Node, parse_mapping, read_bytes

VERSION = 1
NODES = GRIPPER_NODE  # the last one
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

    kind: str
    limb: int
    """0..3; -1: of the runtime, or of all limbs' supply"""
    at_s: float
    for_s: float = 0.0
    node: int = 0
    """0: every one of the limb; of its supply"""
    share: float = SHARE
    motors: str = MOTORS[0]

    @property
    def end_s(self) -> float:
        """When it is over; infinite: never."""
        return self.at_s + self.for_s


def read_faults(path: Path) -> list[Fault]:
    """The faults of a file, by time. Raises DocumentError, OSError."""
    check = Checker(str(path))
    root = check.members(parse_mapping(read_bytes(path), str(path)), ("version", "faults"))
    faults = []
    if "version" in root:
        check.integer(root["version"], VERSION, VERSION)
    if "faults" in root:
        faults = [_fault(check, node) for node in check.items(root["faults"], MAX_FAULTS)]
    check.finish(DocumentError)
    return sorted(faults, key=lambda fault: fault.at_s)


def _fault(check: Checker, node: Node) -> Fault:
    word = node.content["kind"].content if isinstance(node.content, dict) and "kind" in node.content else ""
    needed: tuple[str, ...] = ("kind", "limb", "at_s", "for_s")
    optional: tuple[str, ...] = ("node", "share")
    if word in OF_THE_RUNTIME:
        needed = ("kind", "at_s") if word in FOR_GOOD else ("kind", "at_s", "for_s")
        optional = ("share",) if word == "cpu_starved" else ()
    if word == OF_THE_SUPPLY:
        needed, optional = ("kind", "at_s"), ("limb", "node", "for_s", "motors")
    known = check.members(node, needed, optional)
    kind = check.choice(known["kind"], KINDS) if "kind" in known else ""
    limb = check.choice(known["limb"], LIMB_NAMES) if "limb" in known else ""
    numbers = {
        name: check.number(known[name], 0.0, most, "s" if name.endswith("_s") else "")
        for name, most in (("at_s", MAX_TIME_S), ("for_s", MAX_TIME_S), ("share", 1.0))
        if name in known
    }
    number = check.integer(known["node"], 1, NODES) if "node" in known else int(word != OF_THE_SUPPLY)
    if "node" in known and "limb" not in known:
        check.note(known["node"], "expected its limb beside it")
    return Fault(
        kind=kind,
        limb=LIMB_NAMES.index(limb) if limb in LIMB_NAMES else -1,
        at_s=numbers.get("at_s", 0.0),
        for_s=numbers.get("for_s", math.inf if kind == OF_THE_SUPPLY else 0.0),
        node=number,
        share=numbers.get("share", SHARE),
        motors=check.choice(known["motors"], MOTORS) if "motors" in known else MOTORS[0],
    )
