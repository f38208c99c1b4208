"""What a wall offers a robot: which holds can be gripped, by which limbs, from where; where one can start; how far up
one gets.

All is about level bodies whose heading is between those of start and goal, or up to `TURN_RAD` beyond.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable
from dataclasses import dataclass, field, replace

import numpy as np
from crux_contracts import LIMB_NAMES
from crux_contracts.robot import Robot
from crux_contracts.scenario import Goal, GoalPose, Grasp, Scenario, ScenarioError

from crux_planner.errors import InfeasibleError, no_footholds, wrong
from crux_planner.model.arrays import Array, Flags
from crux_planner.model.build import build_problem, wall_contacts
from crux_planner.model.contacts import PAIR_NAMES, Contact
from crux_planner.model.kinematics import rotation_z
from crux_planner.model.offers import all_grips
from crux_planner.model.problem import Problem
from crux_planner.pipeline.explanation import check_clear, check_start
from crux_planner.reach.arm import CLEAR_M, reaches_of
from crux_planner.reach.body_grid import BodyGrid
from crux_planner.search.equilibrium import StaticEquilibrium
from crux_planner.search.footing import Footing
from crux_planner.search.highest import Highest, Upwards
from crux_planner.search.pose_masks import PoseMasks, gripper
from crux_planner.solvers import clock
from crux_planner.swing.swing_cache import SwingCache

TURN_RAD, STEP_RAD = 0.21, 0.07  # of headings
AROUND_M, AROUND_STEP_M, HEIGHTS = 0.6, 0.03, 3  # of a hold: places of the body from which it may be in reach
STEP_M = 0.02  # of the search upwards
BESIDE_M, ABOVE_M = 0.1, 0.35  # how far its bodies go beyond all holds, and how much further up
PLACE_M = 0.04  # between bodies that are looked at for stances
MARGIN_RAD = 0.04  # to joint limits
STARTS = 5  # stances, the lowest, that the search upwards may begin from
OFF_THE_MAP = "a limb is nearer to a joint limit, or to another limb, than the map has it"

Progress = Callable[[float], None]


@dataclass(frozen=True)
class From:
    """Bodies (x, y, height) in W [m] from which a limb holds on: the one with the most others about it, the ranges of
    all of them, and the heading [rad] of that one; `share` of the bodies around the hold that they are, 0..1.
    """

    body_m: tuple[float, float, float]
    heading_rad: float
    x_m: tuple[float, float]
    y_m: tuple[float, float]
    height_m: tuple[float, float]
    share: float


@dataclass
class Pair:
    """A hold and a pair of its faces: by limb from where it is gripped, else why not; `reason` where no limb can."""

    hold: str
    faces: str
    off_centre: bool = False  # only so
    limbs: dict[str, From] = field(default_factory=dict)
    without: dict[str, str] = field(default_factory=dict)
    reason: str = ""


@dataclass(frozen=True)
class StartStance:
    """A level body (x, y, height) in W [m], the hold and faces of each limb, and by limb which of the hold's grips on
    these faces, where it has some.
    """

    body_m: tuple[float, float, float]
    grasps: dict[str, tuple[str, str]]
    grips: dict[str, int] = field(default_factory=dict)


@dataclass
class WallReport:
    """See the module. `stances`: of every place of the body that has one, the lowest first; `refused`: why the
    scenario's own start is not to be had; `begun` the start searched from.
    """

    pairs: list[Pair]
    refused: str = ""
    stances: list[StartStance] = field(default_factory=list)
    begun: StartStance | None = None
    top: Highest | None = None
    held_by: dict[tuple[str, str], list[str]] = field(default_factory=dict)
    heading_rad: float = 0.0


def wall_report(scenario: Scenario, robot: Robot, limit_s: float, looks: int, at: Progress) -> WallReport:
    """The report on one wall; the search upwards takes so many looks at moves and seconds of computing at most. `at` is
    called with the share of the work that is done.

    Raises ScenarioError where the wall is for feet or limbs stand at the start.
    """
    report = wall_offers(scenario, robot, lambda share: at(0.6 * share))
    _climb(report, scenario, robot, clock.now() + limit_s, looks)
    return report


def wall_offers(scenario: Scenario, robot: Robot, at: Progress = lambda _share: None) -> WallReport:
    """The same without the search upwards: who grips which holds, and all stances.

    Raises ScenarioError where the wall is for feet.
    """
    if scenario.contact.model != "patch":
        raise wrong(scenario, "contact.model", scenario.contact.model, "expected patch: this is about grippers")
    if any(grasp.foothold for grasp in scenario.start.grasps.values()):
        no_footholds(scenario, "a look at a wall where the start is on some is")
    centred, unusable = wall_contacts(scenario, robot, False)
    wider, _ = wall_contacts(scenario, robot, True)
    heading, pairs = scenario.start.body.rpy_rad[2], []
    for index, hold in enumerate(scenario.holds):
        for pair, faces in enumerate(PAIR_NAMES):
            mine = [c for c in centred if (c.hold, c.pair) == (index, pair)]
            off = [] if mine else [c for c in wider if (c.hold, c.pair) == (index, pair)]
            found = Pair(hold.name, faces, bool(off), reason="" if mine or off else unusable[index, pair])
            if mine or off:
                _reached(found, mine or off, scenario, robot, heading)
            pairs.append(found)
        at(0.8 * (index + 1) / len(scenario.holds))
    report = WallReport(pairs, stances=_stances(centred, scenario, robot), heading_rad=heading)
    at(1.0)
    return report


def wall_stances(scenario: Scenario, robot: Robot) -> list[StartStance]:
    """The stances alone."""
    return _stances(wall_contacts(scenario, robot, False)[0], scenario, robot)


def _headings(scenario: Scenario) -> Array:
    """Of bodies, in H."""
    turn = float(
        np.remainder(scenario.goal.body.rpy_rad[2] - scenario.start.body.rpy_rad[2] + np.pi, 2 * np.pi) - np.pi
    )
    low, high = min(turn, 0.0) - TURN_RAD, max(turn, 0.0) + TURN_RAD
    return np.linspace(low, high, int(np.ceil((high - low) / STEP_RAD)) + 1)


def _reached(found: Pair, contacts: list[Contact], scenario: Scenario, robot: Robot, heading: float) -> None:
    """From where each limb holds, else why not."""
    middle = contacts[0].centre_h_m
    x, y = (at + np.arange(-AROUND_M, AROUND_M + 1e-9, AROUND_STEP_M) for at in middle[:2])
    grid = BodyGrid(_headings(scenario), np.zeros(1), np.zeros(1), np.linspace(*robot.body.height_m, HEIGHTS), x, y)
    low, high = robot.grasp.gripper_yaw_rad
    for name, reach in zip(LIMB_NAMES, reaches_of(robot, MARGIN_RAD), strict=True):
        mask = np.zeros(grid.shape, dtype=bool)
        for contact in contacts:
            seen = grid.seen(np.array(gripper(contact.pose)))
            mask |= reach.reaches(seen) & (seen.yaw_rad >= low) & (seen.yaw_rad <= high)
        if mask.any():
            found.limbs[name] = _from(grid, mask, heading)
        else:
            found.without[name] = _why_not(grid, name, contacts, scenario, robot)
    if not found.limbs:
        found.reason = "; ".join(f"{name}: {why}" for name, why in found.without.items())


def _why_not(grid: BodyGrid, name: str, contacts: list[Contact], scenario: Scenario, robot: Robot) -> str:
    """Proven by the outer map, or not: for a grasp anywhere on the faces and at any height of the pads."""
    limb = LIMB_NAMES.index(name)
    reach, least = reaches_of(robot, MARGIN_RAD)[limb], scenario.start.body.rpy_rad[2]
    grip = next(
        g
        for g in all_grips(scenario, robot, least)
        if (g.contact.hold, g.contact.pair) == (contacts[0].hold, contacts[0].pair)
    )
    half = (grip.height_m[1] - grip.height_m[0]) / 2
    slack = np.array([*np.abs(grip.aside_m * grip.contact.tangent[:2]), half, 0.0])
    ruled = np.ones(grid.shape, dtype=bool)
    for contact in contacts:
        tilt = () if contact.tilt_rad is None else contact.tilt_rad
        ruled &= grid.ruled_out(reach, np.array([*grip.contact.centre_h_m, contact.yaw_rad, *tilt]), slack)
    span = "{:.0f} to {:.0f}".format(*np.degrees(grid.yaw_rad[[0, -1]] + least))
    if ruled.all():
        return f"outside its reach for every level body of a heading of {span} degrees (proven)"
    return f"no level body of a heading of {span} degrees found that has it in reach"


def _from(grid: BodyGrid, mask: Flags, heading: float) -> From:
    cells = np.argwhere(mask)
    middle = cells[int(np.argmin(np.abs(cells - cells.mean(axis=0)).sum(axis=1)))]
    place, rpy = grid.pose(middle.tolist())
    cos, sin = np.cos(heading), np.sin(heading)
    x, y = grid.x_m[cells[:, 4]], grid.y_m[cells[:, 5]]
    east, north, up = cos * x - sin * y, sin * x + cos * y, grid.z_m[cells[:, 3]]
    spans = [(float(each.min()), float(each.max())) for each in (east, north, up)]
    return From(_in_w(place, heading), heading + float(rpy[2]), spans[0], spans[1], spans[2], float(mask.mean()))


def _in_w(place_h: Array, heading: float) -> tuple[float, float, float]:
    x, y, z = rotation_z(heading) @ place_h
    return float(x), float(y), float(z)


def _stances(contacts: list[Contact], scenario: Scenario, robot: Robot) -> list[StartStance]:
    """Of places of a level body with the start's heading and height at which four limbs hold, links off each other."""
    if not contacts:
        return []
    places = np.array([c.centre_h_m for c in contacts])
    (x0, y0), (x1, y1) = places[:, :2].min(axis=0), places[:, :2].max(axis=0)
    z = float(np.clip(scenario.start.body.position_m[2], *robot.body.height_m))
    x, y = (np.linspace(a, b, 2 + int((b - a) / PLACE_M)) for a, b in ((x0, x1), (y0, y1)))
    grid = BodyGrid(np.zeros(1), np.zeros(1), np.zeros(1), np.array([z]), x, y)
    reaches, (low, high) = reaches_of(robot, MARGIN_RAD), robot.grasp.gripper_yaw_rad
    found: list[StartStance] = []
    held = np.zeros((len(LIMB_NAMES), len(contacts), len(x), len(y)), dtype=bool)
    for c, contact in enumerate(contacts):
        if not low <= contact.yaw_rad <= high or contact.spines_only:
            continue
        seen = grid.seen(np.array(gripper(contact.pose)))
        for limb, reach in enumerate(reaches):
            held[limb, c] = np.broadcast_to(reach.reaches(seen), grid.shape)[0, 0, 0, 0]
    for cell in np.argwhere(held.any(axis=1).all(axis=0)).tolist():
        chosen = _four(held[:, :, cell[0], cell[1]], contacts, grid, cell, reaches)
        if chosen is None:
            continue
        body = _in_w(np.array([x[cell[0]], y[cell[1]], z]), scenario.start.body.rpy_rad[2])
        found.append(_named(body, [contacts[c] for c in chosen], scenario))
    return found


