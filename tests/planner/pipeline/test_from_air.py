"""Plans that begin with limbs in the air: planned, checked, and what the checker refuses of them."""

from __future__ import annotations

import itertools
from functools import lru_cache
from pathlib import Path
from typing import Any

import pytest
import yaml
from crux_contracts.interpolation import PlanReference
from crux_contracts.plan_file import from_bytes, plan_id, to_bytes
from crux_contracts.robot import load_robot
from crux_contracts.scenario import Scenario, ScenarioError, parse_scenario
from crux_msgs import plan_t
from crux_planner.checker import check_plan
from crux_planner.errors import InfeasibleError
from crux_planner.pipeline.entry import plan
from crux_planner.pipeline.replan import Planner
from crux_planner.solvers import clock
from crux_simulation.benchmarks.random_walls import random_ladder

SCENES = Path(__file__).parents[3] / "msgs" / "scenarios"
RF, AIR, STANCE = 1, 1, 0
PLACE = [0.144, -0.363, 0.033]


def hanging(name: str = "climb-four-holds", without: tuple[str, ...] = ("right-front-low",), **air: Any) -> Scenario:
    """A scene whose RF is in the air, beside where its first hold was."""
    content = yaml.safe_load((SCENES / f"{name}.yaml").read_text())
    content["holds"] = [hold for hold in content["holds"] if hold["name"] not in without]
    for end in ("start", "goal"):
        content[end].get("grasps", {}).pop("RF", None)
    content["start"]["air"] = {"RF": {"position_m": PLACE, "yaw_deg": 3.0, "opening_m": 0.02, **air}}
    return parse_scenario(yaml.safe_dump(content))


@lru_cache
def planned() -> Any:
    return Planner(hanging(), load_robot("scaler")).plan(method="by a test")


def test_the_limb_in_the_air_goes_to_a_hold_before_any_other_moves() -> None:
    result = planned()
    assert result.check.ok
    assert result.check.cost == pytest.approx(result.cost, rel=2e-3)  # the NLP adds a little for spines
    assert result.gait[0] == "RF"
    assert (result.plan.format, result.plan.method) == (plan_t.FORMAT_FROM_AIR, "by a test")
    phases = [[limb.phase for limb in knot.limbs] for knot in result.plan.knots]
    lands = next(k for k, now in enumerate(phases) if now[RF] == STANCE)
    assert phases[:lands] == [[STANCE, AIR, STANCE, STANCE]] * lands
    assert AIR not in phases[-1]
    first = result.plan.knots[0].limbs[RF]
    assert list(first.gripper_position_w_m) == pytest.approx(PLACE)
    assert not any(first.finger_force_w_n)
    assert check_plan(from_bytes(to_bytes(result.plan)), load_robot("scaler")).ok


def test_its_yaw_may_be_given_a_whole_turn_off() -> None:
    result = Planner(hanging(yaw_deg=-357.0), load_robot("scaler")).plan(method="by a test")
    assert result.check.ok
    assert result.gait == planned().gait
    assert result.cost == pytest.approx(planned().cost)


def test_its_fingers_open_before_it_moves() -> None:
    reference = PlanReference(planned().plan)
    rests = reference.limb(RF, 0, [0.0, 0.4])
    assert rests.position_w_m[0] == pytest.approx(PLACE)
    assert rests.position_w_m[1] == pytest.approx(PLACE)
    assert rests.opening_m[0] > 0.04
    assert reference.load(RF, 0, 0.5) == 0.0


@pytest.mark.parametrize(
    ("change", "broken"),
    [
        ("plan.knots[0].limbs[1].gripper_position_w_m = [0.146, -0.363, 0.033]", "start_air"),
        ("plan.knots[0].limbs[1].gripper_yaw_w_rad += 0.01", "start_air"),
        ("plan.format = 1", "plan_format"),
        ("plan.knots[0].limbs[1].finger_force_w_n = [1.0, 0, 0, 0, 0, 0]", "air_force"),
        ("plan.knots[0].limbs[0].finger_force_w_n = [0.0] * 6", "force_balance"),
    ],
)
def test_the_checker_sees_what_is_wrong_at_the_beginning(change: str, broken: str) -> None:
    message = plan_t.decode(planned().plan.encode())
    exec(change, {"plan": message})
    message.plan_id = plan_id(message)
    found = {violation.constraint for violation in check_plan(message, load_robot("scaler")).violations}
    assert broken in found


