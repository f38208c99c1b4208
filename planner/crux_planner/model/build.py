"""From a scenario and a robot description to the numbers of P1.

Everything is expressed in the heading frame H: W turned about its z so that the body starts with yaw 0;
`pipeline/message.py` turns the plan back. What the scenario's author must fix is a ScenarioError; what the wall does
not allow, an InfeasibleError.
"""

import math

import numpy as np
from crux_contracts import LIMB_NAMES
from crux_contracts.gripper_frames import gripper_rotation
from crux_contracts.robot import Robot
from crux_contracts.scenario import Grasp, Scenario

from crux_planner.errors import InfeasibleError, wrong
from crux_planner.model.arrays import Array
from crux_planner.model.contacts import (
    FACE_NAMES,
    PAIR_NAMES,
    Contact,
    GripperShape,
    SwingLimits,
    opening_for,
)
from crux_planner.model.cuboids import Cuboids, cuboids_of
from crux_planner.model.faces import PASSING_CLEARANCE_M, smooth_faces
from crux_planner.model.footholds import Stands
from crux_planner.model.kinematics import rotation_z
from crux_planner.model.limb import limb_masses
from crux_planner.model.mass import body_moment, composite_inertia
from crux_planner.model.offers import TIGHT_CLEARANCE_M, Offers, all_grips
from crux_planner.model.poses import body_and_ends, posture, weights_of, within_limits
from crux_planner.model.problem import BodyBounds, Goal, Patch, Pose, Problem
from crux_planner.model.shapes import limb_radii_m
from crux_planner.model.surfaces import Surfaces
from crux_planner.model.workspace import LimbReach, Reach, WorkspaceRange, leaning_m, limb_reach, tilt_for

MOST_CUBOIDS, MOST_WAY_M = 300, 40.0  # holds, and as many obstacles, and way that are planned at once
LIFT_RESERVE_M = 0.006  # kept below the highest lift that the highest body allows, for a body that tilts
FRICTION_MARGIN = 0.1  # share of the limit surface left unused
MOST_FRICTION = 0.929  # share of (2) that a disc under even pressure bears whatever the load, as the check has it: (2a)
TORQUE_MARGIN = 0.25  # share of the peak torques left unused at the knots, for what moves between them and for errors
LEAST_TORQUE_MARGIN = 0.1  # the same where no plan leaves more: the check has the last word
STEEPEST_RAD = 1.4  # roll and pitch of a body beside bounded surfaces alone: pitch and yaw turn alike at a right angle
ROUNDING_RAD = 1e-9  # of the yaw of a gripper at the edge of its range


def build_problem(
    scenario: Scenario, robot: Robot, *, off_centre: bool = False, reach: LimbReach | None = None
) -> Problem:
    """P1 of a scenario of patch contacts; with `off_centre`, grasps near the ends of wide faces too.

    `reach` is the robot's, where another problem has it already.

    Raises ScenarioError and InfeasibleError.
    """
    _is_about_climbs(scenario, robot)
    _fits_one_plan(scenario)
    body, margins = _body_bounds(scenario, robot), scenario.planner.margins
    heading, start, goal = body_and_ends(scenario, body)
    effort = np.stack([limb.effort_Nm for limb in robot.limbs])
    tilt_rad = tilt_for([start.rpy_rad, goal.rpy_rad], robot.body.max_tilt_rad)
    reach, shape = reach or reach_of(robot, tilt_rad), _gripper_shape(robot)
    surfaces = Surfaces.of(scenario.wall, heading)
    clearance_m = margins.get("clearance_m", robot.grasp.swing_clearance_m)
    limits = _swing_limits(scenario, robot, reach.box, clearance_m, surfaces)
    cuboids = cuboids_of(scenario.cuboids, heading)
    turn_rad = float(goal.rpy_rad[2])
    offers = Offers.of(scenario, robot, cuboids, surfaces, shape, limits, off_centre, turn_rad)
    contacts, unusable = _with_footholds(offers, heading, turn_rad)
    contacts += [_in_air(limb, scenario, heading, cuboids, shape) for limb in scenario.start.air]
    begin = start_contacts(scenario, robot, start, contacts, unusable, robot.grasp.gripper_yaw_rad)
    contact, (tolerance_m, tolerance_rad) = scenario.contact, (scenario.goal.tolerance_m, scenario.goal.tolerance_rad)
    steepest_rad = np.abs([start.rpy_rad[:2], goal.rpy_rad[:2]]).max()
    problem = Problem(
        steps=scenario.horizon.steps,
        dt_s=scenario.horizon.dt_s,
        gravity_h=rotation_z(-heading) @ np.array(scenario.wall.gravity_w_m_s2),
        mass_kg=robot.total_mass_kg,
        inertia_b=start_inertia(robot, start, [contacts[i] for i in begin]),
        patch=Patch(contact.patch_k_m, contact.max_normal_N, contact.spine_shear_N, contact.spine_twist_Nm),
        cuboids=cuboids,
        surfaces=surfaces,
        hold_names=_names(scenario),
        contacts=contacts,
        limb_contacts=_limb_contacts(scenario, contacts, begin),
        start_contacts=(begin[0], begin[1], begin[2], begin[3]),
        start=start,
        goal=Goal(goal, tolerance_m, tolerance_rad, _goal_grasps(scenario, robot, unusable)),
        boxes=reach.box,
        limb_reach=reach,
        gripper_yaw_rad=robot.grasp.gripper_yaw_rad,
        body=body,
        shape=shape,
        swing=limits,
        weights=weights_of(scenario),
        friction_share=min(1.0 - margins.get("friction", FRICTION_MARGIN), MOST_FRICTION),
        limb_masses=tuple(limb_masses(robot, limb) for limb in robot.limbs),
        body_moment_kg_m=body_moment(robot),
        limb_radii_m=limb_radii_m(robot),
        torque_limits_Nm=(1.0 - margins.get("torque", TORQUE_MARGIN)) * effort,
        last_torques_Nm=(1.0 - margins.get("torque", LEAST_TORQUE_MARGIN)) * effort,
        heading_rad=heading,
        follows=not surfaces.endless and bool(steepest_rad > reach.box.max_tilt_rad),
        limit_surface=scenario.planner.limit_surface,
    )
    return problem if scenario.uncertainty is None else problem.sure_of(scenario.uncertainty)