def _named(body_m: tuple[float, float, float], grasps: list[Contact], scenario: Scenario) -> StartStance:
    """The stance of a body and its grasps, in limb order."""
    holds = [scenario.holds[each.hold] for each in grasps]
    by_limb = list(zip(LIMB_NAMES, grasps, holds, strict=True))
    named = {name: (hold.name, PAIR_NAMES[each.pair]) for name, each, hold in by_limb}
    return StartStance(body_m, named, {name: each.grip for name, each, hold in by_limb if hold.grips})


def _four(
    held: Flags, contacts: list[Contact], grid: BodyGrid, cell: list[int], reaches: tuple[object, ...]
) -> tuple[int, ...] | None:
    """A contact on another hold for each limb, the most upright grippers first; None if there are none."""
    yaws, ends = np.array([abs(c.yaw_rad) for c in contacts]), []
    for mine in held:
        at = np.flatnonzero(mine)
        ends.append(at[np.argsort(yaws[at], kind="stable")][:4].tolist())
    here = np.zeros(grid.shape, dtype=bool)
    here[0, 0, 0, 0, cell[0], cell[1]] = True
    for chosen in itertools.product(*ends):
        if len({contacts[c].hold for c in chosen}) < len(LIMB_NAMES):
            continue
        grippers = {limb: np.array(gripper(contacts[c].pose)) for limb, c in enumerate(chosen)}
        if grid.apart(here, grippers, reaches, CLEAR_M).any():  # type: ignore[arg-type]
            return chosen
    return None


