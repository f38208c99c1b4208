"""Holds that have grips: planned and climbed there alone, by plans that the checker judges by itself."""

from __future__ import annotations

import hashlib
import re
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import crux_planner
import numpy as np
import pytest
import yaml
from climbs import climbs_and_replays
from crux_contracts.gripper_frames import gripper_rotation
from crux_contracts.robot import load_robot
from crux_contracts.scenario import ScenarioError, parse_scenario
from crux_msgs import plan_t
from crux_planner.checker.limit_surface import cone_excess, finger_loads, pad_shares
from crux_planner.checker.plan_arrays import read_plan
from crux_planner.checker.report import Findings
from crux_planner.method_report import wall_lacks
from crux_planner.model.build import MOST_FRICTION, wall_contacts
from crux_planner.pipeline.message import PlanResult
from crux_tools.cli import main
from crux_tools.guide.stance import places_of
from crux_tools.robot3d.robot_model import build_model
from crux_tools.telemetry.margins import planned_grip
from crux_tools.view.grip_marks import marks_of
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation
from shared_plans import unproven
from turned import changed_violations, turned

ROBOT = load_robot("scaler")
START, GOAL = "left-front-low", "left-front-high"
FRICTION = [2.2, 1.2]
PARTLY = {"share": [0.5, 0.8], "friction": FRICTION}
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
    return changed_violations(planned().plan, ROBOT, change, old, new)


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


def test_what_neighbours_leave_is_less_than_fingers_need_on_leaning_faces() -> None:
    """A block that comes nearer by 0.5 mm at a time, until fingers cannot open."""
    left = []
    for off_m in np.arange(0.1, 0.0625, -0.0005):
        wall = wide({}, 30.0)
        x, y, _ = next(hold["pose"]["position_m"] for hold in wall["holds"] if hold["name"] == GOAL)
        block = {"position_m": [x + float(off_m), y, 0.0], "rpy_deg": [0, 0, 5]}
        wall["obstacles"] = [{"name": "block", "pose": block, "shape": {"box_m": [0.03, 0.1, 0.06]}}]
        scenario = parse_scenario(wall)
        if why := wall_contacts(scenario, ROBOT, False)[1].get((scenario.hold_index(GOAL), 0)):
            left.append(re.fullmatch(r"its neighbours leave (\d+) mm beside the fingers, they need 18 mm to open", why))
    assert len(left) > 5
    assert max(int(each[1]) if each else 18 for each in left) == 17


def test_a_tall_hold_is_recognised_where_plans_grip_it() -> None:
    """Palms keep 10 mm off its top, which is 85 mm high: pads are 45 mm over the wall."""
    wall = turned(0.0)
    for hold in wall["holds"]:
        hold["pose"]["position_m"][2] = 0.0
        hold["shape"] = {"box_m": [0.06, 0.06, 0.085]}
    scenario = parse_scenario(wall)
    contacts, _ = wall_contacts(scenario, ROBOT, False)
    assert {round(contact.centre_h_m[2], 9) for contact in contacts} == {0.045}
    assert {round(place.centre_W_m[2], 9) for place in places_of(scenario, ROBOT)} == {0.045}


@pytest.mark.parametrize(
    ("grip", "mm"), [({"aside_m": 0.04}, 5.0), ({"aside_m": -0.038}, 3.0), ({"height_m": 0.042}, 2.0)]
)
def test_a_grip_whose_pads_miss_the_faces_is_refused(grip: dict[str, float], mm: float) -> None:
    """The patch is 20 mm about the pads' middles, the faces 110 mm wide and 60 mm high."""
    with pytest.raises(ScenarioError, match=rf"grips\[0\]: {GOAL}: its pads are {mm} mm beyond the faces"):
        crux_planner.plan(wide({GOAL: {"faces": "x"} | grip}), ROBOT)


@cache
def in_part() -> PlanResult:
    """Half of the pad on the plus face of the goal's hold, 0.8 of the other bears, which is smoother."""
    return crux_planner.plan(wide(GRIPS | {GOAL: GRIPS[GOAL] | PARTLY}), ROBOT)


def test_plans_count_on_the_share_of_pads_that_bears() -> None:
    plan, whole = in_part().plan, planned().plan
    found = {limb.friction for knot in plan.knots for limb in knot.limbs if limb.hold == len(plan.holds) - 2}
    assert plan.holds[-2].name == GOAL
    assert found == {0.8 * 1.2}
    assert planned_grip(plan).used[-1, 0].max() < 0.91
    assert in_part().cost >= planned().cost - 1e-6
    assert list(plan.holds[-2].friction) == [*FRICTION, *whole.holds[-2].friction[2:]]
    unsure = wide(GRIPS | {GOAL: GRIPS[GOAL] | PARTLY}) | {"uncertainty": {"friction": 0.1}}
    plan = unproven(parse_scenario(unsure), ROBOT).plan
    assert plan.knots[-1].limbs[0].friction == pytest.approx(0.9 * 0.8 * 1.2)


