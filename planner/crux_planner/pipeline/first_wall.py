"""A first wall for a robot: four holds where its limbs reach, and one a step further up for each.

A limb holds and lifts all along the step about its hold, as the map of its reach has it, so the body can be anywhere
between start and goal, and at any of its heights where there are such holds; and the hold is within the sets that plans
keep to where the map leaves no way. Of such places those are taken where joints turn little for what grippers move.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
from crux_contracts import LIMB_NAMES
from crux_contracts.robot import Robot
from crux_contracts.scenario import ScenarioError, parse_scenario
from scipy import ndimage

from crux_planner.errors import InfeasibleError
from crux_planner.model.arrays import Array, Flags
from crux_planner.model.build import build_problem, reach_of
from crux_planner.model.joint_turns import joint_turns
from crux_planner.model.kinematics import joint_margin
from crux_planner.model.workspace import LEVEL_RAD, LimbReach
from crux_planner.pipeline.explanation import check_start
from crux_planner.reach.arm import reaches_of
from crux_planner.reach.poses import GripperPoses
from crux_planner.search.equilibrium import StaticEquilibrium

OUTWARD = (0.05, 0.35, 0.65)  # of the places that a limb has, how many are nearer to the body's middle
STRIDES_M = (0.15, 0.12, 0.08)  # steps up
LITTLE = (1.25, 2.0, np.inf)  # times what joints turn where they turn least: where they turn no more, then farther
AROUND = ((2, True), (1, True), (1, False), (0, False))
"""Places of the map about the step, and whether for a body at all its heights: the first for which there are walls."""
STEP_M, YAW_STEP_DEG = 0.02, 15  # of the maps that are looked at
HOLD_M, PATCH_M = 0.06, 0.02  # edge of a hold, radius of a patch
SPARE_M = 0.005  # of a hold above the pads' patches
LIMIT_S = 120  # of a plan with limbs without a closed form
HORIZON = {"steps": 80, "dt_s": 2.0}


@dataclass(frozen=True)
class FirstWall:
    """Grippers (4, 4) that hold on: x, y, z [m] and yaw [rad] in the body frame; a step up, and the body's height.

    Of each limb (4,), all along the step and the lift, with the places around and heights of AROUND: what a joint
    turns at most for a metre of the gripper, how stiff the joints' position gains make the gripper at most, and how
    near a joint comes to its limits.
    """

    robot: Robot
    grippers_b: Array
    stride_m: float
    height_m: float
    turns_rad_m: Array
    stiffness_N_m: Array
    margin_rad: Array

    def document(self, slope_deg: float, friction: float) -> dict[str, Any]:
        """The scenario; start and goal have the same stance, a step apart."""
        gripper, pads = self.robot.gripper, sum(self.robot.grasp.pad_height_m) / 2
        widest = 2 * (gripper.opening_m[1] - gripper.pad_radius_m)
        wide = float(np.clip(HOLD_M, 2 * gripper.opening_m[0], widest))
        size = [round(wide, 3), round(max(wide, 2 * PATCH_M), 3), round(pads + PATCH_M + SPARE_M, 3)]
        holds = []
        for row, up in (("low", 0.0), ("high", self.stride_m)):
            for name, (x, y, _, yaw) in zip(LIMB_NAMES, self.grippers_b, strict=True):
                place = [round(float(x) + up, 5), round(float(y), 5)]
                turned = {"yaw_deg": round(float(np.degrees(yaw)), 1)}
                holds.append(
                    {"name": f"{name}-{row}", "position_m": place, "size_m": [*size], **turned, "friction": friction}
                )
        ends = {}
        for end, row, up in (("start", "low", 0.0), ("goal", "high", self.stride_m)):
            grasps = {name: {"hold": f"{name}-{row}", "faces": "x"} for name in LIMB_NAMES}
            ends[end] = {"body": {"position_m": [up, 0.0, self.height_m]}, "grasps": grasps}
        return {
            "version": 1,
            "name": f"first-wall-of-{self.robot.name}",
            "robot": self.robot.name,
            "wall": {"slope_deg": slope_deg},
            "contact": {
                "model": "patch",
                "patch_radius_m": PATCH_M,
                "max_normal_N": gripper.max_finger_force_N,
                "spine_shear_N": 5,
                "spine_twist_Nm": 0.05,
            },
            "holds": holds,
            **ends,
            "horizon": HORIZON,
            **({} if self.robot.closed_form else {"planner": {"time_limit_s": LIMIT_S}}),
        }


def first_walls(robot: Robot) -> Iterator[FirstWall]:
    """Walls that a robot may start on, longer steps first. Raises InfeasibleError where the limbs have no reach that
    crux plans with.
    """
    height = round(sum(robot.body.height_m) / 2, 3)
    planned = reach_of(robot, LEVEL_RAD)
    places = [_places(robot, limb, planned, height) for limb in range(len(LIMB_NAMES))]
    for (spare, high), little in itertools.product(AROUND, LITTLE):
        begun = False
        for stride, share in itertools.product(STRIDES_M, OUTWARD):
            spots = [each[high].spot(stride, share, spare, little) for each in places]
            if not any(each is None for each in spots):
                found = np.array(spots)
                wall = FirstWall(robot, found[:, :4], stride, height, *found[:, 4:].T)
                if _can_be_begun(wall):
                    begun = True
                    yield wall
        if begun:
            return


@dataclass(frozen=True)
class _Places:
    """Where a limb holds and lifts (yaws, x, y), and where plans may start (x, y), over a grid in the body frame; what
    joints turn there at most, how stiff they are and how near to their limits (yaws, x, y): see FirstWall.
    """

    held: Flags
    planned: Flags
    turns_rad_m: Array
    stiffness_N_m: Array
    margin_rad: Array
    yaw_rad: Array
    x_m: Array
    y_m: Array
    z_m: float

    def spot(self, stride_m: float, share: float, spare: int, little: float) -> Array | None:
        """(7,) gripper, turns, stiffness and margin, in the middle of the places so far outwards where a step
        and so many on all sides are held and joints turn little, at the yaw that leaves most of them. None:
        nowhere.
        """
        ahead, aside = int(np.ceil(stride_m / 2 / STEP_M)) + spare, spare
        across = np.ones((1, 2 * ahead + 1, 2 * aside + 1), dtype=bool)
        left = ndimage.binary_erosion(self.held, across) & self.planned
        if not left.any():
            return None
        turns = ndimage.maximum_filter(self.turns_rad_m, footprint=across)
        left &= turns <= little * turns[left].min()
        yaw = int(left.sum(axis=(1, 2)).argmax())
        at, out = np.nonzero(left[yaw])
        away = np.abs(self.y_m[out])
        same = np.flatnonzero(away == away[np.abs(away - np.quantile(away, share)).argmin()])
        one = same[np.argsort(np.abs(self.x_m[at[same]]), kind="stable")[len(same) // 2]]
        x, y = at[one], out[one]
        around = yaw, slice(x - ahead, x + ahead + 1), slice(y - aside, y + aside + 1)
        gripper = self.x_m[x], self.y_m[y], self.z_m, self.yaw_rad[yaw]
        most = self.turns_rad_m[around].max(), self.stiffness_N_m[around].max()
        return np.array([*gripper, *most, self.margin_rad[around].min()])


def _places(robot: Robot, limb: int, planned: LimbReach, height_m: float) -> tuple[_Places, _Places]:
    """With the body at the middle of its heights, and at all of them."""
    own, pads = robot.limbs[limb], sum(robot.grasp.pad_height_m) / 2
    span, middle = own.longest_m, own.shoulder_b_m
    x, y = (np.arange(np.floor((at - span) / STEP_M), (at + span) / STEP_M + 1) * STEP_M for at in middle[:2])
    if own.still:  # such a limb may reach straight ahead alone
        x, y = x + middle[0] % STEP_M, y + middle[1] % STEP_M
    y = y[np.sign(y) == np.sign(middle[1])]
    low, high = np.degrees(robot.grasp.gripper_yaw_rad) / YAW_STEP_DEG
    yaws = np.array(sorted(np.radians(YAW_STEP_DEG * np.arange(np.ceil(low), np.floor(high) + 1)), key=abs))
    lift = robot.grasp.pad_height_m[1] + robot.gripper.pad_radius_m + robot.grasp.swing_clearance_m - pads
    ups = (robot.body.height_m[1] - robot.body.height_m[0]) / 2  # of the body, and as far down
    grip_m = pads - height_m
    z = grip_m + np.array([0.0, lift / 2, lift, -ups, lift + ups])
    yaw, up, ahead, aside = np.ix_(yaws, z, x, y)
    level = np.zeros((1, 1, 1, 1))
    poses, reach = GripperPoses(ahead, aside, up, yaw, level, level), reaches_of(robot)[limb]
    reached = reach.reaches(poses)
    turns, stiffness, margin = np.full((3, *reached.shape), np.inf)
    q = reach.angles(poses.where(np.flatnonzero(reached)))
    gains = np.array(robot.servo.position_gain_Nm_rad[: len(own.joints)])
    senses = own.senses[: len(gains)]
    of_joints = own.transmission.joint_stiffness_Nm_rad(senses * q[:, : len(gains)], gains) * np.outer(senses, senses)
    found = joint_turns(own, q, of_joints)
    turns[reached], stiffness[reached] = found.most_rad_m.max(axis=1), found.stiffness_N_m
    margin[reached] = joint_margin(own, q)
    spots = np.stack(np.meshgrid(x, y, grip_m, indexing="ij"), axis=-1)[:, :, 0]
    beyond = np.array([each.beyond(limb, spots).max(axis=-1) for each in (planned.box, planned.inner)]).min(axis=0)
    inside: Flags = np.less_equal(beyond, 0.0)

    def at(levels: int) -> _Places:
        most = turns[:, :levels].max(axis=1), stiffness[:, :levels].max(axis=1), margin[:, :levels].min(axis=1)
        return _Places(np.all(reached[:, :levels], axis=1), inside, *most, yaws, x, y, grip_m)

    return at(len(z) - 2), at(len(z))


def _can_be_begun(wall: FirstWall) -> bool:
    """Whether the planner takes start and goal on a wall that is level."""
    try:
        scenario = parse_scenario(wall.document(0.0, 1.0), any_robot=True)
        problem = build_problem(scenario, wall.robot)
        check_start(scenario, problem, StaticEquilibrium(problem, problem.friction_share))
    except (ScenarioError, InfeasibleError):
        return False
    return True
