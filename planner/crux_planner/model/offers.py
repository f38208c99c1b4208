"""The grasps that a wall offers grippers."""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from crux_contracts.gripper_frames import gripper_rotation, yaw_and_tilt
from crux_contracts.robot import Robot
from crux_contracts.scenario import Grip as HoldGrip
from crux_contracts.scenario import Hold, Scenario

from crux_planner.model.arrays import Array
from crux_planner.model.contacts import (
    PAIR_NAMES,
    Contact,
    Grip,
    GripperShape,
    SwingLimits,
    opening_for,
    yaws_in_range,
)
from crux_planner.model.cuboids import Cuboids, cuboids_of
from crux_planner.model.faces import Faces, faces_of, usable_friction
from crux_planner.model.kinematics import rotation_from_rpy
from crux_planner.model.surfaces import Surfaces
from crux_planner.model.unusable import WALL_CLEARANCE_M, faces_text, height_text, look_at_grip, narrow_text

TIGHT_CLEARANCE_M = 0.018  # of an opening finger to its neighbours where they leave no more space
EDGE_RESERVE_M = 0.002  # between the patch of an off-centre grasp and its face's edge


@dataclass(frozen=True)
class Offers:
    """To a body that heads as at the start, as at the goal, or in between."""

    scenario: Scenario
    robot: Robot
    cuboids: Cuboids
    surfaces: Surfaces
    shape: GripperShape
    limits: SwingLimits
    off_centre: bool
    yaw_range: tuple[float, float]

    @classmethod
    def of(
        cls,
        scenario: Scenario,
        robot: Robot,
        cuboids: Cuboids,
        surfaces: Surfaces,
        shape: GripperShape,
        limits: SwingLimits,
        off_centre: bool,
        final_yaw_rad: float,
    ) -> Offers:
        low, high = robot.grasp.gripper_yaw_rad
        yaw_range = low + min(final_yaw_rad, 0.0), high + max(final_yaw_rad, 0.0)
        return cls(scenario, robot, cuboids, surfaces, shape, limits, off_centre, yaw_range)

    def contacts(self) -> tuple[list[Contact], dict[tuple[int, int], str]]:
        """All of them, and why a (hold, pair) offers none."""
        contacts: list[Contact] = []
        unusable: dict[tuple[int, int], str] = {}
        for index, hold in enumerate(self.scenario.holds):
            for pair, name in enumerate(PAIR_NAMES):
                made = [self._at(index, pair, number, grip) for number, grip in enumerate(hold.places(name))]
                found = [one for each in made if not isinstance(each, str) for one in each]
                reasons = [each for each in made if isinstance(each, str)]
                contacts += found
                if not found:
                    unusable[index, pair] = next(iter(reasons), "none of its grips is on these faces")
        fingers = sorted(set(self.scenario.contact.spines_only.values()))
        by_spines = (replace(c, spines_only=finger) for finger in fingers for c in contacts if not c.leans)
        return contacts + [c for c in by_spines if not c.slippery], unusable

    def _at(self, index: int, pair: int, number: int, grip: HoldGrip | None) -> list[Contact] | str:
        """At a grip of a pair of faces, its number `number`, or anywhere on them; why not, where there is none."""
        scenario, limits, shape = self.scenario, self.limits, self.shape
        hold, radius_m = scenario.holds[index], scenario.contact.patch_radius_m
        faces = Faces.of(hold, pair, self.robot, radius_m, grip)
        if faces is None:
            return height_text(hold.size_m[2], self.robot, radius_m)
        if (reason := faces_text(hold, pair, faces, shape, radius_m)) is not None:
            return reason
        look_at_grip(scenario, index, grip, faces, pair, self.robot)
        half = faces.half_m
        yaw_rad, tilt_rad = self.cuboids.yaw_and_tilt(index)
        square = gripper_rotation(yaw_rad + pair * np.pi / 2, tilt_rad)
        axis, across, up = square.T
        normal, tilt_rad, turn = _at_angle(square, yaw_rad + pair * np.pi / 2, tilt_rad, grip)
        middle = self.cuboids.foot_m[index] + faces.height_m * up
        middle = middle + faces.off_m * axis + faces.aside_m * across
        slack = faces.width_m / 2 - radius_m - EDGE_RESERVE_M
        anywhere = self.off_centre and slack > EDGE_RESERVE_M and grip is None
        contacts: list[Contact] = []
        for side in (0.0, slack, -slack) if anywhere else (0.0,):
            centre = middle + side * across
            opening = None
            for clearance in (limits.clearance_m, min(limits.clearance_m, TIGHT_CLEARANCE_M)):
                given = (centre, turn, index, half, self.cuboids, shape, clearance, faces.lean_rad)
                opening = opening or opening_for(*given)
            nearest = (np.inf, "") if opening is None else self.surfaces.nearest(centre, turn, opening, shape)
            if opening is None or nearest[0] < WALL_CLEARANCE_M:
                continue
            for yaw, swapped in yaws_in_range(normal, self.yaw_range):
                one = _contact(scenario, hold, index, pair, swapped, yaw, centre, opening)
                one = replace(one, separation_m=2 * half, pad_radius_m=shape.pad_radius, grip=number)
                contacts.append(replace(one, tilt_rad=tilt_rad if scenario.tilts else None))
        opens = partial(opening_for, middle, turn, index, half, self.cuboids, shape, lean_rad=faces.lean_rad)
        return contacts or narrow_text(opens, nearest, min(limits.clearance_m, TIGHT_CLEARANCE_M))


