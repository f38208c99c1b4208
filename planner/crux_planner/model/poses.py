"""What climbs and walks read from a scenario alike: poses in the heading frame H, bounds of the body, weights of J."""

import math

import numpy as np
from crux_contracts import LIMB_NAMES
from crux_contracts.cost_weights import cost_weights
from crux_contracts.robot import Limb, Robot
from crux_contracts.robot_bounds import STILL_RAD
from crux_contracts.scenario import BodyPose, Scenario

from crux_planner.errors import PLANNED_REACH, InfeasibleError, wrong
from crux_planner.model.arrays import Array
from crux_planner.model.hands import hands_of, rotations
from crux_planner.model.kinematics import inverse, limit_margin, rotation_from_rpy, rotation_z
from crux_planner.model.problem import BodyBounds, Pose, Problem, Weights


def pose_in_heading_frame(body: BodyPose, heading: float) -> Pose:
    """A body pose of the scenario, turned so that the start has yaw 0."""
    position = rotation_z(-heading) @ np.array(body.position_m)
    rpy = np.array(body.rpy_rad) - np.array([0.0, 0.0, heading])
    rpy[2] = math.remainder(rpy[2], 2 * math.pi)
    return Pose(position, rpy)


def check_body(scenario: Scenario, body: BodyBounds, start: Pose, goal: Pose) -> None:
    """Bounds (7) of the start and the goal pose."""
    low, high = body.height_m
    tilt_deg = math.degrees(body.max_tilt_rad)
    if not low - 1e-9 <= start.position_m[2] <= high + 1e-9:
        raise wrong(scenario, "start.body.position_m[2]", f"{start.position_m[2]:g}", f"expected {low:g}..{high:g} m")
    if np.abs(start.rpy_rad[:2]).max() > body.max_tilt_rad + 1e-9:
        shown = "{:g}, {:g}".format(*np.degrees(start.rpy_rad[:2]))
        raise wrong(scenario, "start.body.rpy_deg", shown, f"expected roll and pitch within {tilt_deg:.1f} degrees")
    reserve = scenario.goal.tolerance_m
    if not low - reserve <= goal.position_m[2] <= high + reserve:
        raise InfeasibleError(
            "goal bounds",
            f"goal.body.position_m[2]: the body can be {low:g}..{high:g} m above the wall, not {goal.position_m[2]:g}",
            proven=True,
        )
    if np.abs(goal.rpy_rad[:2]).max() > body.max_tilt_rad + scenario.goal.tolerance_rad:
        raise InfeasibleError(
            "goal bounds",
            f"goal.body.rpy_deg: the body cannot tilt further than {tilt_deg:.1f} degrees in roll or pitch",
            proven=True,
        )


def within_limits(limb: Limb, body: Pose, gripper: Array) -> bool:
    """Whether a limb has its gripper (5 or 7,) there within its joint limits, with the body at a pose."""
    q, reached = _angles(limb, body, gripper)
    return reached and bool(limit_margin(limb, q) >= 0.0)


def missing_turn_rad(limb: Limb, body: Pose, gripper: Array) -> float:
    """By how much a limb of fewer than six joints has its gripper turned otherwise; 0 where something else lacks."""
    q, reached = _angles(limb, body, gripper)
    off = float(np.linalg.norm(q[len(limb.joints) :]))
    return off if reached and off > STILL_RAD else 0.0


def _angles(limb: Limb, body: Pose, gripper: Array) -> tuple[Array, bool]:
    to_b, hand = rotation_from_rpy(body.rpy_rad).T, hands_of(gripper)
    q, reached = inverse(limb, to_b @ (hand[:3] - body.position_m), to_b @ rotations(hand))
    return q, bool(reached)


def posture(robot: Robot, body: Pose, grippers: Array) -> dict[str, float]:
    """Joint positions by name with the body at a pose and grippers (4, 5 or 7) as model.hands has them."""
    to_b = rotation_from_rpy(body.rpy_rad).T
    positions: dict[str, float] = {}
    for limb, hand, opening in zip(robot.limbs, hands_of(grippers), grippers[:, 4], strict=True):
        q, _ = inverse(limb, to_b @ (hand[:3] - body.position_m), to_b @ rotations(hand))
        positions.update(zip(limb.joint_names, limb.senses * q, strict=False))
        positions.update(dict.fromkeys(limb.finger_joints, opening))
    return positions


def weights_of(scenario: Scenario) -> Weights:
    """The scenario's weights with the signs of (6): zeta and xi are negative."""
    weights = cost_weights(scenario)
    return Weights(**{**vars(weights), "lift": -weights.lift, "opening": -weights.opening})


def point_text(problem: Problem, position: Array) -> str:
    """A place in W, for people."""
    x, y, z = rotation_z(problem.heading_rad) @ position
    return f"[{x:.2f}, {y:.2f}, {z:.3f}] m"


def out_of_reach(problem: Problem, limb: int, hold: str, beyond_m: float) -> str:
    """What to say of the nearest hold, or the one the goal names, that is outside the outer set of a limb's reach for
    every body at the goal.
    """
    name, place = LIMB_NAMES[limb], point_text(problem, problem.goal.body.position_m)
    if limb in problem.goal.grasps:
        text = f"goal.grasps.{name}: {hold} is out of reach for the goal body at {place}: it is"
    else:
        text = f"no hold within reach of {name} for the goal body at {place}: the nearest, {hold}, is"
    return f"{text} {1000 * beyond_m:.0f} mm outside {name}'s workspace"


def beyond_planned_reach(problem: Problem, limb: int, hold: str, beyond_m: float) -> str:
    """The same of the inner set that plans keep to, for a level body at the very goal."""
    name, place = LIMB_NAMES[limb], point_text(problem, problem.goal.body.position_m)
    which = f"goal.grasps.{name}: {hold}" if limb in problem.goal.grasps else f"the nearest hold for {name}, {hold},"
    return f"{which} is {1000 * beyond_m:.0f} mm beyond {PLANNED_REACH}, for a level body at the goal {place}"


def body_and_ends(scenario: Scenario, body: BodyBounds) -> tuple[float, Pose, Pose]:
    """Heading of the start in W, start and goal in its frame, in bounds. Raises ScenarioError and InfeasibleError."""
    heading = scenario.start.body.rpy_rad[2]
    start, goal = (pose_in_heading_frame(each.body, heading) for each in (scenario.start, scenario.goal))
    check_body(scenario, body, start, goal)
    return heading, start, goal