def test_the_scenario_in_the_plan_says_where_the_limb_begins() -> None:
    message = plan_t.decode(planned().plan.encode())
    message.scenario_yaml = message.scenario_yaml.replace("0.144", "0.244")
    message.plan_id = plan_id(message)
    found = {violation.constraint for violation in check_plan(message, load_robot("scaler")).violations}
    assert "start_air" in found


def touching(opening_m: float) -> Scenario:
    """RF is where it grips; its hold is 0.03 m from the middle."""
    return hanging("climb-one-step", without=(), position_m=[0.14, -0.36, 0.033], opening_m=opening_m)


def test_fingers_that_touch_their_hold_at_the_beginning_may_be_measured_within_it() -> None:
    assert Planner(touching(0.0285), load_robot("scaler")).plan().check.ok


@pytest.mark.sweep
def test_but_not_far_within_it() -> None:
    with pytest.raises(InfeasibleError, match=r"fails the check: clearance_finger of RF") as refused:
        Planner(touching(0.024), load_robot("scaler")).plan(time_limit_s=4.0)
    assert not refused.value.proven


def test_where_the_limb_in_the_air_has_no_hold_in_reach_that_is_said() -> None:
    lonely = hanging(without=("right-front-low", "right-front-high"))
    with pytest.raises(InfeasibleError, match="RF"):
        Planner(lonely, load_robot("scaler")).plan()


def test_where_time_runs_out_what_the_search_has_seen_is_said(monkeypatch: pytest.MonkeyPatch) -> None:
    planner, looks = Planner(hanging("climb-long"), load_robot("scaler")), itertools.count()
    monkeypatch.setattr(clock, "now", lambda: float(next(looks)))  # on any machine after as many looks at the clock
    with pytest.raises(InfeasibleError, match="stances looked at, nearest to the goal") as late:
        planner.plan(time_limit_s=20.0)
    assert late.value.verdict == "undecided"
    assert "(1 stances" not in str(late.value)


def test_the_planner_with_proofs_refuses_a_start_in_the_air_by_name() -> None:
    with pytest.raises(ScenarioError, match=r"start\.air"):
        plan(hanging(), load_robot("scaler"))


@pytest.mark.parametrize(
    ("start", "says"),
    [
        ("air: {RF: {position_m: [0, 0, 0.1], opening_m: 0.02}}", "RF has a grasp in start.grasps"),
        ("air: {XX: {position_m: [0, 0, 0.1], opening_m: 0.02}}", "XX"),
        ("air: {RF: {opening_m: 0.02}}", "position_m"),
    ],
)
def test_a_start_that_makes_no_sense_is_told(start: str, says: str) -> None:
    text = (SCENES / "climb-four-holds.yaml").read_text().replace("start:\n", f"start:\n  {start}\n")
    with pytest.raises(ScenarioError, match=says):
        parse_scenario(text)


def test_a_limb_without_a_grasp_is_missed() -> None:
    content = yaml.safe_load((SCENES / "climb-four-holds.yaml").read_text())
    del content["start"]["grasps"]["RF"]
    with pytest.raises(ScenarioError, match="RF"):
        parse_scenario(yaml.safe_dump(content))


def test_a_way_that_needs_another_heading_is_found_soon_and_waits_for_nothing() -> None:
    content = yaml.safe_load(random_ladder(7112, rungs=5, slope_deg=90.0, spares=True))
    content["holds"] = [hold for hold in content["holds"] if hold["name"] != "right-4"]
    content["start"] = {
        "body": {"position_m": [0.176, 0.002, 0.167], "rpy_deg": [-0.1, 1.1, 2.6]},
        "grasps": {
            limb: {"hold": hold, "faces": face[1], "finger1": face}
            for limb, hold, face in (("LF", "left-4", "-y"), ("LR", "left-1", "+x"), ("RR", "right-2", "-y"))
        },
        "air": {"RF": {"position_m": [0.323, -0.366, 0.036], "yaw_deg": -91.35, "opening_m": 0.03}},
    }
    wall = parse_scenario(yaml.safe_dump(content))
    result = Planner(wall, load_robot("scaler")).plan(time_limit_s=8.0)  # a level body's ways alone take twice as long
    assert result.check.ok
    assert [limb for limb in result.gait if limb != "-"] == ["RF", "LR"]
    assert result.steps <= 2 * 10  # of two moves, not of the horizon's 120
