"""`crux bench routes`: CPU time and J of routes over 16 to 100 holds, beside another checkout's in the same run."""

from __future__ import annotations

import argparse
import os
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from crux_contracts.output_file import look_at_folder
from crux_tools.arguments import whole
from crux_tools.errors import WorkFailed
from crux_tools.output import note, print_json, progress

from crux_simulation.benchmarks.cold_process import Measured, measured
from crux_simulation.benchmarks.random_walls import START_RUNGS, random_ladder

RUNGS = (8, 16, 24, 38, 50)
STEPS_PER_RUNG = 18  # of the horizon: more than any of these routes takes
WORSE = 1e-3  # share of J that the other may be cheaper by
SLOWER = 1.25  # factor of its CPU time in all that this one may take: two runs on a busy machine differ by less
LIMIT_S = 1800.0  # by the wall clock, of one process


@dataclass(frozen=True)
class Route:
    """A ladder and what `crux plan` made of it here, and in the other checkout if there is one."""

    rungs: int
    seed: int
    here: Measured
    other: Measured | None

    @property
    def ok(self) -> bool:
        """Planned within the default time limit, and J no worse than the other's."""
        return bool(self.here.result.get("ok")) and (
            self.other is None or cost(self.here) <= (1.0 + WORSE) * cost(self.other)
        )

    def to_json(self) -> dict[str, Any]:
        """One row of the table."""
        sides = {"here": self.here, "other": self.other}
        rows = {name: _row(side) for name, side in sides.items() if side is not None}
        return {"holds": 2 * self.rungs, "seed": self.seed, "ok": self.ok, **rows}


def cost(side: Measured) -> float:
    """J, infinite without a plan."""
    return float(side.result["cost"]) if side.result.get("ok") else float("inf")


def _row(side: Measured) -> dict[str, Any]:
    kept = {key: side.result.get(key) for key in ("ok", "undecided", "cost", "steps", "error")}
    return {**kept, "cpu_s": round(side.cpu_s, 2)}


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
        "--against", type=Path, metavar="DIR", help="a checkout of another commit, whose planner plans each route too"
    )
    parser.add_argument(
        "--output", type=Path, default=Path("out/bench-routes"), metavar="DIR", help="for scenarios and plans"
    )


def plan_route(rungs: int, seed: int, folder: Path, against: Path | None) -> Route:
    """Plans one ladder here and there, one after the other, every run a process of its own."""
    scenario = folder / f"ladder-{seed}-{rungs}.yaml"
    scenario.write_text(random_ladder(seed, rungs, steps=STEPS_PER_RUNG * rungs), encoding="utf-8")
    found: list[Measured] = []
    for name, checkout in (("here", None), ("other", against))[: 1 if against is None else 2]:
        paths = [] if checkout is None else [str(checkout.resolve() / "planner")]
        path = os.pathsep.join([*paths, *os.environ.get("PYTHONPATH", "").split(os.pathsep)]).strip(os.pathsep)
        output = folder / f"ladder-{seed}-{rungs}.{name}.mcap"
        words = ("plan", str(scenario), "-o", str(output))
        found.append(measured("crux_tools.cli", *words, limit_s=LIMIT_S, environment={"PYTHONPATH": path}))
    return Route(rungs, seed, found[0], found[1] if found[1:] else None)


def ratio(routes: list[Route]) -> float | None:
    """CPU time here over that of the other checkout, in all; None without one."""
    other = [route.other.cpu_s for route in routes if route.other is not None]
    return sum(route.here.cpu_s for route in routes) / sum(other) if other else None


def _print_table(routes: list[Route]) -> None:
    note(f"{'holds':>6} {'seed':>5} {'CPU s':>7} {'J':>10} {'steps':>6}  {'other: CPU s':>12} {'J':>10}  remark")
    for route in routes:
        here, other = route.here, route.other
        cells = f"{here.cpu_s:>7.1f} {cost(here):>10.3f} {here.result.get('steps') or '-':>6}"
        beside = f"{'-':>12} {'-':>10}" if other is None else f"{other.cpu_s:>12.1f} {cost(other):>10.3f}"
        remark = here.result.get("error") or ("" if route.ok else "WORSE")
        note(f"{2 * route.rungs:>6} {route.seed:>5} {cells}  {beside}  {remark}".rstrip())


def run(options: argparse.Namespace) -> int:
    """Exit status 0 when every route is planned within the default limit, and next to another checkout none costs more
    and all take no more CPU time.
    """
    look_at_folder("--output", options.output)
    if options.against is not None and not (options.against / "planner" / "crux_planner").is_dir():
        raise WorkFailed(f"--against {options.against}: no checkout of crux there (planner/crux_planner is missing)")
    routes: list[Route] = []
    with progress("planning routes", len(options.rungs)) as bar:
        for rungs in options.rungs:
            routes.append(plan_route(rungs, options.seed, options.output, options.against))
            bar.at(len(routes))
    share = ratio(routes)
    ok = all(route.ok for route in routes) and (share is None or share <= SLOWER)
    if options.json:
        print_json({"ok": ok, "cpu_ratio": share, "routes": [route.to_json() for route in routes]})
    else:
        _print_table(routes)
        if share is not None:
            note(f"CPU time over that of {options.against}: {share:.2f} (at most {SLOWER:g})")
        note(f"planned within the default limit: {sum(bool(r.here.result.get('ok')) for r in routes)} of {len(routes)}")
    return 0 if ok else 1