def way_up(scenario: Scenario, robot: Robot, limit_s: float, looks: int) -> tuple[Highest, StartStance | None]:
    """What the search upwards finds from the scenario's start, whatever its goal, and the highest stance and place to
    rest on it; None where motors hold the body nowhere.

    Raises ScenarioError or InfeasibleError where the robot cannot start so, with the map's margins.
    """
    problem, upwards = _upwards(scenario, robot)
    top = upwards.highest(looks, clock.now() + limit_s) if upwards.starts_on_the_map else None
    if top is None:
        raise InfeasibleError("reach", OFF_THE_MAP)
    if top.rest is None:
        return top, None
    body = _in_w(np.array(top.rest.body_h_m), scenario.start.body.rpy_rad[2])
    return top, _named(body, [problem.contacts[contact] for contact in top.rest.stance], scenario)


def _upwards(scenario: Scenario, robot: Robot) -> tuple[Problem, Upwards]:
    """The search of a level body over all holds, from the scenario's start; raises as `way_up`."""
    heading = scenario.start.body.rpy_deg[2]
    there = replace(scenario, goal=Goal(GoalPose(scenario.start.body.position_m, (0.0, 0.0, heading))))
    problem = build_problem(there, robot)
    check_start(there, problem, StaticEquilibrium(problem, problem.friction_share))
    check_clear(there, problem, robot)
    places = np.array([c.centre_h_m for c in problem.contacts])
    (x0, y0), (x1, y1) = places[:, :2].min(axis=0) - BESIDE_M, places[:, :2].max(axis=0) + BESIDE_M
    at = problem.start.position_m
    axes = [
        through + STEP_M * np.arange(np.floor((a - through) / STEP_M), np.ceil((b - through) / STEP_M) + 1)
        for through, a, b in ((at[0], x0, x1 + ABOVE_M), (at[1], y0, y1))
    ]
    yaws = np.linspace(-2 * STEP_RAD, 2 * STEP_RAD, 5)
    grid = BodyGrid(yaws, np.zeros(1), np.zeros(1), at[2:3], *axes)
    masks = PoseMasks(problem, robot, grid, MARGIN_RAD)
    return problem, Upwards(masks, Footing(problem, grid), SwingCache(problem))


