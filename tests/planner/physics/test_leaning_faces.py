"""Grasps on faces that lean: where pads touch, what they bear, by geometry and statics of their own."""

from __future__ import annotations

import numpy as np
import pytest
from crux_contracts.robot import load_robot
from crux_contracts.scenario import Scenario, parse_scenario
from crux_planner.model.build import wall_contacts
from crux_planner.model.contacts import Contact
from crux_planner.physics.dynamics import static_map
from crux_planner.physics.limit_surface import finger_forces, finger_inputs, finger_limits, grip_rows
from leaning import leaning

ROBOT = load_robot("scaler")
RADIUS_M = ROBOT.gripper.pad_radius_m
UP = np.array([0.0, 0.0, 1.0])


def contacts(lean_deg: dict[str, float]) -> tuple[Scenario, list[Contact], dict[tuple[int, int], str]]:
    wall = parse_scenario(leaning(lean_deg))
    return wall, *wall_contacts(wall, ROBOT, off_centre=True)


@pytest.mark.parametrize("lean_deg", [{"+x": 30, "-x": 30}, {"+x": 40, "-x": 10}, {"+x": 20, "-y": 25}])
def test_pads_are_balls_that_touch_both_faces(lean_deg: dict[str, float]) -> None:
    wall, found, _ = contacts(lean_deg)
    for contact in found:
        hold = wall.holds[contact.hold]
        c, s = np.cos(hold.yaw_rad), np.sin(hold.yaw_rad)
        to_hold = np.array([[c, s, 0.0], [-s, c, 0.0], [0.0, 0.0, 1.0]])
        for side, touch, face in zip(
            (1, -1), contact.touch_m, (contact.finger1_face, contact.finger1_face ^ 1), strict=True
        ):
            ball = contact.centre_h_m + side * (contact.separation_m / 2 + RADIUS_M) * contact.axis
            place = contact.centre_h_m + side * contact.separation_m / 2 * contact.axis + touch
            assert np.linalg.norm(ball - place) == pytest.approx(RADIUS_M)
            local = to_hold @ (place - np.array([*hold.position_m, 0.0]))
            axis, sign = face // 2, 1 - 2 * (face % 2)
            width = hold.size_m[axis] / 2 - local[2] * np.tan(hold.lean_rad[face])
            assert sign * local[axis] == pytest.approx(width)  # the face is there at this height
            normal = to_hold @ (ball - place) / RADIUS_M
            assert np.arcsin(normal[2]) == pytest.approx(hold.lean_rad[face])
            beside = [4 - 2 * (axis + 1) + k for k in (0, 1)]  # the patch ends before the sides beside it
            ends = [hold.size_m[1 - axis] / 2 - local[2] * np.tan(hold.lean_rad[k]) for k in beside]
            assert -ends[1] + 0.019 < local[1 - axis] < ends[0] - 0.019


def test_steep_and_slippery_faces_are_no_grasp() -> None:
    wall = leaning({"+x": 45, "-x": 10}, foot_m=0.08)
    for hold in wall["holds"]:
        hold["friction"] = 0.9
    read = parse_scenario(wall)
    found, unusable = wall_contacts(read, ROBOT, off_centre=False)
    assert all(contact.pair == 1 for contact in found)
    assert "face +x leans by 45 degrees, with friction 0.9 pads slide off from 42" in unusable[0, 0]


def test_forces_and_moments_are_those_at_the_places_where_pads_touch() -> None:
    rng = np.random.default_rng(1)
    _, found, _ = contacts({"+x": 35, "-x": 10})
    contact = next(c for c in found if c.leans)
    q = rng.normal(size=5) * [10, 10, 0.2, 10, 10]
    forces, moments = finger_forces(q, contact.axis, contact.tangent, (contact.normals, contact.touch_m))
    faces = contact.centre_h_m + contact.separation_m / 2 * np.outer([1.0, -1.0], contact.axis)
    about_origin = (np.cross(faces, forces) + moments).sum(axis=0)
    base = static_map(contact.centre_h_m, contact.axis, contact.tangent) @ [*q[:3], q[3] - q[4]]
    assert forces.sum(axis=0) == pytest.approx(base[:3])
    assert about_origin == pytest.approx(base[3:] + contact.leaning_moments @ q)
    touch = faces + contact.touch_m
    twists = np.outer(q[2] * np.array([1.0, -1.0]), [1, 1, 1]) * contact.normals
    assert about_origin == pytest.approx((np.cross(touch, forces) + twists).sum(axis=0))
    leaning = contact.normals, contact.touch_m
    assert finger_inputs(forces, moments, contact.axis, contact.tangent, leaning) == pytest.approx(q)


@pytest.mark.parametrize("lean_deg", [0.0, 20.0, 45.0])
def test_rows_are_the_cone_about_each_normal(lean_deg: float) -> None:
    """Sampled loads are within the rows just where each finger's own force is in the ball of (2) about its normal."""
    rng, friction, k_m = np.random.default_rng(2), 2.2, 0.013
    lean = np.radians([lean_deg, lean_deg / 2])
    limits = finger_limits(np.array([friction, friction]), np.zeros((2, 3)), lean)
    directions = rng.normal(size=(4000, 3))
    directions /= np.linalg.norm(directions, axis=1, keepdims=True)
    scaled = directions / [1.0, 1.0, k_m]
    rows, right = grip_rows(limits, scaled, np.ones(len(scaled)), np.full(2, 1e6))
    loads = rng.uniform(-1, 1, size=(300, 5)) * [60, 60, 0.6, 10, 30] + [0, 0, 0, 0, 40]
    near = 0
    for load in loads:
        s1, s2, m, pull, squeeze = load
        used = 0.0
        for side, angle in zip((1, -1), lean, strict=True):
            press = squeeze + side * pull / 2 if limits[0].side else squeeze - abs(pull) / 2 + max(side * pull, 0.0)
            normal = np.array([side * np.cos(angle), 0.0, np.sin(angle)])
            force = np.array([side * press, s1, s2])
            pushed = float(force @ normal)
            sliding = np.linalg.norm(force - pushed * normal)
            used = max(used, float(np.hypot(sliding, m / k_m)) / (friction * pushed) if pushed > 0 else np.inf)
        inside = bool((rows @ (load if limits[0].side else [s1, s2, m, pull, squeeze - abs(pull) / 2]) <= right).all())
        if abs(used - 1.0) > 0.03:
            assert inside == (used < 1.0)
            near += used < 1.0
    assert 30 < near < 270