def test_the_checker_goes_by_the_friction_of_grips() -> None:
    """A plan for 1.2 under a pad, where the scenario has 0.9, whatever the faces of the plan's holds have."""
    scene = yaml.safe_load(in_part().plan.scenario_yaml)
    (grip,) = next(hold["grips"] for hold in scene["holds"] if hold["name"] == GOAL)
    grip["friction"] = [2.2, 0.9]
    text = yaml.safe_dump(scene)

    def change(plan: plan_t) -> None:
        plan.scenario_yaml, plan.scenario_sha256 = text, hashlib.sha256(text.encode()).hexdigest()
        plan.holds[-2].friction = [2.2, 0.9, *plan.holds[-2].friction[2:]]

    assert "friction" in changed_violations(in_part().plan, ROBOT, change)


def test_the_checker_has_the_limit_surface_of_what_bears() -> None:
    """Against the share that a finger's wrench leaves of (2a), with k and the spines of its pad."""
    plan = plan_t.decode(in_part().plan.encode())
    scenario = parse_scenario(plan.scenario_yaml)
    arrays = read_plan(plan, Findings(), ROBOT.gripper.pad_radius_m)
    assert arrays is not None
    loads = finger_loads(arrays, 0.6, pad_shares(scenario))
    twist_Nm = np.full_like(loads.twist_Nm, 0.2)  # more than spines hold
    beyond = loads.excess(loads.shear_N, twist_Nm, loads.normal_N, ..., arrays.patch_k_m)
    at = -1, 0  # LF ends on the goal's hold
    for finger in (0, 1):
        share = [0.5, 0.8][arrays.faces[-1, 0, finger]]
        shear = np.maximum(np.abs(loads.shear_N[at][finger]) - 5.0 * share, 0.0)
        twist = (0.2 - 0.05 * share) / (share * arrays.patch_k_m)
        demand = (np.hypot(*shear) ** 1.65 + twist**1.65) ** (1 / 1.65)
        most = FRICTION[arrays.faces[-1, 0, finger]] * loads.normal_N[at][finger]
        assert beyond[at][finger] == pytest.approx(demand - most, abs=1e-9)


@settings(max_examples=50)
@given(st.floats(0.5, 1.0), st.floats(0.0, 1.0), st.floats(0.0, 1.0))
def test_less_friction_is_inside_the_surface_of_what_bears(share: float, slide: float, size: float) -> None:
    """What plans have, friction x share with the whole k, against (2a) with k x share."""
    shear, twist = size * share * np.array([slide, np.sqrt(1.0 - slide**2) * 0.01])
    none, one = np.array(0.0), np.array(1.0)
    load = MOST_FRICTION * np.array([shear, 0.0]), np.array(MOST_FRICTION * twist), one
    excess = cone_excess(*load, friction=one, patch_k_m=share * 0.01, spine_shear_N=none, spine_twist_Nm=none)
    assert excess <= 1e-12


def test_in_physics_pads_twist_and_spines_hold_by_what_bears() -> None:
    plan = in_part().plan
    robot = build_model(ROBOT, plan)
    pads = {robot.model.geom(geom).name for geom in robot.pad_geoms}
    faces = {face.geom: face for face in robot.faces if face.hold == len(plan.holds) - 2}
    assert {face.share for face in faces.values()} == {0.5, 0.8, 1.0}
    for pair in range(robot.model.npair):
        names = {robot.model.geom(geom[pair]).name for geom in (robot.model.pair_geom1, robot.model.pair_geom2)}
        if names & pads and (on := names & set(faces)):
            share = {"+x": 0.5, "-x": 0.8}.get(min(on)[-2:], 1.0)
            slide, _, spin = robot.model.pair_friction[pair][:3]
            assert spin == pytest.approx(share * plan.patch_k_m * slide)
    by_face = dict(zip((face.geom for face in robot.faces), robot.adhesion_of_face, strict=True))
    by_friction = [by_face[geom] * faces[geom].friction for geom in sorted(faces) if geom.endswith("x")]
    assert by_friction == pytest.approx([0.5, 0.8])
    assert [faces[geom].friction for geom in sorted(faces) if geom.endswith("x")] == FRICTION


