"""The walking problem in numbers: P1 with point feet on z = 0, in the heading frame H (see crux_planner.model.build).

The gripper stands with both pads on the surface; its frame is one pad radius above the foot point.
"""

from dataclasses import dataclass, replace

import numpy as np
from crux_contracts import LIMB_NAMES
from crux_contracts.pchip import Pchip
from crux_contracts.robot import Robot
from crux_contracts.scenario import Scenario

from crux_planner.errors import PLANNED_REACH, InfeasibleError, wrong
from crux_planner.model.arrays import Array
from crux_planner.model.foothold_regions import FootholdRanges, foothold_ranges
from crux_planner.model.kinematics import rotation_from_rpy, rotation_z
from crux_planner.model.limb import limb_masses
from crux_planner.model.mass import body_moment, centre_of_mass, centres_of_mass, centres_of_pressure, composite_inertia
from crux_planner.model.poses import body_and_ends, posture, weights_of
from crux_planner.model.problem import BodyBounds, CentroidalProblem, Goal, Pose
from crux_planner.model.workspace import Reach, WorkspaceRange, acceptance_boxes, box, tilt_for

FRICTION_MARGIN = 0.3  # share of the cone left unused: nothing squeezes a foot when it begins to slip
_UPRIGHT_SHARE = 1e-3  # of gravity along the surface: pressed on it no more than that, nothing stands
_FOOT_MOVE_M = 0.05  # over which the limbs' pull on the centre of mass is measured
FINAL_FOOT_M = 0.02  # of a foot at the end off its place under the body, along x and along y


@dataclass(frozen=True)
class MarginProfile:
    """What a walk keeps clear of beyond (7) and (8): space for what the robot does not do as planned."""

    least_share: float  # of the weight on a foot in stance: keeps the body off the edge of its support
    true_share: float  # the same while three feet stand, for body and limbs as they accelerate at the knots
    acceleration: tuple[float, float]  # of the body [m/s^2], [rad/s^2]: it is to move smoothly between the knots
    between_share: float  # as `true_share` between the knots, where motions are less smooth than from knot to knot


@dataclass(frozen=True)
class Cut:
    """A corner of a limb's box (9a) that is left out: `normal_b` times the foot's place there is `most` at most."""

    limb: int
    normal_b: Array
    most: float


USUAL = MarginProfile(0.1275, 0.07, (1.0, 0.35), 0.01)
BOLD = MarginProfile(0.1275, 0.07, (2.0, 0.7), 0.0)  # where strides are too long for the usual
BOLDEST = MarginProfile(0.075, 0.06, (2.0, 0.7), 0.0)  # where they are too long for that


@dataclass(frozen=True, kw_only=True)
class WalkProblem(CentroidalProblem):
    """P1 of a walk."""

    friction: float  # of the cone a plan may use
    wall_friction: float
    max_normal_N: float  # of a foot
    start_feet_h_m: Array  # (4, 2)
    goal_feet_h_m: Array  # (4, 2) under the body at the goal as they are at the start, or beside an obstacle there
    foothold_ranges_h_m: FootholdRanges  # beside obstacles
    cuts: tuple[Cut, ...]
    foot_speed_m_s: float
    paces: tuple[float, float, float, float]  # of each foot, as a share of its speeds
    foot_yaw_rad: tuple[float, float]  # relative to the body
    foot_yaw_rate_rad_s: float
    step_height_m: float
    limbs_share: float  # of a foot's way over the body, how far it moves the centre of mass: limbs have mass too
    neutral_feet_b_m: Array  # (4, 2) where the centre of mass is the body's origin
    profile: MarginProfile
    opening_m: float  # of the fingers, all the time
    pad_radius_m: float  # of the gripper's centre above the foot point

    @property
    def pendulum_s2(self) -> float:
        """By how much the centre of pressure is behind the centre of mass [m] for each m/s^2 of it."""
        height = (self.start.position_m[2] + self.goal.body.position_m[2]) / 2
        return float(height / -self.gravity_h[2])

    def centres_of_mass(self, poses: Array, feet: Array, yaws: Array) -> Array:
        """Places (K, 3) for body poses (K, 6), feet (K, 4, 3) and their yaws (K, 4)."""
        return centres_of_mass(self, poses, self._grippers(feet, yaws))

    def centres_of_pressure(self, poses: Array, feet: Array, yaws: Array, parts: int = 1) -> Array:
        """Places (parts N + 1, 2) for the same at all knots, as bodies and limbs accelerate there and, with every
        interval in `parts`, on the way between them that the plan is read as (msgs/PLAN.md).
        """
        hands, last = self._grippers(feet, yaws), len(poses) - 1
        if parts > 1:
            at = np.linspace(0.0, last, last * parts + 1)
            poses, hands = (Pchip(np.arange(last + 1.0), each)(at) for each in (poses, hands))
        return centres_of_pressure(self, poses, hands, self.dt_s / parts)

    def _grippers(self, feet: Array, yaws: Array) -> Array:
        return np.concatenate([feet + np.array([0.0, 0.0, self.pad_radius_m]), yaws[..., None]], axis=2)

    def pressing(self, places: Array) -> Array:
        """Where masses at places (N + 1, ...) at the knots press by their weight and acceleration, as pendulums."""
        found = places.copy()
        found[1:-1] -= self.pendulum_s2 / self.dt_s**2 * np.diff(places, 2, axis=0)
        return found


