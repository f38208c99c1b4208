"""`crux bench climbs`: draws random walls, plans and climbs each one, and counts."""

from __future__ import annotations

import argparse
from pathlib import Path
from typing import Any

from crux_contracts.output_file import look_at_folder
from crux_contracts.scenario import parse_scenario
from crux_tools.arguments import whole
from crux_tools.output import note, print_json
from crux_tools.report.results import CLIMBED, Row

from crux_simulation.campaign.command import add_cluster_options
from crux_simulation.campaign.job import ClimbJob
from crux_simulation.campaign.walls import Wall

PLANNED_SHARE = 0.95  # of the walls; every planned one must be climbed


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `crux bench climbs`."""
    parser.add_argument("--count", type=whole(1), default=20, metavar="N", help="walls to draw (default: %(default)s)")
    parser.add_argument(
        "--seed", type=whole(0), default=1, metavar="N", help="of the first wall (default: %(default)s)"
    )
    parser.add_argument("--slope", type=float, default=45.0, metavar="DEG", help="of the walls (default: %(default)s)")
    parser.add_argument(
        "--all-limbs", action="store_true", help="demand that every limb moves to the hold above it, not the body alone"
    )
    parser.add_argument(
        "--output", type=Path, default=Path("out/bench-climbs"), metavar="DIR", help="for results, and logs of failures"
    )
    add_cluster_options(parser)


def _cell(value: Any, scale: float = 1.0, digits: int = 1) -> str:
    return "-" if value is None else f"{scale * float(value):.{digits}f}"


def _print_table(rows: list[Row]) -> None:
    note(f"{'wall':>5} {'plan s':>7} {'climbed':>8} {'body mm':>8} {'force N':>8} {'slip mm':>8} {'x real':>7}  remark")
    for row in rows:
        plan, climb = row["plan"], row.get("climb", {})
        tracking = climb.get("tracking", {})
        climbed = ("yes" if climb["ok"] else "NO") if climb else "-"
        note(
            f"{row['wall_seed']:>5} {_cell(plan.get('seconds')) if plan['ok'] else 'NO':>7} {climbed:>8} "
            f"{_cell(tracking.get('body_m'), 1e3):>8} {_cell(tracking.get('force_N'), digits=2):>8} "
            f"{_cell(climb.get('largest_slip_m'), 1e3, 2):>8} "
            f"{_cell(climb.get('real_time_factor')):>7}  {row['reason']}"
        )


def run(options: argparse.Namespace) -> int:
    """Exit status 0 when 95 % of the walls were planned and every planned one climbed."""
    from crux_simulation.campaign.engine import run_anew

    settings = (("all_limbs", options.all_limbs), ("slope_deg", options.slope))
    walls = [Wall("wall", seed, settings) for seed in range(options.seed, options.seed + options.count)]
    parse_scenario(walls[0].scenario(), f"walls of --slope {options.slope:g}")
    look_at_folder("--output", options.output)
    jobs = [ClimbJob("wall", wall, wall.seed) for wall in walls]
    rows = run_anew(jobs, options.output, options, "climbing random walls")
    planned = sum("climb" in row for row in rows)
    climbed = sum(row["verdict"] == CLIMBED for row in rows)
    ok = planned >= PLANNED_SHARE * options.count and climbed == planned
    if options.json:
        results = [{"seed": row["wall_seed"], "plan": row["plan"], "climb": row.get("climb", {})} for row in rows]
        print_json({"ok": ok, "count": options.count, "planned": planned, "climbed": climbed, "walls": results})
    else:
        _print_table(rows)
        note(f"{planned} of {options.count} walls planned, {climbed} of {planned} climbed; results in {options.output}")
    return 0 if ok else 1
