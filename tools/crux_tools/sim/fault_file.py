"""Scheduled faults of the buses, as `crux climb --faults FILE` reads them.

version: 1
faults:
  - {kind: cut, limb: RF, at_s: 8.0, for_s: 1.0}
  - {kind: reset, limb: LF, node: 3, at_s: 12.0, for_s: 0.2}

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
SHARE = 0.3  # of `loss`, unless told

ON_ANY_BUS = ("cut", "loss", "crc", "stale", "forged", "ahead", "second_master", "reset", "controller_off")
ON_SOCKETCAN = ("bus_off", "error_passive", "unacknowledged", "queue_full", "interface_down")
KINDS = ON_ANY_BUS + ON_SOCKETCAN


@dataclass(frozen=True)
class Fault:
    """One thing that goes wrong on one limb's bus."""

    kind: str
    limb: int
    at_s: float
    for_s: float
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
    known = check.members(node, ("kind", "limb", "at_s", "for_s"), ("node", "share"))
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
        limb=LIMB_NAMES.index(limb) if limb in LIMB_NAMES else 0,
        at_s=numbers.get("at_s", 0.0),
        for_s=numbers.get("for_s", 0.0),
        node=number,
        share=numbers.get("share", SHARE),
    )
