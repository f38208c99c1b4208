"""`crux bench fast`: random walls planned for the least time, each climbed as planned and in a drawn world.

Walls are drawn by turns: four holds on any slope up to vertical, a ladder with obstacles, and two hold fields. A wall
without a plan within its limit is counted, not climbed.
"""

from __future__ import annotations

import argparse
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from crux_contracts.output_file import look_at_folder
from crux_contracts.scenario_types import OBJECTIVES
from crux_tools.arguments import whole
from crux_tools.output import note, print_json
from crux_tools.report.results import CLIMBED, Row
from crux_tools.report.statistics import Rate

from crux_simulation.benchmarks.replanned_climbs import LoopJob
from crux_simulation.benchmarks.worlds import AT_GOAL_SHARE, WORLD, cause_of, fell, lost_grip
from crux_simulation.campaign.command import add_cluster_options
from crux_simulation.campaign.job import ClimbJob, WorldFile
from crux_simulation.campaign.walls import Wall

LIMIT_S = 30.0  # of planning a wall
MOST_FORCE_N, MOST_BODY_M = 1.5, 0.005
SLOPE_DEG = (20.0, 90.0)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `crux bench fast`."""
    parser.add_argument("--count", type=whole(1), default=50, metavar="N", help="walls (default: %(default)s)")
    parser.add_argument("--seed", type=whole(0), default=1, metavar="N", help="of the first (default: %(default)s)")
    parser.add_argument(
        "--objective", choices=OBJECTIVES, default="time", help="what they are planned for (default: %(default)s)"
    )
    parser.add_argument("--world", type=Path, default=WORLD, metavar="FILE.yaml", help="drawn from (default: ordinary)")
    parser.add_argument(
        "--output", type=Path, default=Path("out/bench-fast"), metavar="DIR", help="for results, and logs of failures"
    )
    add_cluster_options(parser)


@dataclass(frozen=True)
class FastJob(LoopJob):
    """A climb of which the speed is asked as well: the body's, straight from start to end."""

    def _measured(self, plan: Any, result: Any) -> dict[str, Any]:
        told = super()._measured(plan, result)
        places_m = result.truth.body_position_m[result.truth.climbing != 0]
        way_m = float(np.linalg.norm(places_m[-1] - places_m[0])) if len(places_m) else 0.0
        return {**told, "m_min": 60.0 * way_m / told["time_s"] if told["time_s"] else 0.0}


def wall_of(seed: int, objective: str) -> tuple[str, Wall]:
    """Its kind, and the wall; the same seed draws the same."""
    slope_deg = float(np.round(np.random.default_rng(seed).uniform(*SLOPE_DEG), 1))
    if seed % 4 == 0:
        drawn = Wall("wall", seed, (("all_limbs", True), ("slope_deg", slope_deg)))
    elif seed % 4 == 1:
        drawn = Wall("ladder", seed, (("rungs", 6), ("obstacles", 2), ("slope_deg", slope_deg)))
    else:
        drawn = Wall("field", seed)
    return drawn.kind, drawn.planned(objective=objective, time_limit_s=LIMIT_S)


def line_of(rows: list[Row]) -> dict[str, Any]:
    """How the climbs of one world went."""
    climbs = [row["climb"] for row in rows]
    whole = [climb for climb in climbs if "m_min" in climb]
    forces = [climb["tracking"]["force_N"] for climb in whole]
    bodies = [climb["tracking"]["body_m"] for climb in whole]
    return {
        "climbs": len(climbs),
        "at_goal": sum(row["verdict"] == CLIMBED for row in rows),
        "slips": sum(climb.get("slips", 0) for climb in climbs),
        "lost_grips": sum(map(lost_grip, rows)),
        "fell": sum(map(fell, rows)),
        "median_m_min": float(np.median([climb["m_min"] for climb in whole])) if whole else 0.0,
        "median_force_N": float(np.median(forces)) if whole else 0.0,
        "most_force_N": max(forces, default=0.0),
        "most_body_m": max(bodies, default=0.0),
        "least_margin": min((climb["margin"] for climb in whole), default=0.0),
        "reasons": dict(Counter(cause_of(row) for row in rows if row["verdict"] != CLIMBED)),
    }


def is_well(line: dict[str, Any], as_planned: bool) -> bool:
    """Whether nothing slipped or fell and 97 % ended at the goal; as planned, near the plan as well."""
    unharmed = line["slips"] == line["lost_grips"] == line["fell"] == 0
    near = line["most_force_N"] <= MOST_FORCE_N and line["most_body_m"] <= MOST_BODY_M
    return unharmed and line["at_goal"] >= AT_GOAL_SHARE * line["climbs"] and (near or not as_planned)


def run(options: argparse.Namespace) -> int:
    """Exit status 0 when in both worlds nothing slipped or fell, and 97 % of the climbs ended at the goal."""
    from crux_simulation.campaign.engine import run_anew
    from crux_simulation.sim.world_file import read_world

    look_at_folder("--output", options.output)
    drawn = WorldFile(read_world(options.world).name, options.world.read_text(encoding="utf-8"))
    worlds = (WorldFile(), drawn)
    walls = [wall_of(seed, options.objective) for seed in range(options.seed, options.seed + options.count)]
    jobs: list[ClimbJob] = [FastJob(kind, wall, wall.seed, world) for kind, wall in walls for world in worlds]
    rows = run_anew(jobs, options.output, options, "climbing fast")
    climbed = [row for row in rows if "climb" in row]
    table = {each.name: line_of([row for row in climbed if row["world"] == each.name]) for each in worlds}
    ok = all(is_well(line, name == WorldFile().name) for name, line in table.items())
    if options.json:
        print_json({"ok": ok, "count": options.count, "worlds": table})
        return 0 if ok else 1
    for name, line in table.items():
        note(
            f"{name:9} at the goal {Rate(line['at_goal'], line['climbs'])}; {line['slips']} slips, "
            f"{line['lost_grips']} lost a grip, {line['fell']} fell; {line['median_m_min']:.3f} m/min"
        )
        note(
            f"{'':9} force {line['median_force_N']:.2f} N in the median, {line['most_force_N']:.2f} N at most; "
            f"body {1e3 * line['most_body_m']:.1f} mm at most; margin {line['least_margin']:.3f} at least"
        )
        for reason, count in line["reasons"].items():
            note(f"{count:14}  {reason}")
    note(f"{(len(rows) - len(climbed)) // 2} of {options.count} walls have no plan")
    note(f"results in {options.output}; crux report {options.output} -o FILE.html shows them")
    return 0 if ok else 1
