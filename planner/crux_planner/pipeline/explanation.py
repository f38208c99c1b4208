"""What to tell the user when a start cannot be used or the search finds no way: which constraint, which limb, where."""

import itertools
from collections.abc import Iterator
from dataclasses import replace

import numpy as np
from crux_contracts import LIMB_NAMES
from crux_contracts.gripper_frames import gripper_rotation
from crux_contracts.robot import Robot
from crux_contracts.scenario import Scenario, Uncertainty

from crux_planner.errors import PLANNED_REACH, TIME_LIMIT, InfeasibleError, LevelGoalError, StuckError, wrong
from crux_planner.model.arrays import Array
from crux_planner.model.contacts import Contact
from crux_planner.model.hands import hands_of, rotations
from crux_planner.model.kinematics import inverse, limit_margin, rotation_from_rpy, rotation_z
from crux_planner.model.poses import beyond_planned_reach, missing_turn_rad, point_text, within_limits
from crux_planner.model.problem import Problem
from crux_planner.model.schedule import Stance
from crux_planner.physics.reachable_set import ReachableSet, goal_contacts
from crux_planner.reach import between
from crux_planner.reach.arm import CLEAR_M, reaches_of
from crux_planner.reach.poses import GripperPoses
from crux_planner.reach.solids import Links, gap_m, solids
from crux_planner.reach.trunk_clearance import boxes_of
from crux_planner.search.equilibrium import StaticEquilibrium
from crux_planner.search.map_search import MapSearch
from crux_planner.search.stances import Oracles, SearchReport, costs_to_go
from crux_planner.swing.swing_cache import SwingCache
from crux_planner.trajectory.box_planes import separation

LACKING_N = 0.01  # a balance that lacks less is met
LEAST_APART_M = CLEAR_M / 2  # of links and trunk, as the check asks
_SAME_M = 1e-4  # as exactly as it does


def check_start(scenario: Scenario, problem: Problem, equilibrium: StaticEquilibrium) -> None:
    """Raise ScenarioError where a start grasp is out of reach or the start is not in equilibrium."""
    for limb, name in enumerate(LIMB_NAMES):
        if (missing := _missing_reach(scenario, problem, limb)) is not None:
            hold, what = _place_text(problem, problem.start_contacts[limb]), "hold"
            if problem.contacts[problem.start_contacts[limb]].foot:
                what = "foothold"
            raise wrong(scenario, f"start.grasps.{name}.{what}", hold, missing)
    stance = problem.start_contacts
    at = problem.start.position_m
    no_balance = equilibrium.position(stance, at, at, at) is None
    if no_balance and LACKING_N < (lacking := equilibrium.missing_force(stance, at, at)) < np.inf:
        text = f"not in equilibrium: friction, spines and contact.max_normal_N fall short by {lacking:.1f} N"
        cure = "give the grasped faces more friction, or the body another place"
        raise wrong(scenario, "start.grasps", _stance_text(problem, stance), f"{text}; {cure}")


def _missing_reach(scenario: Scenario, problem: Problem, limb: int) -> str | None:
    """Why a limb cannot hold on where the climb starts; None where it can, wherever its hold may be."""
    contact, own, start = problem.contacts[problem.start_contacts[limb]], problem.limb_masses[limb].limb, problem.start
    place = rotation_from_rpy(start.rpy_rad).T @ (contact.centre_h_m - start.position_m)
    reached = within_limits(own, start, contact.pose)
    if reached and scenario.uncertainty is not None and contact.bears:
        if all(within_limits(own, start, there) for there in _moved(contact, scenario.uncertainty)):
            return None
        known = scenario.uncertainty
        off = f"{1e3 * known.hold_position_m:g} mm along each of its axes and {known.hold_yaw_deg:g} degrees off"
        return f"out of reach within the joint limits where the hold is {off}, as it may be"
    if reached or not (contact.bears or own.closed_form):
        return None
    if (off_rad := missing_turn_rad(own, start, contact.pose)) > 0:
        off = f"it would stand {np.degrees(off_rad):.1f} degrees off"
        return f"the {len(own.joints)} joints of {LIMB_NAMES[limb]} cannot turn the gripper so: {off}"
    outside, turn = _outside_m(scenario, problem, limb), np.degrees(contact.yaw_rad - start.rpy_rad[2])
    text = f"out of reach by {1000 * outside:.0f} mm" if outside > 0 else "out of reach"
    text += f" within the joint limits with the gripper turned by {turn:.0f} degrees to the body"
    inner = problem.limb_reach.inner
    centre, half = inner.centre_b_m[limb], inner.half_m
    axis = int(np.argmax(np.abs(place - centre) - half))
    low, high = centre[axis] - half[axis], centre[axis] + half[axis]
    if low <= place[axis] <= high:
        return text
    at = f"{'xyz'[axis]} = {place[axis]:.3f} m in the body frame"
    return f"{text}: it would be at {at}; {low:.3f}..{high:.3f} m is the middle of what {LIMB_NAMES[limb]} reaches"


