"""Swings between holds of different planes: the same way whichever axes the whole is in."""

from __future__ import annotations

from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from crux_contracts.gripper_frames import gripper_rotation, yaw_and_tilt
from crux_planner.model.contacts import Contact, GripperShape, SwingLimits
from crux_planner.model.cuboids import NO_CUBOIDS, Cuboids
from crux_planner.model.hands import TILTED, hands_of, rotations
from crux_planner.swing.swing import Swing, plan_swing
from crux_planner.swing.swing_cache import SwingCache
from crux_planner.swing.swing_frame import SwingFrame
from scipy.spatial.transform import Rotation

SHAPE = GripperShape(0.008, 0.066, 0.048, 0.012, 0.05)
SIZE_M = np.array([0.06, 0.06, 0.06])
LIMITS = SwingLimits(2.0, 0.05, 0.25, 0.024, 0.01, 0.6)


def way(
    turns: list[Rotation], feet_m: list[np.ndarray], slabs: Cuboids = NO_CUBOIDS, limits: SwingLimits = LIMITS
) -> Swing | None:
    """From one hold to another, turned so and there."""
    contacts = []
    for hold, (turn, foot) in enumerate(zip(turns, feet_m, strict=True)):
        yaw, tilt = yaw_and_tilt(turn.as_matrix())
        place, grips = foot + turn.apply([0.0, 0.0, 0.03]), (np.full(2, 2.2), np.zeros((2, 3)))
        contacts.append(Contact(hold, 0, 0, yaw, place, 0.06, *grips, 0.048, tilt_rad=tilt))
    yaw, pitch, roll = np.array([turn.as_euler("ZYX") for turn in turns]).T
    foot = np.array(feet_m)
    holds = Cuboids(foot[:, :2], np.tile(SIZE_M / 2, (2, 1)), yaw, np.column_stack([roll, pitch]), foot[:, 2])
    return plan_swing(contacts[0], contacts[1], holds, SHAPE, replace(limits, slabs=slabs))


def about_y(*angles_deg: float) -> list[Rotation]:
    return [Rotation.from_euler("y", angle, degrees=True) for angle in angles_deg]


@pytest.mark.parametrize("angles_deg", [(0.0, -30.0), (20.0, 20.0), (45.0, -45.0), (0.0, 40.0)])
def test_it_leaves_and_comes_straight_off_the_holds(angles_deg: tuple[float, float]) -> None:
    turns = about_y(*angles_deg)
    found = way(turns, [np.zeros(3), np.array([0.2, 0.0, 0.0])])
    assert found is not None
    for contact, station, turn in zip((found.start, found.end), found.stations[[0, -1]], turns, strict=True):
        off = turn.inv().apply(station[:3] - contact.centre_h_m)
        assert off[:2] == pytest.approx([0.0, 0.0], abs=1e-9)
        assert off[2] > 0.03
        assert rotations(hands_of(station)) == pytest.approx(turn.as_matrix())


def test_it_goes_over_a_ridge_from_the_hold_on_it_to_one_far_below() -> None:
    """Fingers along the way: the higher the gripper, the farther is it off its hold."""
    limits = replace(LIMITS, endless=False, max_height_m=0.16)
    feet = [np.array([0.14, 0.0, 0.08]), np.array([0.239, 0.0, -0.019])]
    found = way(about_y(-45.0, 45.0), feet, limits=limits)
    assert found is not None
    assert found.stations[:, 2].min() > 0.08 + 0.06


@pytest.mark.parametrize("whole_deg", [-25.0, 15.0, 40.0])
def test_the_way_is_the_same_when_all_is_turned(whole_deg: float) -> None:
    feet, turns = [np.zeros(3), np.array([0.2, 0.02, 0.01])], about_y(5.0, -10.0)
    whole = about_y(whole_deg)[0]
    plain, turned = way(turns, feet), way([whole * turn for turn in turns], [whole.apply(foot) for foot in feet])
    assert plain is not None
    assert turned is not None
    assert whole.apply(plain.stations[:, :3]) == pytest.approx(turned.stations[:, :3], abs=1e-9)


def test_it_passes_over_an_edge_between_the_holds() -> None:
    """A convex edge, both planes falling away by 30 degrees from x = 0.1, 0.02 m higher than the holds' tops."""
    turns = about_y(-30.0, 30.0)
    feet = [np.array([0.0, 0.0, 0.0]), np.array([0.2, 0.0, 0.0])]
    height = 0.1 * np.tan(np.radians(30)) + 0.04
    roof = Cuboids(
        np.array([[0.1, 0.0]]), np.array([[0.02, 0.5, height / 2]]), np.zeros(1), np.zeros((1, 2)), np.zeros(1)
    )
    low, high = way(turns, feet), way(turns, feet, roof)
    assert low is not None
    assert high is not None
    assert high.stations[:, 2].min() >= height + LIMITS.clearance_m
    assert high.stations[:, 2].min() > low.stations[:, 2].min() + 0.01


