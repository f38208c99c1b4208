"""`crux bench pace`: the same climbs planned for the least J, in the least time and in between, and what that costs."""

from __future__ import annotations

import argparse
from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
import yaml
from crux_contracts.output_file import look_at_folder
from crux_contracts.scenario_document import scenario_document
from crux_contracts.scenario_types import OBJECTIVES
from crux_msgs import robot_state_t
from crux_tools.output import note, print_json, progress
from crux_tools.paths import SCENARIOS
from crux_tools.telemetry import read_log

from crux_simulation.benchmarks.cold_process import crux_json
from crux_simulation.benchmarks.scenes import scene_names

SCENES = ("climb-four-holds", "climb-vertical", "climb-overhang", "climb-diagonal", "climb-obstacles")


@dataclass(frozen=True)
class Pace:
    """One climb; `why_not` is empty where it succeeded."""

    scene: str
    objective: str
    why_not: str
    plan_s: float = 0.0
    m_min: float = 0.0
    """of the body from start to goal, from its first motion on"""
    force_rms_N: float = 0.0
    body_error_m: float = 0.0
    slips: int = 0
    largest_slip_m: float = 0.0


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `crux bench pace`."""
    parser.add_argument("scene", nargs="*", help=f"names of climbs that ship (default: {', '.join(SCENES)})")
    parser.add_argument("--output", type=Path, default=Path("out/bench-pace"), metavar="DIR", help="for plans and logs")


def climbed(scene: str, objective: str, folder: Path) -> Pace:
    """Plans and climbs a scene with this objective; scenario, plan and log stay in `folder`."""
    content = scenario_document((SCENARIOS / f"{scene}.yaml").read_text(encoding="utf-8"))
    content["planner"] = {**content.get("planner", {}), "objective": objective}
    scenario, plan, log = (folder / f"{scene}-{objective}.{end}" for end in ("yaml", "plan.mcap", "log.mcap"))
    scenario.write_text(yaml.safe_dump(content), encoding="utf-8")
    planned, _ = crux_json("plan", str(scenario), "-o", str(plan))
    if not planned.get("ok"):
        return Pace(scene, objective, str(planned.get("error")))
    climb, _ = crux_json("climb", str(plan), "-o", str(log))
    if not climb.get("ok"):
        return Pace(scene, objective, str(climb.get("reason") or climb.get("error")))
    read = read_log(log)
    state, tracking = read.state, climb["tracking"]
    moving = (state["supervisor_state"] == robot_state_t.CLIMBING) & (state["plan_time_s"] > 0.0)
    times, places = read.time_s[moving], state["body_position_w_m"][moving]
    return Pace(
        scene,
        objective,
        "",
        plan_s=float(state["plan_end_s"][-1]),
        m_min=60.0 * float(np.linalg.norm(places[-1] - places[0]) / (times[-1] - times[0])),
        force_rms_N=float(tracking["force_N"]),
        body_error_m=float(tracking["body_m"]),
        slips=int(climb["slips"]),
        largest_slip_m=float(climb["largest_slip_m"]),
    )


def run(options: argparse.Namespace) -> int:
    """Exit status 0 when every climb succeeded without a slip."""
    names, known = options.scene or list(SCENES), [name for name in scene_names() if name.startswith("climb")]
    for name in names:
        if name not in known:
            note(f"crux bench pace: {name}: no such climb; there are {', '.join(known)}")
            return 2
    look_at_folder("--output", options.output)
    pairs = [(name, objective) for name in names for objective in OBJECTIVES]
    results: list[Pace] = []
    with progress("planning and climbing at every pace", len(pairs)) as bar:
        for name, objective in pairs:
            results.append(climbed(name, objective, options.output))
            bar.at(len(results))
    ok = all(not result.why_not and result.slips == 0 for result in results)
    if options.json:
        print_json({"ok": ok, "climbs": [asdict(result) for result in results]})
        return 0 if ok else 1
    heads = f"{'plan s':>7} {'m/min':>6} {'ratio':>6} {'force N':>8} {'body mm':>8} {'slip mm':>8}"
    note(f"{'scene':<18} {'objective':<9} {heads}")
    paper = {result.scene: result.m_min for result in results if result.objective == "paper"}
    for each in results:
        ratio = each.m_min / paper[each.scene] if paper[each.scene] else 0.0
        note(
            f"{each.scene:<18} {each.objective:<9} {each.plan_s:>7.1f} {each.m_min:>6.3f} {ratio:>6.2f} "
            f"{each.force_rms_N:>8.2f} {1e3 * each.body_error_m:>8.1f} {1e3 * each.largest_slip_m:>8.2f}  "
            f"{each.why_not}"
        )
    return 0 if ok else 1
