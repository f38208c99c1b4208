"""Grasps: heights, yaws and openings."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from crux_contracts.robot import load_robot
from crux_contracts.scenario import ScenarioError
from crux_planner.model.build import build_problem
from crux_planner.model.contacts import GripperShape, opening_for, yaws_in_range
from crux_planner.model.cuboids import Cuboids
from crux_planner.model.faces import pad_heights
from crux_planner.model.kinematics import rotation_z
from crux_planner.pipeline.explanation import check_start
from crux_planner.search.equilibrium import StaticEquilibrium
from hypothesis import given
from hypothesis import strategies as st
from other_limbs import other_limbs
from walls import one_move, scenario

SHAPE = GripperShape(0.008, 0.066, 0.048, 0.012, 0.05)
CLEARANCE_M = 0.024


def test_pads_stand_with_the_patch_on_the_face_and_the_palm_above_the_hold() -> None:
    assert pad_heights(0.06, (0.02, 0.05), 0.02, 0.04) == pytest.approx((0.02, 0.04))
    assert pad_heights(0.05, (0.02, 0.05), 0.02, 0.04) == pytest.approx((0.02, 0.03))  # the patch ends below the top
    assert pad_heights(0.08, (0.02, 0.05), 0.02, 0.04) == pytest.approx((0.04, 0.05))  # the palm stays above it
    for height_m in (0.03, 0.12):
        low, high = pad_heights(height_m, (0.02, 0.05), 0.02, 0.04)
        assert low > high


@given(st.floats(-7, 7))
def test_yaws_are_half_turns_apart_and_every_axis_has_one_in_range(axis: float) -> None:
    found = yaws_in_range(axis, (-1.75, 1.75))
    assert found
    for yaw, swapped in found:
        assert -1.75 <= yaw <= 1.75
        halves = (yaw - axis) / np.pi
        assert halves == pytest.approx(round(halves), abs=1e-9)
        assert swapped == (round(halves) % 2 != 0)


def wall(*places: tuple[float, float]) -> Cuboids:
    return Cuboids(np.array(places), np.full((len(places), 3), 0.03), np.zeros(len(places)))


def test_a_lone_hold_is_left_with_the_preferred_opening() -> None:
    opening = opening_for(np.array([0, 0, 0.035]), np.eye(3), 0, 0.03, wall((0, 0)), SHAPE, CLEARANCE_M)
    assert opening == pytest.approx(SHAPE.open_opening)


def test_a_neighbour_makes_the_fingers_open_less_or_not_at_all() -> None:
    centre, turn = np.array([0, 0, 0.035]), np.eye(3)
    for distance in (0.125, 0.121):
        opening = opening_for(centre, turn, 0, 0.03, wall((0, 0), (distance, 0)), SHAPE, CLEARANCE_M)
        assert opening is not None
        assert distance - 0.03 - (opening + SHAPE.pad_radius) >= CLEARANCE_M - 1e-12  # to the neighbour
        assert opening + SHAPE.pad_radius - 0.03 >= CLEARANCE_M - 1e-12  # to the hold itself
    assert opening_for(centre, turn, 0, 0.03, wall((0, 0), (0.1, 0)), SHAPE, CLEARANCE_M) is None
    across = opening_for(centre, rotation_z(np.pi / 2), 0, 0.03, wall((0, 0), (0.1, 0)), SHAPE, CLEARANCE_M)
    assert across == pytest.approx(SHAPE.open_opening)


def test_a_neighbour_that_leans_over_the_fingers_leaves_less_to_open() -> None:
    """Its foot is far enough, its top is not: a box 0.1 m high that leans by 30 degrees towards the hold."""
    centre, lean = np.array([0, 0, 0.035]), np.radians(30)

    def opening(foot_x_m: float) -> float | None:
        feet, tilts = np.array([[0, 0], [foot_x_m, 0]]), np.array([[0, 0], [0, -lean]])
        half = np.array([[0.03, 0.03, 0.03], [0.03, 0.03, 0.05]])
        two = Cuboids(feet, half, np.zeros(2), tilts, np.zeros(2))
        return opening_for(centre, np.eye(3), 0, 0.03, two, SHAPE, 0.018)

    found = [opening(x) for x in (0.3, 0.148, 0.145)]
    assert found[0] == pytest.approx(SHAPE.open_opening, abs=1e-3)
    for foot_x_m, narrow in zip((0.148, 0.145), found[1:], strict=True):
        assert narrow is not None
        assert narrow < SHAPE.open_opening - 2e-3
        corner = 0.1 * np.array([-np.sin(lean), np.cos(lean)]) - 0.03 * np.array([np.cos(lean), np.sin(lean)])
        assert centre[2] < corner[1] < centre[2] + SHAPE.finger_height
        finger_x_m = narrow + SHAPE.pad_radius  # a line from the pad to the palm, as thick as a pad
        assert foot_x_m + corner[0] - finger_x_m - SHAPE.pad_radius >= 0.004 - 1e-9


def test_a_start_is_gripped_with_the_finger_on_the_face_that_the_limb_reaches(tmp_path: Path) -> None:
    robot = load_robot(other_limbs("hands that turn one way", tmp_path))
    text = one_move()
    for grasp in text["start"]["grasps"].values():
        grasp["faces"] = "y"
    problem = build_problem(scenario(text), robot)
    yaws = [problem.contacts[c].yaw_rad for c in problem.start_contacts]
    assert yaws == pytest.approx([-np.pi / 2, np.pi / 2, -np.pi / 2, np.pi / 2])
    text["start"]["grasps"]["RF"]["finger1"] = "-y"  # turned the other way
    wrong = build_problem(scenario(text), robot)
    with pytest.raises(ScenarioError, match=r"start\.grasps\.RF\.hold: RF-low: out of reach.*by -90 degrees"):
        check_start(scenario(text), wrong, StaticEquilibrium(wrong, wrong.friction_share))
