"""`crux bench walls`: plans and climbs the walls in benchmarks/walls, other scenario files, or drawn ones."""

from __future__ import annotations

import argparse
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from crux_contracts.output_file import look_at_folder
from crux_contracts.scenario_types import OBJECTIVES
from crux_tools.arguments import positive, whole
from crux_tools.errors import UsageError
from crux_tools.output import note, print_json
from crux_tools.paths import ROOT
from crux_tools.report.results import Row

from crux_simulation.benchmarks.hold_fields import DECIDED_SHARE, PROVEN, SOLVED, UNDECIDED, WRONG, verdict
from crux_simulation.campaign.command import add_cluster_options
from crux_simulation.campaign.job import ClimbJob
from crux_simulation.campaign.walls import Wall

WALLS = ROOT / "benchmarks" / "walls"
LIMIT_S = 60.0  # a wall
DRAWN = "planes"


@dataclass(frozen=True)
class WallJob(ClimbJob):
    """A climb of which the body's speed is asked."""

    def _measured(self, plan: Any, result: Any) -> dict[str, Any]:
        moving = result.truth.climbing != 0
        places, cycles = result.truth.body_position_m[moving], result.truth.cycle[moving]
        if len(cycles) < 2:
            return super()._measured(plan, result)
        minutes = float(np.ptp(cycles)) * result.model.robot.dt_s / 60.0
        return {**super()._measured(plan, result), "m_min": float(np.linalg.norm(places[-1] - places[0])) / minutes}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `crux bench walls`."""
    parser.add_argument("wall", nargs="*", type=Path, help="scenario files (default: all in benchmarks/walls)")
    parser.add_argument(
        "--drawn", type=whole(1), metavar="N", help="in place of files, draw so many walls of two planes at an edge"
    )
    parser.add_argument(
        "--seed", type=whole(0), default=1, metavar="N", help="of the first that is drawn (default: %(default)s)"
    )
    parser.add_argument(
        "--limit", type=positive, default=LIMIT_S, metavar="S",
        help="seconds of computing that planning a wall may take (default: %(default)s)",
    )  # fmt: skip
    parser.add_argument("--objective", choices=OBJECTIVES, help="what is planned for (default: as the walls say)")
    parser.add_argument("--output", type=Path, default=Path("out/bench-walls"), metavar="DIR", help="for results")
    add_cluster_options(parser)


def wall_job(path: Path, limit_s: float, objective: str | None = None) -> WallJob:
    """Plans, for an objective of its own if one is given, checks and climbs the wall of a scenario file. Raises
    UsageError where it cannot be read.
    """
    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        raise UsageError(f"{path}: expected a scenario file: {error}") from None
    return WallJob(path.stem, Wall(text=text).planned(objective=objective), time_limit_s=limit_s)


def _jobs(options: argparse.Namespace) -> list[WallJob]:
    if options.drawn:
        if options.wall:
            raise UsageError("--drawn: takes no scenario files beside it")
        seeds = range(options.seed, options.seed + options.drawn)
        walls = [Wall(DRAWN, seed).planned(objective=options.objective) for seed in seeds]
        return [WallJob(DRAWN, wall, time_limit_s=options.limit) for wall in walls]
    paths = options.wall or sorted(WALLS.glob("*.yaml"))
    if not paths:
        raise UsageError(f"{WALLS}: no walls here; name scenario files")
    return [wall_job(path, options.limit, options.objective) for path in paths]


def line_of(row: Row) -> dict[str, Any]:
    """One line of the table; None where there is no such figure."""
    plan, climb = row["plan"], row.get("climb", {})
    figures = {name: climb.get(name) for name in ("slips", "largest_slip_m", "m_min")}
    cpu_s = plan.get("computed_s", row["cpu_s"])  # a climb's is not counted
    planned = {"verdict": verdict(row), "J": plan.get("cost"), "gap": plan.get("gap"), "cpu_s": cpu_s}
    name = row.get("wall", f"{DRAWN}-{row['wall_seed']}") if row["walls"] == DRAWN else row["walls"]
    return {"wall": name, **planned, "climbed": climb.get("ok"), **figures, "why": row["reason"]}


def run(options: argparse.Namespace) -> int:
    """Exit status 0 when 90 % of the walls were decided in time and every plan passed the check and its climb."""
    from crux_simulation.campaign.engine import run_anew

    jobs = _jobs(options)
    look_at_folder("--output", options.output)
    lines = [line_of(row) for row in run_anew(jobs, options.output, options, "planning and climbing walls")]
    counts = Counter(line["verdict"] for line in lines)
    decided = counts[SOLVED] + counts[PROVEN]
    ok = decided >= DECIDED_SHARE * len(lines) and not counts[WRONG]
    if options.json:
        print_json({"ok": ok, "decided": decided, "walls": lines})
        return 0 if ok else 1
    width = max(len(line["wall"]) for line in lines)
    heads = f"{'J':>8} {'gap %':>6} {'CPU s':>6} {'climbed':>7} {'slips':>5} {'slip mm':>7} {'m/min':>6}"
    note(f"{'wall':<{width}} {'verdict':>10} {heads}  why not")
    for line in lines:
        note(f"{line['wall']:<{width}} {line['verdict']:>10} {_figures(line)}  {line['why']}".rstrip())
    note(
        f"{decided} of {len(lines)} decided within {options.limit:g} s of computing each: {counts[SOLVED]} climbed, "
        f"{counts[PROVEN]} proven infeasible; {counts[UNDECIDED]} undecided, {counts[WRONG]} wrong"
    )
    return 0 if ok else 1


def _figures(line: dict[str, Any]) -> str:
    def cell(name: str, width: int, digits: int, scale: float = 1.0) -> str:
        value = line[name]
        return f"{'-' if value is None else f'{scale * value:.{digits}f}':>{width}}"

    climbed = {None: "-", True: "yes", False: "NO"}[line["climbed"]]
    planned = f"{cell('J', 8, 2)} {cell('gap', 6, 0, 100.0)} {cell('cpu_s', 6, 1)} {climbed:>7}"
    return f"{planned} {cell('slips', 5, 0)} {cell('largest_slip_m', 7, 2, 1e3)} {cell('m_min', 6, 3)}"