def _moved(contact: Contact, known: Uncertainty) -> Iterator[Array]:
    """Poses (5 or 7,) of a gripper that holds on where its hold is as far off as it may be."""
    pose, off_m, turned_rad = contact.pose, known.hold_position_m, known.hold_yaw_rad
    surface = gripper_rotation(0.0, np.zeros(2) if contact.tilt_rad is None else contact.tilt_rad)[:, :2]
    for x, y, turned in itertools.product((-off_m, off_m), (-off_m, off_m), (-turned_rad, turned_rad)):
        there = pose.copy()
        there[:3] += surface @ [x, y]
        there[3] += turned
        yield there


def check_clear(scenario: Scenario, problem: Problem, robot: Robot) -> None:
    """Raise ScenarioError where the trunk or links would start in a cuboid that they may touch, in what is behind a
    surface, or at each other.
    """
    start, boxes = problem.start, boxes_of(problem.solids)
    pose, turn = np.concatenate([start.position_m, start.rpy_rad])[None], rotation_from_rpy(start.rpy_rad)
    tall = [each.name for each, tall in zip(scenario.cuboids, problem.tall, strict=True) if tall]
    hands = hands_of(np.array([problem.contacts[c].pose for c in problem.start_contacts]))
    for name, box in zip((*tall, *problem.surfaces.names), boxes, strict=True):
        gaps = {"the trunk": min(float(separation(t, box, pose)[1][0]) for t in reaches_of(robot)[0].keep_off.trunk)}
        for limb, reach in enumerate(reaches_of(robot)):
            place = (turn.T @ (hands[limb, :3] - start.position_m))[None]
            yaw = hands[limb, 3] - start.rpy_rad[2]
            links = reach.links(GripperPoses.of(place, (turn.T @ rotations(hands[limb]))[None], yaw))
            ends = (start.position_m + end[0, ~links.hand] @ turn.T for end in (links.start_m, links.end_m))
            gaps[f"a link of {LIMB_NAMES[limb]}"] = float((gap_m((box,), *ends) - links.radius_m[~links.hand]).min())
        what = min(gaps, key=lambda each: gaps[each])
        if gaps[what] < 0.0:
            text = f"{what} would be {-1000 * gaps[what]:.0f} mm inside {name}"
            raise wrong(scenario, "start.body", point_text(problem, start.position_m), text)
    _check_apart(scenario, problem, robot)


