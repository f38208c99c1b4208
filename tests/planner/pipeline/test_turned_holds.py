"""A climb on holds that are turned out of the wall's plane: planned, checked, and refused where holds are otherwise."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache

import crux_planner
import numpy as np
import pytest
from at_pace import is_quick
from crux_contracts.robot import load_robot
from crux_contracts.scenario import ScenarioError
from crux_msgs import plan_t
from crux_planner.pipeline.message import PlanResult
from crux_planner.pipeline.replan import Planner
from scipy.spatial.transform import Rotation
from turned import ROLL_DEG, changed_violations, turned

ROBOT = load_robot("scaler")
LF = 0


@cache
def planned() -> PlanResult:
    return crux_planner.plan(turned(), ROBOT)


def violations(change: Callable[[plan_t], None], old: str = "", new: str = "") -> set[str]:
    return changed_violations(planned().plan, ROBOT, change, old, new)


def test_it_is_planned_and_passes_the_check() -> None:
    result = planned()
    assert result.check.ok
    assert result.gap is None  # bounds are about upright holds
    assert result.check.cost == pytest.approx(result.cost, rel=2e-3)


def test_it_is_climbed_in_less_time_where_that_is_asked() -> None:
    assert is_quick(planned(), ROBOT)


def test_its_own_moves_are_planned_again_quickly() -> None:
    found = planned()
    again = Planner(turned(), ROBOT).replan(found.plan, 0.0, quick=True)
    assert again.check.ok
    assert again.gait == found.gait
    assert again.cost < 1.05 * found.cost


def test_grippers_come_along_the_holds_own_z_and_press_on_their_faces() -> None:
    plan = planned().plan
    for knot in plan.knots:
        for limb, grip in enumerate(knot.limbs):
            if grip.hold < 0:
                continue
            side = 1.0 if limb in (0, 2) else -1.0
            yaw = plan.holds[grip.hold].yaw_rad
            of_hold = Rotation.from_euler("ZYX", [yaw, 0.0, np.radians(side * ROLL_DEG)])
            turn = Rotation.from_rotvec([*grip.gripper_tilt_w_rad, 0.0]) * Rotation.from_euler(
                "z", grip.gripper_yaw_w_rad
            )
            between = (of_hold.inv() * turn).as_matrix()
            assert between[2, 2] == pytest.approx(1.0)  # about the hold's z alone, by quarter turns
            assert np.abs(between[:2, :2]).round(9).tolist() in ([[1, 0], [0, 1]], [[0, 1], [1, 0]])
            outward = turn.apply([1.0, 0.0, 0.0])
            assert outward @ grip.finger_force_w_n[:3] > 0.0 > outward @ grip.finger_force_w_n[3:]


def test_the_gripper_leaves_its_hold_straight_off_it() -> None:
    plan = planned().plan
    air = [k for k, knot in enumerate(plan.knots) if knot.limbs[LF].phase == knot.limbs[LF].AIR]
    before, lifted = (np.array(plan.knots[k].limbs[LF].gripper_position_w_m) for k in (air[0], air[0] + 1))
    way = (lifted - before) / np.linalg.norm(lifted - before)
    roll = np.radians(ROLL_DEG)
    assert way == pytest.approx([0.0, -np.sin(roll), np.cos(roll)], abs=1e-6)


def test_a_gripper_that_stays_upright_is_not_on_its_face() -> None:
    def upright(plan: plan_t) -> None:
        for knot in plan.knots:
            for limb in knot.limbs:
                limb.gripper_tilt_w_rad = [0.0, 0.0]

    assert "finger_axis" in violations(upright)


def test_holds_that_are_turned_otherwise_are_not_the_plans() -> None:
    def other(plan: plan_t) -> None:
        for hold in plan.holds:
            hold.tilt_rad = [0.8 * hold.tilt_rad[0], hold.tilt_rad[1]]

    assert "scenario_match" in violations(other)
    assert "finger_axis" in violations(other, f"- {ROLL_DEG}", f"- {0.8 * ROLL_DEG}")


def test_a_turned_obstacle_is_in_the_way_where_it_is() -> None:
    def moved(plan: plan_t) -> None:
        plan.holds[-1].position_w_m = [0.215, 0.36, 0.12]

    assert violations(lambda _plan: None) == set()
    found = violations(moved, "- 0.42\n    - 0.0\n    - 0.06", "- 0.215\n    - 0.36\n    - 0.12")
    assert any(name.startswith("clearance_") for name in found)


def test_the_papers_methods_are_about_upright_holds() -> None:
    with pytest.raises(ScenarioError, match=r"planner\.method: two_block: expected auto: left-front-low is turned"):
        crux_planner.plan(turned(), ROBOT, method="two_block")


def test_a_finger_that_would_be_in_the_wall_is_named() -> None:
    wall = turned()
    wall["holds"][0]["pose"] |= {"position_m": [0.14, 0.36, 0.0], "rpy_deg": [0, 30, 0]}
    with pytest.raises(ScenarioError, match=r"a finger or the palm would be .* off the wall, they need 3 mm"):
        crux_planner.plan(wall, ROBOT)
