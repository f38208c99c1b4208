"""`crux bench uncertainty`: the plan for an uncertain world beside the usual one, climbed in the same drawn worlds.

The margin of a climb is the least share of a pad's friction that is left, in physics (sim/grip_margin.py), over time
and over the pads of all limbs that bear their whole load, whether all four stand or one swings: 0 is a slip, 0.5 a pad
that would hold with half of its friction. A share, for newtons tell little of a pad that bears next to nothing. Pads
that have just touched, or are about to open, do not count: nothing would fall with them.
"""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import yaml
from crux_contracts.output_file import look_at_folder
from crux_contracts.plan_file import write_plan
from crux_contracts.scenario import Scenario, load_scenario, parse_scenario
from crux_contracts.scenario_document import scenario_document
from crux_tools.arguments import whole
from crux_tools.errors import UsageError, WorkFailed
from crux_tools.output import note, print_json
from crux_tools.paths import SCENARIOS
from crux_tools.report.results import Row

from crux_simulation.benchmarks.worlds import WORLD, fell, lost_grip
from crux_simulation.campaign.command import add_cluster_options
from crux_simulation.campaign.job import ClimbJob, WorldFile
from crux_simulation.campaign.walls import Wall
from crux_simulation.sim.judge import CLIMBING, FULL_LOAD, STANCE

SCENE = SCENARIOS / "climb-four-holds.yaml"
AS_DRAWN = {"friction": 0.4, "hold_position_m": 0.005, "hold_yaw_deg": 3.0, "mass_kg": 1.0, "centre_of_mass_m": 0.01}
"""What tools/worlds/ordinary.yaml draws: friction and payload to their ends, a payload 0.1 m off a robot of 9.6 kg;
holds to one standard deviation."""
USUAL, SURE = "usual plan", "plan for the uncertain"
BETTER = 1.5


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `crux bench uncertainty`."""
    parser.add_argument(
        "--scenario", type=Path, default=SCENE, metavar="FILE.yaml",
        help="a climb; without a key `uncertainty` it gets what the world file draws (default: climb-four-holds)",
    )  # fmt: skip
    parser.add_argument("--count", type=whole(1), default=40, metavar="N", help="worlds (default: %(default)s)")
    parser.add_argument("--seed", type=whole(0), default=1, metavar="N", help="of the first (default: %(default)s)")
    parser.add_argument("--world", type=Path, default=WORLD, metavar="FILE.yaml", help="drawn from (default: ordinary)")
    parser.add_argument(
        "--output",
        type=Path,
        default=Path("out/bench-uncertainty"),
        metavar="DIR",
        help="for results, failures",
    )
    add_cluster_options(parser)


@cache
def planned(text: str) -> tuple[dict[str, Any], Any]:
    """What `crux plan` says of a scenario, and the plan: once a process."""
    from crux_contracts.robot import load_robot
    from crux_planner import plan

    scenario = parse_scenario(text)
    result = plan(scenario, load_robot(scenario.robot))
    return result.to_json(), result.plan


@dataclass(frozen=True)
class MarginJob(ClimbJob):
    """A climb that is asked for its margins."""

    def _plan(self, scenario: Scenario, path: Path) -> dict[str, Any]:
        said, plan = planned(scenario.yaml_text)
        write_plan(path, plan)
        return {name: said[name] for name in ("ok", "cost", "nominal_cost", "steps")}

    def _measured(self, plan: Any, result: Any) -> dict[str, Any]:
        from crux_tools.telemetry.reader import read_log

        from crux_simulation.sim.grip_margin import grip_margins

        log, margins = read_log(result.log), grip_margins(result.truth, plan, result.model)
        cycle, logged = result.truth.cycle, log.state["cycle"]
        row = np.clip(np.searchsorted(logged, cycle), 0, len(logged) - 1)
        bears = (log.references["phase"] == STANCE) & (log.references["load"] > FULL_LOAD)
        bears &= (log.state["supervisor_state"] == CLIMBING)[:, None]
        bears = bears[row] & (logged[row] == cycle)[:, None]
        return {"margin": float(np.nanmin(np.where(bears[..., None], margins, np.nan)))}


def scenarios_of(path: Path) -> dict[str, str]:
    """The scenario without and with its uncertainty, as YAML text. Raises ScenarioError."""
    text = scenario_document(load_scenario(path).yaml_text, str(path))
    known = text.pop("uncertainty", AS_DRAWN)
    return {name: yaml.safe_dump(text | more) for name, more in ((USUAL, {}), (SURE, {"uncertainty": known}))}


def line_of(rows: list[Row]) -> dict[str, Any]:
    """How the climbs of one plan went."""
    climbs = [row["climb"] for row in rows]
    found = [climb for climb in climbs if "margin" in climb]
    if not found:
        raise WorkFailed(f"{rows[0]['walls']}: {rows[0]['reason']}")
    margins = [climb["margin"] for climb in found]
    return {
        "climbs": len(climbs),
        "at_goal": sum(bool(climb["ok"]) for climb in climbs),
        "slips": sum(climb["slips"] for climb in found),
        "fell": sum(map(fell, rows)),
        "lost_grips": sum(map(lost_grip, rows)),
        "cost": rows[0]["plan"]["cost"],
        "least_margin": min(margins),
        "median_margin": float(np.median(margins)),
    }


def times(margin: float, usual: float) -> float | None:
    """How many times the usual margin; None where a pad of the usual plan has none left."""
    return margin / usual if usual > 0.0 else None


def run(options: argparse.Namespace) -> int:
    """Exit status 0 when the least margin is 1.5 times that of the usual plan, without a slip."""
    from crux_simulation.campaign.engine import run_anew
    from crux_simulation.sim.world_file import read_world

    look_at_folder("--output", options.output)
    world = WorldFile(read_world(options.world).name, options.world.read_text(encoding="utf-8"))
    texts, seeds = scenarios_of(options.scenario), range(options.seed, options.seed + options.count)
    jobs = [MarginJob(name, Wall(text=text), seed, world) for seed in seeds for name, text in texts.items()]
    rows = run_anew(jobs, options.output, options, "climbing with both plans")
    for row in rows:
        if "climb" not in row:
            raise UsageError(f"{options.scenario}: no {row['walls']}: {row['reason']}")
    table = {name: line_of([row for row in rows if row["walls"] == name]) for name in texts}
    usual, sure = table[USUAL], table[SURE]
    ratios = {which: times(sure[f"{which}_margin"], usual[f"{which}_margin"]) for which in ("least", "median")}
    ok = (ratios["least"] or 0.0) >= BETTER and sure["slips"] == sure["lost_grips"] == sure["fell"] == 0
    if options.json:
        print_json({"ok": ok, "plans": table, "ratios": ratios})
        return 0 if ok else 1
    for name, line in table.items():
        note(
            f"{name:22} J {line['cost']:6.2f}; {line['at_goal']} of {line['climbs']} at the goal, "
            f"{line['slips']} slips, {line['lost_grips']} lost a grip, {line['fell']} fell"
        )
        note(f"{'':22} margin {line['least_margin']:.3f} at least, {line['median_margin']:.3f} in the median")
    least, median = ("no number of" if ratio is None else f"{ratio:.2f}" for ratio in ratios.values())
    note(f"margin {least} times the usual plan's, {median} times in the median")
    note(f"results in {options.output}; crux report {options.output} -o FILE.html shows them")
    return 0 if ok else 1
