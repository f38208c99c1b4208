"""`crux bench faults`: every fault of the buses in mid-climb; how long until the robot holds, and whether it stays.

LF swings while RF stands: a fault on RF is one of a limb that bears, one on LF of a limb in the air. What needs a CAN
interface runs over SocketCAN in a kernel of its own with virtual time, the rest over UDP in lockstep; times are those
of the control cycle.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import dataclass
from pathlib import Path

from crux_tools.bench.fault_file import ON_ANY_BUS, ON_SOCKETCAN
from crux_tools.benches.cold_process import crux_json
from crux_tools.errors import WorkFailed
from crux_tools.output import note, print_json, progress
from crux_tools.paths import ROOT

SCENARIO = ROOT / "msgs" / "scenarios" / "climb-one-step.yaml"
AT_S, FOR_S = 8.0, 1.0  # LF is in the air
LONGEST_HOLD_S = 0.1
IN_THE_AIR, BEARING = "LF", "RF"
ALSO_IN_THE_AIR = ("cut", "reset", "interface_down")
BUSES = "can0,can1,can2,can3"
TIMEOUT_S = "300"


@dataclass(frozen=True)
class Row:
    """One fault and what became of it."""

    kind: str
    limb: str
    stopped_s: float | None
    held_s: float | None
    on_wall: bool
    moved_on: bool
    slips: int
    reason: str

    @property
    def ok(self) -> bool:
        """The robot held soon, stayed, and did not go on by itself."""
        return self.held_s is not None and self.held_s <= LONGEST_HOLD_S and self.on_wall and not self.moved_on


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `crux bench faults`."""
    parser.add_argument("--kinds", nargs="+", choices=ON_ANY_BUS + ON_SOCKETCAN, metavar="KIND", help="not all of them")
    parser.add_argument(
        "--output", type=Path, default=Path("out/bench-faults"), metavar="DIR", help="for plan and logs"
    )


def _climb(plan: Path, folder: Path, kind: str, limb: str) -> Row:
    name = folder / f"{kind}-{limb}"
    faults = name.with_suffix(".yaml")
    faults.write_text(f"version: 1\nfaults:\n  - {{kind: {kind}, limb: {limb}, at_s: {AT_S}, for_s: {FOR_S}}}\n")
    climb = ["climb", str(plan), "-o", str(name.with_suffix(".mcap")), "--faults", str(faults)]
    if kind in ON_SOCKETCAN:
        crux = [sys.executable, "-m", "crux_tools.cli"]
        guest = ["can", "run", "--virtual-time", "-i", BUSES, "--timeout", TIMEOUT_S, "--"]
        result, _ = crux_json(*guest, *crux, *climb, "--bus", "socketcan", "--pace", "realtime")
    else:
        result, _ = crux_json(*climb)
    if "faults" not in result:
        raise WorkFailed(f"{kind} on {limb}: {result.get('error', 'no result')}")
    (course,) = result["faults"]
    return Row(
        kind=kind,
        limb=limb,
        stopped_s=course["runtime_s"],
        held_s=course["held_s"],
        on_wall=bool(result["robot_on_wall"]),
        moved_on=bool(course["moved_on"]),
        slips=int(result["slips"]),
        reason=str(result["reason"]),
    )


def _ms(seconds: float | None) -> str:
    return "never" if seconds is None else f"{seconds * 1e3:.0f} ms"


def _table(rows: list[Row]) -> None:
    note(f"{'fault':16} {'limb':5} {'stops':>8} {'holds':>8}  {'on the wall':12} slips")
    for row in rows:
        stays = "yes" if row.on_wall else "FELL"
        mark = "" if row.ok else "  <- not as it must be"
        stops, holds = _ms(row.stopped_s), _ms(row.held_s)
        note(f"{row.kind:16} {row.limb:5} {stops:>8} {holds:>8}  {stays:12} {row.slips}{mark}")


def run(options: argparse.Namespace) -> int:
    """Exit status 0 when after every fault the robot held within LONGEST_HOLD_S and stayed on the wall."""
    options.output.mkdir(parents=True, exist_ok=True)
    plan = options.output / "plan.mcap"
    if not crux_json("plan", str(SCENARIO), "-o", str(plan))[0].get("ok"):
        raise WorkFailed(f"{SCENARIO.name} cannot be planned")
    kinds = options.kinds or ON_ANY_BUS + ON_SOCKETCAN
    cases = [(kind, BEARING) for kind in kinds] + [(kind, IN_THE_AIR) for kind in kinds if kind in ALSO_IN_THE_AIR]
    rows = []
    with progress("faults", len(cases)) as bar:
        for done, (kind, limb) in enumerate(cases):
            rows.append(_climb(plan, options.output, kind, limb))
            bar.at(done + 1)
    if options.json:
        print_json({"ok": all(row.ok for row in rows), "faults": [vars(row) for row in rows]})
    else:
        _table(rows)
    return 0 if all(row.ok for row in rows) else 1
