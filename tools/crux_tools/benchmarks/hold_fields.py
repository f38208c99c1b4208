"""`crux bench fields`: random hold fields, each one solved, proven infeasible for the planner's reach, or undecided."""

from __future__ import annotations

import argparse
from collections import Counter
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from crux_contracts.output_file import look_at_folder
from crux_planner.errors import FOR_ITS_REACH

from crux_tools.arguments import positive, whole
from crux_tools.benchmarks.cold_process import HANGING, crux_json
from crux_tools.benchmarks.random_fields import random_field
from crux_tools.output import note, print_json, progress

DECIDED_SHARE = 0.9
LIMIT_S = 20.0  # a field, cold process
RESERVE_S = 2.0  # of the limit: for the process to start and end
SOLVED, PROVEN, UNDECIDED, WRONG = "solved", "infeasible", "undecided", "WRONG"


@dataclass(frozen=True)
class FieldResult:
    """What became of one field; WRONG is a plan reported solved that fails the check."""

    seed: int
    verdict: str
    seconds: float
    why: str
    plan: dict[str, Any]

    def as_json(self) -> dict[str, Any]:
        """One entry of the bench's JSON object."""
        return {
            "seed": self.seed,
            "verdict": self.verdict,
            "seconds": round(self.seconds, 2),
            "why": self.why,
            "gait": self.plan.get("gait"),
        }


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
        help="seconds of computing that a field may take, start of the process included (default: %(default)s)",
    )
    parser.add_argument(
        "--output", type=Path, default=Path("out/bench-fields"), metavar="DIR", help="for scenarios and plans"
    )


def decide_one(seed: int, limit_s: float, folder: Path) -> FieldResult:
    """Plans one field in a cold process and checks the plan, if there is one, in another."""
    scenario, plan = folder / f"field-{seed}.yaml", folder / f"field-{seed}.plan.mcap"
    scenario.write_text(random_field(seed), encoding="utf-8")
    plan.unlink(missing_ok=True)
    words = ("plan", str(scenario), "-o", str(plan), "--time-limit", f"{limit_s - RESERVE_S:g}")
    planned, seconds = crux_json(*words, limit_s=HANGING * limit_s)
    why = str(planned.get("error", "")).removeprefix(f"{scenario}: ")
    if planned.get("ok"):
        checked, _ = crux_json("check", str(plan))
        verdict = SOLVED if checked.get("ok") else WRONG
        return FieldResult(seed, verdict, seconds, "" if checked.get("ok") else str(checked), planned)
    return FieldResult(seed, PROVEN if planned.get("proven") else UNDECIDED, seconds, why, planned)


def run(options: argparse.Namespace) -> int:
    """Exit status 0 when 90 % of the fields were decided in time and no plan failed the check."""
    look_at_folder("--output", options.output)
    results: list[FieldResult] = []
    if not options.json:
        note(f"{'field':>5} {'verdict':>10} {'s':>6}  gait, or why not")
    with progress("deciding random fields", options.count) as bar:
        for seed in range(options.seed, options.seed + options.count):
            result = decide_one(seed, options.limit, options.output)
            results.append(result)
            bar.at(len(results))
            if not options.json:
                what = result.why or " ".join(result.plan.get("gait", []))
                note(f"{seed:>5} {result.verdict:>10} {result.seconds:>6.1f}  {what}")
    counts = Counter(result.verdict for result in results)
    decided = counts[SOLVED] + counts[PROVEN]
    ok = decided >= DECIDED_SHARE * options.count and not counts[WRONG]
    if options.json:
        shares = {name.lower(): counts[name] for name in (SOLVED, PROVEN, UNDECIDED, WRONG)}
        fields = [result.as_json() for result in results]
        print_json({"ok": ok, "count": options.count, "decided": decided, **shares, "fields": fields})
    else:
        note(
            f"{decided} of {options.count} decided within {options.limit:g} s of computing each: "
            f"{counts[SOLVED]} solved and checked, {counts[PROVEN]} proven infeasible {FOR_ITS_REACH}; "
            f"{counts[UNDECIDED]} undecided, {counts[WRONG]} wrong"
        )
    return 0 if ok else 1
