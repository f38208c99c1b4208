"""`crux bench replan`: plans again from every stance of a route, with everything warm, and times it."""

from __future__ import annotations

import argparse
import time
from pathlib import Path

from crux_tools.output import note, print_json, progress

LIMIT_S = 0.3
PLANNING = ("stance", "contacts", "body", "nlp", "message")  # the check is timed apart


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `crux bench replan`."""
    default = Path(__file__).resolve().parents[3] / "msgs" / "scenarios" / "climb-obstacles.yaml"
    parser.add_argument("--scenario", type=Path, default=default, metavar="FILE", help="default: climb-obstacles")


def run(options: argparse.Namespace) -> int:
    """Exit status 0 when every plan passed the check and none took longer than the limit without it."""
    from crux_contracts.robot import load_robot
    from crux_contracts.scenario import load_scenario
    from crux_planner.errors import InfeasibleError
    from crux_planner.planning import plan
    from crux_planner.replanning import Planner, stances

    scenario = load_scenario(options.scenario)
    robot = load_robot(scenario.robot)
    began = time.monotonic()
    first = plan(scenario, robot)
    cold_s = time.monotonic() - began
    planner = Planner(scenario, robot)
    knots = stances(first.plan)[:-1]
    rows, failed = [], 0
    with progress("planning again", len(knots)) as bar:
        planner.replan(first.plan, 0.0)
        for k in knots:
            began = time.monotonic()
            try:
                result = planner.replan(first.plan, k * first.plan.dt_s)
            except InfeasibleError as error:
                note(f"{k * first.plan.dt_s:g} s: {error}")
                failed += 1
                continue
            whole_s = time.monotonic() - began
            quick = "stance" in result.timing
            planning_s = sum(result.timing[part] for part in PLANNING) if quick else whole_s
            rows.append(
                {"at_s": k * first.plan.dt_s, "ok": result.ok, "quick": quick, "planning_s": round(planning_s, 3),
                 "check_s": result.timing["check"], "cost": result.cost, "timing": result.timing}
            )  # fmt: skip
            bar.at(len(rows))
    times = [float(row["planning_s"]) for row in rows]
    worst, mean = max(times), sum(times) / len(times)
    ok = worst <= LIMIT_S and not failed and all(row["ok"] for row in rows)
    if options.json:
        print_json({"ok": ok, "cold_s": cold_s, "worst_s": worst, "mean_s": mean, "stances": rows, "failed": failed})
        return 0 if ok else 1
    note(f"{'from s':>7} {'planning s':>11} {'check s':>8}  parts")
    for row in rows:
        how = row["timing"] if row["quick"] else "from scratch, check included"
        note(f"{row['at_s']:>7.0f} {row['planning_s']:>11.3f} {row['check_s']:>8.3f}  {how}")
    note(f"planned cold in {cold_s:.2f} s; again without the check: worst {worst:.3f} s, mean {mean:.3f} s")
    return 0 if ok else 1
