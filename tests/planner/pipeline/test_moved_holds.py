"""Planning again on a map whose holds were found elsewhere than the running plan has them."""

from __future__ import annotations

import cmath
import math
from functools import lru_cache
from typing import Any

import numpy as np
import pytest
from crux_contracts.plan_route import join_knot, joined
from crux_contracts.robot import load_robot
from crux_contracts.scenario import Scenario, parse_scenario
from crux_msgs import limb_knot_t
from crux_planner.checker import check_plan
from crux_planner.errors import InfeasibleError
from crux_planner.pipeline.moved_holds import on_moved_holds
from crux_planner.pipeline.replan import Planner
from crux_planner.pipeline.restart import stances
from scipy.spatial.transform import Rotation
from shared_plans import unproven
from turned import turned
from walls import scenario, two_rows

SHIFT_M, TURN_DEG = (0.009, -0.006), 4.0
MOVED = 2  # number of the hold


def wall(moved: bool = False) -> Scenario:
    content = two_rows()
    if moved:
        hold = content["holds"][MOVED]
        hold["position_m"] = [a + b for a, b in zip(hold["position_m"], SHIFT_M, strict=True)]
        hold["yaw_deg"] = hold.get("yaw_deg", 0.0) + TURN_DEG
    return scenario(content)


@lru_cache
def running() -> Any:
    return unproven(wall(), load_robot("scaler")).plan


def grips(plan: Any) -> list[tuple[int, int, Any]]:
    """Knot, limb and what it grips, of all."""
    return [(k, i, limb) for k, knot in enumerate(plan.knots) for i, limb in enumerate(knot.limbs) if limb.phase == 0]


def test_grips_go_with_the_hold_that_has_moved_and_no_other_does() -> None:
    before, after = running(), on_moved_holds(running(), wall(moved=True))
    hold, turn = before.holds[MOVED], cmath.exp(1j * math.radians(TURN_DEG))
    middle = complex(*hold.position_w_m[:2])
    met = 0
    for (_, _, old), (_, _, new) in zip(grips(before), grips(after), strict=True):
        there = complex(*old.gripper_position_w_m[:2])
        turned = 0.0
        if before.holds[old.hold].name == hold.name:
            there = middle + complex(*SHIFT_M) + turn * (there - middle)
            turned, met = math.radians(TURN_DEG), met + 1
        assert complex(*new.gripper_position_w_m[:2]) == pytest.approx(there, abs=1e-9)
        assert new.gripper_yaw_w_rad - old.gripper_yaw_w_rad == pytest.approx(turned, abs=1e-9)
        assert new.gripper_position_w_m[2] == old.gripper_position_w_m[2]
    assert met


def test_a_grip_on_a_turned_hold_goes_with_it_out_of_the_walls_plane() -> None:
    """9 mm off along x, 5 mm along z, and tilted by 6 degrees more."""
    moved, before = turned(), unproven(parse_scenario(turned()), load_robot("scaler")).plan
    hold = next(each for each in moved["holds"] if each["name"] == before.holds[MOVED].name)
    hold["pose"]["position_m"] = list(np.add(hold["pose"]["position_m"], [0.009, 0.0, 0.005]))
    hold["pose"]["rpy_deg"] = list(np.add(hold["pose"]["rpy_deg"], [0.0, 6.0, 3.0]))
    after = on_moved_holds(before, parse_scenario(moved))

    def in_hold(grip: Any, pose_m: Any, rpy_deg: Any) -> Any:
        """Place and rotation vector of a gripper in a hold's frame."""
        of_hold = Rotation.from_euler("xyz", rpy_deg, degrees=True).inv()
        turn = Rotation.from_rotvec([*grip.gripper_tilt_w_rad, 0.0]) * Rotation.from_euler("z", grip.gripper_yaw_w_rad)
        place = of_hold.apply(np.subtract(grip.gripper_position_w_m, pose_m))
        return np.append(place, (of_hold * turn).as_rotvec())

    was, met = before.holds[MOVED], 0
    rpy_deg = np.degrees([*was.tilt_rad, was.yaw_rad])
    for (_, _, old), (_, _, new) in zip(grips(before), grips(after), strict=True):
        if old.hold == MOVED:
            there = in_hold(new, hold["pose"]["position_m"], hold["pose"]["rpy_deg"])
            assert there == pytest.approx(in_hold(old, was.position_w_m, rpy_deg), abs=1e-9)
            met += 1
        else:
            assert new.gripper_position_w_m == old.gripper_position_w_m
    assert met


def test_where_nothing_has_moved_it_is_the_same_plan() -> None:
    assert on_moved_holds(running(), wall()) is running()


def test_the_running_plans_own_moves_are_planned_on_the_map_as_it_was_measured() -> None:
    robot, planner = load_robot("scaler"), Planner(wall(moved=True), load_robot("scaler"))
    ks = stances(running())
    for k in ks[:-1]:
        result = planner.replan(running(), running().knots[k].time_s, quick=True)
        assert "contacts" not in result.timing  # nothing was searched
        assert check_plan(result.plan, robot).ok
        names = [result.plan.holds[limb.hold].name for limb in result.plan.knots[-1].limbs]
        assert names == [running().holds[limb.hold].name for limb in running().knots[-1].limbs]
        if k == 0:
            continue
        assert running().knots[join_knot(running(), result.plan)].body_position_w_m == pytest.approx(
            list(running().knots[k].body_position_w_m), abs=1e-6
        )


def test_joined_it_is_one_plan_in_which_no_gripper_moves_on_its_hold() -> None:
    k = stances(running())[2]
    part = Planner(wall(moved=True), load_robot("scaler")).replan(running(), running().knots[k].time_s, quick=True).plan
    at, whole = join_knot(running(), part), joined(running(), part)
    assert len(whole.knots) == at + len(part.knots)
    assert sorted(hold.name for hold in whole.holds) == sorted(hold.name for hold in running().holds)
    for limb in range(4):
        for one, other in zip(whole.knots[:-1], whole.knots[1:], strict=True):
            here, there = one.limbs[limb], other.limbs[limb]
            if here.phase == there.phase == limb_knot_t.STANCE:
                assert here.hold == there.hold
                assert here.gripper_position_w_m == pytest.approx(list(there.gripper_position_w_m), abs=1e-6)
                assert here.gripper_yaw_w_rad == pytest.approx(there.gripper_yaw_w_rad, abs=1e-6)
    for old, new in zip(running().knots[:at], whole.knots[:at], strict=True):
        assert list(new.body_position_w_m) == list(old.body_position_w_m)
        for a, b in zip(old.limbs, new.limbs, strict=True):
            press = [np.linalg.norm(limb.finger_force_w_n) for limb in (a, b)]
            assert press[0] == pytest.approx(press[1], abs=1e-9)


def test_quick_says_why_it_finds_nothing_in_place_of_planning_from_scratch(monkeypatch: pytest.MonkeyPatch) -> None:
    def refuse(*_: Any, **__: Any) -> None:
        raise AssertionError("planned from scratch")

    monkeypatch.setattr("crux_planner.pipeline.replan.plan_at_once", refuse)
    planner = Planner(wall(), load_robot("scaler"))
    begin, after = ({limb.hold for limb in running().knots[k].limbs} for k in stances(running())[:2])
    (lost,) = after - begin
    with pytest.raises(InfeasibleError):
        planner.replan(running(), 0.0, without=[running().holds[lost].name], quick=True, time_limit_s=2.0)
