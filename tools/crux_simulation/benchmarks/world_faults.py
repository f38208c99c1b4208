"""`crux bench faults --world`: one thing goes wrong with holds, sensors, drives, their supply or the runtime's process,
or two things at once.

A runtime that restarts does so in this process, and a guide leads on.

Faults of the process need a process: the runtime is killed and its disk full in lockstep over UDP; where it is stopped
or starved the climb goes by the clock, in a kernel with virtual time, so that all of these are the same in every run.
Only the flood takes real time: what it costs is what it is about.
"""

from __future__ import annotations

import argparse
import itertools
import math
import re
import shlex
from collections import defaultdict
from collections.abc import Collection
from dataclasses import dataclass, replace
from functools import reduce
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any, NamedTuple

import numpy as np
import yaml
from crux_contracts import LIMB_NAMES
from crux_contracts.channels import FAULT_BY_CODE
from crux_tools.errors import WorkFailed
from crux_tools.output import note, print_json
from crux_tools.report.results import LOG_FILE, Row

from crux_simulation.benchmarks.cold_process import CRUX, GUEST, crux_json
from crux_simulation.benchmarks.worlds import USUAL, Walls
from crux_simulation.campaign.job import AGAIN_FILE, PLAN_FILE, ClimbJob, WorldFile


class InTheWorld(NamedTuple):
    """A fault of the robot or of its holds: its entry in a world file, and the faults by which it is told aright."""

    entry: str
    causes: tuple[str, ...]


def _of_sensor(sensor: str, on: str, error: str, *causes: str) -> InTheWorld:
    return InTheWorld(f"sensors: [{{{{sensor: {sensor}, on: {{{on}}}, error: {error}, from_s: {{at_s}}}}}}]", causes)


WRONG_WRENCH = ("ft_implausible", "unbalanced")
IN_THE_WORLD = {
    "encoder-frozen": _of_sensor("encoder", "joint", "freeze", "encoder_frozen"),
    "encoder-jump": _of_sensor("encoder", "joint", "jump, rad: 0.1", "encoder_jumped"),
    "ft-zero": _of_sensor("force_torque", "limb", "zero", *WRONG_WRENCH),
    "ft-frozen": _of_sensor("force_torque", "limb", "freeze", *WRONG_WRENCH),
    "ft-nan": _of_sensor("force_torque", "limb", "nan", "ft_not_ready"),
    "ft-jump": _of_sensor("force_torque", "limb", "jump, N: [0, 0, 15]", *WRONG_WRENCH),
    "ft-dropout": _of_sensor("force_torque", "limb", "dropout, share: 0.5", "ft_silent", "ft_not_ready"),
    "finger-force-zero": _of_sensor("finger_force", "limb", "zero", "finger_force_implausible"),
    "finger-force-frozen": _of_sensor("finger_force", "limb", "freeze", "finger_force_implausible"),
    "opening-frozen": _of_sensor("finger_opening", "limb", "freeze", "event_timeout", "finger_force_implausible"),
    "gripper-jams": InTheWorld("robot: {{grippers: {{{limb}: {{jams_at_s: {at_s}}}}}}}", ("event_timeout",)),
    "weak-joint": InTheWorld(
        "robot: {{joints: {{{joint}: {{torque_factor: 0.5}}}}}}", ("tracking_error", "ft_implausible")
    ),
    "slippery-hold": InTheWorld("holds: {{{hold}: {{friction_factor: 0.2}}}}", ("grasp_failed", "slip")),
    "hold-breaks": InTheWorld("holds: {{{hold}: {{breaks_at_s: {at_s}}}}}", ("grip_lost", "hold_missing")),
    "hold-missing": InTheWorld("holds: {{{hold}: {{present: false}}}}", ("hold_missing",)),
    "hold-creeps": InTheWorld("holds: {{{hold}: {{viscosity_Ns_m: 18000}}}}", ("hold_creeps", "grasp_failed", "slip")),
    "encoder-drifts": _of_sensor("encoder", "joint", "drift, rad: 0.001", "encoder_drifts"),
    # What a climb has to bear: there is nothing to tell.
    "hold-narrower": InTheWorld("holds: {{{hold}: {{size_change_m: [-0.02, -0.02, 0]}}}}", ()),
    "gripper-slow": InTheWorld("robot: {{grippers: {{{limb}: {{speed_limit_m_s: 0.01}}}}}}", ()),
    "joint-late": InTheWorld("robot: {{joints: {{{joint}: {{dead_cycles: 2}}}}}}", ()),
    "joint-sticks": InTheWorld("robot: {{joints: {{{joint}: {{friction_Nm: 0.5, stiction_Nm: 1.0}}}}}}", ()),
}
LOCKSTEP, BY_THE_CLOCK = ("--bus", "udp"), ("--bus", "udp", "--pace", "realtime")
IN_A_GUEST = ("--bus", "socketcan", "--pace", "realtime")