def _with_footholds(
    offers: Offers, heading_rad: float, final_yaw_rad: float
) -> tuple[list[Contact], dict[tuple[int, int], str]]:
    """Grasps and stands that the wall offers, and why a hold and pair, or a foothold, offers none."""
    contacts, unusable = offers.contacts()
    if not offers.scenario.footholds:
        return contacts, unusable
    given = offers.scenario, offers.cuboids, offers.surfaces, offers.shape, heading_rad, offers.yaw_range
    stands, why = Stands(*given, final_yaw_rad, min(offers.limits.clearance_m, TIGHT_CLEARANCE_M)).contacts()
    return contacts + stands, unusable | why


def _names(scenario: Scenario) -> list[str]:
    """Of holds; where limbs may stand, of all cuboids and footholds, as plan_t.holds has them."""
    if not scenario.footholds:
        return [hold.name for hold in scenario.holds]
    return [*(cuboid.name for cuboid in scenario.cuboids), *(foothold.name for foothold in scenario.footholds)]


def _is_about_climbs(scenario: Scenario, robot: Robot) -> None:
    """Raises ScenarioError where contacts or what is uncertain cannot be planned for."""
    if scenario.contact.model != "patch":
        raise wrong(scenario, "contact.model", scenario.contact.model, "expected patch: this is about climbs")
    if scenario.contact.max_normal_N > robot.gripper.max_finger_force_N:
        most = f"expected at most {robot.gripper.max_finger_force_N:g} N, what a finger of {robot.name} can press"
        raise wrong(scenario, "contact.max_normal_N", f"{scenario.contact.max_normal_N:g}", most)
    if scenario.uncertainty is not None and scenario.footholds:
        standing = f"is not supported yet where limbs may stand, as on {scenario.footholds[0].name}"
        raise wrong(scenario, "uncertainty", "", standing)
    if scenario.uncertainty is not None and scenario.leans:
        leaning = next(hold.name for hold in scenario.holds if hold.leans)
        raise wrong(scenario, "uncertainty", "", f"is not supported yet where {leaning} has faces that lean")
    at_angle = next((hold.name for hold in scenario.holds if hold.tilted_grips), None)
    if scenario.uncertainty is not None and scenario.uncertainty.moves_holds and at_angle is not None:
        why = f"of holds' places is not supported yet where {at_angle} has a grip at an angle"
        raise wrong(scenario, "uncertainty", "", why)


def _fits_one_plan(scenario: Scenario) -> None:
    expected = "in one plan; crux plan --stream plans a route part by part"
    for key, count in (("holds", len(scenario.holds)), ("obstacles", len(scenario.obstacles))):
        if count > MOST_CUBOIDS:
            raise wrong(scenario, key, str(count), f"expected at most {MOST_CUBOIDS} {expected}")
    way_m = math.dist(scenario.start.body.position_m, scenario.goal.body.position_m)
    if way_m > MOST_WAY_M:
        raise wrong(scenario, "goal.body", f"{way_m:.1f} m away", f"expected at most {MOST_WAY_M:g} m {expected}")


