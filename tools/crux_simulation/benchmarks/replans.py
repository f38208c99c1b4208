"""`crux bench replan`: plans again from every stance of a route, with everything warm, and times it.

From each stance three ways: as the plan has it; with the body one to two centimetres elsewhere; and without the hold
that the next move would go to. Beside the wall given, random ladders of sixteen holds.
"""

from __future__ import annotations

import argparse
import statistics
import time
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np
from crux_tools.arguments import whole
from crux_tools.output import note, print_json, progress
from crux_tools.paths import SCENARIOS

LIMIT_S = 0.3  # of planning and check, from a stance as the plan has it
OFF_M = (0.01, 0.02)  # how far off the body is
DRAWS = 50  # of a place for it that all limbs reach
LOST_LIMIT_S = 5.0  # for a wall that lacks a hold: it may have no way at all


@dataclass(frozen=True)
class Case:
    """One stance of one wall, and what is different there; seconds are medians over the repetitions."""

    wall: str
    at_s: float
    case: str  # plain, off or lost
    found: bool
    how: str  # along the old moves, back to them, by other headings, or from scratch
    planning_s: float
    whole_s: float
    cost: float | None
    parts: dict[str, float]


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Options of `crux bench replan`."""
    parser.add_argument(
        "--scenario",
        type=Path,
        default=SCENARIOS / "climb-obstacles.yaml",
        metavar="FILE",
        help="default: climb-obstacles",
    )
    parser.add_argument("--walls", type=whole(0), default=3, metavar="N", help="random ladders beside it (default: 3)")
    parser.add_argument("--repeat", type=whole(1), default=3, metavar="N", help="times each is planned (default: 3)")
    parser.add_argument("--plain", action="store_true", help="only from the stances as the plan has them")


def run(options: argparse.Namespace) -> int:
    """Exit status 0 when every plain stance gave a plan that passes the check, within the limit, check and all."""
    from crux_contracts.scenario import load_scenario, parse_scenario

    from crux_simulation.benchmarks.random_walls import random_ladder

    ladders = [(f"ladder {seed}", random_ladder(seed)) for seed in range(1, options.walls + 1)]
    walls = [load_scenario(options.scenario), *(parse_scenario(text, name) for name, text in ladders)]
    cases: list[Case] = []
    with progress("planning again", len(walls)) as bar:
        for done, wall in enumerate(walls, start=1):
            cases += _wall(wall, options.repeat, ("plain",) if options.plain else ("plain", "off", "lost"))
            bar.at(done)
    plain = [case for case in cases if case.case == "plain"]
    ok = all(case.found and case.whole_s <= LIMIT_S for case in plain)
    if options.json:
        print_json({"ok": ok, "summary": _summary(cases), "cases": [vars(case) for case in cases]})
        return 0 if ok else 1
    note(f"{'wall':>16} {'from s':>6} {'case':>6} {'planning s':>11} {'whole s':>8} {'J':>8}  how")
    for case in cases:
        cost = f"{case.cost:8.2f}" if case.cost is not None else f"{'none':>8}"
        note(
            f"{case.wall:>16} {case.at_s:>6.0f} {case.case:>6} {case.planning_s:>11.3f} {case.whole_s:>8.3f} {cost}  "
            f"{case.how} {case.parts}"
        )
    for name, values in _summary(cases).items():
        note(f"{name:>6}: " + ", ".join(f"{key} {value:.3g}" for key, value in values.items()))
    return 0 if ok else 1


def _summary(cases: list[Case]) -> dict[str, dict[str, float]]:
    summary = {}
    for name in dict.fromkeys(case.case for case in cases):
        of = [case for case in cases if case.case == name]
        found = [case for case in of if case.found] or of
        summary[name] = {
            "stances": len(of),
            "found": sum(case.found for case in of),
            "planning_median_s": statistics.median(case.planning_s for case in found),
            "planning_worst_s": max(case.planning_s for case in found),
            "whole_median_s": statistics.median(case.whole_s for case in found),
            "whole_worst_s": max(case.whole_s for case in found),
        }
    return summary


def _wall(wall: Any, repeat: int, names: tuple[str, ...]) -> list[Case]:
    from crux_contracts.robot import load_robot
    from crux_planner import InfeasibleError, Planner, plan, stances

    robot = load_robot(wall.robot)
    try:
        first = plan(wall, robot).plan
    except InfeasibleError as error:
        note(f"{wall.name}: {error}")
        return []
    planner = Planner(wall, robot)
    knots = stances(first)
    planner.replan(first, 0.0)
    random = np.random.default_rng(1)
    cases = []
    for k, after in pairwise(knots):
        for name in names:
            more = _difference(name, wall, first, k, after, random)
            if more is not None:
                cases.append(_case(planner, first, k, name, more, repeat))
    return cases


def _difference(
    name: str, wall: Any, running: Any, k: int, after: int, random: np.random.Generator
) -> dict[str, Any] | None:
    """What `Planner.replan` is told beside the stance; None where that cannot be."""
    from crux_contracts.scenario import BodyPose, ScenarioError
    from crux_planner import scenario_at

    knot = running.knots[k]
    for _ in range(DRAWS if name == "off" else 0):
        way = random.normal(size=3) * np.array([1.0, 1.0, 0.3])  # the wall leaves less room up and down
        place = np.array(knot.body_position_w_m) + random.uniform(*OFF_M) * way / np.linalg.norm(way)
        roll, pitch, yaw = np.degrees(knot.body_rpy_rad).tolist()
        body = BodyPose((place[0], place[1], place[2]), (roll, pitch, yaw))
        try:
            scenario_at(wall, running, k, body)
        except ScenarioError:  # out of reach: the robot cannot be there
            continue
        return {"body": body}
    if name == "lost":
        next_holds = {limb.hold for limb in running.knots[after].limbs} - {limb.hold for limb in knot.limbs}
        lost = [running.holds[hold].name for hold in next_holds]
        return {"without": lost, "time_limit_s": LOST_LIMIT_S} if lost else None
    return {} if name == "plain" else None


def _case(planner: Any, running: Any, k: int, name: str, more: dict[str, Any], repeat: int) -> Case:
    from crux_contracts.scenario import ScenarioError
    from crux_planner.errors import InfeasibleError

    at_s = k * running.dt_s
    tries, result, how = [], None, "no plan found"
    for _ in range(repeat):
        began = time.monotonic()
        try:
            result = planner.replan(running, at_s, **more)
        except (InfeasibleError, ScenarioError) as error:
            how = str(error)
            tries.append((time.monotonic() - began, 0.0))
            break
        tries.append((time.monotonic() - began, result.timing["check"]))
    parts = {} if result is None else result.timing
    if result is not None:
        how = "back to them" if "contacts" in parts else "along"
        how = "from scratch" if "stance" not in parts else "headings" if "headings" in parts else how
    return Case(
        wall=planner.scenario.name,
        at_s=at_s,
        case=name,
        found=result is not None and result.check.ok,
        how=how,
        planning_s=round(statistics.median(whole - check for whole, check in tries), 3),
        whole_s=round(statistics.median(whole for whole, _ in tries), 3),
        cost=None if result is None else round(result.cost, 3),
        parts=parts,
    )
