"""Where a running plan can be left, and the scenario from there on."""

from collections.abc import Callable, Collection
from typing import Any

import numpy as np
from crux_contracts import LIMB_NAMES
from crux_contracts.grip_places import grasp_of
from crux_contracts.interpolation import knot_times_s
from crux_contracts.scenario import BodyPose, Scenario, parse_scenario
from crux_contracts.scenario_document import as_obstacle, scenario_document
from crux_msgs import plan_t

from crux_planner.errors import InfeasibleError, wrong

EARLY_S = 1e-9
"""A knot counts as reached."""


def stances(running: plan_t) -> list[int]:
    """The first knots at which all limbs hold on, one a stance: what a climb can be planned again from."""
    holds = [tuple(int(limb.hold) for limb in knot.limbs) for knot in running.knots]
    return [k for k, now in enumerate(holds) if min(now) >= 0 and (k == 0 or now != holds[k - 1])]


def stance_knot(running: plan_t, at_s: float) -> int:
    """The first knot at or after a time at which all limbs hold on. Raises InfeasibleError after the last one."""
    times_s = knot_times_s(running)
    k = int(np.searchsorted(times_s, at_s - EARLY_S))
    while k < len(running.knots) and min(limb.hold for limb in running.knots[k].limbs) < 0:
        k += 1
    if k >= len(running.knots):
        raise InfeasibleError("time", f"the plan ends at {times_s[-1]:g} s: nothing to plan again from at {at_s:g} s")
    return k


def scenario_at(
    scenario: Scenario, running: plan_t, k: int, body: BodyPose | None = None, without: Collection[str] = ()
) -> Scenario:
    """The scenario with the stance at knot k of a plan for its start, the body there or elsewhere, and the steps left.

    Holds in `without` become obstacles. Raises ScenarioError for a name that is no hold's, InfeasibleError where a limb
    is on that hold, or should end on it.
    """
    knot = running.knots[k]
    position, rpy_deg = knot.body_position_w_m, np.degrees(knot.body_rpy_rad).tolist()
    if body is not None:
        position, rpy_deg = body.position_m, list(body.rpy_deg)
    grasps_there = grasps_at(running, k)
    held = {name: grasp["hold"] for name, grasp in grasps_there.items()}
    for place, grasps in (("start", held), ("goal", {name: g.hold for name, g in scenario.goal.grasps.items()})):
        for limb, hold in grasps.items():
            if hold in without:
                raise InfeasibleError(f"{place} grasp", f"{place}.grasps.{limb}: {hold} is no hold any more")
    start = {
        "body": {"position_m": [float(v) for v in position], "rpy_deg": rpy_deg},
        "grasps": grasps_there,
    }
    return rewritten(scenario, start=start, steps=max(1, len(running.knots) - 1 - k), without=without)


def grasps_at(running: plan_t, k: int) -> dict[str, dict[str, Any]]:
    """What each limb grips at knot k of a plan, a stance, as a scenario's start has it."""
    planned = parse_scenario(running.scenario_yaml, any_robot=True)
    limbs = zip(LIMB_NAMES, running.knots[k].limbs, strict=True)
    return {name: grasp_of(running, limb, planned) for name, limb in limbs}


def edited(scenario: Scenario, edit: Callable[[dict[str, Any]], None]) -> Scenario:
    """The scenario with its document changed in place by `edit`. Raises ScenarioError where that makes none."""
    content = scenario_document(scenario.yaml_text, scenario.path)
    edit(content)
    return parse_scenario(content, scenario.path)


def with_objective(scenario: Scenario, objective: str) -> Scenario:
    """The scenario with this planner.objective. Raises ScenarioError where it does not go with the rest."""
    if objective == scenario.planner.objective:
        return scenario
    return edited(scenario, lambda content: content.setdefault("planner", {}).update(objective=objective))


def rewritten(
    scenario: Scenario, *, steps: int, start: dict[str, Any] | None = None, without: Collection[str] = ()
) -> Scenario:
    """The scenario with other steps, another start if one is given, and some holds become obstacles."""
    if start is None and not without and steps == scenario.horizon.steps:
        return scenario
    return edited(scenario, lambda content: _rewrite(scenario, content, steps, start, without))


def _rewrite(
    scenario: Scenario,
    content: dict[str, Any],
    steps: int,
    start: dict[str, Any] | None,
    without: Collection[str],
) -> None:
    content["horizon"]["steps"] = int(steps)
    if start is not None:
        content["start"] = start
    names = [hold["name"] for hold in content["holds"]]
    for name in without:
        if name not in names:
            raise wrong(scenario, "without", name, f"expected one of the holds {', '.join(names)}")
    lost = [hold for hold in content["holds"] if hold["name"] in without]
    if lost:
        content["holds"] = [hold for hold in content["holds"] if hold["name"] not in without]
        content["obstacles"] = [*content.get("obstacles", []), *map(as_obstacle, lost)]
