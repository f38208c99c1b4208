"""`crux bench faults`: every fault of the buses in mid-climb; how long until the robot holds, and whether it stays.

LF swings while RF stands: a fault on RF is one of a limb that bears, one on LF of a limb in the air. All run over
SocketCAN in a kernel of their own with virtual time, so the times are those of the control cycle whatever the machine
does meanwhile.
"""

from __future__ import annotations

import argparse
import sys
from dataclasses import asdict, dataclass
from pathlib import Path

from crux_contracts.output_file import look_at_folder

from crux_tools.benchmarks.cold_process import crux_json
from crux_tools.errors import WorkFailed
from crux_tools.output import note, print_json, progress
from crux_tools.paths import ROOT
from crux_tools.sim.fault_file import ON_ANY_BUS, ON_SOCKETCAN

SCENARIO = ROOT / "msgs" / "scenarios" / "climb-one-step.yaml"
AT_S, FOR_S = 8.0, 1.0  # LF is in the air
LONGEST_HOLD_S = 0.1
IN_THE_AIR, BEARING = "LF", "RF"
ALSO_IN_THE_AIR = ("cut", "reset", "controller_off", "interface_down")
OF_ONE_NODE = ("reset", "controller_off")
JOINT, GRIPPER = 2, 7  # the shoulder's pitch bears most
BUSES = "can0,can1,can2,can3"
TIMEOUT_S = "900"


@dataclass(frozen=True)
class Case:
    """One fault to be tried."""

    kind: str
    limb: str
    node: int = JOINT
    for_s: float = FOR_S

    @property
    def where(self) -> str:
        """Limb, and node where it is one's."""
        return f"{self.limb}.{self.node}" if self.kind in OF_ONE_NODE else self.limb

    def document(self) -> str:
        """As `crux climb --faults` reads it."""
        numbers = f"node: {self.node}, at_s: {AT_S}, for_s: {self.for_s}"
        return f"version: 1\nfaults:\n  - {{kind: {self.kind}, limb: {self.limb}, {numbers}}}\n"


@dataclass(frozen=True)
class Row:
    """One fault and what became of it."""

    kind: str
    where: str
    for_s: float
    stopped_s: float | None
    held_s: float | None
    moved_m: float | None
    on_wall: bool
    moved_on: bool
    slips: int
    cause: str | None
    reason: str

    @property
    def ok(self) -> bool:
        """The robot held soon, said why, stayed, and did not go on by itself."""
        held = self.held_s is not None and self.held_s <= LONGEST_HOLD_S and self.cause is not None
        return held and self.on_wall and not self.moved_on


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `crux bench faults`."""
    parser.add_argument("--kinds", nargs="+", choices=ON_ANY_BUS + ON_SOCKETCAN, metavar="KIND", help="not all of them")
    parser.add_argument(
        "--images", action="store_true", help="the limb's nodes run their images on emulated microcontrollers"
    )
    parser.add_argument(
        "--output", type=Path, default=Path("out/bench-faults"), metavar="DIR", help="for plan and logs"
    )


def cases(kinds: tuple[str, ...]) -> list[Case]:
    """Every kind on a limb that bears, some on one in the air; of one node: a joint and a gripper."""
    found = []
    for kind in kinds:
        for limb in (BEARING, IN_THE_AIR) if kind in ALSO_IN_THE_AIR else (BEARING,):
            if kind == "reset":  # back at once, and silent for long
                found += [Case(kind, limb, for_s=0.0), Case(kind, limb)]
            else:
                found.append(Case(kind, limb))
        if kind in OF_ONE_NODE:
            found.append(Case(kind, BEARING, GRIPPER, 0.0 if kind == "reset" else FOR_S))
    return found


def _climb(plan: Path, folder: Path, case: Case, images: bool) -> Row:
    name = folder / f"{case.kind}-{case.where}-{case.for_s:g}s"
    faults = name.with_name(f"{name.name}.yaml")
    faults.write_text(case.document())
    guest = ["can", "run", "--virtual-time", "-i", BUSES, "--timeout", TIMEOUT_S, "--"]
    climb = [sys.executable, "-m", "crux_tools.cli", "climb", str(plan), "-o", f"{name}.mcap", "--faults", str(faults)]
    emulated = ["--emulate", case.limb] if images else []
    result, _ = crux_json(*guest, *climb, "--bus", "socketcan", "--pace", "realtime", *emulated)
    if "faults" not in result:
        raise WorkFailed(f"{case.kind} on {case.where}: {result.get('error', 'no result')}")
    (course,) = result["faults"]
    return Row(
        kind=case.kind,
        where=case.where,
        for_s=case.for_s,
        stopped_s=course["runtime_s"],
        held_s=course["held_s"],
        moved_m=course["moved_m"],
        on_wall=bool(result["robot_on_wall"]),
        moved_on=bool(course["moved_on"]),
        slips=int(result["slips"]),
        cause=course["cause"],
        reason=str(result["reason"]),
    )


def _ms(seconds: float | None) -> str:
    return "never" if seconds is None else f"{seconds * 1e3:.0f} ms"


HEAD = f"{'fault':16} {'where':5} {'lasts':>6} {'stops':>7} {'holds':>7} {'moves':>7}  {'on wall':8} slips  cause"


def _line(row: Row) -> str:
    stays = "yes" if row.on_wall else "FELL"
    mark = "" if row.ok else "  <- not as it must be"
    moves = "?" if row.moved_m is None else f"{row.moved_m * 1e3:.1f} mm"
    lasts = f"{row.for_s:g} s" if row.for_s > 0 else "-"
    return (
        f"{row.kind:16} {row.where:5} {lasts:>6} {_ms(row.stopped_s):>7} {_ms(row.held_s):>7} {moves:>7}  "
        f"{stays:8} {row.slips:<5}  {row.cause or 'none'}{mark}"
    )


def run(options: argparse.Namespace) -> int:
    """Exit status 0 when after every fault the robot held within LONGEST_HOLD_S and stayed on the wall."""
    look_at_folder("--output", options.output)
    plan = options.output / "plan.mcap"
    if not crux_json("plan", str(SCENARIO), "-o", str(plan))[0].get("ok"):
        raise WorkFailed(f"{SCENARIO.name} cannot be planned")
    tried = cases(tuple(options.kinds or ON_ANY_BUS + ON_SOCKETCAN))
    rows = []
    with progress("faults", len(tried)) as bar:
        if not options.json:
            note(HEAD)
        for done, case in enumerate(tried):
            rows.append(_climb(plan, options.output, case, options.images))
            if not options.json:
                note(_line(rows[-1]))
            bar.at(done + 1)
    if options.json:
        print_json({"ok": all(row.ok for row in rows), "faults": [asdict(row) for row in rows]})
    return 0 if all(row.ok for row in rows) else 1
