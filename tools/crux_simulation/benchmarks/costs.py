"""`crux bench costs`: J of `auto` and of `two_block` on the same pairs of start and goal, side by side, with times."""

from __future__ import annotations

import argparse
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from crux_contracts.output_file import look_at_folder
from crux_planner.errors import FOR_ITS_REACH
from crux_tools.arguments import whole
from crux_tools.output import note, print_json, progress

from crux_simulation.benchmarks.cold_process import crux_json
from crux_simulation.benchmarks.pairs import TASKS, pairs

METHODS = ("auto", "two_block")
WORSE = 1e-3  # share of J by which `auto` may be worse: what the exact programs' tolerances leave open


@dataclass(frozen=True)
class Pair:
    """What each method made of one pair: the object of `crux plan --json` and the wall time of its process [s]."""

    task: str
    seed: int
    plans: dict[str, dict[str, Any]]
    wall_s: dict[str, float]

    def cost(self, method: str) -> float:
        """J, infinite without a plan."""
        plan = self.plans[method]
        return float(plan["cost"]) if plan.get("ok") else float("inf")

    @property
    def ok(self) -> bool:
        """`auto` planned, and no worse than the other."""
        least = self.cost(METHODS[1])
        return self.cost(METHODS[0]) < float("inf") and self.cost(METHODS[0]) <= least + WORSE * abs(least)

    def to_json(self) -> dict[str, Any]:
        """One row of the table."""
        rows = {
            method: {
                "ok": bool(plan.get("ok")),
                "cost": plan.get("cost"),
                "gap": plan.get("gap"),
                "gait": plan.get("gait"),
                "seconds": plan.get("seconds"),
                "wall_s": round(self.wall_s[method], 3),
                "error": plan.get("error"),
            }
            for method, plan in self.plans.items()
        }
        return {"task": self.task, "seed": self.seed, "ok": self.ok, **rows}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `crux bench costs`."""
    parser.add_argument(
        "--count", type=whole(1), default=10, metavar="N", help="pairs of each task (default: %(default)s)"
    )
    parser.add_argument(
        "--seed", type=whole(0), default=1, metavar="N", help="of the first pair (default: %(default)s)"
    )
    parser.add_argument("--task", choices=TASKS, action="append", help="climbing or walking (default: both)")
    parser.add_argument(
        "--output", type=Path, default=Path("out/bench-costs"), metavar="DIR", help="for scenarios and plans"
    )


def plan_pair(task: str, seed: int, scenario_yaml: str, folder: Path) -> Pair:
    """Plans one pair by each method, every run a process of its own."""
    scenario = folder / f"{task}-{seed}.yaml"
    scenario.write_text(scenario_yaml, encoding="utf-8")
    plans, wall_s = {}, {}
    for method in METHODS:
        output = folder / f"{task}-{seed}.{method}.mcap"
        plans[method], wall_s[method] = crux_json("plan", str(scenario), "-o", str(output), "--method", method)
    return Pair(task, seed, plans, wall_s)


def _print_table(found: list[Pair]) -> None:
    head = " ".join(f"{method + ' J':>12} {'wall s':>7} {'gap %':>6}" for method in METHODS)
    note(f"{'task':>9} {'pair':>5} {head} {'J ratio':>8}  remark")
    for pair in found:
        cells = []
        for method in METHODS:
            gap = pair.plans[method].get("gap")
            cost = f"{pair.cost(method):.3f}" if pair.plans[method].get("ok") else "NO"
            cells.append(f"{cost:>12} {pair.wall_s[method]:>7.2f} {'-' if gap is None else f'{100 * gap:.0f}':>6}")
        both = all(plan.get("ok") for plan in pair.plans.values())
        ratio = f"{pair.cost(METHODS[0]) / pair.cost(METHODS[1]):.3f}" if both else "-"
        errors = [f"{method}: {plan['error']}" for method, plan in pair.plans.items() if plan.get("error")]
        remark = "; ".join(([] if pair.ok else ["WORSE" if both else "missing"]) + errors)
        note(f"{pair.task:>9} {pair.seed:>5} {' '.join(cells)} {ratio:>8}  {remark}".rstrip())


def run(options: argparse.Namespace) -> int:
    """Exit status 0 when `auto` planned every pair and its J is nowhere above that of `two_block`."""
    look_at_folder("--output", options.output)
    tasks = options.task or list(TASKS)
    drawn = [(task, seed, text) for task in tasks for seed, text in pairs(task, options.count, options.seed)]
    found: list[Pair] = []
    with progress("planning pairs", len(drawn)) as bar:
        for task, seed, text in drawn:
            found.append(plan_pair(task, seed, text, options.output))
            bar.at(len(found))
    ok = all(pair.ok for pair in found)
    if options.json:
        print_json({"ok": ok, "count": options.count, "pairs": [pair.to_json() for pair in found]})
    else:
        _print_table(found)
        note(f"gap: to a bound proven {FOR_ITS_REACH}")
        note(f"auto no worse than two_block on {sum(pair.ok for pair in found)} of {len(found)} pairs")
    return 0 if ok else 1
