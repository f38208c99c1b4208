"""`crux bench climbs`: draws random walls, plans and climbs each one, and counts."""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from crux_contracts.output_file import look_at_folder

from crux_tools.arguments import whole
from crux_tools.benchmarks.cold_process import crux_json
from crux_tools.benchmarks.random_walls import random_wall
from crux_tools.output import note, print_json, progress

PLANNED_SHARE = 0.95  # of the walls; every planned one must be climbed


@dataclass(frozen=True)
class WallResult:
    """What became of one wall."""

    seed: int
    plan: dict[str, Any]
    climb: dict[str, Any]

    @property
    def planned(self) -> bool:
        """crux plan wrote a checked plan."""
        return bool(self.plan.get("ok"))

    @property
    def climbed(self) -> bool:
        """The robot reached the goal without slip or fall."""
        return bool(self.climb.get("ok"))

    @property
    def remark(self) -> str:
        """Why not."""
        return str(self.climb.get("reason") or self.climb.get("error") or self.plan.get("error") or "")


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
        "--output", type=Path, default=Path("out/bench-climbs"), metavar="DIR", help="for scenarios, plans and logs"
    )


def climb_one(seed: int, scenario_yaml: str, folder: Path) -> WallResult:
    """Plans and climbs one wall; its files stay in `folder`."""
    scenario, plan, log = (folder / f"wall-{seed}{suffix}" for suffix in (".yaml", ".plan.mcap", ".log.mcap"))
    scenario.write_text(scenario_yaml, encoding="utf-8")
    planned, _ = crux_json("plan", str(scenario), "-o", str(plan))
    climbed: dict[str, Any] = {}
    if planned.get("ok"):
        climbed, _ = crux_json("climb", str(plan), "-o", str(log), "--seed", str(seed))
    return WallResult(seed, planned, climbed)


def _cell(value: Any, scale: float = 1.0, digits: int = 1) -> str:
    return "-" if value is None else f"{scale * float(value):.{digits}f}"


def _print_table(results: list[WallResult]) -> None:
    note(f"{'wall':>5} {'plan s':>7} {'climbed':>8} {'body mm':>8} {'force N':>8} {'slip mm':>8} {'x real':>7}  remark")
    for result in results:
        tracking = result.climb.get("tracking", {})
        climbed = ("yes" if result.climbed else "NO") if result.planned else "-"
        note(
            f"{result.seed:>5} {_cell(result.plan.get('seconds')) if result.planned else 'NO':>7} {climbed:>8} "
            f"{_cell(tracking.get('body_m'), 1e3):>8} {_cell(tracking.get('force_N'), digits=2):>8} "
            f"{_cell(result.climb.get('largest_slip_m'), 1e3, 2):>8} "
            f"{_cell(result.climb.get('real_time_factor')):>7}  {result.remark}"
        )


def run(options: argparse.Namespace) -> int:
    """Exit status 0 when 95 % of the walls were planned and every planned one climbed."""
    from crux_contracts.scenario import parse_scenario

    parse_scenario(random_wall(options.seed, options.slope), f"walls of --slope {options.slope:g}")
    look_at_folder("--output", options.output)
    results: list[WallResult] = []
    with progress("climbing random walls", options.count) as bar:
        for seed in range(options.seed, options.seed + options.count):
            wall = random_wall(seed, options.slope, all_limbs=options.all_limbs)
            results.append(climb_one(seed, wall, options.output))
            bar.at(len(results))
    planned = sum(result.planned for result in results)
    climbed = sum(result.climbed for result in results)
    ok = planned >= PLANNED_SHARE * options.count and climbed == planned
    if options.json:
        walls = [{"seed": result.seed, "plan": result.plan, "climb": result.climb} for result in results]
        print_json({"ok": ok, "count": options.count, "planned": planned, "climbed": climbed, "walls": walls})
    else:
        _print_table(results)
        note(f"{planned} of {options.count} walls planned, {climbed} of {planned} climbed; files in {options.output}")
    return 0 if ok else 1
