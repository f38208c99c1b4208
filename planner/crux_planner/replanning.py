"""Planning again from the middle of a route, quickly: everything that does not depend on the start is kept.

A `Planner` keeps the problem in numbers, the oracles of the search with all they have answered (balance, reach, ways)
and the compiled equations. A plan made again starts at rest on a stance of the old one, and goes to the same goal.
"""

from __future__ import annotations

import math
import time
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import yaml
from crux_contracts import LIMB_NAMES
from crux_contracts.robot import Robot
from crux_contracts.scenario import Scenario, parse_scenario

from crux_planner.arrays import Array
from crux_planner.build import build_problem, pose_in_heading_frame, start_inertia
from crux_planner.checker import check_plan
from crux_planner.contacts import PAIR_NAMES
from crux_planner.errors import InfeasibleError
from crux_planner.exact import solve_within_torques
from crux_planner.planning import plan
from crux_planner.problem import Pose, Problem
from crux_planner.result import PlanResult, plan_message
from crux_planner.search.body_path import SPEED_SHARE, knot_path, smooth_events
from crux_planner.search.schedule import Schedule, lay_out, least_durations
from crux_planner.search.stances import Reach, search
from crux_planner.search.strength import Strength
from crux_planner.search.ways import Ways
from crux_planner.stage_functions import StageFunctions
from crux_planner.work import Work

TIME_LIMIT_S = 10.0
SPARE_KNOTS = (0, 6)  # beyond what is needed: a body less hurried where the check refuses the first


class Planner:
    """Plans again and again on one wall, towards one goal."""

    def __init__(self, scenario: Scenario, robot: Robot) -> None:
        """Raises ScenarioError and InfeasibleError, as `crux_planner.plan` does."""
        self.scenario, self.robot = scenario, robot
        self.problem = build_problem(scenario, robot)
        self.balance = Strength(self.problem, self.problem.friction_share)
        self.reach, self.ways = Reach(self.problem), Ways(self.problem)
        self.functions = StageFunctions(self.problem).started_elsewhere(self.problem)

    def replan(
        self,
        running: Any,
        at_s: float,
        *,
        time_limit_s: float = TIME_LIMIT_S,
        log: Callable[[str], None] | None = None,
    ) -> PlanResult:
        """A checked plan from the stance that `running`, a plan of this wall, takes next at or after `at_s`.

        Its horizon is what is left, or what the way takes if that is more. `timing` has contacts, body and nlp, which
        are the planning, and message and check apart. Where the quick way finds nothing `plan` is asked.
        Raises InfeasibleError.
        """
        began = time.monotonic()
        work = Work(lambda _what, _share: None, log or (lambda _line: None))
        with work.part("stance", 0.0):
            scenario = scenario_at(self.scenario, running, at_s)
            problem = self._from(scenario)
        for spare in SPARE_KNOTS:
            found = self._realise(problem, work, began + time_limit_s, spare)
            if found is None:
                continue
            steps, schedule, solution = found
            with work.part("message", 0.7):
                scenario = at_start(scenario, steps=steps)
                message = plan_message(scenario, self.robot, replace(problem, steps=steps), schedule, solution, "auto")
            with work.part("check", 0.8):
                report = check_plan(message, self.robot)
            if report.ok:
                return PlanResult(
                    ok=True,
                    plan=message,
                    check=report,
                    cost=solution.cost,
                    iterations=solution.iterations,
                    gait=schedule.gait,
                    position_residual_m=solution.position_residual_m,
                    force_residual_N=solution.force_residual_N,
                    seconds=time.monotonic() - began,
                    timing=work.seconds,
                )
        work.log("the quick way found no plan that passes the check; planning from scratch")
        return plan(scenario, self.robot, time_limit_s=max(began + time_limit_s - time.monotonic(), 1.0), log=log)

    def _from(self, scenario: Scenario) -> Problem:
        """The problem with another start, in the same frame and with the same contacts."""
        problem = self.problem
        start = pose_in_heading_frame(scenario.start.body, problem.heading_rad)
        contacts = []
        for limb in LIMB_NAMES:
            grasp = scenario.start.grasps[limb]
            wanted = (scenario.hold_index(grasp.hold), PAIR_NAMES.index(grasp.faces))
            fits = [i for i, c in enumerate(problem.contacts) if (c.hold, c.pair) == wanted]
            if not fits:
                raise InfeasibleError("start grasp", f"{limb} cannot grip {grasp.hold} by faces {grasp.faces}")
            contacts.append(min(fits, key=lambda i: abs(problem.contacts[i].yaw_rad)))
        first, second, third, fourth = contacts
        return replace(
            problem,
            start=start,
            start_contacts=(first, second, third, fourth),
            steps=scenario.horizon.steps,
            inertia_b=start_inertia(self.robot, start, [problem.contacts[c] for c in contacts]),
        )

    def _as_level(self, problem: Problem) -> Problem:
        """The problem as the path of a level body sees it: how the robot is tilted is left to the exact programme."""
        bounds = self.reach.of(problem.start_contacts)
        position = problem.start.position_m if bounds is None else _inside(problem.start.position_m, *bounds)
        return replace(problem, start=Pose(position, np.zeros(3)))

    def _realise(self, problem: Problem, work: Work, deadline: float, spare: int) -> tuple[int, Schedule, Any] | None:
        """Steps, schedule and solution from the problem's start; None where the search or the exact P1 has none."""
        with work.part("contacts", 0.1):
            moves, _ = search(problem, self.balance, self.reach, self.ways, at_once=1, greed=1.0, deadline=deadline)
        if moves is None:
            return None
        step = SPEED_SHARE * problem.body.max_speed_m_s * problem.dt_s
        with work.part("body", 0.3):
            moves = smooth_events(problem, self.balance, self.reach, self.ways, moves)
            needed = int(sum(part.sum() for part in least_durations(problem, self.ways, moves, step)))
            problem = replace(problem, steps=max(problem.steps, needed) + spare)
            schedule = lay_out(problem, self.ways, moves, step)
            path = knot_path(self._as_level(problem), self.balance, schedule)
        if path is None:
            return None
        with work.part("nlp", 0.4):
            solution = solve_within_torques(
                problem, schedule, path, deadline, self.functions.started_elsewhere(problem)
            )
        return (problem.steps, schedule, solution) if solution.solved else None