class ScheduledFault(NamedTuple):
    """Its entry in a file of faults, what a climb may then say, and how it is run."""

    entry: str
    causes: tuple[str, ...]
    options: tuple[str, ...]


LATE = ("26 cycle_late",)
STARVED = (*LATE, "30 all_nodes_silent", "31 all_nodes_hold")  # a flood starves the runtime or the nodes' simulation
OF_THE_RUNTIME = {
    "runtime-killed": ScheduledFault("{{kind: runtime_killed, at_s: {at_s}}}", ("ended by signal 9",), LOCKSTEP),
    "runtime-stopped": ScheduledFault("{{kind: runtime_stopped, at_s: {at_s}, for_s: {for_s}}}", LATE, IN_A_GUEST),
    "cpu-starved": ScheduledFault(
        "{{kind: cpu_starved, at_s: {at_s}, for_s: {for_s}, share: {share}}}", LATE, IN_A_GUEST
    ),
    "lcm-flooded": ScheduledFault("{{kind: lcm_flooded, at_s: {at_s}, for_s: {for_s}}}", STARVED, BY_THE_CLOCK),
    "disk-full": ScheduledFault("{{kind: disk_full, at_s: {at_s}}}", ("log incomplete: file too large",), LOCKSTEP),
}
IN_MEMORY: tuple[str, ...] = ()
OF_THE_SUPPLY = {
    "power-lost": ScheduledFault("{{kind: power_lost, at_s: {at_s}, for_s: {for_s}}}", ("38 power_lost",), IN_MEMORY),
    "power-lost-limb": ScheduledFault(
        "{{kind: power_lost, limb: {limb}, at_s: {at_s}, for_s: {for_s}}}", ("38 power_lost",), IN_MEMORY
    ),
}
SCHEDULED = OF_THE_RUNTIME | OF_THE_SUPPLY
RESTARTS, TELLS_RESTART = "runtime-restarts", "34 restarted"
TWO = "two-at-once"
BESIDE = (  # leave the limb its hold: with another fault three limbs can still bear
    *("encoder-frozen", "encoder-jump", "encoder-drifts", "ft-zero", "ft-frozen", "ft-nan", "ft-jump", "ft-dropout"),
    *("finger-force-zero", "finger-force-frozen", "hold-narrower", "gripper-slow", "joint-late", "joint-sticks"),
)
LOOKS_S = 0.1  # before the end of the plan, at least
KINDS = {kind: fault.entry for kind, fault in (IN_THE_WORLD | SCHEDULED).items()} | {RESTARTS: "", TWO: ""}
LOSES_A_HOLD = ("hold-breaks", "hold-missing", "slippery-hold")  # of whoever grips there
FIRST_S, LAST_S = 6.0, 60.0  # the times of faults, or until the plan ends where that is sooner
START_S = 2.0  # of the climb: there the plan's time begins
FOR_S = (0.3, 2.0)
SHARE = (0.1, 0.8)  # of a core
LEAST_GRIPS = 3  # left as a hold breaks; with fewer another limb was on its way
FAULTS_FILE = "faults.yaml"


@dataclass(frozen=True)
class Fault:
    """What goes wrong in one climb. What depends on the plan is drawn as a share: 0..1."""

    kind: str
    limb: str
    """empty: on no limb, or on that which grips the hold"""
    joint: str = "LF.1"
    when: float = 0.0
    where: float = 0.0
    for_s: float = FOR_S[0]
    share: float = SHARE[0]
    both: tuple[Fault, ...] = ()
    """of TWO: both of them"""

    def at_s(self, plan: Any) -> float:
        """When, from the beginning of a climb of `plan`."""
        return float(round(FIRST_S + self.when * (min(LAST_S, START_S + plan.knots[-1].time_s) - FIRST_S), 1))

    def text(self, plan: Any) -> str:
        """The world file, or the file of faults, for a climb of `plan`."""
        if self.kind in SCHEDULED:
            return f"version: 1\nfaults: [{self._entry(plan)}]\n"
        entries = [yaml.load(fault._entry(plan), yaml.BaseLoader) for fault in self.both or (self,)]
        return f"{_flow(reduce(_merged, entries, {'version': '1', 'name': self.kind}))}\n"

    def _entry(self, plan: Any) -> str:
        at_s = self.at_s(plan)
        holds = gripped(plan, at_s - START_S)
        places = {"limb": self.limb, "joint": self.joint, "hold": holds[int(self.where * len(holds))]}
        return KINDS[self.kind].format(at_s=at_s, for_s=self.for_s, share=self.share, **places)


