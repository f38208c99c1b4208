"""Feet among grips: a plan in which some limbs grip and others stand, and what the check says once it is broken."""

from __future__ import annotations

import copy
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from crux_contracts.interpolation import PlanReference
from crux_contracts.plan_file import from_bytes, to_bytes
from crux_contracts.robot import load_robot
from crux_contracts.scenario import load_scenario
from crux_msgs import hold_t, limb_knot_t, plan_t
from crux_planner.checker import CheckReport, check_plan
from crux_planner.checker.equilibrium import shared_load, within_cones
from crux_planner.checker.feet import on_surfaces
from crux_planner.checker.plan_arrays import read_plan
from crux_planner.checker.report import Findings
from crux_planner.checker.sampling import sample
from crux_tools.paths import ROOT
from shared_plans import SharedPlans

ROBOT = load_robot("scaler")
WALL = load_scenario(ROOT / "benchmarks" / "walls" / "feet-45.yaml")
LR, RR = 2, 3


@pytest.fixture(scope="module")
def plan(planned: SharedPlans) -> plan_t:
    return planned(WALL, ROBOT).plan


def feet(plan: plan_t, limb: int = RR) -> list[limb_knot_t]:
    """The limb's knots in stance on footholds."""
    knots = [knot.limbs[limb] for knot in plan.knots]
    return [each for each in knots if each.phase == each.STANCE and each.finger1_face == each.FACE_WALL]


def broken(plan: plan_t, change: Callable[[plan_t], Any]) -> CheckReport:
    other = copy.deepcopy(plan)
    change(other)
    other.plan_id = ""
    return check_plan(other, ROBOT)


def force(knot: limb_knot_t) -> np.ndarray:
    whole: np.ndarray = np.array(knot.finger_force_w_n).reshape(2, 3).sum(axis=0)
    return whole


def move(knot: limb_knot_t, *by_m: float) -> None:
    knot.gripper_position_w_m = np.add(knot.gripper_position_w_m, by_m).tolist()


def push(knot: limb_knot_t, whole_n: np.ndarray) -> None:
    knot.finger_force_w_n = np.tile(np.asarray(whole_n) / 2, 2).tolist()


def test_hands_and_feet_are_in_one_plan(plan: plan_t) -> None:
    report = check_plan(plan, ROBOT)
    assert report.ok
    assert report.cost == pytest.approx(plan.cost, rel=2e-4)  # spines' shares count a little in the planner's
    assert plan.format == plan_t.FORMAT_FEET
    assert [hold.graspable for hold in plan.holds] == [hold_t.HOLD] * 4 + [hold_t.FOOTHOLD] * 3
    first, last = plan.knots[0].limbs, plan.knots[-1].limbs
    assert (first[LR].hold, first[LR].finger1_face) == (0, limb_knot_t.FACE_PLUS_X)
    assert (last[LR].hold, last[LR].finger1_face) == (4, limb_knot_t.FACE_WALL)
    assert [limb.hold for limb in (first[RR], last[RR])] == [5, 6]
    for knot in feet(plan):
        assert knot.gripper_position_w_m[2] == 0.0
        assert knot.friction == 0.9
        pushed = force(knot)
        assert 0.0 < pushed[2] <= 60.0
        assert np.hypot(*pushed[:2]) <= 0.9 * pushed[2]
        assert not np.any(knot.finger_moment_w_nm)
    assert from_bytes(to_bytes(plan)).plan_id == plan.plan_id


def test_the_reader_of_plans_and_the_check_have_a_foot_s_gripper_at_the_same_places(plan: plan_t) -> None:
    reference = PlanReference(plan)
    arrays = read_plan(plan, Findings(), ROBOT.gripper.pad_radius_m)
    assert arrays is not None
    samples = sample(on_surfaces(arrays, WALL, ROBOT, Findings()))
    share = (samples.time_s - arrays.time_s[samples.interval]) / arrays.step_s[samples.interval]
    for limb in range(4):
        for row in range(0, len(share), 3):
            read = reference.limb(limb, int(samples.interval[row]), float(share[row]))
            np.testing.assert_allclose(read.position_w_m, samples.gripper_position[row, limb], atol=1e-9)
    about_foot_point = samples.moment - np.cross(samples.below_m, samples.force)
    assert samples.foot.any()
    np.testing.assert_allclose(about_foot_point[samples.foot], 0.0, atol=1e-9)
    stood = samples.gripper_position[0, RR]
    assert stood[2] == pytest.approx(ROBOT.gripper.pad_radius_m)
    assert samples.gripper_position[:, RR, 2].min() == pytest.approx(ROBOT.gripper.pad_radius_m)


def pull(plan: plan_t) -> None:
    knot = feet(plan)[1]
    push(knot, force(knot) * [1.0, 1.0, -1.0])


def slide(plan: plan_t) -> None:
    knot = feet(plan)[1]
    push(knot, np.add(force(knot), (0.0, 60.0, 0.0)))


def press(plan: plan_t) -> None:
    push(feet(plan)[1], np.array([0.0, 0.0, 61.0]))


def twist(plan: plan_t) -> None:
    feet(plan)[1].finger_moment_w_nm = [0.0, 0.0, 0.01] + [0.0] * 3


def unevenly(plan: plan_t) -> None:
    knot = feet(plan)[1]
    knot.finger_force_w_n = [*force(knot), 0.0, 0.0, 0.0]