def _check_apart(scenario: Scenario, problem: Problem, robot: Robot) -> None:
    """Raise ScenarioError where, for certain, links start nearer to the trunk or to another limb's than the check
    allows: of shapes that are all in the links.
    """
    start, turn = problem.start, rotation_from_rpy(problem.start.rpy_rad)
    hands = hands_of(np.array([problem.contacts[c].pose for c in problem.start_contacts]))
    place, turned, yaw = (hands[:, :3] - start.position_m) @ turn, turn.T @ rotations(hands), hands[:, 3]
    all_links: list[Links] = []
    for limb, (name, reach) in enumerate(zip(LIMB_NAMES, reaches_of(robot), strict=True)):
        shapes = solids(robot, reach.limb, around=False)
        seen = GripperPoses.of(place[[limb]], turned[[limb]], yaw[limb] - start.rpy_rad[2])
        links = replace(reach, keep_off=shapes).links(seen)  # type: ignore[type-var]
        all_links.append(links)
        own = slice(len(shapes.links))
        gaps = gap_m(shapes.trunk, links.start_m[0, own], links.end_m[0, own]) - links.radius_m[own]
        _apart(scenario, problem, f"a link of {name}", "the trunk", float(gaps.min(initial=np.inf)))
    for one, two in itertools.combinations(range(len(LIMB_NAMES)), 2):
        gap = float(between.gap_m(all_links[one], all_links[two], hands=False)[0])
        _apart(scenario, problem, f"a link of {LIMB_NAMES[one]}", f"one of {LIMB_NAMES[two]}", gap)


def _apart(scenario: Scenario, problem: Problem, what: str, other: str, gap: float) -> None:
    if gap < LEAST_APART_M - _SAME_M:
        text = f"{what} would be {1000 * gap:.1f} mm off {other}, expected at least {1000 * LEAST_APART_M:.0f} mm"
        raise wrong(scenario, "start.body", point_text(problem, problem.start.position_m), text)


def _outside_m(scenario: Scenario, problem: Problem, limb: int) -> float:
    """How far [m] the start's grasp, wherever on its faces, is outside the outer set of a limb; not positive: it may be
    within reach.
    """
    grasp, outer, start = problem.contacts[problem.start_contacts[limb]], problem.limb_reach.outer, problem.start
    if not grasp.bears:
        return 0.0
    if grasp.foot:
        places = [(grasp.centre_h_m + outer.above_m * grasp.up).tolist()]
    else:
        hold, radius = scenario.holds[grasp.hold], scenario.contact.patch_radius_m
        aside = max(hold.size_m[1 - grasp.pair] / 2 - radius, 0.0)
        ends = itertools.product((-aside, aside), (radius, hold.size_m[2] - radius))
        places = [[*(grasp.centre_h_m + side * grasp.tangent)[:2], z + outer.above_m] for side, z in ends]
    along = (np.array(places) - start.position_m) @ rotation_from_rpy(start.rpy_rad) @ outer.directions.T
    off, extent = along - outer.middle_m[limb], outer.extent_m[limb]
    return float(np.maximum(off.min(axis=0) - extent, -off.max(axis=0) - extent).max())


def explain(oracles: Oracles, report: SearchReport, at_once: int) -> InfeasibleError:
    """Why the search found nothing."""
    problem, equilibrium, reach, swings = oracles.problem, oracles.equilibrium, oracles.reachable, oracles.swings
    crowded = "no gripper gets on: other grippers or cuboids stand in the way of every swing"
    return (
        _goal_out_of_reach(problem, reach)
        or _chain_broken(problem, reach, swings)
        or _timed_out(problem, report)
        or _goal_unbalanced(problem, equilibrium, report)
        or _lift_unbalanced(problem, equilibrium, reach, report, at_once)
        or InfeasibleError("passage", f"from {_stance_text(problem, report.nearest)} {crowded}")
    )


