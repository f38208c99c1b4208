"""`crux bench faults --world`: one thing goes wrong with holds, sensors or drives at a random time of a climb."""

from __future__ import annotations

import argparse
import re
from collections import defaultdict
from dataclasses import dataclass
from typing import Any

import numpy as np
from crux_contracts import LIMB_NAMES

from crux_tools.benchmarks.worlds import wall_of
from crux_tools.campaign.job import CLIMBED, ClimbJob, WorldFile
from crux_tools.campaign.store import Row
from crux_tools.output import note, print_json

KINDS = {
    "encoder-frozen": "sensors: [{{sensor: encoder, on: {joint}, error: freeze, from_s: {at_s}}}]",
    "encoder-jump": "sensors: [{{sensor: encoder, on: {joint}, error: jump, rad: 0.1, from_s: {at_s}}}]",
    "ft-zero": "sensors: [{{sensor: force_torque, on: {limb}, error: zero, from_s: {at_s}}}]",
    "ft-frozen": "sensors: [{{sensor: force_torque, on: {limb}, error: freeze, from_s: {at_s}}}]",
    "ft-nan": "sensors: [{{sensor: force_torque, on: {limb}, error: nan, from_s: {at_s}}}]",
    "ft-jump": "sensors: [{{sensor: force_torque, on: {limb}, error: jump, N: [0, 0, 15], from_s: {at_s}}}]",
    "ft-dropout": "sensors: [{{sensor: force_torque, on: {limb}, error: dropout, share: 0.5, from_s: {at_s}}}]",
    "finger-force-zero": "sensors: [{{sensor: finger_force, on: {limb}, error: zero, from_s: {at_s}}}]",
    "finger-force-frozen": "sensors: [{{sensor: finger_force, on: {limb}, error: freeze, from_s: {at_s}}}]",
    "opening-frozen": "sensors: [{{sensor: finger_opening, on: {limb}, error: freeze, from_s: {at_s}}}]",
    "gripper-jams": "robot: {{grippers: {{{limb}: {{jams_at_s: {at_s}}}}}}}",
    "weak-joint": "robot: {{joints: {{{joint}: {{torque_factor: 0.5}}}}}}",
    "slippery-hold": "holds: {{{hold}: {{friction_factor: 0.2}}}}",
    "hold-breaks": "holds: {{{hold}: {{breaks_at_s: {at_s}}}}}",
    "hold-missing": "holds: {{{hold}: {{present: false}}}}",
}
WITHOUT_A_LIMB = ("slippery-hold", "hold-breaks", "hold-missing")  # whoever grips there
LOSES_A_HOLD = ("hold-breaks", "hold-missing", "slippery-hold")
TIMES_S = (6.0, 60.0)
HOLDS = 8
FALL_M = 0.100


@dataclass(frozen=True)
class Fault:
    """What goes wrong in one climb."""

    kind: str
    limb: str
    text: str
    """the world file"""


def draw_fault(seed: int) -> Fault:
    """One fault, by turns of every kind; place and time are drawn."""
    random = np.random.default_rng(seed)
    kind = list(KINDS)[seed % len(KINDS)]
    limb = LIMB_NAMES[int(random.integers(len(LIMB_NAMES)))]
    joint = f"{limb}.{int(random.integers(1, 7))}"
    place = {"limb": limb, "joint": joint, "hold": int(random.integers(HOLDS))}
    entry = KINDS[kind].format(at_s=round(float(random.uniform(*TIMES_S)), 1), **place)
    return Fault(kind, "" if kind in WITHOUT_A_LIMB else limb, f"version: 1\nname: {kind}\n{entry}\n")


def jobs_of(count: int, first_seed: int) -> list[ClimbJob]:
    """Shipped scenes and random walls in turn, each with one fault."""
    faults = [draw_fault(first_seed + index) for index in range(count)]
    return [
        ClimbJob(fault.kind, wall_of(index, first_seed + index), first_seed + index, WorldFile(fault.kind, fault.text))
        for index, fault in enumerate(faults)
    ]


@dataclass(frozen=True)
class Ending:
    """How a climb with a fault ended."""

    kind: str
    climbed: bool
    fell: bool
    told: bool
    """a fault was told, of the limb it was on where it was on one"""
    body_m: float


def ending_of(row: Row, fault: Fault) -> Ending:
    """A limb that has lost its hold has not fallen where the body stays."""
    climb: dict[str, Any] = row.get("climb", {})
    body_m = float((climb.get("tracking") or {}).get("body_m") or 0.0)
    fell = bool(climb.get("fell")) if fault.kind not in LOSES_A_HOLD else body_m > FALL_M
    faults = re.findall(r" s: (\d+) \w+(?:, limb (\w\w))?", row["reason"])
    told = any(not fault.limb or limb == fault.limb for _, limb in faults)
    return Ending(fault.kind, row["verdict"] == CLIMBED, fell, told, body_m)


def run(options: argparse.Namespace) -> int:
    """Exit status 0 when nothing fell, and every climb ended at the goal or with its fault told of the right limb."""
    from crux_tools.campaign.engine import run_anew

    rows = run_anew(jobs_of(options.count, options.seed), options.output, options, "climbing with one fault")
    endings = [ending_of(row, draw_fault(row["seed"])) for row in rows if "climb" in row]
    ok = all(not end.fell and (end.climbed or end.told) for end in endings)
    kinds: dict[str, list[Ending]] = defaultdict(list)
    for end in endings:
        kinds[end.kind].append(end)
    table = {
        kind: {
            "climbs": len(found),
            "at_goal": sum(end.climbed for end in found),
            "told": sum(end.told for end in found),
            "fell": sum(end.fell for end in found),
            "most_body_m": max(end.body_m for end in found),
        }
        for kind, found in kinds.items()
    }
    if options.json:
        print_json({"ok": ok, "count": options.count, "climbed": len(endings), "kinds": table})
        return 0 if ok else 1
    note(f"{'fault':20} {'climbs':>6} {'at goal':>8} {'told':>5} {'fell':>5} {'body at most':>13}")
    for kind, line in sorted(table.items()):
        body = f"{1e3 * line['most_body_m']:.1f} mm"
        note(f"{kind:20} {line['climbs']:6} {line['at_goal']:8} {line['told']:5} {line['fell']:5} {body:>13}")
    note(f"{len(endings)} of {options.count} planned and climbed; results in {options.output}")
    return 0 if ok else 1