def wall_contacts(
    scenario: Scenario, robot: Robot, off_centre: bool
) -> tuple[list[Contact], dict[tuple[int, int], str]]:
    """All grasps that the wall offers, for the heading of the start, and why a (hold, pair) offers none: whatever start
    and goal are.
    """
    reach = reach_of(robot, tilt_for([np.zeros(3)], robot.body.max_tilt_rad))
    clearance_m = scenario.planner.margins.get("clearance_m", robot.grasp.swing_clearance_m)
    heading = scenario.start.body.rpy_rad[2]
    surfaces = Surfaces.of(scenario.wall, heading)
    limits = _swing_limits(scenario, robot, reach.box, clearance_m, surfaces)
    cuboids, shape = cuboids_of(scenario.cuboids, heading), _gripper_shape(robot)
    return Offers.of(scenario, robot, cuboids, surfaces, shape, limits, off_centre, 0.0).contacts()


def _body_bounds(scenario: Scenario, robot: Robot) -> BodyBounds:
    """(7) of the body: beside bounded surfaces alone any height, and any tilt but the steepest."""
    bounds = robot.body
    ranges = (bounds.height_m, bounds.max_tilt_rad) if scenario.wall.endless else ((-np.inf, np.inf), STEEPEST_RAD)
    return BodyBounds(*ranges, bounds.max_speed_m_s, bounds.max_rate_rad_s, bounds.height_m[0])


def _gripper_shape(robot: Robot) -> GripperShape:
    gripper = robot.gripper
    return GripperShape(*gripper.opening_m, gripper.open_opening_m, gripper.pad_radius_m, gripper.finger_height_m)


_KNOWN: dict[tuple[str, float], LimbReach] = {}


def reach_of(robot: Robot, tilt_rad: float) -> LimbReach:
    """(9a) for tilts up to `tilt_rad` and every gripper yaw, from the pads' least height on a hold to the highest
    swing; the outer set for all tilts; once a process for robots of one hash. Raises InfeasibleError where limbs do not
    reach so with the body that tilted.
    """
    key = robot.hash, tilt_rad
    if key not in _KNOWN:
        _KNOWN[key] = _reach_of(robot, tilt_rad)
    return _KNOWN[key]


def _reach_of(robot: Robot, tilt_rad: float) -> LimbReach:
    grasp = robot.grasp
    wanted = WorkspaceRange(
        robot.body.height_m,
        grasp.pad_height_m,
        grasp.pad_height_m[1] + robot.gripper.pad_radius_m + grasp.swing_clearance_m,
        grasp.max_swing_height_m,
        tilt_rad,
        grasp.gripper_yaw_rad,
        robot.body.max_tilt_rad,
    )
    return limb_reach(robot.limbs, wanted)


def _swing_limits(
    scenario: Scenario, robot: Robot, boxes: Reach, clearance_m: float, surfaces: Surfaces
) -> SwingLimits:
    """No swing is higher than what every limb reaches under the highest body; on bounded surfaces the map of reach says
    how high that is.
    """
    lean = max(leaning_m(limb, boxes.max_tilt_rad) for limb in robot.limbs)
    top_m = robot.body.height_m[1] + float((boxes.centre_b_m[:, 2] + boxes.half_m[2]).min()) - lean - LIFT_RESERVE_M
    return SwingLimits(
        scenario.horizon.dt_s,
        robot.grasp.approach_speed_m_s,
        robot.grasp.yaw_rate_rad_s,
        clearance_m,
        PASSING_CLEARANCE_M,
        robot.grasp.max_swing_height_m if surfaces.names else min(robot.grasp.max_swing_height_m, top_m),
        endless=surfaces.endless,
        slabs=surfaces.slabs,
    )


def _limb_contacts(scenario: Scenario, contacts: list[Contact], begin: list[int]) -> list[list[int]]:
    """By limb, the contacts that are for the finger it hangs on, if for one, and hold."""
    hanging = [scenario.contact.spines_only.get(limb, 0) for limb in LIMB_NAMES]
    return [
        [i for i, c in enumerate(contacts) if c.spines_only == finger and (c.bears or i == here)]
        for finger, here in zip(hanging, begin, strict=True)
    ]