def _at_angle(square: Array, yaw_rad: float, tilt_rad: Array, grip: HoldGrip | None) -> tuple[float, Array, Array]:
    """Yaw, tilt (2,) and rotation (3, 3) of a gripper at a grip, from those of one that is along the hold's own z."""
    if grip is None or not grip.tilt_deg:
        return yaw_rad, tilt_rad, square
    turn = square @ rotation_from_rpy(np.array([grip.tilt_rad, 0.0, 0.0]))
    return *yaw_and_tilt(turn), turn


def all_grips(scenario: Scenario, robot: Robot, heading: float) -> list[Grip]:
    """Every hold and face pair that the gripper spans at all, whatever stands beside it."""
    grips = []
    cuboids, radius = cuboids_of(scenario.cuboids, heading), scenario.contact.patch_radius_m
    least, most = robot.gripper.opening_m
    for index, hold in enumerate(scenario.holds):
        low = max(robot.grasp.pad_height_m[0], radius)
        high = min(robot.grasp.pad_height_m[1], hold.size_m[2] - radius)
        for pair in (0, 1):
            aside = hold.size_m[1 - pair] / 2 - radius
            if low > high or aside < 0 or not 2 * least <= hold.size_m[pair] <= 2 * most:
                continue
            yaw_rad, tilt_rad = cuboids.yaw_and_tilt(index)
            yaw, up = yaw_rad + pair * np.pi / 2, gripper_rotation(yaw_rad, tilt_rad)[:, 2]
            centre = cuboids.foot_m[index] + (low + high) / 2 * up
            contact = _contact(scenario, hold, index, pair, False, yaw, centre, most)
            contact = replace(contact, tilt_rad=tilt_rad if scenario.tilts else None)
            grips.append(Grip(contact, aside, (low, high)))
    return grips


def _contact(
    scenario: Scenario, hold: Hold, index: int, pair: int, swapped: bool, yaw: float, centre: Array, opening: float
) -> Contact:
    faces = faces_of(pair)[:: -1 if swapped else 1]  # of fingers 1 and 2
    return Contact(
        hold=index,
        pair=pair,
        finger1_face=faces[0],
        yaw_rad=yaw,
        centre_h_m=centre,
        separation_m=hold.size_m[pair],
        friction=np.array([usable_friction(hold, face) for face in faces]),
        spines=np.stack([_spines(scenario, hold, face) for face in faces]),
        open_m=opening,
        lean_rad=np.array([hold.lean_rad[face] for face in faces]),
    )


def _spines(scenario: Scenario, hold: Hold, face: int) -> Array:
    """(3,): most that the spines of a finger hold of (s1, s2, m) on a face."""
    shear_N, twist_Nm = scenario.contact.spine_shear_N, scenario.contact.spine_twist_Nm
    return float(hold.spines[face]) * hold.pad_share[face] * np.array([shear_N, shear_N, twist_Nm])
