"""Climbs at the robot's pace: as short as its bounds allow, in balance, and refused where something lacks time."""

from __future__ import annotations

import copy
import dataclasses
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from crux_contracts.interpolation import PlanReference
from crux_contracts.plan_file import from_bytes, to_bytes
from crux_contracts.robot import load_robot
from crux_contracts.scenario import parse_scenario
from crux_msgs import plan_t
from crux_planner.checker import check_plan
from crux_planner.pipeline import pace
from crux_planner.pipeline.message import PlanResult
from crux_planner.pipeline.session import Work

from . import synthetic
from .broken import RF, only

ROBOT = load_robot("scaler")
SILENT = Work(lambda _what, _share: None, lambda _line: None)
FIRST, LAST = synthetic.FIRST_AIR, synthetic.LAST_AIR


def at_pace(objective: str, robot: Any = ROBOT) -> PlanResult:
    """The plan made by hand with another objective."""
    plan = synthetic.make_plan()
    plan.scenario_yaml += f"planner: {{objective: {objective}}}\n"
    scenario = parse_scenario(plan.scenario_yaml)
    plan.scenario_sha256 = scenario.sha256
    plan = synthetic.sign(plan)
    given = PlanResult(True, plan, check_plan(plan, robot), plan.cost, 0, [], 0.0, 0.0)
    return pace.paced(given, scenario, robot, SILENT)


TIME = at_pace("time")


def steps_s(plan: plan_t) -> np.ndarray:
    return np.diff([knot.time_s for knot in plan.knots])


def broken(change: Callable[[plan_t], None]) -> Any:
    plan = copy.deepcopy(TIME.plan)
    change(plan)
    return check_plan(synthetic.sign(plan), ROBOT)


def quicker(interval: int, share: float) -> Callable[[plan_t], None]:
    """One interval takes only a share of its time."""

    def change(plan: plan_t) -> None:
        cut_s = (1 - share) * steps_s(plan)[interval]
        for knot in plan.knots[interval + 1 :]:
            knot.time_s -= cut_s

    return change


def test_paper_is_the_plan_as_it_was() -> None:
    assert all(at_pace("paper").plan.knots[k].time_s == k * synthetic.DT_S for k in range(synthetic.N_KNOTS))
    assert at_pace("paper").plan.format == plan_t.FORMAT


def test_time_takes_a_fifth_of_it_and_passes_the_check() -> None:
    plan = from_bytes(to_bytes(TIME.plan))
    report = check_plan(plan, ROBOT)
    assert report.ok, report
    assert report.cost == plan.cost == TIME.cost
    assert plan.format == plan_t.FORMAT_MOVING_FINGERS
    assert plan.knots[-1].time_s < 0.2 * synthetic.DT_S * (synthetic.N_KNOTS - 1)


def test_no_interval_could_be_shorter() -> None:
    """Each has the least time of one of the bounds, computed here from what moves in it."""
    bounds, knots = ROBOT.pace, TIME.plan.knots
    found = steps_s(TIME.plan)
    for k, step_s in enumerate(found):
        here, there = knots[k], knots[k + 1]
        way_m = float(
            np.linalg.norm(np.subtract(there.limbs[RF].gripper_position_w_m, here.limbs[RF].gripper_position_w_m))
        )
        opens_m = (there.limbs[RF].finger_separation_m - here.limbs[RF].finger_separation_m) / 2
        smooth_s = max(1.5 * way_m / bounds.swing_speed_m_s, (6 * way_m / bounds.swing_acceleration_m_s2) ** 0.5)
        body_m = max(np.abs(np.subtract(there.body_position_w_m, here.body_position_w_m)))
        least = [body_m / bounds.body_speed_m_s, bounds.min_step_s]
        least += {
            FIRST - 1: [bounds.load_time_s / 0.45],
            FIRST: [smooth_s / 0.6, opens_m / ROBOT.gripper.max_finger_speed_m_s],
            LAST: [smooth_s / 0.6, -opens_m / ROBOT.gripper.max_finger_speed_m_s],
            LAST + 1: [bounds.load_time_s / 0.4],
        }.get(k, [way_m / bounds.swing_speed_m_s])
        assert step_s == pytest.approx(max(least), rel=2e-3), k


def test_fingers_open_no_wider_than_holds_and_clearance_need() -> None:
    openings = [knot.limbs[RF].finger_separation_m / 2 for knot in TIME.plan.knots[FIRST + 1 : LAST + 1]]
    np.testing.assert_allclose(openings, synthetic.HALF_M + ROBOT.pace.opening_clearance_m)


