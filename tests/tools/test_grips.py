"""Holds that have grips: planned and climbed there alone, by plans that the checker judges by itself."""

from __future__ import annotations

import hashlib
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import crux_planner
import numpy as np
import pytest
from climbs import climbs_and_replays
from crux_contracts.plan_file import plan_id
from crux_contracts.robot import load_robot
from crux_contracts.scenario import ScenarioError, parse_scenario
from crux_msgs import plan_t
from crux_planner.checker import check_plan
from crux_planner.method_report import wall_lacks
from crux_planner.model.build import wall_contacts
from crux_planner.pipeline.message import PlanResult
from crux_tools.guide.stance import places_of
from scipy.spatial.transform import Rotation
from turned import turned

ROBOT = load_robot("scaler")
START, GOAL = "left-front-low", "left-front-high"
GRIPS = {START: {"faces": "x", "aside_m": -0.015}, GOAL: {"faces": "x", "aside_m": 0.02, "height_m": 0.03}}


def wide(grips: dict[str, dict[str, Any]], lean_deg: float = 0.0) -> dict[str, Any]:
    """One move on a vertical wall: holds that are wide along y, and turned unless their sides lean."""
    wall = turned(20.0 if lean_deg == 0.0 else 0.0)
    for hold in wall["holds"]:
        hold["shape"] = {"box_m": [0.06 if lean_deg == 0.0 else 0.09, 0.11, 0.06]}
        if lean_deg:
            hold["pose"] |= {"position_m": [*hold["pose"]["position_m"][:2], 0.0], "rpy_deg": [0, 0, 5]}
            hold["shape"]["lean_deg"] = {"+x": lean_deg, "-x": lean_deg / 2, "+y": lean_deg}
        if hold["name"] in grips:
            hold["grips"] = [grips[hold["name"]]]
    return wall


@cache
def planned() -> PlanResult:
    return crux_planner.plan(wide(GRIPS), ROBOT)


def places(plan: plan_t, hold: str) -> np.ndarray:
    """Where grippers on a hold are, along its own axes off its foot's middle, (n, 3)."""
    found = []
    for knot in plan.knots:
        for limb in knot.limbs:
            if limb.hold >= 0 and plan.holds[limb.hold].name == hold:
                body = plan.holds[limb.hold]
                turn = Rotation.from_euler("ZYX", [body.yaw_rad, *body.tilt_rad[::-1]])
                found.append(turn.inv().apply(np.subtract(limb.gripper_position_w_m, body.position_w_m)))
    return np.array(found)


def violations(change: Callable[[plan_t], None], old: str = "", new: str = "") -> set[str]:
    """Of the plan with something changed, also in its scenario's text."""
    plan = plan_t.decode(planned().plan.encode())
    assert old in plan.scenario_yaml
    plan.scenario_yaml = plan.scenario_yaml.replace(old, new)
    plan.scenario_sha256 = hashlib.sha256(plan.scenario_yaml.encode()).hexdigest()
    change(plan)
    plan.plan_id = plan_id(plan)
    return {violation.constraint for violation in check_plan(plan, ROBOT).violations}


def test_grippers_are_at_the_grips() -> None:
    plan = planned().plan
    assert len(places(plan, START)) > 0
    assert places(plan, START)[:, :2] == pytest.approx(np.tile([0.0, -0.015], (len(places(plan, START)), 1)), abs=1e-9)
    assert len(places(plan, GOAL)) > 0
    assert places(plan, GOAL) == pytest.approx(np.tile([0.0, 0.02, 0.03], (len(places(plan, GOAL)), 1)), abs=1e-9)


def test_the_checker_refuses_other_places() -> None:
    assert violations(lambda _plan: None) == set()
    assert violations(lambda _plan: None, "aside_m: 0.02", "aside_m: 0.021") == {"contact_place"}
    assert violations(lambda _plan: None, "height_m: 0.03", "height_m: 0.029") == {"contact_place"}
    assert violations(lambda _plan: None, "faces: x\n    aside_m: 0.02", "faces: y\n    aside_m: 0.02") == {"hold"}


@pytest.mark.parametrize("lean_deg", [0.0, 20.0])
@pytest.mark.parametrize("off_centre", [False, True])
def test_a_hold_offers_its_grips_alone(lean_deg: float, off_centre: bool) -> None:
    """Where a side beside the faces leans, too, `aside_m` counts from the middle of the foot."""
    grips = {GOAL: {"faces": "x", "aside_m": -0.018, "height_m": 0.032}, START: {"faces": "y", "aside_m": 0.0}}
    scenario = parse_scenario(wide(grips, lean_deg))
    contacts, unusable = wall_contacts(scenario, ROBOT, off_centre)
    index = scenario.hold_index(GOAL)
    body = scenario.holds[index]
    turn = Rotation.from_euler("ZYX", [body.yaw_rad, *body.tilt_rad[::-1]])
    mine = [contact for contact in contacts if contact.hold == index]
    assert {contact.pair for contact in mine} == {0}
    for contact in mine:
        place = turn.inv().apply(contact.centre_h_m - [*body.position_m, body.foot_z_m])
        assert place[1:] == pytest.approx([-0.018, 0.032], abs=1e-9)
    if lean_deg:  # what a robot is recognised on, where holds are upright
        found = [place for place in places_of(scenario, ROBOT) if place.hold == index]
        assert {place.finger1 for place in found} == {"+x", "-x"}
        assert found[0].centre_W_m == pytest.approx(mine[0].centre_h_m, abs=1e-9)
    assert unusable[index, 1] == "none of its grips is on these faces"
    assert wall_lacks(scenario, ROBOT)[scenario.hold_index(START), "x"] == "none of its grips is on these faces"


@pytest.mark.parametrize(
    ("grip", "mm"), [({"aside_m": 0.04}, 5.0), ({"aside_m": -0.038}, 3.0), ({"height_m": 0.042}, 2.0)]
)
def test_a_grip_whose_pads_miss_the_faces_is_refused(grip: dict[str, float], mm: float) -> None:
    """The patch is 20 mm about the pads' middles, the faces 110 mm wide and 60 mm high."""
    with pytest.raises(ScenarioError, match=rf"grips\[0\]: {GOAL}: its pads are {mm} mm beyond the faces"):
        crux_planner.plan(wide({GOAL: {"faces": "x"} | grip}), ROBOT)


def test_the_robot_climbs_from_grip_to_grip(tmp_path: Path) -> None:
    """About 10 s: a move by runtime and physics, and its replay."""
    climbs_and_replays(planned(), ROBOT, tmp_path / "log.mcap")