def _in_air(name: str, scenario: Scenario, heading: float, cuboids: Cuboids, shape: GripperShape) -> Contact:
    """Where a limb is in the air at the start: a contact that bears nothing; its hold: what it surrounds."""
    gripper, limb = scenario.start.air[name], LIMB_NAMES.index(name)
    centre = rotation_z(-heading) @ np.array(gripper.position_m)
    yaw = math.remainder(gripper.yaw_rad - heading, 2 * math.pi)
    turn = gripper_rotation(yaw, np.zeros(2))
    inside = np.flatnonzero(cuboids.distance(centre) < 0.0)
    hold = int(inside[0]) if len(inside) else -1 - limb
    half = float(np.clip(gripper.opening_m, shape.smallest_opening, shape.largest_opening))
    opening = opening_for(centre, turn, hold, half, cuboids, shape, TIGHT_CLEARANCE_M) or shape.open_opening
    finger = scenario.contact.spines_only.get(name, 0)
    nothing = (np.zeros(2), np.zeros((2, 3)))
    tilt = np.zeros(2) if scenario.tilts else None
    return Contact(hold, 0, -1, yaw, centre, 2 * half, *nothing, max(opening, half), finger, bears=False, tilt_rad=tilt)


def start_contacts(
    scenario: Scenario,
    robot: Robot,
    start: Pose,
    contacts: list[Contact],
    unusable: dict[tuple[int, int], str],
    turned_rad: tuple[float, float],
) -> list[int]:
    """The contacts of the scenario's start, of those of a hold and pair the least turned that the limb reaches with the
    body at `start`, and off its heading by what is in `turned_rad`; `unusable` says why a hold and pair has none.
    Raises ScenarioError.
    """
    low, high = np.array(turned_rad) + start.rpy_rad[2] + [-ROUNDING_RAD, ROUNDING_RAD]
    chosen, in_air = [], (i for i, c in enumerate(contacts) if not c.bears)  # in the order of start.air
    begun = {limb: next(in_air) for limb in scenario.start.air}
    for limb, own in zip(LIMB_NAMES, robot.limbs, strict=True):
        if limb in begun:
            chosen.append(begun[limb])
            continue
        grasp = scenario.start.grasps[limb]
        hold, pair = _wanted(scenario, grasp)
        finger = scenario.contact.spines_only.get(limb, 0)
        found = [i for i, c in enumerate(contacts) if (c.hold, c.pair, c.spines_only) == (hold, pair, finger)]
        if not found:
            why = unusable.get((hold, pair), f"finger {finger} never presses, so its face needs spines")
            shown = grasp.foothold or f"{grasp.hold}, faces {grasp.faces}"
            raise wrong(scenario, f"start.grasps.{limb}", shown, why)
        if not grasp.foothold:
            found = [i for i in found if grasp.finger1 in (None, FACE_NAMES[contacts[i].finger1_face])]
        found = [i for i in found if low <= contacts[i].yaw_rad <= high]
        if not found:
            beyond = "expected the other face: with this one the gripper would be turned beyond its range"
            raise wrong(scenario, f"start.grasps.{limb}.finger1", str(grasp.finger1), beyond)
        found = [i for i in found if grasp.grip in (None, contacts[i].grip)]
        if not found:
            why = f"fingers have no space there on {grasp.hold}"
            raise wrong(scenario, f"start.grasps.{limb}.grip", str(grasp.grip), why)
        found = [i for i in found if within_limits(own, start, contacts[i].pose)] or found
        chosen.append(min(found, key=lambda i: abs(contacts[i].yaw_rad)))  # of equal ones the first: centred
    return chosen


def _goal_grasps(scenario: Scenario, robot: Robot, unusable: dict[tuple[int, int], str]) -> dict[int, tuple[int, int]]:
    wanted = {}
    for limb, grasp in scenario.goal.grasps.items():
        key = _wanted(scenario, grasp)
        if key in unusable and grasp.foothold:
            text = f"goal.grasps.{limb}: no gripper can stand on {grasp.foothold}: {unusable[key]}"
            raise InfeasibleError("goal grasp", text)
        if key in unusable:
            spanned = {(g.contact.hold, g.contact.pair) for g in all_grips(scenario, robot, 0.0)}
            raise InfeasibleError(
                "goal grasp",
                f"goal.grasps.{limb}: {grasp.hold} cannot be gripped by faces {grasp.faces}: {unusable[key]}",
                proven=not scenario.not_upright
                and (key not in spanned or bool(smooth_faces(scenario.holds[key[0]], key[1]))),
            )
        wanted[LIMB_NAMES.index(limb)] = key
    return wanted


def _wanted(scenario: Scenario, grasp: Grasp) -> tuple[int, int]:
    """Hold and pair of a grasp; a foothold, as contacts number it, and 0."""
    return scenario.place_index(grasp), 0 if grasp.foothold else PAIR_NAMES.index(grasp.faces)


def start_inertia(robot: Robot, start: Pose, grasps: list[Contact]) -> Array:
    """Inertia about the centre of mass in the posture of the start."""
    return composite_inertia(robot, posture(robot, start, np.array([grasp.pose for grasp in grasps])))
