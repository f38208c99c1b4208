"""`crux bench fields`: random hold fields, each one solved, proven infeasible, or undecided."""

from __future__ import annotations

import argparse
from collections import Counter
from pathlib import Path

from crux_contracts.output_file import look_at_folder
from crux_planner.errors import FOR_ALL_REACH
from crux_tools.arguments import positive, whole
from crux_tools.output import note, print_json
from crux_tools.report import results
from crux_tools.report.results import Row

from crux_simulation.campaign.command import add_cluster_options
from crux_simulation.campaign.job import ClimbJob
from crux_simulation.campaign.walls import Wall

DECIDED_SHARE = 0.9
LIMIT_S = 20.0  # a field
SOLVED, PROVEN, UNDECIDED, WRONG = "solved", "infeasible", "undecided", "WRONG"
VERDICTS = {results.PLANNED: SOLVED, results.CLIMBED: SOLVED, results.FAILED: WRONG}
VERDICTS |= {results.INFEASIBLE: PROVEN, results.WRONG: WRONG}


def verdict(row: Row) -> str:
    """WRONG is a plan reported solved that fails the check, or whose climb ends elsewhere than at the goal."""
    return VERDICTS.get(row["verdict"], UNDECIDED)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `crux bench fields`."""
    parser.add_argument("--count", type=whole(1), default=20, metavar="N", help="fields to draw (default: %(default)s)")
    parser.add_argument(
        "--seed", type=whole(0), default=1, metavar="N", help="of the first field (default: %(default)s)"
    )
    parser.add_argument(
        "--limit",
        type=positive,
        default=LIMIT_S,
        metavar="S",
        help="seconds of computing that planning a field may take (default: %(default)s)",
    )
    parser.add_argument(
        "--climb", action="store_true", help="climb in physics what is solved, which the table's seconds count as well"
    )
    parser.add_argument("--output", type=Path, default=Path("out/bench-fields"), metavar="DIR", help="for results")
    add_cluster_options(parser)


def field_job(seed: int, limit_s: float, climbs: bool = False) -> ClimbJob:
    """Plans a field and checks the plan, if there is one; with `climbs`, climbs it."""
    return ClimbJob("field", Wall("field", seed), seed, time_limit_s=limit_s, climbs=climbs)


def run(options: argparse.Namespace) -> int:
    """Exit status 0 when 90 % of the fields were decided in time and no plan failed the check, or its climb."""
    from crux_simulation.campaign.engine import run_anew

    look_at_folder("--output", options.output)
    seeds = range(options.seed, options.seed + options.count)
    jobs = [field_job(seed, options.limit, options.climb) for seed in seeds]
    rows = run_anew(jobs, options.output, options, "deciding random fields")
    counts = Counter(map(verdict, rows))
    decided = counts[SOLVED] + counts[PROVEN]
    ok = decided >= DECIDED_SHARE * options.count and not counts[WRONG]
    if options.json:
        shares = {name.lower(): counts[name] for name in (SOLVED, PROVEN, UNDECIDED, WRONG)}
        fields = [
            {
                "seed": row["wall_seed"], "verdict": verdict(row), "seconds": row["cpu_s"], "why": row["reason"],
                "gait": row["plan"].get("gait"),
            } for row in rows
        ]  # fmt: skip
        print_json({"ok": ok, "count": options.count, "decided": decided, **shares, "fields": fields})
        return 0 if ok else 1
    note(f"{'field':>5} {'verdict':>10} {'s':>6}  gait, or why not")
    for row in rows:
        what = row["reason"] or " ".join(row["plan"]["gait"])
        note(f"{row['wall_seed']:>5} {verdict(row):>10} {row['cpu_s']:>6.1f}  {what}")
    solved = f"{counts[SOLVED]} solved and {'climbed' if options.climb else 'checked'}"
    note(
        f"{decided} of {options.count} decided within {options.limit:g} s of computing each: {solved}, "
        f"{counts[PROVEN]} proven infeasible {FOR_ALL_REACH}; {counts[UNDECIDED]} undecided, {counts[WRONG]} wrong"
    )
    return 0 if ok else 1