def level_stance_at_goal(problem: Problem, robot: Robot) -> Stance | None:
    """Four holds that the joint limits themselves let a level body grip at its goal; None if there are none.

    The body is looked at in the middle of the goal's tolerance and at the corners of a cube in it.
    """
    goal = problem.goal
    centres = np.stack([c.centre_h_m for c in problem.contacts])
    turns = rotation_z(-goal.body.rpy_rad[2]) @ rotations(hands_of(np.array([c.pose for c in problem.contacts])))
    holds = np.array([c.hold for c in problem.contacts])
    (low, high), yaw_rad = problem.gripper_yaw_rad, np.array([c.yaw_rad for c in problem.contacts])
    turned = (low <= yaw_rad - goal.body.rpy_rad[2]) & (yaw_rad - goal.body.rpy_rad[2] <= high)
    corners = np.array([[0.0] * 3, *itertools.product((-1.0, 1.0), repeat=3)])
    for position in goal.body.position_m + goal.position_slack_m * corners:
        place = (centres - position) @ rotation_z(goal.body.rpy_rad[2])
        ends = []
        for index, limb in enumerate(robot.limbs):
            q, reached = inverse(limb, place, turns)
            ok = reached & (limit_margin(limb, q) >= 0.0)
            ok &= np.isin(np.arange(len(holds)), problem.limb_contacts[index]) & turned
            ok &= np.array([problem.may_end(index, c) for c in problem.contacts])
            at = np.flatnonzero(ok)
            ends.append(at[np.unique(holds[at], return_index=True)[1]].tolist())
        for first, second, third, fourth in itertools.product(*ends):
            if len(set(holds[[first, second, third, fourth]])) == len(LIMB_NAMES):
                return first, second, third, fourth
    return None


def no_way_to(problem: Problem, stance: Stance, none: InfeasibleError) -> InfeasibleError:
    """What to say instead of a want of reach where a level body could stand at the goal."""
    held = _stance_text(problem, stance)
    text = f"no sequence of contacts found to the goal, where joint limits let a level body hold {held}"
    reason = InfeasibleError("contacts", f"{text}; {none}" if none.relaxed else text, undecided=none.undecided)
    reason.relaxed = none.relaxed
    return reason


def stuck_at(search: MapSearch) -> InfeasibleError | None:
    """Where a search by map got nearest to the goal, and what keeps its limbs there; None where it stood nowhere."""
    if search.nearest is None:
        return None
    nearest, kept = _stance_text(search.problem, search.nearest[0]), search.stuck(search.nearest)
    if not search.problem.follows:
        return StuckError("reach", f"the map leads no nearer to the goal than {nearest}: {kept}")
    text = f"no sequence of contacts found for a body that tilts with the surfaces; nearest to the goal was {nearest}"
    return InfeasibleError("contacts", f"{text}: {kept}")


def _goal_out_of_reach(problem: Problem, reach: ReachableSet) -> InfeasibleError | None:
    goal, slack = problem.goal.body.position_m, problem.goal.position_slack_m
    for limb, ends in enumerate(goal_contacts(problem, reach)):
        if ends:
            continue
        usable = [c for c in reach.usable[limb] if problem.may_end(limb, problem.contacts[c])]
        if not usable:
            return InfeasibleError("reach", f"no hold can be gripped by {LIMB_NAMES[limb]}")
        near, far = reach.around(goal, slack)
        beyond = np.maximum(reach.low[limb, usable] - far, near - reach.high[limb, usable]).max(axis=1)
        nearest = int(np.argmin(beyond))
        hold = problem.hold_names[problem.contacts[usable[nearest]].hold]
        return LevelGoalError("reach", beyond_planned_reach(problem, limb, hold, beyond[nearest]))
    return None


def _chain_broken(problem: Problem, reach: ReachableSet, swings: SwingCache) -> InfeasibleError | None:
    """A limb whose holds do not lead from start to goal, even with all other limbs out of the way."""
    for limb, table in enumerate(costs_to_go(problem, reach, swings)):
        if problem.start_contacts[limb] in table:
            continue
        low, high = reach.low[limb], reach.high[limb]
        line = np.linspace(problem.start.position_m, problem.goal.body.position_m, 200)
        along = line @ reach.shape.directions.T
        usable = reach.usable[limb]
        inside = (along[:, None] >= low[usable] - 1e-9) & (along[:, None] <= high[usable] + 1e-9)
        inside = inside.all(axis=2).any(axis=1)
        if not inside.all():
            first = int(np.argmin(inside))
            after = first + int(np.argmax(inside[first:])) if inside[first:].any() else len(line)
            span = f"{point_text(problem, line[first])} and {point_text(problem, line[after - 1])}"
            text = f"no hold for {LIMB_NAMES[limb]} within {PLANNED_REACH} for a body between {span}"
            return InfeasibleError("reach", text)
        hold = _place_text(problem, problem.start_contacts[limb])
        if swings.any_forbidden:
            text = f"{LIMB_NAMES[limb]} gets from {hold} to no hold towards the goal without touching something"
            return InfeasibleError("passage", text)
        text = f"{LIMB_NAMES[limb]} finds no chain of holds from {hold} to the goal"
        if _connected(problem, reach, limb):
            return InfeasibleError("passage", f"{text}: obstacles or other holds close every way")
        why = f"no body position has both the hold it leaves and one nearer the goal within {PLANNED_REACH}"
        return InfeasibleError("reach", f"{text}: {why}")
    return None


