"""Climbs over the edge of two bounded planes: planned, checked, and refused where a plane is elsewhere."""

from __future__ import annotations

import hashlib
from functools import cache

import crux_planner
import numpy as np
import pytest
import yaml
from at_pace import is_quick
from crux_contracts.plan_file import plan_id
from crux_contracts.robot import load_robot
from crux_contracts.scenario import ScenarioError, parse_scenario
from crux_msgs import plan_t
from crux_planner.checker import check_plan
from crux_planner.errors import HorizonError
from crux_planner.model.build import build_problem
from crux_planner.pipeline.explanation import check_clear
from crux_planner.pipeline.message import PlanResult
from crux_planner.pipeline.session import Session
from crux_tools.paths import ROOT
from edges import CHIMNEY, CONCAVE, CONVEX, chimney, edge, over_a_ledge
from shared_plans import unproven

ROBOT, WALLS = load_robot("scaler"), ROOT / "benchmarks" / "walls"
LF = 0


@cache
def planned(*given: float) -> PlanResult:
    return crux_planner.plan(edge(*given), ROBOT)


def violations(plan: plan_t, surface: int, shift_m: list[float], moved: list[str] | None = None) -> set[str]:
    """Of a plan whose scenario has a surface elsewhere; `moved` receives what is said."""
    plan = plan_t.decode(plan.encode())
    scene = yaml.safe_load(plan.scenario_yaml)
    pose = scene["surfaces"][surface]["rectangle"]["pose"]
    pose["position_m"] = [float(a + b) for a, b in zip(pose["position_m"], shift_m, strict=True)]
    plan.scenario_yaml = yaml.safe_dump(scene)
    plan.scenario_sha256 = hashlib.sha256(plan.scenario_yaml.encode()).hexdigest()
    plan.plan_id = plan_id(plan)
    found = check_plan(plan, ROBOT).violations
    if moved is not None:
        moved += [each.detail for each in found]
    return {violation.constraint for violation in found}


@pytest.mark.parametrize("given", [CONVEX, CONCAVE], ids=["convex", "concave"])
def test_the_front_limbs_go_over_the_edge(given: tuple[float, float, float]) -> None:
    result = planned(*given)
    assert result.check.ok
    assert result.gap is None  # bounds are about one endless wall
    first, last = (result.plan.knots[k].limbs[LF] for k in (0, -1))
    tilts = [np.degrees(limb.gripper_tilt_w_rad[1]) for limb in (first, last)]
    assert tilts == pytest.approx([-given[0], -given[1]], abs=1e-6)
    assert violations(result.plan, 1, [0.0, 0.0, 0.0]) == set()


@pytest.mark.parametrize("given", [CONVEX, CONCAVE], ids=["convex", "concave"])
def test_an_edge_is_climbed_in_less_time_where_that_is_asked(given: tuple[float, float, float]) -> None:
    assert is_quick(planned(*given), ROBOT)


@pytest.mark.parametrize("given", [CONVEX, CONCAVE], ids=["convex", "concave"])
def test_a_surface_is_in_the_way_where_it_is(given: tuple[float, float, float]) -> None:
    said: list[str] = []
    off = 0.03 * np.array([-np.sin(np.radians(given[1])), 0.0, np.cos(np.radians(given[1]))])
    found = violations(planned(*given).plan, 1, off.tolist(), said)
    assert {"clearance_finger"} <= found
    assert any("the surface upper" in each for each in said)


def test_below_the_edge_nothing_is_in_the_way_but_what_there_is() -> None:
    """Fingers on the falling plane are under z = 0 of W, which is no surface of this wall."""
    plan = planned(*CONVEX).plan
    assert plan.knots[-1].limbs[LF].gripper_position_w_m[2] < -0.004
    assert not any(name.startswith("clearance") for name in violations(plan, 0, [0.0, 0.0, -0.05]))


def test_limbs_hold_walls_that_face_each_other() -> None:
    """Left and right of a body that has nothing behind."""
    plan = crux_planner.plan(chimney(*CHIMNEY), ROBOT).plan
    tilts = np.degrees([limb.gripper_tilt_w_rad for knot in plan.knots for limb in knot.limbs if limb.hold >= 0])
    assert np.abs(tilts[:, 0]) == pytest.approx(90.0)
    assert check_plan(plan, ROBOT).ok
    highest_m = max(limb.gripper_position_w_m[2] for knot in plan.knots for limb in knot.limbs)
    assert highest_m > ROBOT.grasp.max_swing_height_m  # which is about swings over an endless plane


@pytest.mark.sweep
def test_where_motors_leave_a_level_body_no_path_one_that_tilts_has_it() -> None:
    """Start and goal are level, as the map that is asked first: with that alone J is 20.0."""
    wall = yaml.safe_load((WALLS / "edge-60.yaml").read_text(encoding="utf-8"))
    result = crux_planner.plan(wall, ROBOT)
    assert result.check.ok
    assert result.cost < 18.0


