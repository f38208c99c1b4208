"""`crux bench faults`: every fault of the buses in mid-climb; how long until the robot holds, and whether it stays.

LF swings while RF stands: a fault on RF is one of a limb that bears, one on LF of a limb in the air. All run over
SocketCAN in a kernel of their own with virtual time, so the times are those of the control cycle whatever the machine
does meanwhile.
"""

from __future__ import annotations

import argparse
from dataclasses import asdict, dataclass, field
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from crux_contracts.output_file import look_at_folder
from crux_contracts.scenario_types import OBJECTIVES
from crux_tools.arguments import whole
from crux_tools.errors import UsageError, WorkFailed
from crux_tools.output import note, print_json
from crux_tools.paths import SCENARIOS
from crux_tools.report.results import FAILED, HELD, LOG_FILE

from crux_simulation.benchmarks import world_faults
from crux_simulation.benchmarks.cold_process import CRUX, GUEST, crux_json
from crux_simulation.benchmarks.worlds import add_like_option
from crux_simulation.campaign.command import add_cluster_options
from crux_simulation.campaign.job import NOMINAL, PLAN_FILE, Outcome
from crux_simulation.sim.fault_file import NODE_TWICE, ON_ANY_BUS, ON_SOCKETCAN

SCENARIO = SCENARIOS / "climb-one-step.yaml"
AT_S, FOR_S = 8.0, 1.0  # LF is in the air
LONGEST_HOLD_S = 0.1
ON_BUSES = ON_ANY_BUS + ON_SOCKETCAN
IN_THE_AIR, BEARING = "LF", "RF"
ALSO_IN_THE_AIR = ("cut", "reset", "controller_off", "interface_down")
OF_ONE_NODE = ("reset", "controller_off", NODE_TWICE)
JOINT, GRIPPER = 2, 7  # the shoulder's pitch bears most


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
class Found:
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
    of_the_buses, in_the_world = ", ".join(ON_BUSES), ", ".join(world_faults.KINDS)
    parser.add_argument(
        "--kinds",
        nargs="+",
        choices=(*ON_BUSES, *world_faults.KINDS),
        metavar="KIND",
        help=f"not all of them; of the buses: {of_the_buses}; with --world: {in_the_world}",
    )
    parser.add_argument(
        "--images", action="store_true", help="the limb's nodes run their images on emulated microcontrollers"
    )
    parser.add_argument(
        "--world", action="store_true", help="faults of holds, sensors, drives and the runtime, one or two at once"
    )
    parser.add_argument(
        "--count", type=whole(1), default=300, metavar="N", help="with --world: climbs (default: %(default)s)"
    )
    parser.add_argument(
        "--seed", type=whole(0), default=1, metavar="N", help="with --world: of the first (default: %(default)s)"
    )
    parser.add_argument(
        "--objective", choices=OBJECTIVES, help="with --world: what climbs are planned for (default: as walls say)"
    )
    add_like_option(parser)
    parser.add_argument(
        "--output", type=Path, default=Path("out/bench-faults"), metavar="DIR", help="for results, and logs of failures"
    )
    add_cluster_options(parser)


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


@dataclass(frozen=True)
class FaultJob:
    """A climb of `plan`, the bytes of its file, with one fault."""

    case: Case
    images: bool
    plan: bytes = field(repr=False)

    @property
    def key(self) -> str:
        """In words."""
        return f"{self.case.kind}-{self.case.where}-{self.case.for_s:g}s{'-images' if self.images else ''}"

    def labels(self) -> dict[str, Any]:
        """As of a climb."""
        return {"walls": self.case.kind, "wall_seed": 0, "world": NOMINAL, "seed": 0, "method": ""}

    def run(self) -> Outcome:
        """Climbs under a kernel with virtual time."""
        with TemporaryDirectory(prefix="crux-fault-") as name:
            plan, log, faults = (Path(name) / file for file in (PLAN_FILE, LOG_FILE, "faults.yaml"))
            plan.write_bytes(self.plan)
            faults.write_text(self.case.document())
            climb = ["climb", str(plan), "-o", str(log), "--faults", str(faults)]
            emulated = ["--emulate", self.case.limb] if self.images else []
            result, _ = crux_json(*GUEST, *CRUX, *climb, "--bus", "socketcan", "--pace", "realtime", *emulated)
            files = {file.name: file.read_bytes() for file in Path(name).iterdir()}
        if "faults" not in result:
            raise WorkFailed(f"{self.case.kind} on {self.case.where}: {result.get('error', 'no result')}")
        found = self._found(result)
        row = {"key": self.key, **self.labels(), "verdict": HELD if found.ok else FAILED, "reason": found.reason}
        return Outcome(row | {"fault": asdict(found)}, files)

    def _found(self, result: dict[str, Any]) -> Found:
        (course,) = result["faults"]
        return Found(
            kind=self.case.kind,
            where=self.case.where,
            for_s=self.case.for_s,
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


def _line(row: Found) -> str:
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
    from crux_simulation.campaign.engine import run_anew

    look_at_folder("--output", options.output)
    kinds = tuple(world_faults.KINDS) if options.world else ON_BUSES
    options.kinds = tuple(options.kinds or kinds)
    for kind in options.kinds:
        if kind not in kinds:
            raise UsageError(f"--kinds {kind}: {'a fault of the buses' if options.world else 'only with --world'}")
    if options.world:
        return world_faults.run(options)
    plan = options.output / "plan.mcap"
    if not crux_json("plan", str(SCENARIO), "-o", str(plan))[0].get("ok"):
        raise WorkFailed(f"{SCENARIO.name} cannot be planned")
    tried = cases(options.kinds)
    jobs = [FaultJob(case, options.images, plan.read_bytes()) for case in tried]
    rows = [Found(**row["fault"]) for row in run_anew(jobs, options.output, options, "breaking the buses")]
    if options.json:
        print_json({"ok": all(row.ok for row in rows), "faults": [asdict(row) for row in rows]})
    else:
        note("\n".join([HEAD, *map(_line, rows)]))
    return 0 if all(row.ok for row in rows) else 1