def _connected(problem: Problem, reach: ReachableSet, limb: int) -> bool:
    """Whether a limb's holds would lead from start to goal, hold by hold in reach, if nothing stood in its way."""
    usable, seen = set(reach.usable[limb]), set(goal_contacts(problem, reach)[limb])
    queue = list(seen)
    while queue:
        near = usable.intersection(map(int, reach.neighbours(limb, queue.pop()))) - seen
        seen |= near
        queue += near
    return problem.start_contacts[limb] in seen


def _timed_out(problem: Problem, report: SearchReport) -> InfeasibleError | None:
    if not report.timed_out:
        return None
    seen = f"{report.expanded} stances looked at, nearest to the goal: {_stance_text(problem, report.nearest)}"
    text = f"no sequence of contacts found in the time allowed ({seen}); allow more with --time-limit"
    return InfeasibleError(TIME_LIMIT, text)


def _goal_unbalanced(problem: Problem, equilibrium: StaticEquilibrium, report: SearchReport) -> InfeasibleError | None:
    """The search reached stances with the goal in reach, but the body cannot stand there."""
    if report.nearest is None or report.nearest_cost > 1e-9:
        return None
    at = problem.goal.body.position_m
    lacking = equilibrium.missing_force(report.nearest, at, at)
    return _unbalanced(f"no equilibrium at the goal on {_stance_text(problem, report.nearest)}", lacking)


def _lift_unbalanced(
    problem: Problem, equilibrium: StaticEquilibrium, reach: ReachableSet, report: SearchReport, at_once: int
) -> InfeasibleError | None:
    bounds = reach.of(report.nearest) if report.nearest is not None else None
    if report.nearest is None or bounds is None or not report.lifts_without_balance:
        return None
    limbs = sorted(report.lifts_without_balance) if at_once == 1 else list(range(4))
    shortages = []
    for limb in limbs:
        support = tuple(c for other, c in enumerate(report.nearest) if other != limb)
        shortages.append((equilibrium.missing_force(support, *bounds, report.nearest), limb))
    lacking, limb = min(shortages)
    others = _stance_text(problem, report.nearest, without=limb)
    return _unbalanced(f"no equilibrium when {LIMB_NAMES[limb]} lifts off with the others on {others}", lacking)


def _unbalanced(where: str, lacking_N: float) -> InfeasibleError:
    """By friction, or by joint torques where friction lacks nothing; inf is not known."""
    if lacking_N == np.inf:
        return InfeasibleError("equilibrium", f"{where}: none was found")
    if lacking_N < LACKING_N:
        return InfeasibleError("torque", f"{where}: the joints are too weak for what friction would hold")
    return InfeasibleError("equilibrium", f"{where}: friction and spines fall short by {lacking_N:.1f} N")


def _place_text(problem: Problem, contact: int) -> str:
    """The hold of a contact, by name."""
    grasp = problem.contacts[contact]
    return problem.hold_names[grasp.hold] if grasp.bears else "in the air"


def _stance_text(problem: Problem, stance: Stance | None, without: int | None = None) -> str:
    if stance is None:
        return "the start"
    others = [limb for limb in range(len(stance)) if limb != without]
    return ", ".join(f"{LIMB_NAMES[limb]} {_place_text(problem, stance[limb])}" for limb in others)