def _inside(values: Array, low: Array, high: Array) -> Array:
    """Values moved into bounds, with a little room where there is some."""
    room = np.minimum(_ROOM_M, (high - low) / 2)
    return np.clip(values, low + room, high - room)


def stances(running: Any) -> list[int]:
    """The first knots at which all limbs hold on, one a stance: what a climb can be planned again from."""
    holds = [tuple(int(limb.hold) for limb in knot.limbs) for knot in running.knots]
    return [k for k, now in enumerate(holds) if min(now) >= 0 and (k == 0 or now != holds[k - 1])]


def scenario_at(scenario: Scenario, running: Any, at_s: float) -> Scenario:
    """The scenario with the stance for its start that a plan takes first at or after a time, and the steps left."""
    k = max(0, math.ceil(at_s / running.dt_s - 1e-9))
    while k < len(running.knots) and min(limb.hold for limb in running.knots[k].limbs) < 0:
        k += 1
    if k >= len(running.knots):
        end_s = (len(running.knots) - 1) * running.dt_s
        raise InfeasibleError("time", f"the plan ends at {end_s:g} s: nothing to plan again from at {at_s:g} s")
    knot = running.knots[k]
    start = {
        "body": {
            "position_m": [float(v) for v in knot.body_position_w_m],
            "rpy_deg": [math.degrees(v) for v in knot.body_rpy_rad],
        },
        "grasps": {
            name: {"hold": running.holds[limb.hold].name, "faces": PAIR_NAMES[limb.finger1_face // 2]}
            for name, limb in zip(LIMB_NAMES, knot.limbs, strict=True)
        },
    }
    return at_start(scenario, start=start, steps=max(1, len(running.knots) - 1 - k))


def at_start(scenario: Scenario, *, steps: int, start: dict[str, Any] | None = None) -> Scenario:
    """The scenario with other steps, and another start if one is given."""
    if start is None and steps == scenario.horizon.steps:
        return scenario
    content = yaml.load(scenario.yaml_text, Loader=_LOADER)
    content["horizon"]["steps"] = int(np.int64(steps))
    if start is not None:
        content["start"] = start
    return parse_scenario(yaml.dump(content, Dumper=_DUMPER, sort_keys=False), scenario.path)


_ROOM_M = 1e-3
_LOADER = getattr(yaml, "CSafeLoader", yaml.SafeLoader)
_DUMPER = getattr(yaml, "CSafeDumper", yaml.SafeDumper)
