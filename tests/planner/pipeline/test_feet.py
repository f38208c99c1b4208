"""Climbs in which some limbs stand on footholds."""

from __future__ import annotations

import copy
from typing import Any

import crux_planner
import numpy as np
import pytest
from crux_contracts.robot import load_robot
from crux_contracts.scenario import Scenario, ScenarioError, load_scenario, parse_scenario
from crux_contracts.yaml_document import Node, parse_mapping
from crux_msgs import hold_t, limb_knot_t, plan_t
from crux_planner.checker import check_plan
from crux_planner.errors import InfeasibleError
from crux_planner.model.build import build_problem
from crux_planner.model.contacts import Contact
from crux_planner.model.kinematics import rotation_from_rpy
from crux_planner.pipeline.restart import with_objective
from crux_planner.pipeline.route import plan_route
from crux_planner.pipeline.wall_check import wall_offers
from crux_planner.search.equilibrium import StaticEquilibrium
from crux_tools.paths import ROOT
from shared_plans import SharedPlans, unproven

ROBOT = load_robot("scaler")
WALLS = ROOT / "benchmarks" / "walls"
SLOPE = load_scenario(WALLS / "feet-45.yaml")


def plain(node: Node) -> Any:
    if isinstance(node.content, dict):
        return {key: plain(member) for key, member in node.content.items()}
    return [plain(item) for item in node.content] if isinstance(node.content, list) else node.content


def slope(**changes: Any) -> Scenario:
    """The slope with other keys at its top."""
    document = plain(parse_mapping((WALLS / "feet-45.yaml").read_bytes(), "feet-45.yaml"))
    return parse_scenario(copy.deepcopy(document) | changes)


def stands(limb: limb_knot_t) -> bool:
    return bool(limb.finger1_face == limb.FACE_WALL)


def stood_on(scenario: Scenario) -> list[Contact]:
    return [contact for contact in build_problem(scenario, ROBOT).contacts if contact.foot]


def test_a_plan_where_no_limb_stands_is_as_without_footholds(planned: SharedPlans) -> None:
    goal = {"body": {"position_m": [0.01, 0, 0.185]}, "grasps": {"LF": {"hold": "left-2", "faces": "x"}}}
    holds = [
        *plain(parse_mapping((WALLS / "feet-45.yaml").read_bytes(), ""))["holds"],
        {"name": "right-0", "pose": {"position_m": [-0.14, -0.36, 0]}, "shape": {"box_m": [0.06] * 3}, "friction": 2.2},
    ]
    grasps = {limb: {"hold": hold, "faces": "x"} for limb, hold in
              (("LF", "left-1"), ("RF", "right-1"), ("LR", "left-0"), ("RR", "right-0"))}  # fmt: skip
    start = {"body": {"position_m": [0, 0, 0.185]}, "grasps": grasps}
    footholds = [{"name": "far", "position_m": [0.6, 0.0, 0.0]}]
    plan = planned(slope(holds=holds, start=start, goal=goal, footholds=footholds), ROBOT).plan
    assert plan.format == plan_t.FORMAT
    assert {hold.graspable for hold in plan.holds} == {hold_t.HOLD}


@pytest.mark.parametrize(("name", "surfaces"), [("feet-floor-wall", {"lower"}), ("feet-chimney", {"left", "right"})])
def test_feet_stand_on_bounded_surfaces(name: str, surfaces: set[str], planned: SharedPlans) -> None:
    scenario = load_scenario(WALLS / f"{name}.yaml")
    plan = planned(scenario, ROBOT).plan
    assert plan.format == plan_t.FORMAT_FEET
    stood_on = set()
    for foot in (limb for knot in plan.knots for limb in knot.limbs if stands(limb)):
        foothold = scenario.footholds[foot.hold - len(scenario.cuboids)]
        slab = next(slab for slab in scenario.wall.slabs if slab.name == foothold.surface)
        normal = rotation_from_rpy(np.array([*slab.tilt_rad, slab.yaw_rad]))[:, 2]
        pushed = np.array(foot.finger_force_w_n).reshape(2, 3).sum(axis=0)
        assert pushed @ normal > 0.0
        assert np.linalg.norm(pushed - pushed @ normal * normal) <= slab.friction * pushed @ normal
        assert foot.friction == slab.friction
        stood_on.add(slab.name)
    assert stood_on == surfaces