def test_routes_need_whole_pads(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    wall = tmp_path / "wall.yaml"
    wall.write_text(in_part().plan.scenario_yaml, encoding="utf-8")
    assert main(["plan", str(wall), "-o", str(tmp_path / "route"), "--stream"]) == 2
    assert "holds: pads bear in part on left-front-high: parts of a route do not have" in capsys.readouterr().err


def test_a_pad_of_which_less_than_half_bears_is_refused() -> None:
    with pytest.raises(ScenarioError, match=r"grips\[0\].share\[0\]: 0.4: expected a number in 0.5..1"):
        parse_scenario(wide({GOAL: {"faces": "x", "share": [0.4, 1.0]}}))


def test_grips_are_drawn_where_pads_touch() -> None:
    """By the plan's own grippers, half of what is between their pads to either side."""
    plan, held = planned().plan, set[tuple[float, ...]]()
    for limb in (limb for knot in plan.knots for limb in knot.limbs if limb.hold >= 0):
        turn = gripper_rotation(limb.gripper_yaw_w_rad, np.array(limb.gripper_tilt_w_rad))
        for side in (0.5, -0.5):
            place = np.array(limb.gripper_position_w_m) + side * limb.finger_separation_m * turn[:, 0]
            if plan.holds[limb.hold].name in GRIPS:
                held.add(tuple(round(float(each), 5) + 0.0 for each in place))
    marks = marks_of(plan, ROBOT)
    assert {tuple(round(each, 5) + 0.0 for each in mark["position"]) for mark in marks} == held
    assert len(marks) == len(held) == 4


ENDS_M = (-0.03, 0.03)
ENDS = [{"faces": "x", "aside_m": aside, "height_m": 0.03} for aside in ENDS_M]


def long_holds(blocked: int, begun: int | None = None) -> dict[str, Any]:
    """The left front holds can be taken at either end; at one end of the upper one fingers have no space to open."""
    wall = turned(0.0)
    for hold in wall["holds"]:
        hold["pose"]["position_m"][2] = 0.0
        hold["shape"] = {"box_m": [0.06, 0.11, 0.06]}
        if hold["name"] in (START, GOAL):
            hold["grips"] = ENDS
        if hold["name"] == GOAL:
            x, y, _ = hold["pose"]["position_m"]
            place = [x + 0.065, y + ENDS_M[blocked], 0.0]
            block = {"name": "block", "pose": {"position_m": place}, "shape": {"box_m": [0.03, 0.03, 0.06]}}
            wall["obstacles"] = [block]
    if begun is not None:
        wall["start"]["grasps"]["LF"]["grip"] = begun
    return wall


@cache
def at_an_end(blocked: int, begun: int | None = None) -> PlanResult:
    return crux_planner.plan(long_holds(blocked, begun), ROBOT)


@pytest.mark.parametrize(("blocked", "begun"), [(0, 1), (1, 0)])
def test_the_search_takes_the_end_of_a_hold_that_is_free(blocked: int, begun: int) -> None:
    found = at_an_end(blocked, begun)
    assert found.check.violations == []
    assert places(found.plan, START)[:, 1] == pytest.approx(np.full(len(places(found.plan, START)), ENDS_M[begun]))
    assert places(found.plan, GOAL)[:, 1] == pytest.approx(np.full(len(places(found.plan, GOAL)), ENDS_M[1 - blocked]))


def test_a_start_has_the_grip_that_it_names() -> None:
    plan = at_an_end(0, 1).plan
    assert changed_violations(plan, ROBOT, lambda _plan: None) == set()
    assert changed_violations(plan, ROBOT, lambda _plan: None, "grip: 1", "grip: 0") == {"contact_place"}
    assert changed_violations(plan, ROBOT, lambda _plan: None, "aside_m: 0.03", "aside_m: 0.02") == {"contact_place"}
    assert changed_violations(plan, ROBOT, lambda _plan: None, "aside_m: -0.03", "aside_m: -0.02") == set()


def test_a_plan_from_a_stance_begins_at_the_end_that_is_held() -> None:
    for blocked in (0, 1):
        plan = at_an_end(blocked, 1 - blocked).plan
        there = crux_planner.scenario_at(parse_scenario(plan.scenario_yaml), plan, len(plan.knots) - 1)
        assert there.start.grasps["LF"].grip == 1 - blocked
        assert there.start.grasps["RF"].grip is None
        found = [place for place in places_of(there, ROBOT) if place.hold == there.hold_index(GOAL)]
        assert {(place.grip, round(place.centre_W_m[1] - 0.36, 9)) for place in found} == set(enumerate(ENDS_M))


def test_the_robot_climbs_from_end_to_end(tmp_path: Path) -> None:
    climbs_and_replays(at_an_end(0, 1), ROBOT, tmp_path / "log.mcap")


def test_the_robot_climbs_from_grip_to_grip(tmp_path: Path) -> None:
    """About 10 s: a move by runtime and physics, and its replay."""
    climbs_and_replays(in_part(), ROBOT, tmp_path / "log.mcap")
