"""`crux bench loop`: the same climbs in drawn worlds, without and with planning again on the way (crux climb --replan).

Margins are those of `crux bench uncertainty`; a replan's time is that of planning and check, by the wall's clock.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from crux_contracts.output_file import look_at_folder
from crux_contracts.scenario import load_scenario
from crux_tools.arguments import whole
from crux_tools.errors import UsageError
from crux_tools.output import note, print_json
from crux_tools.paths import SCENARIOS, WORLDS
from crux_tools.report.results import Row

from crux_simulation.benchmarks.uncertainty import MarginJob, line_of
from crux_simulation.campaign.command import add_cluster_options
from crux_simulation.campaign.job import ClimbJob, WorldFile
from crux_simulation.campaign.walls import Wall

SCENE, WORLD = SCENARIOS / "climb-four-holds.yaml", WORLDS / "holds-15mm-5deg.yaml"
AS_PLANNED, REPLANNED = "as planned", "planned again"
LIMIT_S = 0.2  # of a replan in the median, check and all


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `crux bench loop`."""
    parser.add_argument(
        "--scenario", type=Path, default=SCENE, metavar="FILE.yaml", help="a climb (default: climb-four-holds)"
    )
    parser.add_argument("--count", type=whole(1), default=50, metavar="N", help="worlds (default: %(default)s)")
    parser.add_argument("--seed", type=whole(0), default=1, metavar="N", help="of the first (default: %(default)s)")
    parser.add_argument(
        "--world", type=Path, default=WORLD, metavar="FILE.yaml", help="drawn from (default: holds-15mm-5deg)"
    )
    parser.add_argument(
        "--output", type=Path, default=Path("out/bench-loop"), metavar="DIR", help="for results, and logs of failures"
    )
    add_cluster_options(parser)


@dataclass(frozen=True)
class LoopJob(MarginJob):
    """A climb of which margins and time are asked, without or with planning again on the way."""

    replans: bool = False

    def climb_command(self) -> str:
        """What climbs so, beside the job's files."""
        return super().climb_command() + (" --replan" if self.replans else "")

    def _measured(self, plan: Any, result: Any) -> dict[str, Any]:
        climbing = result.truth.cycle[result.truth.climbing != 0]
        time_s = float(np.ptp(climbing)) * result.model.robot.dt_s if len(climbing) else 0.0
        return {**super()._measured(plan, result), "time_s": time_s}

    def _options(self, world: Any) -> Any:
        from crux_simulation.sim.climb import ClimbOptions

        return ClimbOptions(seed=self.seed, world=world, replan=self.replans)


def loop_line(rows: list[Row]) -> dict[str, Any]:
    """How the climbs went, and what was planned again on their way."""
    climbs = [row["climb"] for row in rows if "margin" in row["climb"]]
    each = [made for climb in climbs for made in (climb.get("replans") or {"each": []})["each"]]
    seconds = [made["seconds"] for made in each]
    return line_of(rows) | {
        "reached_goal": sum(bool(climb["reached_goal"]) for climb in climbs),
        "median_time_s": float(np.median([climb["time_s"] for climb in climbs])),
        "force_N": float(np.median([climb["tracking"]["force_N"] for climb in climbs])),
        "replans": len(each),
        "kept": sum(made["kept"] for made in each),
        "replan_median_s": float(np.median(seconds)) if seconds else None,
        "replan_worst_s": max(seconds, default=None),
        "replan_median_computed_s": float(np.median([made["computed_s"] for made in each])) if each else None,
    }


def run(options: argparse.Namespace) -> int:
    """Exit status 0 when the loop costs no goal, slip or fall, and a replan takes 0.2 s in the median at most."""
    from crux_simulation.campaign.engine import run_anew
    from crux_simulation.sim.world_file import read_world

    look_at_folder("--output", options.output)
    world = WorldFile(read_world(options.world).name, options.world.read_text(encoding="utf-8"))
    wall = Wall(text=load_scenario(options.scenario).yaml_text)
    ways = {AS_PLANNED: False, REPLANNED: True}
    seeds = range(options.seed, options.seed + options.count)
    jobs: list[ClimbJob] = [LoopJob(way, wall, seed, world, replans=on) for seed in seeds for way, on in ways.items()]
    rows = run_anew(jobs, options.output, options, "climbing without and with the loop")
    for row in rows:
        if "climb" not in row:
            raise UsageError(f"{options.scenario}: {row['reason']}")
    table = {way: loop_line([row for row in rows if row["walls"] == way]) for way in ways}
    ok = is_no_worse(table[AS_PLANNED], table[REPLANNED])
    if options.json:
        print_json({"ok": ok, "ways": table})
        return 0 if ok else 1
    for way, line in table.items():
        note(
            f"{way:14} {line['reached_goal']} of {line['climbs']} at the goal, {line['slips']} slips, "
            f"{line['lost_grips']} lost a grip, {line['fell']} fell; {line['median_time_s']:.1f} s"
        )
        note(f"{'':14} margin {line['least_margin']:.3f} at least, {line['median_margin']:.3f} in the median")
    line = table[REPLANNED]
    if line["replans"]:
        took = f"{line['replan_median_s']:.2f} s in the median, {line['replan_worst_s']:.2f} s at most"
        took += f"; {line['replan_median_computed_s']:.2f} s of computing"
        note(f"{line['replans']} times planned again, {line['kept']} kept; {took}")
    note(f"results in {options.output}; crux report {options.output} -o FILE.html shows them")
    return 0 if ok else 1


def is_no_worse(as_planned: dict[str, Any], replanned: dict[str, Any]) -> bool:
    """Whether the loop costs nothing of what a climb is for, and is quick."""
    less_at_goal = replanned["reached_goal"] < as_planned["reached_goal"]
    more = any(replanned[name] > as_planned[name] for name in ("slips", "lost_grips", "fell"))
    return not less_at_goal and not more and (replanned["replan_median_s"] or 0.0) <= LIMIT_S