def _merged(one: Any, other: Any) -> Any:
    """Of two world files: sections of both."""
    if isinstance(one, dict) and isinstance(other, dict):
        return one | other | {key: _merged(one[key], other[key]) for key in one.keys() & other.keys()}
    return one + other if isinstance(one, list) else other


def _flow(value: Any) -> str:
    """As YAML, scalars as they were written."""
    if isinstance(value, dict):
        return "{" + ", ".join(f"{key}: {_flow(each)}" for key, each in value.items()) + "}"
    return "[" + ", ".join(map(_flow, value)) + "]" if isinstance(value, list) else str(value)


def gripped(plan: Any, from_s: float) -> list[int]:
    """The holds that `plan` grips at `from_s` or later, by their number in it: what happens to them matters."""
    last_s = plan.knots[-1].time_s
    knots = [knot for knot in plan.knots if knot.time_s >= min(from_s, last_s)]
    return sorted({limb.hold for knot in knots for limb in knot.limbs if limb.hold >= 0})


def limbs_on(plan: Any, hold: str) -> set[str]:
    """The limbs that grip a hold anywhere in `plan`."""
    number = [each.name for each in plan.holds].index(hold)
    return {
        name for knot in plan.knots for name, limb in zip(LIMB_NAMES, knot.limbs, strict=True) if limb.hold == number
    }


def draw_fault(seed: int) -> Fault:
    """One fault, or two at once, by turns of every kind; place and time are drawn."""
    random = np.random.default_rng(seed)
    kind = list(KINDS)[seed % len(KINDS)]
    fault = _drawn(kind, random)
    if kind != TWO:
        return fault
    first = str(random.choice([each for each in IN_THE_WORLD if each not in BESIDE]))
    second = replace(_drawn(str(random.choice(BESIDE)), random), when=fault.when)
    return replace(fault, both=(replace(_drawn(first, random), when=fault.when), second))


def _drawn(kind: str, random: np.random.Generator) -> Fault:
    limb = LIMB_NAMES[int(random.integers(len(LIMB_NAMES)))]
    joint = f"{limb}.{int(random.integers(1, 7))}"
    when, where = float(random.random()), float(random.random())
    for_s, share = round(float(random.uniform(*FOR_S)), 2), round(float(random.uniform(*SHARE)), 2)
    on_a_limb = "{limb}" in KINDS[kind] or "{joint}" in KINDS[kind]
    return Fault(kind, limb if on_a_limb else "", joint, when, where, for_s, share)


@dataclass(frozen=True)
class FaultyWorld(WorldFile):
    """A world in which one thing goes wrong, drawn for the plan that is climbed."""

    def draw(self, seed: int, plan: Any) -> Any:
        """As of any world file."""
        return WorldFile(self.name, draw_fault(seed).text(plan)).draw(seed, plan)


@dataclass(frozen=True)
class WorldFaultJob(ClimbJob):
    """A climb in a world in which one thing goes wrong, or two."""

    def _measured(self, plan: Any, result: Any) -> dict[str, Any]:
        """Whose holds go wrong, by the plan; where one breaks: how many limbs grip others then, in physics."""
        holds = self.world.draw(self.seed, plan).holds
        found: dict[str, Any] = {"on_holds": sorted(set().union(*(limbs_on(plan, name) for name in holds)))}
        broken = [(name, change.breaks_at_s) for name, change in holds.items() if math.isfinite(change.breaks_at_s)]
        if not broken or result.truth is None:
            return found
        ((name, breaks_at_s),) = broken
        time_s = result.truth.cycle * result.model.model.opt.timestep
        before = np.searchsorted(time_s, breaks_at_s) - 1
        face = result.truth.pad_face[before].reshape(len(LIMB_NAMES), 2)
        hold = np.where(face >= 0, result.model.face_hold[face], -1)
        others = hold != [each.name for each in plan.holds].index(name)
        return found | {"grips_left": int(((hold >= 0) & others).all(axis=1).sum())}


