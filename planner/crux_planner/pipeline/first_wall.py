"""A first wall for a robot: four holds where its limbs reach, and one a step further up for each.

A limb holds and lifts all along the step about its hold, as the map of its reach has it, so the body can be anywhere
between start and goal; and the hold is within the sets that plans keep to where the map leaves no way.
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
from crux_planner.model.workspace import LEVEL_RAD, LimbReach
from crux_planner.pipeline.explanation import check_start
from crux_planner.reach.arm import reaches_of
from crux_planner.reach.poses import GripperPoses
from crux_planner.search.equilibrium import StaticEquilibrium

OUTWARD = (0.05, 0.35, 0.65)  # of the places that a limb has, how many are nearer to the body's middle
STRIDES_M = (0.15, 0.12, 0.08)  # steps up
SPARE = (1, 0)  # places of the map about the step, where there are such walls at all, and else
STEP_M, LEVELS, YAW_STEP_DEG = 0.02, 3, 15  # of the maps that are looked at
HOLD_M, PATCH_M = 0.06, 0.02  # edge of a hold, radius of a patch
SPARE_M = 0.005  # of a hold above the pads' patches
LIMIT_S = 120  # of a plan with limbs without a closed form
HORIZON = {"steps": 80, "dt_s": 2.0}


@dataclass(frozen=True)
class FirstWall:
    """Grippers (4, 4) that hold on: x, y, z [m] and yaw [rad] in the body frame; a step up, and the body's height."""

    robot: Robot
    grippers_b: Array
    stride_m: float
    height_m: float

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
    for spare in SPARE:
        begun = False
        for stride, share in itertools.product(STRIDES_M, OUTWARD):
            grippers = [each.gripper(stride, share, spare) for each in places]
            if not any(each is None for each in grippers):
                wall = FirstWall(robot, np.array(grippers), stride, height)
                if _can_be_begun(wall):
                    begun = True
                    yield wall
        if begun:
            return


@dataclass(frozen=True)
class _Places:
    """Where a limb holds and lifts (yaws, x, y), and where plans may start (x, y), over a grid in the body frame."""

    held: Flags
    planned: Flags
    yaw_rad: Array
    x_m: Array
    y_m: Array
    z_m: float

    def gripper(self, stride_m: float, share: float, spare: int) -> Array | None:
        """(4,) at the yaw that leaves most places for a step, and so many on all sides, in the middle of those so far
        outwards; None: nowhere.
        """
        ahead, aside = int(np.ceil(stride_m / 2 / STEP_M)) + spare, spare
        across = np.ones((1, 2 * ahead + 1, 2 * aside + 1), dtype=bool)
        left = ndimage.binary_erosion(self.held, across) & self.planned
        yaw = int(left.sum(axis=(1, 2)).argmax())
        at, out = np.nonzero(left[yaw])
        if not len(at):
            return None
        away = np.abs(self.y_m[out])
        same = np.flatnonzero(away == away[np.abs(away - np.quantile(away, share)).argmin()])
        one = same[np.argsort(np.abs(self.x_m[at[same]]), kind="stable")[len(same) // 2]]
        return np.array([self.x_m[at[one]], self.y_m[out[one]], self.z_m, self.yaw_rad[yaw]])


def _places(robot: Robot, limb: int, planned: LimbReach, height_m: float) -> _Places:
    own, pads = robot.limbs[limb], sum(robot.grasp.pad_height_m) / 2
    span, middle = own.longest_m, own.shoulder_b_m
    x, y = (np.arange(np.floor((at - span) / STEP_M), (at + span) / STEP_M + 1) * STEP_M for at in middle[:2])
    if own.still:  # such a limb may reach straight ahead alone
        x, y = x + middle[0] % STEP_M, y + middle[1] % STEP_M
    y = y[np.sign(y) == np.sign(middle[1])]
    low, high = np.degrees(robot.grasp.gripper_yaw_rad) / YAW_STEP_DEG
    yaws = np.array(sorted(np.radians(YAW_STEP_DEG * np.arange(np.ceil(low), np.floor(high) + 1)), key=abs))
    lift = robot.grasp.pad_height_m[1] + robot.gripper.pad_radius_m + robot.grasp.swing_clearance_m - pads
    z = pads - height_m + np.linspace(0.0, lift, LEVELS)
    yaw, up, ahead, aside = np.ix_(yaws, z, x, y)
    level = np.zeros((1, 1, 1, 1))
    reached = reaches_of(robot)[limb].reaches(GripperPoses(ahead, aside, up, yaw, level, level))
    spots = np.stack(np.meshgrid(x, y, z[:1], indexing="ij"), axis=-1)[:, :, 0]
    beyond = np.array([each.beyond(limb, spots).max(axis=-1) for each in (planned.box, planned.inner)]).min(axis=0)
    return _Places(np.all(reached, axis=1), np.less_equal(beyond, 0.0), yaws, x, y, float(z[0]))


def _can_be_begun(wall: FirstWall) -> bool:
    """Whether the planner takes start and goal on a wall that is level."""
    try:
        scenario = parse_scenario(wall.document(0.0, 1.0), any_robot=True)
        problem = build_problem(scenario, wall.robot)
        check_start(scenario, problem, StaticEquilibrium(problem, problem.friction_share))
    except (ScenarioError, InfeasibleError):
        return False
    return True