def build_walk(scenario: Scenario, robot: Robot) -> WalkProblem:
    """P1 of a scenario with point contacts. Raises ScenarioError and InfeasibleError."""
    if scenario.contact.model != "point":
        raise wrong(scenario, "contact.model", scenario.contact.model, "expected point: this is about walks")
    if scenario.holds:
        raise wrong(scenario, "holds", scenario.holds[0].name, "expected none with contact.model point")
    if scenario.contact.spine_shear_N or scenario.contact.spine_twist_Nm:
        raise wrong(scenario, "contact.spine_shear_N", "above 0", "expected 0: feet on the surface have no spines")
    if not robot.closed_form:
        raise wrong(scenario, "robot", robot.name, "expected limbs with closed-form kinematics: only they walk")
    walking = robot.walking
    height_m, tilt_rad = robot.body.height_m, robot.body.max_tilt_rad
    body = BodyBounds(height_m, tilt_rad, walking.max_speed_m_s, walking.max_rate_rad_s, height_m[0])
    heading, start, goal = body_and_ends(scenario, body)
    turn = abs(float(goal.rpy_rad[2]))
    if turn > walking.foot_yaw_rad[1]:
        most = f"the feet allow a turn of {walking.foot_yaw_rad[1]} rad"
        raise InfeasibleError("goal bounds", f"goal.body.rpy_deg: {most}")
    feet = np.array([scenario.start.feet[limb] for limb in LIMB_NAMES]) @ rotation_z(-heading)[:2, :2].T
    boxes = _boxes(robot, tilt_for([start.rpy_rad, goal.rpy_rad], body.max_tilt_rad))
    body = replace(body, max_tilt_rad=boxes.max_tilt_rad)
    share, neutral = _limbs_pull(robot, start, feet)
    goal_yaw = float(goal.rpy_rad[2])
    goal_feet = goal.position_m[:2] + (feet - start.position_m[:2]) @ rotation_z(goal_yaw)[:2, :2].T
    slack = boxes.half_m[:2] - np.abs(goal_feet - goal.position_m[:2] - boxes.centre_b_m[:, :2]).max(axis=0)
    ranges = foothold_ranges(scenario.obstacles, robot, heading, goal_yaw, feet, goal_feet, np.maximum(slack, 0.0))
    problem = WalkProblem(
        steps=scenario.horizon.steps,
        dt_s=scenario.horizon.dt_s,
        gravity_h=rotation_z(-heading) @ np.array(scenario.wall.gravity_w_m_s2),
        mass_kg=robot.total_mass_kg,
        inertia_b=composite_inertia(robot, _on_feet(robot, start, feet)),
        limb_masses=tuple(limb_masses(robot, limb) for limb in robot.limbs),
        body_moment_kg_m=body_moment(robot),
        friction=(1.0 - scenario.planner.margins.get("friction", FRICTION_MARGIN)) * scenario.wall.friction,
        wall_friction=scenario.wall.friction,
        max_normal_N=scenario.contact.max_normal_N,
        start_feet_h_m=feet,
        start=start,
        goal=Goal(goal, scenario.goal.tolerance_m, scenario.goal.tolerance_rad, {}),
        goal_feet_h_m=np.clip(goal_feet, *ranges.last),
        foothold_ranges_h_m=ranges,
        boxes=boxes,
        cuts=(),
        body=body,
        foot_speed_m_s=walking.foot_speed_m_s,
        paces=(1.0, 1.0, 1.0, 1.0),
        foot_yaw_rad=walking.foot_yaw_rad,
        foot_yaw_rate_rad_s=walking.foot_yaw_rate_rad_s,
        step_height_m=walking.step_height_m,
        limbs_share=share,
        neutral_feet_b_m=neutral,
        weights=weights_of(scenario),
        profile=USUAL,
        opening_m=robot.gripper.opening_m[0],
        pad_radius_m=robot.gripper.pad_radius_m,
        heading_rad=heading,
    )
    _check_start(scenario, problem)
    return problem