def beside(plan: plan_t) -> None:
    for knot in feet(plan):
        move(knot, 0.001, 0.0, 0.0)


def above(plan: plan_t) -> None:
    for knot in feet(plan):
        move(knot, 0.0, 0.0, 0.001)


def lean(plan: plan_t) -> None:
    for knot in feet(plan):
        knot.gripper_tilt_w_rad = [0.01, 0.0]


def close_fingers(plan: plan_t) -> None:
    feet(plan)[1].finger_separation_m -= 0.002


def two_on_one(plan: plan_t) -> None:
    for knot in feet(plan):
        knot.hold = 4


def no_such_place(plan: plan_t) -> None:
    for knot in feet(plan):
        knot.hold = 9


def on_a_hold(plan: plan_t) -> None:
    for knot in feet(plan):
        knot.hold = 3


def by_a_face(plan: plan_t) -> None:
    for knot in feet(plan):
        knot.finger1_face = 0


def rougher(plan: plan_t) -> None:
    plan.holds[5].friction = [0.0, 0.0, 0.0, 0.0, 1.5]


def off_the_wall(plan: plan_t) -> None:
    plan.holds[5].position_w_m = [-0.14, -0.36, 0.002]


def turned(plan: plan_t) -> None:
    plan.holds[5].tilt_rad = [0.01, 0.0]


def larger(plan: plan_t) -> None:
    plan.holds[5].size_m = [0.03, 0.03, 0.0]


def older(plan: plan_t) -> None:
    plan.format = plan_t.FORMAT_OWN_TIMES


def cuboid_last(plan: plan_t) -> None:
    plan.holds[3], plan.holds[6] = plan.holds[6], plan.holds[3]


def first_knot_in_air(plan: plan_t, limb: int = RR) -> int:
    return next(k for k, knot in enumerate(plan.knots) if knot.limbs[limb].phase == limb_knot_t.AIR)


def drag(plan: plan_t) -> None:
    after = plan.knots[first_knot_in_air(plan) + 1].limbs[RR]
    move(after, 0.004, 0.0, 0.0)


def open_on_it(plan: plan_t) -> None:
    plan.knots[first_knot_in_air(plan) + 1].limbs[RR].finger_separation_m += 0.002


BROKEN: list[tuple[Callable[[plan_t], None], str]] = [
    (pull, "foot_pull"),
    (slide, "foot_slide"),
    (press, "foot_press"),
    (twist, "foot_moment"),
    (unevenly, "foot_halves"),
    (beside, "contact_face"),
    (above, "contact_face"),
    (lean, "finger_axis"),
    (close_fingers, "contact_motion"),
    (two_on_one, "hold_shared"),
    (no_such_place, "hold"),
    (on_a_hold, "hold"),
    (by_a_face, "hold"),
    (rougher, "scenario_match"),
    (off_the_wall, "scenario_match"),
    (turned, "scenario_match"),
    (larger, "scenario_match"),
    (older, "plan_format"),
    (cuboid_last, "plan_format"),
    (drag, "foot_way"),
    (open_on_it, "foot_fingers"),
]


@pytest.mark.parametrize(("change", "constraint"), BROKEN, ids=[change.__name__ for change, _ in BROKEN])
def test_the_check_refuses(plan: plan_t, change: Callable[[plan_t], None], constraint: str) -> None:
    report = broken(plan, change)
    assert not report.ok
    assert constraint in {violation.constraint for violation in report.violations}


def test_between_knots_grips_bear_what_a_foot_cannot(plan: plan_t) -> None:
    """Feet that press less than planned would have to slide."""
    read = read_plan(plan, Findings(), ROBOT.gripper.pad_radius_m)
    assert read is not None
    arrays = on_surfaces(read, WALL, ROBOT, Findings())
    planned = sample(arrays)
    stands = planned.foot & (planned.load > 0.0)
    weak = replace(planned, force=np.where(stands[..., None], planned.force * [1.0, 1.0, 0.3], planned.force))
    weak = replace(weak, moment=np.where(stands[..., None], np.cross(weak.below_m, weak.force), weak.moment))
    about = planned.body_position
    shared = shared_load(weak, about, None, ROBOT.control.twist_length_m)
    normal, slides = shared[0].force[..., 2], np.linalg.norm(shared[0].force[..., :2], axis=2)
    assert (slides > 0.9 * normal + 1.0)[stands].any()
    found, left = within_cones(arrays, weak, shared, about, ROBOT.control.twist_length_m)
    normal, slides = found.force[..., 2], np.linalg.norm(found.force[..., :2], axis=2)
    assert (slides <= 0.9 * normal + 1e-6)[stands].all()
    assert normal[stands].min() >= 0.0
    balanced = left < 1e-6
    assert balanced.mean() > 0.9
    np.testing.assert_allclose(found.force.sum(axis=1)[balanced], weak.force.sum(axis=1)[balanced], atol=1e-6)
    arm = found.gripper_position - about[:, None]
    moment = (np.cross(arm, found.force) + found.moment).sum(axis=1)
    np.testing.assert_allclose(moment[balanced], 0.0, atol=1e-6)
    on_foot = found.moment - np.cross(found.below_m, found.force)
    np.testing.assert_allclose(on_foot[stands], 0.0, atol=1e-9)