@pytest.mark.parametrize("roll_rad", [0.0, np.pi])
def test_a_wall_far_across_is_not_in_the_way(roll_rad: float) -> None:
    """A slab 0.1 m thick whose lower side is 0.5 m above the holds' feet, or so low that no palm fits under it."""
    limits = replace(LIMITS, max_height_m=0.16, endless=False)
    feet = [np.zeros(3), np.array([0.14, 0.0, 0.0])]

    def under(lower_m: float) -> Swing | None:
        foot = lower_m + (0.1 if roll_rad else 0.0)
        half, tilt = np.array([[0.5, 0.5, 0.05]]), np.array([[roll_rad, 0.0]])
        slab = Cuboids(np.array([[0.07, 0.0]]), half, np.zeros(1), tilt, np.array([foot]))
        return way(about_y(10.0, 10.0), feet, slab, limits)

    free, found = way(about_y(10.0, 10.0), feet, NO_CUBOIDS, limits), under(0.5)
    assert free is not None
    assert found is not None
    assert found.stations == pytest.approx(free.stations)
    assert under(0.12) is None


@pytest.mark.parametrize(("endless", "high_m", "there"), [(True, 0.0, True), (True, 0.1, False), (False, 0.1, True)])
def test_the_height_of_swings_counts_from_an_endless_plane_or_from_the_holds(
    endless: bool, high_m: float, there: bool
) -> None:
    feet = [np.array([0.0, 0.0, high_m]), np.array([0.2, 0.0, high_m])]
    assert (
        way(about_y(20.0, 20.0), feet, limits=replace(LIMITS, max_height_m=0.16, endless=endless)) is not None
    ) == there


def test_there_is_no_way_between_holds_that_face_each_other() -> None:
    feet = [np.array([0.0, 0.0, 0.0]), np.array([0.6, 0.0, 0.0])]
    assert way(about_y(80.0, -80.0), feet) is None
    assert way(about_y(80.0, 79.0), [feet[0], np.array([0.0, 0.2, 0.0])]) is not None


@pytest.mark.parametrize("pitch_deg", [90.0, -90.0, 89.99999, 40.0])
def test_bodies_are_the_same_in_its_axes_whichever_way_they_are_turned(pitch_deg: float) -> None:
    """Their distances to points, for frames in which their x is along z, too."""
    random, turn = np.random.default_rng(2), Rotation.from_euler("ZYX", [30.0, 0.0, 20.0], degrees=True)
    body = np.array([[0.1, 0.2]]), np.array([[0.1, 0.03, 0.05]])
    boxes = Cuboids(*body, np.radians([30.0]), np.radians([[20.0, 0.0]]), np.array([0.04]))
    to_lock = turn * Rotation.from_euler("ZYX", [50.0, pitch_deg, 10.0], degrees=True).inv()
    frame = SwingFrame(to_lock.as_matrix(), np.array([0.3, -0.1, 0.2]))
    points = random.uniform(-0.4, 0.4, (200, 3))
    assert frame.cuboids(boxes).distance(frame.points(points)) == pytest.approx(boxes.distance(points), abs=1e-6)


def test_rotations_are_those_of_gripper_frames() -> None:
    """`rotations` above is the planner's own: the frame of a gripper by its definition."""
    hand = np.array([0.0, 0.0, 0.0, 0.4, 0.2, -0.3])
    assert rotations(hand) == pytest.approx(gripper_rotation(0.4, hand[4:]))


@pytest.mark.parametrize("tilt_deg", [0.0, 40.0, 75.0, 90.0])
def test_grippers_on_one_plane_are_as_far_apart_however_it_is_turned(tilt_deg: float) -> None:
    (turn,), contacts = about_y(tilt_deg), list[Contact]()
    for hold, along_m in enumerate((0.0, 0.12, 0.28)):
        yaw, tilt = yaw_and_tilt(turn.as_matrix())
        grips = 0.06, np.full(2, 2.2), np.zeros((2, 3)), 0.048
        contacts.append(Contact(hold, 0, 0, yaw, turn.apply([along_m, 0.0, 0.03]), *grips, tilt_rad=tilt))
    problem: Any = SimpleNamespace(contacts=contacts, shape=SHAPE, swing=LIMITS, hand_numbers=TILTED)
    swings = SwingCache(problem)
    assert [swings.apart(0, other) for other in (1, 2)] == [False, True]


def test_grippers_that_face_each_other_clash_where_palms_meet() -> None:
    """On two walls: at 0.3 m between their holds nothing touches, at 0.1 m the palms are in one another."""
    for between_m, apart in ((0.3, True), (0.1, False)):
        contacts = list[Contact]()
        for hold, (turn, side) in enumerate(zip(about_y(90.0, -90.0), (-0.5, 0.5), strict=True)):
            yaw, tilt = yaw_and_tilt(turn.as_matrix())
            place, grips = np.array([side * between_m, 0.0, 0.0]), (0.06, np.full(2, 2.2), np.zeros((2, 3)), 0.048)
            contacts.append(Contact(hold, 0, 0, yaw, place, *grips, tilt_rad=tilt))
        problem: Any = SimpleNamespace(contacts=contacts, shape=SHAPE, swing=LIMITS, hand_numbers=TILTED)
        assert SwingCache(problem).apart(0, 1) == apart
