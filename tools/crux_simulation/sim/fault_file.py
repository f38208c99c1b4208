"""Scheduled faults of the buses and of the runtime's process, as `crux climb --faults FILE` reads them.

version: 1
faults:
  - {kind: cut, limb: RF, at_s: 8.0, for_s: 1.0}
  - {kind: reset, limb: LF, node: 3, at_s: 12.0, for_s: 0.2}
  - {kind: runtime_stopped, at_s: 14.0, for_s: 1.0}

Times count from the first control cycle; a climb starts at 2 s. README.md of the tools says what each kind does.
"""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from crux_contracts import LIMB_NAMES
from crux_contracts.reading import Checker
from crux_contracts.yaml_document import DocumentError, Node, parse_mapping, read_bytes

VERSION = 1
NODES = 7
MAX_FAULTS = 100
MAX_TIME_S = 3600.0
SHARE = 0.3  # of `loss` and `cpu_starved`, unless told

NODE_TWICE = "node_twice"
ON_ANY_BUS = ("cut", "loss", "crc", "stale", "forged", "ahead", "second_master", "reset", "controller_off", NODE_TWICE)
ON_SOCKETCAN = ("bus_off", "error_passive", "unacknowledged", "queue_full", "interface_down")
FOR_GOOD = ("runtime_killed", "disk_full")
BY_THE_CLOCK = ("runtime_stopped", "cpu_starved")  # in lockstep physics waits for the runtime
OF_THE_RUNTIME = (*FOR_GOOD, *BY_THE_CLOCK, "lcm_flooded")  # of its process, on no limb
KINDS = ON_ANY_BUS + ON_SOCKETCAN + OF_THE_RUNTIME


@dataclass(frozen=True)
class Fault:
    """One thing that goes wrong on one limb's bus, or with the runtime's process."""

    kind: str
    limb: int
    """0..3; -1: of the runtime"""
    at_s: float
    for_s: float = 0.0
    node: int = 1
    share: float = SHARE

    @property
    def end_s(self) -> float:
        """When it is over."""
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
    known = check.members(node, needed, optional)
    kind = check.choice(known["kind"], KINDS) if "kind" in known else ""
    limb = check.choice(known["limb"], LIMB_NAMES) if "limb" in known else ""
    numbers = {
        name: check.number(known[name], 0.0, most, "s" if name.endswith("_s") else "")
        for name, most in (("at_s", MAX_TIME_S), ("for_s", MAX_TIME_S), ("share", 1.0))
        if name in known
    }
    number = check.integer(known["node"], 1, NODES) if "node" in known else 1
    return Fault(
        kind=kind,
        limb=LIMB_NAMES.index(limb) if limb in LIMB_NAMES else -1,
        at_s=numbers.get("at_s", 0.0),
        for_s=numbers.get("for_s", 0.0),
        node=number,
        share=numbers.get("share", SHARE),
    )
