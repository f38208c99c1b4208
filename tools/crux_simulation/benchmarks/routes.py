"""`crux bench routes`: CPU time and J of routes over 16 to 100 holds; with `--stream` in parts, over any number."""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from crux_contracts.output_file import look_at_folder
from crux_contracts.scenario_types import MAX_STEPS, OBJECTIVES
from crux_tools.arguments import whole
from crux_tools.output import note, print_json, progress

from crux_simulation.benchmarks.cold_process import Measured, measured
from crux_simulation.benchmarks.random_walls import START_RUNGS, random_ladder

RUNGS = (8, 16, 24, 38, 50)
STEPS_PER_RUNG = 18  # of the horizon: more than any of these routes takes
LIMIT_S = 1800.0  # by the wall clock, of one process
MOST_MB, MOST_EXPONENT = 1000.0, 1.1  # of routes in parts: memory, and how CPU time grows with the holds


@dataclass(frozen=True)
class Route:
    """A ladder and what `crux plan` made of it."""

    rungs: int
    seed: int
    planned: Measured

    @property
    def ok(self) -> bool:
        """Planned within the default time limit."""
        return bool(self.planned.result.get("ok"))

    def to_json(self) -> dict[str, Any]:
        """One row of the table."""
        result = self.planned.result
        kept = {key: result.get(key) for key in ("undecided", "cost", "steps", "error")}
        if parts := result.get("parts"):
            kept |= {key: sum(part[key] for part in parts) for key in ("cost", "steps")}
        head = {"holds": 2 * self.rungs, "seed": self.seed, "ok": self.ok}
        return {**head, **kept, "cpu_s": round(self.planned.cpu_s, 2), "peak_MB": round(self.planned.peak_MB)}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `crux bench routes`."""
    parser.add_argument(
        "--rungs",
        type=whole(START_RUNGS + 1),
        nargs="+",
        default=list(RUNGS),
        metavar="N",
        help="of the ladders, two holds each (default: 8 16 24 38 50)",
    )
    parser.add_argument("--seed", type=whole(0), default=1, metavar="N", help="of the ladders (default: %(default)s)")
    parser.add_argument("--stream", action="store_true", help="plan in parts, as crux plan --stream does")
    parser.add_argument("--objective", choices=OBJECTIVES, default="paper", help="(default: %(default)s)")
    parser.add_argument(
        "--output", type=Path, default=Path("out/bench-routes"), metavar="DIR", help="for scenarios and plans"
    )


def plan_route(rungs: int, options: argparse.Namespace) -> Route:
    """Plans one ladder in a process of its own."""
    scenario = options.output / f"ladder-{options.seed}-{rungs}.yaml"
    steps = min(STEPS_PER_RUNG * rungs, MAX_STEPS)
    scenario.write_text(random_ladder(options.seed, rungs, steps=steps), encoding="utf-8")
    words = ["plan", str(scenario), "--objective", options.objective]
    if options.stream:
        parts = scenario.with_suffix("")
        for part in parts.glob("*.mcap"):
            part.unlink()
        words += ["-o", str(parts), "--stream"]
    else:
        words += ["-o", str(scenario.with_suffix(".mcap"))]
    return Route(rungs, options.seed, measured("crux_tools.cli", *words, limit_s=LIMIT_S))


def exponent_of(routes: list[Route]) -> float | None:
    """With which power of the number of holds the CPU time grows; None of fewer than two routes."""
    if len({route.rungs for route in routes}) < 2:
        return None
    holds, seconds = [2 * route.rungs for route in routes], [route.planned.cpu_s for route in routes]
    return float(np.polyfit(np.log(holds), np.log(seconds), 1)[0])


def _print_table(rows: list[dict[str, Any]]) -> None:
    note(f"{'holds':>6} {'seed':>5} {'CPU s':>7} {'MB':>5} {'J':>10} {'steps':>6}  remark")
    for row in rows:
        cost = f"{row['cost']:>10.3f} {row['steps']:>6}" if row["ok"] else f"{'-':>10} {'-':>6}"
        head = f"{row['holds']:>6} {row['seed']:>5} {row['cpu_s']:>7.1f} {row['peak_MB']:>5}"
        note(f"{head} {cost}  {row['error'] or ''}".rstrip())


def run(options: argparse.Namespace) -> int:
    """Exit status 0 when every route is planned within the default limit, and those in parts in little memory and in a
    time that grows about as they do.
    """
    look_at_folder("--output", options.output)
    routes: list[Route] = []
    with progress("planning routes", len(options.rungs)) as bar:
        for rungs in options.rungs:
            routes.append(plan_route(rungs, options))
            bar.at(len(routes))
    good, exponent = sum(route.ok for route in routes), exponent_of(routes)
    ok = good == len(routes)
    if options.stream:
        small = all(route.planned.peak_MB <= MOST_MB for route in routes)
        ok = ok and small and (exponent is None or exponent <= MOST_EXPONENT)
    rows = [route.to_json() for route in routes]
    if options.json:
        print_json({"ok": ok, "exponent": exponent, "routes": rows})
    else:
        _print_table(rows)
        note(f"planned within the default limit: {good} of {len(routes)}")
        if exponent is not None:
            note(f"CPU time grows as the number of holds to the power of {exponent:.2f}")
    return int(not ok)
