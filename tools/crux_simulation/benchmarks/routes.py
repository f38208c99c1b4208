"""`crux bench routes`: CPU time and J of routes over 16 to 100 holds."""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from crux_contracts.output_file import look_at_folder
from crux_tools.arguments import whole
from crux_tools.output import note, print_json, progress

from crux_simulation.benchmarks.cold_process import Measured, measured
from crux_simulation.benchmarks.random_walls import START_RUNGS, random_ladder

RUNGS = (8, 16, 24, 38, 50)
STEPS_PER_RUNG = 18  # of the horizon: more than any of these routes takes
LIMIT_S = 1800.0  # by the wall clock, of one process


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
        kept = {key: self.planned.result.get(key) for key in ("undecided", "cost", "steps", "error")}
        head = {"holds": 2 * self.rungs, "seed": self.seed, "ok": self.ok}
        return {**head, **kept, "cpu_s": round(self.planned.cpu_s, 2)}


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
    parser.add_argument(
        "--output", type=Path, default=Path("out/bench-routes"), metavar="DIR", help="for scenarios and plans"
    )


def plan_route(rungs: int, seed: int, folder: Path) -> Route:
    """Plans one ladder in a process of its own."""
    scenario = folder / f"ladder-{seed}-{rungs}.yaml"
    scenario.write_text(random_ladder(seed, rungs, steps=STEPS_PER_RUNG * rungs), encoding="utf-8")
    words = ("plan", str(scenario), "-o", str(scenario.with_suffix(".mcap")))
    return Route(rungs, seed, measured("crux_tools.cli", *words, limit_s=LIMIT_S))


def _print_table(routes: list[Route]) -> None:
    note(f"{'holds':>6} {'seed':>5} {'CPU s':>7} {'J':>10} {'steps':>6}  remark")
    for route in routes:
        result = route.planned.result
        cost = f"{result['cost']:>10.3f} {result['steps']:>6}" if route.ok else f"{'-':>10} {'-':>6}"
        remark = result.get("error") or ""
        note(f"{2 * route.rungs:>6} {route.seed:>5} {route.planned.cpu_s:>7.1f} {cost}  {remark}".rstrip())


def run(options: argparse.Namespace) -> int:
    """Exit status 0 when every route is planned within the default limit."""
    look_at_folder("--output", options.output)
    routes: list[Route] = []
    with progress("planning routes", len(options.rungs)) as bar:
        for rungs in options.rungs:
            routes.append(plan_route(rungs, options.seed, options.output))
            bar.at(len(routes))
    good = sum(route.ok for route in routes)
    if options.json:
        print_json({"ok": good == len(routes), "routes": [route.to_json() for route in routes]})
    else:
        _print_table(routes)
        note(f"planned within the default limit: {good} of {len(routes)}")
    return int(good < len(routes))
