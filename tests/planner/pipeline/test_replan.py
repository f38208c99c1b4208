"""Planning again from the stances of a running plan."""

from __future__ import annotations

from functools import lru_cache
from typing import Any

import numpy as np
import pytest
from crux_contracts.robot import load_robot
from crux_contracts.scenario import BodyPose, ScenarioError
from crux_planner.errors import InfeasibleError
from crux_planner.pipeline.replan import Planner
from crux_planner.pipeline.restart import stances
from shared_plans import unproven
from walls import ladder, one_move, scenario, two_rows


@lru_cache
def route() -> tuple[Planner, Any]:
    wall, robot = scenario(two_rows()), load_robot("scaler")
    return Planner(wall, robot), unproven(wall, robot).plan


def test_a_plan_made_again_starts_where_the_running_one_holds_on_and_passes_the_check() -> None:
    planner, running = route()
    found = stances(running)
    assert len(found) == 5  # the start and one after each move
    for k in found[1:]:
        result = planner.replan(running, k * running.dt_s)
        assert result.ok
        assert result.check.ok
        first, knot = result.plan.knots[0], running.knots[k]
        assert list(first.body_position_w_m) == pytest.approx(list(knot.body_position_w_m), abs=1e-9)
        assert [limb.hold for limb in first.limbs] == [limb.hold for limb in knot.limbs]
        assert [limb.hold for limb in result.plan.knots[-1].limbs] == [limb.hold for limb in running.knots[-1].limbs]


def test_in_mid_swing_the_next_stance_is_taken() -> None:
    planner, running = route()
    k = stances(running)[1]
    result = planner.replan(running, (k - 0.5) * running.dt_s)
    assert list(result.plan.knots[0].body_position_w_m) == pytest.approx(list(running.knots[k].body_position_w_m))


def test_after_the_end_there_is_nothing_to_plan() -> None:
    planner, running = route()
    with pytest.raises(InfeasibleError, match="ends at"):
        planner.replan(running, 1e4)


def test_the_running_plans_own_moves_are_kept_and_cost_no_more() -> None:
    planner, running = route()
    again = planner.replan(running, 0.0)
    assert "contacts" not in again.timing  # nothing was searched
    assert again.cost <= 1.0001 * running.cost


def test_a_plan_made_again_leaves_most_of_the_goals_tolerance_to_what_tracks_it() -> None:
    planner, running = route()
    again = planner.replan(running, stances(running)[2] * running.dt_s)
    off = np.linalg.norm(np.subtract(again.plan.knots[-1].body_position_w_m, planner.scenario.goal.body.position_m))
    assert off < planner.scenario.goal.tolerance_m / 3


def test_with_the_body_elsewhere_the_plan_begins_there() -> None:
    planner, running = route()
    k = stances(running)[1]
    x, y, z = running.knots[k].body_position_w_m
    body = BodyPose((x + 0.008, y - 0.01, z), (0.0, 0.0, 1.0))
    result = planner.replan(running, k * running.dt_s, body=body)
    assert result.check.ok
    assert list(result.plan.knots[0].body_position_w_m) == pytest.approx([x + 0.008, y - 0.01, z])


def test_a_body_outside_its_bounds_is_refused_at_once() -> None:
    planner, running = route()
    k = stances(running)[1]
    x, y, _ = running.knots[k].body_position_w_m
    with pytest.raises(ScenarioError, match="position_m"):
        planner.replan(running, k * running.dt_s, body=BodyPose((x, y, 0.1), (0.0, 0.0, 0.0)))


def test_a_lost_hold_is_gone_round_and_stays_in_the_way() -> None:
    planner = Planner(scenario(ladder(5, steps=60)), load_robot("scaler"))
    running = planner.plan().plan
    k, after = stances(running)[:2]
    (lost,) = {limb.hold for limb in running.knots[after].limbs} - {limb.hold for limb in running.knots[k].limbs}
    name = running.holds[lost].name
    result = planner.replan(running, 0.0, without=[name])
    assert result.check.ok
    assert not {"proof", "bound"} & set(result.timing)  # they take seconds, and change no plan
    held = {result.plan.holds[limb.hold].name for knot in result.plan.knots for limb in knot.limbs if limb.hold >= 0}
    assert name not in held
    assert [hold.graspable for hold in result.plan.holds if hold.name == name] == [0]
    with pytest.raises(InfeasibleError, match=f"{name} is no hold any more"):
        planner.replan(running, after * running.dt_s, without=[name])
    with pytest.raises(ScenarioError, match="expected one of the holds"):
        planner.replan(running, 0.0, without=["no-such-hold"])


def test_a_gripper_stays_on_the_faces_as_it_is_turned() -> None:
    """On faces y of these holds a gripper fits two ways, half a turn apart: it must begin as it stands."""
    wall, robot = one_move(), load_robot("scaler")
    wall["goal"].pop("grasps")
    for name in wall["start"]["grasps"]:
        wall["start"]["grasps"][name]["faces"] = "y"
    begun = {}
    for side in ("+y", "-y"):
        wall["start"]["grasps"]["LF"]["finger1"] = side
        begun[side] = unproven(scenario(wall), robot).plan
    first, second = (begun[side].knots[0].limbs[0] for side in ("+y", "-y"))
    assert (first.finger1_face, second.finger1_face) == (2, 3)
    assert abs(first.gripper_yaw_w_rad - second.gripper_yaw_w_rad) == pytest.approx(np.pi)
    wall["start"]["grasps"]["LF"].pop("finger1")
    planner = Planner(scenario(wall), robot)
    for running in begun.values():
        again = planner.replan(running, 0.0)
        assert again.plan.knots[0].limbs[0].finger1_face == running.knots[0].limbs[0].finger1_face