def _climb(report: WallReport, scenario: Scenario, robot: Robot, deadline: float, looks: int) -> None:
    """How far up one gets from the scenario's start, or else from the lowest stance that the planner takes."""
    own = None
    if not scenario.start.air:
        grasps = {name: (grasp.hold, grasp.faces) for name, grasp in scenario.start.grasps.items()}
        own = StartStance(scenario.start.body.position_m, grasps)
    for begun in ([own] if own is not None else []) + report.stances[:STARTS]:
        start = scenario.start
        if begun is not own:
            body = replace(start.body, position_m=begun.body_m, rpy_deg=(0.0, 0.0, start.body.rpy_deg[2]))
            start = replace(start, body=body, air={}, grasps={n: Grasp(*g) for n, g in begun.grasps.items()})
        try:
            problem, upwards = _upwards(replace(scenario, start=start), robot)
        except (ScenarioError, InfeasibleError) as error:
            if begun is own:
                report.refused = str(error)
            continue
        report.begun, report.top = begun, upwards.highest(looks, deadline)
        if report.top is None:
            report.refused = report.refused or OFF_THE_MAP
            continue
        for contact, limbs in report.top.held_by.items():
            each = problem.contacts[contact]
            names = report.held_by.setdefault((problem.hold_names[each.hold], PAIR_NAMES[each.pair]), [])
            names += [LIMB_NAMES[limb] for limb in sorted(limbs) if LIMB_NAMES[limb] not in names]
        report.top.body_h_m = _in_w(np.array(report.top.body_h_m), report.heading_rad)
        return
