"""Routes of any length: a climb planned in parts, each from the stance in which the one before ends.

A part is a plan of its own: of a scenario with the holds and obstacles that the robot can reach on its way, from rest
to rest, about a metre towards the goal. Memory does not grow with the route, and time grows as its length.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from typing import Any

import numpy as np
from crux_contracts import LIMB_NAMES
from crux_contracts.robot import Robot
from crux_contracts.scenario import Cuboid, Scenario, parse_scenario
from crux_contracts.scenario_document import scenario_document

from crux_planner.errors import TIME_LIMIT, InfeasibleError, no_footholds, wrong
from crux_planner.model.arrays import Array, Flags
from crux_planner.model.build import build_problem
from crux_planner.model.kinematics import rotation_z
from crux_planner.pipeline.at_once import plan_at_once
from crux_planner.pipeline.message import PlanResult
from crux_planner.pipeline.replan import Planner
from crux_planner.pipeline.restart import grasps_at
from crux_planner.solvers import clock

WAY_M = 0.8  # of a part, towards the goal
FIRST_SHARE = 0.5  # of that for the first part, so that the robot can begin soon
GOALS = ((1.0, 0.0), (0.75, 0.0), (1.25, 0.0), (0.5, 0.0), (1.0, 0.15), (1.0, -0.15), (0.5, 0.1), (0.5, -0.1))
"""Where a part may end, in the order in which these are tried: share of its way, and aside of it [m]."""
LAST_SHARE = 1.4  # of a part's way that is left to the goal makes the last part
TOLERANCE_M, TOLERANCE_DEG = 0.03, 5.0  # of the body where a part ends
TIME_LIMIT_S = 20.0  # of CPU for each way that a part is tried by
THOROUGH = 3  # ends that are tried again by all that `plan` has, each for so many times as long


@dataclass(frozen=True)
class _Place:
    """A body pose as scenarios have it, in W."""

    position_m: Array
    rpy_deg: Array

    def towards(self, other: _Place, share: float, aside_m: float) -> _Place:
        """A share of the way to another place, and so far left of it."""
        way = other.position_m - self.position_m
        length = max(float(np.hypot(way[0], way[1])), 1e-9)
        aside = np.array([-way[1], way[0], 0.0]) * aside_m / length
        turn = (other.rpy_deg - self.rpy_deg + 180.0) % 360.0 - 180.0
        return _Place(self.position_m + share * way + aside, self.rpy_deg + share * turn)

    def as_yaml(self) -> dict[str, list[float]]:
        return {"position_m": self.position_m.tolist(), "rpy_deg": self.rpy_deg.tolist()}


def plan_route(
    scenario: Scenario,
    robot: Robot,
    *,
    time_limit_s: float = TIME_LIMIT_S,
    log: Callable[[str], None] | None = None,
    deadline: float = math.inf,
) -> Iterator[PlanResult]:
    """The parts of a route one after the other, each planned and checked when it is asked for.

    From the second on a part is given when the next one is found: one that leads nowhere may still end elsewhere.
    `time_limit_s` is CPU time [s] for each way that a part is tried by; none is after the `deadline` (of
    solvers.clock.now). Raises ScenarioError for walks and for starts
    in the air, InfeasibleError where a part is not found: those before it can be climbed.
    """
    if scenario.contact.model != "patch":
        raise wrong(scenario, "contact.model", scenario.contact.model, "expected patch: routes are climbs")
    if scenario.start.air:
        raise wrong(scenario, "start.air", ", ".join(scenario.start.air), "expected all limbs on holds")
    no_footholds(scenario, "routes are")
    route = _Route(scenario, robot)
    grasps = {name: vars(scenario.start.grasps[name]) for name in LIMB_NAMES}
    begun = {name: {k: v for k, v in grasp.items() if v not in (None, "")} for name, grasp in grasps.items()}
    tried = _Tried(time_limit_s, deadline, log)
    following = _Parts(route, route.start, begun, FIRST_SHARE, tried)
    if (held := following.next()) is None:
        raise following.failure
    yield held.result  # the robot may begin, so it does end there
    route.format = held.result.plan.format
    given = True
    while not held.last:
        nexts = _Parts(route, *route.end_of(held.result), 1.0, tried)
        if (found := nexts.next()) is not None:
            if not given:
                yield held.result
            held, following, given = found, nexts, False
        elif not given and (other := following.next()) is not None:
            held = other
        else:
            if not given:
                yield held.result
            raise nexts.failure
    if not given:
        yield held.result


def is_long(scenario: Scenario) -> bool:
    """Whether a route makes more than one part; there is none where limbs may stand."""
    if scenario.footholds:
        return False
    way = np.subtract(scenario.goal.body.position_m, scenario.start.body.position_m)
    return float(np.linalg.norm(way[:2])) > LAST_SHARE * WAY_M


@dataclass(frozen=True)
class _Tried:
    """How each way of a part is tried: see `plan_route`."""

    time_limit_s: float
    deadline: float
    log: Callable[[str], None] | None

    def seconds(self, times: int = 1) -> float:
        """For the next one. Raises InfeasibleError where the time is over."""
        left_s = self.deadline - clock.now()
        if left_s <= 0.0:
            raise InfeasibleError(TIME_LIMIT, "time ran out")
        return min(times * self.time_limit_s, left_s)


@dataclass(frozen=True)
class _Part:
    result: PlanResult
    last: bool


class _Parts:
    """The parts that may follow from a stance, one way after the other."""

    def __init__(
        self,
        route: _Route,
        start: _Place,
        grasps: dict[str, Any],
        share: float,
        tried: _Tried,
    ) -> None:
        self._route, self._start, self._grasps, self._share, self._tried = route, start, grasps, share, tried
        self._none: InfeasibleError | None = None  # why the first way gives none
        self._found = self._find()

    def next(self) -> _Part | None:
        """The next one that the runtime joins to the others, and that ends in a stance from which the route can go
        on.
        """
        route = self._route
        joined = (part for part in self._found if route.format in (None, part.result.plan.format))
        return next((part for part in joined if part.last or route.goes_on(part.result)), None)

    @property
    def failure(self) -> InfeasibleError:
        """Why there is none, after the last."""
        x, y, _ = self._start.position_m
        where = f"from the body at ({x:.2f}, {y:.2f}) m"
        if self._none is None:
            return InfeasibleError(
                "route", f"no part {where} has the format of those before and ends where one can begin"
            )
        return InfeasibleError(self._none.constraint, f"no part of the route {where}: {self._none}")

    def _find(self) -> Iterator[_Part]:
        """By the quickest moves, and where those give none, by all that `plan` tries."""
        goals = list(self._route.goals(self._start, self._share))
        tried = self._tried
        for goal, last in goals:
            try:
                planner = Planner(self._route.part(self._start, self._grasps, goal), self._route.robot)
                yield _Part(planner.plan(time_limit_s=tried.seconds(), log=tried.log), last)
            except InfeasibleError as none:
                self._none = self._none or none
        for goal, last in goals[:THOROUGH]:
            part = self._route.part(self._start, self._grasps, goal)
            with suppress(InfeasibleError):
                yield _Part(
                    plan_at_once(part, self._route.robot, time_limit_s=tried.seconds(THOROUGH), log=tried.log), last
                )


class _Route:
    """A scenario's document, and what of it is near a way."""

    def __init__(self, scenario: Scenario, robot: Robot) -> None:
        self.scenario, self.robot = scenario, robot
        self.document = scenario_document(scenario.yaml_text, scenario.path)
        self.start = _Place(np.array(scenario.start.body.position_m), np.array(scenario.start.body.rpy_deg))
        self.goal = _Place(np.array(scenario.goal.body.position_m), np.array(scenario.goal.body.rpy_deg))
        self.format: int | None = None  # of the plans: which one the first part shows
        self._reach_m = reach_m(robot)
        self._places = np.array([each.position_m for each in scenario.cuboids]).reshape(-1, 2)
        self._extent_m = np.array([_extent_m(each) for each in scenario.cuboids])

    def goals(self, start: _Place, share: float) -> Iterator[tuple[_Place | None, bool]]:
        """Where a part from `start` may end, None for the route's own goal, and whether it is the last part."""
        left_m = float(np.linalg.norm((self.goal.position_m - start.position_m)[:2]))
        if left_m <= LAST_SHARE * WAY_M:
            yield None, True
        for of_way, aside_m in GOALS:
            if (to_goal := share * of_way * WAY_M / max(left_m, 1e-9)) < 1.0:
                yield start.towards(self.goal, to_goal, aside_m), False

    def part(self, start: _Place, grasps: dict[str, Any], goal: _Place | None) -> Scenario:
        """The scenario of a part: what stands where the robot can reach on a straight way to the part's goal."""
        near = self._near(start.position_m[:2], (goal or self.goal).position_m[:2])
        holds, obstacles = self.document.get("holds", []), self.document.get("obstacles", [])
        content = dict(self.document, start={"body": start.as_yaml(), "grasps": grasps})
        content["holds"] = [hold for hold, kept in zip(holds, near, strict=False) if kept]
        content["obstacles"] = [each for each, kept in zip(obstacles, near[len(holds) :], strict=True) if kept]
        if goal is not None:
            tolerances = {"tolerance_m": TOLERANCE_M, "tolerance_deg": TOLERANCE_DEG}
            content["goal"] = {"body": {**goal.as_yaml(), **tolerances}}
        return parse_scenario(content, self.scenario.path)

    def _near(self, begin: Array, end: Array) -> Flags:
        way = end - begin
        along = np.clip((self._places - begin) @ way / max(float(way @ way), 1e-12), 0.0, 1.0)
        off_m = np.linalg.norm(self._places - begin - along[:, None] * way, axis=1)
        return np.asarray(off_m <= self._reach_m + self._extent_m)

    def end_of(self, result: PlanResult) -> tuple[_Place, dict[str, Any]]:
        """Where a part ends, as the next one's start."""
        knot = result.plan.knots[-1]
        body = _Place(np.array(knot.body_position_w_m), np.degrees(knot.body_rpy_rad))
        return body, grasps_at(result.plan, -1)

    def goes_on(self, result: PlanResult) -> bool:
        """Whether a next part would begin with the grippers where they are: off the middle of its face, none does."""
        start, grasps = self.end_of(result)
        try:
            scenario = self.part(start, grasps, start.towards(self.goal, 1e-6, 0.0))
            problem = build_problem(scenario, self.robot)
        except InfeasibleError:
            return False
        to_w = rotation_z(problem.heading_rad)
        off = [
            to_w @ problem.contacts[c].centre_h_m - np.array(limb.gripper_position_w_m)
            for c, limb in zip(problem.start_contacts, result.plan.knots[-1].limbs, strict=True)
        ]
        return bool(np.abs(off).max() < 1e-6)


def reach_m(robot: Robot) -> float:
    """How far from the body's origin what a gripper touches can be, along the wall."""
    lengths = []
    for limb in robot.limbs:
        hand_m = 0.0 if limb.closed_form else limb.wrist_to_gripper_m  # upright below the wrist in the closed form
        lengths.append(float(np.linalg.norm(limb.shoulder_b_m)) + limb.upper_link_m + limb.lower_link_m + hand_m)
    return max(lengths) + robot.gripper.opening_m[1]


def _extent_m(cuboid: Cuboid) -> float:
    """Farther from its foot's middle it is nowhere, in plan view."""
    return math.hypot(*cuboid.size_m) if cuboid.turned else math.hypot(*cuboid.size_m[:2]) / 2