@dataclass(frozen=True)
class ScheduledFaultJob(ClimbJob):
    """A climb in a process of its own, with a file of faults."""

    def climb_command(self) -> str:
        """In a kernel with virtual time where the fault needs that."""
        guest = f"crux {shlex.join(GUEST)} " if self._is_in_a_guest() else ""
        return f"{guest}crux {shlex.join(self._climb_words(Path(), AGAIN_FILE))}"

    def _is_in_a_guest(self) -> bool:
        return SCHEDULED[self.walls].options == IN_A_GUEST

    def _climb_words(self, folder: Path, log: str) -> list[str]:
        words = ["climb", str(folder / PLAN_FILE), "-o", str(folder / log), "--seed", str(self.seed)]
        return [*words, "--faults", str(folder / FAULTS_FILE), *SCHEDULED[self.walls].options]

    def _climb(self, plan: Any, _robot: Any, folder: Path) -> dict[str, Any]:
        (folder / FAULTS_FILE).write_text(draw_fault(self.seed).text(plan), encoding="utf-8")
        guest = (*GUEST, *CRUX) if self._is_in_a_guest() else ()
        result, _ = crux_json(*guest, *self._climb_words(folder, LOG_FILE))
        return {name: value for name, value in result.items() if name != "log"}


@dataclass(frozen=True)
class RestartJob(ClimbJob):
    """A climb whose runtime dies, starts again and is led on by a guide."""

    drawn_by: str = ""
    """the options that draw its wall"""

    def climb_command(self) -> str:
        """Another campaign, of this climb alone."""
        return (
            f"crux bench faults --world --kinds {RESTARTS} --count 1 --seed {self.seed}{self.drawn_by} --output again"
        )

    def _climb(self, plan: Any, robot: Any, folder: Path) -> dict[str, Any]:
        from crux_simulation.sim.restarting import Restarting

        fault = draw_fault(self.seed)
        with TemporaryDirectory() as state, Restarting(plan, robot, folder, Path(state), self.seed) as climb:
            try:
                climb.climb_until(min(fault.at_s(plan) - START_S, plan.knots[-1].time_s - LOOKS_S))
                told = climb.restart(round(fault.for_s / robot.dt_s)).fault.code
                said = climb.guide()
            except WorkFailed as error:
                return {"ok": False, "error": str(error)}
            verdict = climb.verdict()
        ok = verdict.reached_goal and not verdict.fell and not verdict.lost_grips and not verdict.slips
        end = {"reached_goal": verdict.reached_goal, "fell": verdict.fell, "slips": verdict.slips}
        reason = "; ".join([f"{told} {FAULT_BY_CODE[told].name}", *said])
        return end | {"ok": ok, "lost_grips": list(verdict.lost_grips), "reason": reason}


def job_of(fault: Fault, index: int, seed: int, walls: Walls = USUAL) -> ClimbJob:
    """A climb with that fault."""
    wall = walls.of(index, seed)
    if fault.kind == RESTARTS:
        return RestartJob(RESTARTS, wall, seed, drawn_by=walls.words())
    job = ScheduledFaultJob if fault.kind in SCHEDULED else WorldFaultJob
    return job(fault.kind, wall, seed, FaultyWorld(fault.kind, "drawn for its plan"))


def jobs_of(count: int, first_seed: int, kinds: Collection[str] = tuple(KINDS), walls: Walls = USUAL) -> list[ClimbJob]:
    """Climbs with one fault each, of the first seeds whose faults are of `kinds`."""
    jobs = list[ClimbJob]()
    for turn in itertools.count():
        if len(jobs) == count:
            break
        fault = draw_fault(first_seed + turn)
        if fault.kind in kinds:  # other walls in every round, or a kind would always have the same
            index = turn % len(KINDS) + turn // len(KINDS)
            jobs.append(job_of(fault, index, first_seed + turn, walls))
    return jobs


