"""A climb on holds whose faces lean: planned, checked, and refused by the check once the holds are smoother."""

from __future__ import annotations

import hashlib
from functools import cache

import crux_planner
import numpy as np
import pytest
from at_pace import is_quick
from crux_contracts.plan_file import plan_id
from crux_contracts.plan_series import plan_series
from crux_contracts.robot import load_robot
from crux_contracts.scenario import ScenarioError, parse_scenario
from crux_msgs import plan_t
from crux_planner.checker import check_plan
from crux_planner.model.build import build_problem
from crux_planner.pipeline.grip_loads import bear_more
from crux_planner.pipeline.message import PlanResult
from crux_planner.pipeline.replan import Planner
from leaning import leaning
from walls import one_move

ROBOT, LF = load_robot("scaler"), 0
WALL = leaning({"+x": 30, "-x": 30}, one_move(slope_deg=90.0))


@cache
def planned() -> PlanResult:
    return crux_planner.plan(WALL, ROBOT)


def changed(old: str, new: str) -> plan_t:
    """The plan of a wall whose file says something else."""
    plan = plan_t.decode(planned().plan.encode())
    assert old in plan.scenario_yaml
    plan.scenario_yaml = plan.scenario_yaml.replace(old, new)
    plan.scenario_sha256 = hashlib.sha256(plan.scenario_yaml.encode()).hexdigest()
    return plan


def test_it_is_planned_and_passes_the_check() -> None:
    result = planned()
    assert result.check.ok
    assert result.gap is None  # bounds are about upright faces
    assert all(hold.lean_rad[:2] == pytest.approx([0.5235987756] * 2) for hold in result.plan.holds)
    assert result.check.cost == pytest.approx(result.cost, rel=2e-3)  # the program adds a little for spines


def test_it_is_climbed_in_less_time_where_that_is_asked() -> None:
    assert is_quick(planned(), ROBOT)


def test_fingers_on_faces_that_lean_unlike_bear_just_what_is_asked_for() -> None:
    """A moment, which is the same about every point; a squeeze turns a gripper whose pads touch at unlike heights."""
    plan = plan_t.decode(planned().plan.encode())
    for hold in plan.holds:
        hold.lean_rad = [hold.lean_rad[0], 0.2, *hold.lean_rad[2:]]
    before, asked = plan_series(plan), np.zeros((len(plan.knots) - 1, 6))
    asked[0], harder = [0.0, 0.0, 0.0, 0.5, 0.3, -0.4], np.zeros((len(asked), 4))
    harder[0, LF] = 3.0
    bear_more(plan, asked, build_problem(parse_scenario(plan.scenario_yaml), ROBOT), harder)
    after = plan_series(plan)
    pressed = [each.finger_force_n[0, LF] @ each.opening_axis[0, LF] * [1.0, -1.0] for each in (before, after)]
    assert (pressed[1] > pressed[0] + 2.9).all()
    more = after.wrench - before.wrench
    more[..., 3:] += np.cross(after.gripper_position_m, more[..., :3])
    assert more[0].sum(axis=0) == pytest.approx(asked[0], abs=1e-6)
    assert np.abs(more[1:]).max() == 0.0


def test_its_own_moves_are_planned_again_quickly() -> None:
    again = Planner(WALL, ROBOT).replan(planned().plan, 0.0, quick=True)
    assert again.check.ok
    assert again.cost < 1.05 * planned().cost


def test_a_wall_with_other_faces_is_not_the_plans() -> None:
    plan = changed("+x: 30", "+x: 25")
    plan.plan_id = plan_id(plan)
    names = {violation.constraint for violation in check_plan(plan, ROBOT).violations}
    assert "scenario_match" in names


def test_upright_faces_are_not_where_the_pads_are() -> None:
    plan = changed("x: 30\n", "x: 0\n")
    for hold in plan.holds:
        hold.lean_rad = [0.0] * 4
    plan.plan_id = plan_id(plan)
    names = {violation.constraint for violation in check_plan(plan, ROBOT).violations}
    assert {"contact_face", "limit_surface_between_knots"} & names


def test_smoother_faces_do_not_hold() -> None:
    plan = changed("friction: 2.2", "friction: 1.0")
    for hold in plan.holds:
        hold.friction = [1.0] * 5
    for knot in plan.knots:
        for limb in knot.limbs:
            limb.friction = min(limb.friction, 1.0)
    plan.plan_id = plan_id(plan)
    names = {violation.constraint for violation in check_plan(plan, ROBOT).violations}
    assert "limit_surface" in names


def test_what_is_not_there_yet_is_refused() -> None:
    with pytest.raises(ScenarioError) as error:
        crux_planner.plan(WALL | {"uncertainty": {"friction": 0.1}}, ROBOT)
    assert "uncertainty: is not supported yet where LF-low has faces that lean" in str(error.value)
    with pytest.raises(ScenarioError) as error:
        crux_planner.plan(WALL, ROBOT, method="two_block")
    assert "planner.method: two_block: expected auto: LF-low has faces that lean" in str(error.value)