def test_the_trunk_keeps_off_a_ledge_until_it_is_beside_it() -> None:
    """The trunk reaches 0.15 m ahead and 0.03 m down; the ledge begins at x = 0.22 m."""
    plan = crux_planner.plan(over_a_ledge(), ROBOT).plan
    over = [knot.body_position_w_m[2] for knot in plan.knots if knot.body_position_w_m[0] + 0.15 > 0.225]
    assert len(over) > 2
    assert min(over) > 0.155 + 0.03
    assert plan.knots[-1].body_position_w_m[2] < ROBOT.body.height_m[0]  # which is about an endless plane
    assert violations(plan, 2, [0.0, 0.0, 0.0]) == set()


def test_a_trunk_that_would_start_in_a_surface_is_named() -> None:
    """30 mm of it are under the body's origin, and the ledge is 155 mm high."""
    wall = over_a_ledge()
    wall["start"]["body"]["position_m"][2] = 0.17
    with pytest.raises(ScenarioError, match=r"start\.body: .*: the trunk would be 15 mm inside ledge"):
        crux_planner.plan(wall, ROBOT)


@pytest.mark.parametrize(("height_m", "inside"), [(0.12, None), (0.09, 10)])
def test_a_low_body_is_over_low_obstacles_or_in_them(height_m: float, inside: int | None) -> None:
    """Where no surface is endless, nothing keeps trunk and links as high as palms, which are 85 mm over the plane."""
    wall = edge(0.0, 0.0)
    wall["obstacles"] = [{"name": "low", "pose": {"position_m": [0.0, 0.0, 0.0]}, "shape": {"box_m": [0.1, 0.1, 0.07]}}]
    wall["start"]["body"]["position_m"][2] = height_m
    scenario = parse_scenario(wall)
    problem = build_problem(scenario, ROBOT)
    if inside is None:
        check_clear(scenario, problem, ROBOT)
        return
    with pytest.raises(ScenarioError, match=rf"start\.body: .*: the trunk would be {inside} mm inside low"):
        check_clear(scenario, problem, ROBOT)


def test_the_papers_methods_are_about_one_endless_wall() -> None:
    with pytest.raises(ScenarioError, match=r"planner\.method: two_block: expected auto: left-"):
        crux_planner.plan(edge(*CONVEX), ROBOT, method="two_block")


@pytest.mark.parametrize("name", ["corner-90", pytest.param("ridge-60", marks=pytest.mark.sweep)])
def test_limbs_in_a_corner_keep_off_the_trunk_wherever_holds_are(name: str) -> None:
    """With holds off by as much as links otherwise keep off the trunk, and its start farther than boxes of reach go."""
    known = {"friction": 0.2, "hold_position_m": 0.005, "hold_yaw_deg": 3.0, "mass_kg": 0.5, "centre_of_mass_m": 0.01}
    wall = yaml.safe_load((WALLS / f"{name}.yaml").read_text(encoding="utf-8")) | {"uncertainty": known}
    result = unproven(parse_scenario(wall), ROBOT, time_limit_s=40.0)
    assert result.check.ok
    assert any(each.constraint.endswith("_uncertain") for each in result.check.worst)


def test_a_start_out_of_reach_where_holds_may_be_is_named() -> None:
    known = {"hold_position_m": 0.05, "hold_yaw_deg": 30.0}
    wall = yaml.safe_load((WALLS / "edge-90.yaml").read_text(encoding="utf-8")) | {"uncertainty": known}
    said = r"start\.grasps\.LR\.hold: left-0: out of reach within the joint limits where the hold is 50 mm"
    with pytest.raises(ScenarioError, match=said):
        crux_planner.plan(wall, ROBOT)


def test_a_palm_that_would_be_in_a_surface_is_named() -> None:
    wall = edge(*CONVEX)
    post = {"pose": {"position_m": [0.0, 0.42, 0.3], "rpy_deg": [90, 0, 0]}, "size_m": [1.0, 1.0], "depth_m": 0.1}
    wall["surfaces"].append({"name": "side", "rectangle": post})
    for limb, hold in (("LF", "left-2"), ("LR", "left-0")):
        wall["start"]["grasps"][limb] = {"hold": hold, "faces": "y"}
    with pytest.raises(ScenarioError, match=r"a finger or the palm would be -?\d+ mm off side, they need 3 mm"):
        crux_planner.plan(wall, ROBOT)


@pytest.mark.sweep
def test_over_an_edge_too_few_steps_are_said_with_how_many_are_enough() -> None:
    wall = edge(*CONVEX)
    wall["horizon"]["steps"] = 5
    with pytest.raises(HorizonError) as said:
        crux_planner.plan(wall, ROBOT)
    relaxed = said.value.relaxed
    assert relaxed is not None
    wall["horizon"]["steps"] = relaxed["amount"]
    assert crux_planner.plan(wall, ROBOT).check.ok


def test_where_time_runs_out_over_too_few_steps_these_are_said(monkeypatch: pytest.MonkeyPatch) -> None:
    """As on a machine so slow that one way is all that is looked at."""
    monkeypatch.setattr(Session, "late", property(lambda _session: True))
    with pytest.raises(HorizonError, match="5 steps are too few for 4 moves; allow at least 24"):
        crux_planner.plan(edge(*CONVEX) | {"horizon": {"steps": 5, "dt_s": 2.0}}, ROBOT)