@dataclass(frozen=True)
class Ending:
    """How a climb with a fault ended."""

    kind: str
    climbed: bool
    fell: bool
    lost_grip: bool
    """by another limb than those whose hold the fault is about"""
    told: bool
    """by a fault that names the cause, and the limb it was on where it was on one; of the runtime: that very one, and
    where it died the nodes held the robot"""
    body_m: float
    few_grips: bool = False
    """a hold broke while another limb was on its way: fewer than three grips were left"""


def _names(fault: Fault, told: list[tuple[str, str]], on_holds: list[str] | None) -> bool:
    """A fault of its causes, of its limb, or of one that grips its hold, is among those that were told."""
    limbs = [fault.limb] if fault.limb else on_holds
    return any(name in IN_THE_WORLD[fault.kind].causes and (not limbs or limb in limbs) for name, limb in told)


def ending_of(row: Row, fault: Fault) -> Ending:
    """Of a campaign's row; what a fall and a lost grip are, the judge says."""
    climb: dict[str, Any] = row.get("climb", {})
    body_m = float((climb.get("tracking") or {}).get("body_m") or 0.0)
    few_grips = climb.get("grips_left", LEAST_GRIPS) < LEAST_GRIPS
    fell, lost_grip = bool(climb.get("fell")), bool(climb.get("lost_grips"))
    climbed = bool(climb.get("reached_goal")) and not fell and not lost_grip and not climb.get("slips")
    lost_grip = lost_grip and not any(each.kind in LOSES_A_HOLD for each in fault.both or (fault,))
    if fault.kind == RESTARTS:
        told = climbed and TELLS_RESTART in row["reason"]
    elif fault.kind in SCHEDULED:
        where = f", limb {fault.limb}" if fault.limb else ""
        told = any(f"{cause}{where}" in row["reason"] for cause in SCHEDULED[fault.kind].causes)
        told = told and climb.get("robot_on_wall") is True
    else:
        faults = re.findall(r" s: \d+ (\w+)(?:, limb (\w\w))?", row["reason"])
        told = any(_names(each, faults, climb.get("on_holds")) for each in fault.both or (fault,))
    return Ending(fault.kind, climbed, fell, lost_grip, told, body_m, few_grips)


def line_of(found: list[Ending]) -> dict[str, Any]:
    """How the climbs with one kind of fault ended; those of them with fewer than three grips left once more."""
    few = [end for end in found if end.few_grips]
    line = {
        "climbs": len(found),
        "at_goal": sum(end.climbed for end in found),
        "told": sum(end.told for end in found),
        "lost_grips": sum(end.lost_grip for end in found),
        "fell": sum(end.fell for end in found),
        "most_body_m": max(end.body_m for end in found),
    }
    return {**line, "few_grips": line_of([replace(end, few_grips=False) for end in few])} if few else line


def run(options: argparse.Namespace) -> int:
    """Exit status 0 when nothing fell nor lost a grip that was not the fault's, and every climb told the right cause or
    ended at the goal."""
    from crux_simulation.campaign.engine import run_anew

    jobs = jobs_of(options.count, options.seed, options.kinds, Walls(options.like, options.objective))
    rows = run_anew(jobs, options.output, options, "climbing with one fault")
    endings = [ending_of(row, draw_fault(row["seed"])) for row in rows if "climb" in row]
    ok = all(not end.fell and not end.lost_grip and (end.climbed or end.told) for end in endings)
    kinds: dict[str, list[Ending]] = defaultdict(list)
    for end in endings:
        kinds[end.kind].append(end)
    table = {kind: line_of(found) for kind, found in kinds.items()}
    if options.json:
        print_json({"ok": ok, "count": options.count, "climbed": len(endings), "kinds": table})
        return 0 if ok else 1
    note(f"{'fault':20} {'climbs':>6} {'at goal':>8} {'told':>5} {'lost':>5} {'fell':>5} {'body at most':>13}")
    for kind, line in sorted(table.items()):
        body = f"{1e3 * line['most_body_m']:.1f} mm"
        counts = " ".join(f"{line[name]:5}" for name in ("told", "lost_grips", "fell"))
        note(f"{kind:20} {line['climbs']:6} {line['at_goal']:8} {counts} {body:>13}")
        if few := line.get("few_grips"):
            body = f"{1e3 * few['most_body_m']:.1f} mm"
            note(f"  of these with fewer than three grips left: {few['climbs']}, {few['fell']} fell, {body}")
    note(f"{len(endings)} of {options.count} planned and climbed; results in {options.output}")
    return 0 if ok else 1