def _boxes(robot: Robot, tilt_rad: float) -> Reach:
    """(9a) of the feet, whose centres are their pads' radius above the surface, for tilts up to `tilt_rad`."""
    pad, walking = robot.gripper.pad_radius_m, robot.walking
    heights = robot.body.height_m, (pad, pad), pad + walking.step_height_m, pad + walking.step_height_m
    wanted = WorkspaceRange(*heights, tilt_rad, walking.foot_yaw_rad, robot.body.max_tilt_rad)
    boxes = acceptance_boxes(robot.limbs, wanted)
    return box(boxes.centre_b_m - np.array([0.0, 0.0, pad]), boxes.half_m, tilt_rad)


def _check_start(scenario: Scenario, problem: WalkProblem) -> None:
    """Raise ScenarioError for a start foot beyond its box, InfeasibleError where the surface is too steep to stand."""
    rotation = rotation_from_rpy(problem.start.rpy_rad)
    for limb, name in enumerate(LIMB_NAMES):
        foot = np.append(problem.start_feet_h_m[limb], 0.0)
        place = rotation.T @ (foot - problem.start.position_m)
        beyond = np.abs(place - problem.boxes.centre_b_m[limb]) - problem.boxes.half_m
        if beyond.max() > 0:
            axis = int(np.argmax(beyond))
            centre, half = problem.boxes.centre_b_m[limb][axis], problem.boxes.half_m[axis]
            shown = "[{:g}, {:g}]".format(*scenario.start.feet[name])
            text = f"{1000 * beyond[axis]:.0f} mm beyond {PLANNED_REACH}: the foot is at {'xyz'[axis]} = "
            text += f"{place[axis]:.3f} m in the body frame, not within {centre - half:.3f}..{centre + half:.3f} m"
            raise wrong(scenario, f"start.feet.{name}", shown, text)
    along, across = float(np.linalg.norm(problem.gravity_h[:2])), -float(problem.gravity_h[2])
    if along > problem.friction * max(across, 0.0):
        steep = across <= _UPRIGHT_SHARE * along
        needed = "no friction is enough" if steep else f"standing needs a friction of {along / across:.2f}"
        text = f"wall.slope_deg: {needed}, wall.friction less its margin is {problem.friction:.2f}"
        raise InfeasibleError("equilibrium", text)


def _limbs_pull(robot: Robot, start: Pose, feet: Array) -> tuple[float, Array]:
    """How the feet's places move the centre of mass, linear about the start's posture: `limbs_share` and
    `neutral_feet_b_m` of WalkProblem.
    """
    upright = Pose(start.position_m, np.zeros(3))
    here = centre_of_mass(robot, _on_feet(robot, upright, feet))
    there = centre_of_mass(robot, _on_feet(robot, upright, feet - np.array([_FOOT_MOVE_M, 0.0])))
    share = float((here - there)[0]) / (4 * _FOOT_MOVE_M)
    return share, feet - start.position_m[:2] - here[:2] / (4 * share)


def _on_feet(robot: Robot, body: Pose, feet: Array) -> dict[str, float]:
    """The posture with the feet (4, 2) on the surface."""
    upright = [robot.gripper.pad_radius_m, 0.0, robot.gripper.opening_m[0]]
    return posture(robot, body, np.column_stack([feet, np.tile(upright, (len(feet), 1))]))