def test_feet_push_never_pull_and_bear_no_more_than_the_most_in_the_search() -> None:
    """Three of them, 9.6 kg and 54 N each: 90 % of what pads press."""
    for up_m_s2, stands in ((-9.81, True), (9.81, False), (-20.0, False)):
        problem = build_problem(slope(gravity_m_s2=[0.0, 0.0, up_m_s2]), ROBOT)
        equilibrium, at = StaticEquilibrium(problem, problem.friction_share), np.array([-0.07, 0.0, 0.185])
        feet = tuple(i for i, contact in enumerate(problem.contacts) if contact.foot)
        assert (equilibrium.position(feet, at, at, at) is not None) == stands


def test_pads_keep_on_their_surface_and_off_what_stands_beside_it() -> None:
    assert len(stood_on(SLOPE)) == 3
    block = {"name": "block", "pose": {"position_m": [-0.14, -0.36, 0]}, "shape": {"box_m": [0.14, 0.3, 0.03]}}
    with pytest.raises(ScenarioError, match="foot-right-0: fingers and palm have no space there"):
        build_problem(slope(obstacles=[block]), ROBOT)
    above = block | {"pose": {"position_m": [-0.02, -0.36, 0]}}
    with pytest.raises(InfeasibleError, match="no gripper can stand on foot-right-1"):
        build_problem(slope(obstacles=[above]), ROBOT)
    astride = block | {"shape": {"box_m": [0.14, 0.02, 0.03]}}
    turned = [contact for contact in stood_on(slope(obstacles=[astride])) if contact.hold == 6]
    assert [abs(contact.axis[1]) for contact in turned] == pytest.approx([1.0])


def test_a_foothold_out_of_reach_is_named() -> None:
    footholds = [{"name": f.name, "position_m": list(f.position_m)} for f in SLOPE.footholds]
    footholds[1]["position_m"] = [-0.5, -0.36, 0.0]
    with pytest.raises(ScenarioError, match=r"start.grasps.RR.foothold: foot-right-0: out of reach by \d+ mm"):
        unproven(slope(footholds=footholds), ROBOT)


def test_uncertainty_does_not_know_feet_yet() -> None:
    with pytest.raises(ScenarioError, match="uncertainty: is not supported yet where limbs may stand"):
        unproven(slope(uncertainty={"friction": 0.1}), ROBOT)


@pytest.mark.parametrize("name", ["feet-45", "feet-floor-wall", "feet-chimney"])
def test_a_climb_with_feet_takes_less_time_where_that_is_asked(name: str, planned: SharedPlans) -> None:
    """The checker agrees that accelerations are balanced by what grips and feet bear."""
    even = load_scenario(WALLS / f"{name}.yaml")
    quick = planned(with_objective(even, "time"), ROBOT)
    assert quick.plan.format == plan_t.FORMAT_FEET
    assert check_plan(quick.plan, ROBOT).ok
    assert quick.plan.knots[-1].time_s < 0.4 * even.horizon.dt_s * quick.steps
    assert not any(np.any(limb.finger_moment_w_nm) for knot in quick.plan.knots for limb in knot.limbs if stands(limb))


def test_other_methods_routes_planning_again_and_looks_at_walls_do_not_know_feet(planned: SharedPlans) -> None:
    with pytest.raises(ScenarioError, match="expected auto: limbs may stand on foot-left-1"):
        unproven(SLOPE, ROBOT, method="two_block")
    with pytest.raises(ScenarioError, match="routes are not supported"):
        next(plan_route(SLOPE, ROBOT))
    with pytest.raises(ScenarioError, match="planning again is not supported"):
        crux_planner.Planner(SLOPE, ROBOT).replan(planned(SLOPE, ROBOT).plan, 0.0)
    with pytest.raises(ScenarioError, match="a look at a wall where the start is on some"):
        wall_offers(SLOPE, ROBOT)