def test_the_way_of_grippers_and_body_is_the_same() -> None:
    before, after = synthetic.make_plan(), TIME.plan
    for old, new in zip(before.knots, after.knots, strict=True):
        assert list(old.body_position_w_m) == list(new.body_position_w_m)
        assert [list(limb.gripper_position_w_m) for limb in old.limbs] == [
            list(limb.gripper_position_w_m) for limb in new.limbs
        ]
    assert PlanReference(after).end_s == after.knots[-1].time_s


def test_balanced_is_in_between() -> None:
    result = at_pace("balanced")
    assert check_plan(result.plan, ROBOT).ok
    np.testing.assert_allclose(steps_s(result.plan), 1.25 * steps_s(TIME.plan), rtol=1e-6)


def test_intervals_that_the_check_refuses_take_longer(monkeypatch: pytest.MonkeyPatch) -> None:
    least_times_s = pace.least_times_s
    monkeypatch.setattr(pace, "least_times_s", lambda *given: 0.6 * least_times_s(*given))
    result = at_pace("time")
    assert result.plan.format == plan_t.FORMAT_MOVING_FINGERS
    assert check_plan(result.plan, ROBOT).ok
    assert (steps_s(result.plan)[FIRST - 1 : LAST + 2] >= steps_s(TIME.plan)[FIRST - 1 : LAST + 2] - 1e-9).all()


@pytest.mark.parametrize(("knot", "interval"), [(FIRST + 1, FIRST), (LAST, LAST)])
def test_fingers_too_near_the_hold_as_the_gripper_lifts_or_comes_down_are_found(knot: int, interval: int) -> None:
    def change(plan: plan_t) -> None:
        plan.knots[knot].limbs[RF].finger_separation_m = 2 * (synthetic.HALF_M + 0.006)

    found = only(broken(change), "clearance_finger")
    start_s, end_s = (TIME.plan.knots[k].time_s for k in (interval, interval + 1))
    assert all(each.limb == "RF" for each in found)
    assert all(start_s < (each.time_s or 0.0) < end_s for each in found)
    assert max(each.amount for each in found) == pytest.approx(0.003 - 0.4 * 0.006, abs=2e-4)


def test_fingers_with_little_room_stand_still_as_the_gripper_lifts_and_comes_down() -> None:
    narrow = dataclasses.replace(ROBOT, pace=dataclasses.replace(ROBOT.pace, opening_clearance_m=0.005))
    result = at_pace("time", narrow)
    assert result.plan.format == plan_t.FORMAT_OWN_TIMES
    assert check_plan(result.plan, narrow).ok


def test_a_plan_that_passes_at_no_pace_stays_as_it_was() -> None:
    slow = dataclasses.replace(ROBOT, pace=dataclasses.replace(ROBOT.pace, opening_clearance_m=1e-4))
    assert at_pace("time", slow).plan.format == plan_t.FORMAT


@pytest.mark.parametrize(
    ("interval", "share", "constraint", "limb"),
    [
        (FIRST - 1, 0.9, "load_time", "RF"),
        (FIRST, 0.8, "finger_speed", "RF"),
        (LAST, 0.8, "finger_speed", "RF"),
        (FIRST, 0.5, "lift_acceleration", "RF"),
        (FIRST, 0.3, "lift_speed", "RF"),
        (FIRST + 1, 0.3, "swing_speed", "RF"),
        (LAST, 0.9, "lift_acceleration", "RF"),
        (LAST + 1, 0.9, "load_time", "RF"),
    ],
)
def test_too_little_time_is_found(interval: int, share: float, constraint: str, limb: str) -> None:
    found = only(broken(quicker(interval, share)), constraint)
    start_s = TIME.plan.knots[interval].time_s
    assert any(each.limb == limb and each.time_s == pytest.approx(start_s) for each in found)


def test_forces_that_were_not_balanced_anew_are_found() -> None:
    def change(plan: plan_t) -> None:
        for old, new in zip(synthetic.make_plan().knots, plan.knots, strict=True):
            for was, limb in zip(old.limbs, new.limbs, strict=True):
                limb.finger_force_w_n = list(was.finger_force_w_n)

    assert only(broken(change), "force_balance")[0].amount > 0.1


def test_times_of_their_own_do_not_excuse_a_plan_for_the_paper() -> None:
    def change(plan: plan_t) -> None:
        plan.scenario_yaml = plan.scenario_yaml.replace("objective: time", "objective: paper")

    assert only(broken(change), "swing_speed")


@pytest.mark.parametrize(("knot", "time_s"), [(0, 0.1), (4, -1.0), (4, 0.0)])
def test_knots_out_of_order_are_refused(knot: int, time_s: float) -> None:
    def change(plan: plan_t) -> None:
        plan.knots[knot].time_s = time_s

    (found,) = only(broken(change), "time_stamps")
    assert found.time_s == time_s
