"""Grips at an angle: grippers turned about their opening axis, off their hold's z, so that both pads stay flat."""

from __future__ import annotations

from functools import cache
from pathlib import Path
from typing import Any

import crux_planner
import mujoco
import numpy as np
import pytest
from climbs import climbs_and_replays
from crux_contracts.robot import load_robot
from crux_contracts.scenario import Grip, Hold, ScenarioError, parse_scenario
from crux_msgs import plan_t
from crux_planner.checker.limit_surface import finger_loads
from crux_planner.checker.plan_arrays import read_plan
from crux_planner.checker.report import Findings
from crux_planner.errors import InfeasibleError
from crux_planner.model.build import MOST_FRICTION, build_problem, wall_contacts
from crux_planner.model.faces import Faces
from crux_planner.pipeline.message import PlanResult
from crux_simulation.wall.edit.ghost import Ghost
from crux_tools.robot3d.robot_model import build_model
from crux_tools.robot3d.start_pose import RobotPose, take_pose
from crux_tools.telemetry.margins import planned_grip
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.optimize import linprog
from scipy.spatial.transform import Rotation
from turned import changed_violations, turned

ROBOT = load_robot("scaler")
START, GOAL = "left-front-low", "left-front-high"
LF = 0


def wall(start: list[float], goal: list[float], roll_deg: float = 0.0, faces: str = "x") -> dict[str, Any]:
    """One move on a vertical wall, from a hold gripped at one of some angles to another, by faces that are 60 mm apart
    and as wide.
    """
    scene = turned(roll_deg)
    for hold in scene["holds"]:
        if roll_deg == 0.0:
            hold["pose"]["position_m"][2] = 0.0
        for name, angles in ((START, start), (GOAL, goal)):
            if hold["name"] == name:
                hold["grips"] = [{"faces": faces, "tilt_deg": angle} for angle in angles]
    return scene


def hold_of(scene: dict[str, Any], name: str) -> dict[str, Any]:
    return next(hold for hold in scene["holds"] if hold["name"] == name)


@cache
def planned(start_deg: float, goal_deg: float, roll_deg: float = 0.0) -> PlanResult:
    return crux_planner.plan(wall([start_deg], [goal_deg], roll_deg), ROBOT)


@pytest.mark.parametrize("faces", ["x", "y"])
@pytest.mark.parametrize("angle_deg", [-25.0, 15.0])
def test_a_gripper_is_turned_about_its_opening_axis(faces: str, angle_deg: float) -> None:
    """About the plus way of its faces, by the right hand, whichever finger is on which face, on a turned hold too."""
    scenario = parse_scenario(wall([0.0], [angle_deg], 20.0, faces))
    contacts, _ = wall_contacts(scenario, ROBOT, off_centre=True)
    index = scenario.hold_index(GOAL)
    mine = [contact for contact in contacts if contact.hold == index]
    assert len(mine) > 0
    body = scenario.holds[index]
    of_hold = Rotation.from_euler("ZYX", [body.yaw_rad, *body.tilt_rad[::-1]])
    about = of_hold.apply([1.0, 0.0, 0.0] if faces == "x" else [0.0, 1.0, 0.0])
    up = Rotation.from_rotvec(np.radians(angle_deg) * about).apply(of_hold.apply([0.0, 0.0, 1.0]))
    for contact in mine:
        assert contact.up == pytest.approx(up, abs=1e-9)
        assert contact.axis == pytest.approx(about * (1.0 if contact.finger1_face % 2 == 0 else -1.0), abs=1e-9)


@pytest.mark.parametrize(("angles", "roll_deg"), [((0.0, 15.0), 0.0), ((-20.0, 40.0), 0.0), ((15.0, -30.0), 20.0)])
def test_pads_of_the_robot_are_on_the_faces(angles: tuple[float, float], roll_deg: float) -> None:
    """As MuJoCo has the robot in the plan's first and last pose."""
    found = planned(*angles, roll_deg)
    assert found.check.violations == []
    robot = build_model(ROBOT, found.plan)
    data = mujoco.MjData(robot.model)
    for knot, name, angle in zip((0, -1), (START, GOAL), angles, strict=True):
        assert take_pose(robot, data, RobotPose.of_knot(found.plan.knots[knot], robot)) == []
        mujoco.mj_kinematics(robot.model, data)
        body = next(hold for hold in found.plan.holds if hold.name == name)
        turn = Rotation.from_euler("ZYX", [body.yaw_rad, *body.tilt_rad[::-1]]).inv()
        pads = turn.apply(data.geom_xpos[robot.pad_geoms[2 * LF : 2 * LF + 2]] - body.position_w_m)
        off = 0.03 + ROBOT.gripper.pad_radius_m
        assert sorted(pads[:, 0]) == pytest.approx([-off, off], abs=1e-4)
        assert pads[:, 1:] == pytest.approx(np.tile([0.0, 0.035], (2, 1)), abs=1e-4)
        up = turn.apply(data.body("LF_gripper").xmat.reshape(3, 3)[:, 2])
        assert up == pytest.approx([0.0, -np.sin(np.radians(angle)), np.cos(np.radians(angle))], abs=1e-3)


def test_the_checker_refuses_other_angles() -> None:
    plan = planned(0.0, 15.0).plan
    assert changed_violations(plan, ROBOT, lambda _plan: None) == set()
    for other in ("tilt_deg: 15.2", "tilt_deg: -15.0", "tilt_deg: 0.0"):
        assert changed_violations(plan, ROBOT, lambda _plan: None, "tilt_deg: 15.0", other) == {"finger_axis"}

    def square(plan: plan_t) -> None:
        for limb in (limb for knot in plan.knots for limb in knot.limbs if limb.hold >= 0):
            limb.gripper_tilt_w_rad = [0.0, 0.0]

    assert "finger_axis" in changed_violations(plan, ROBOT, square)


@pytest.mark.parametrize(("angles", "roll_deg"), [((0.0, 0.0), 20.0), ((-20.0, 40.0), 0.0)])
def test_margins_of_plans_are_those_of_the_checker(angles: tuple[float, float], roll_deg: float) -> None:
    """Spines hold so much along each way of the gripper, which is neither the wall's nor, at an angle, the hold's. What
    is planned keeps its reserve in friction there.
    """
    plan = planned(*angles, roll_deg).plan
    arrays = read_plan(plan, Findings(), ROBOT.gripper.pad_radius_m)
    assert arrays is not None
    loads = finger_loads(arrays, 0.6)
    beyond = loads.excess(loads.shear_N, loads.twist_Nm, loads.normal_N, ..., arrays.patch_k_m)
    seen = planned_grip(plan)
    assert -seen.margin_n[arrays.gripped] == pytest.approx(beyond[arrays.gripped], abs=1e-9)
    assert np.nanmax(seen.used) < MOST_FRICTION + 0.01


def test_the_search_takes_an_angle_that_is_free() -> None:
    """An eave is over the middle of the goal's hold, 25 mm off it: a palm has no space there."""

    def under_an_eave(angles: list[float]) -> dict[str, Any]:
        scene = wall(angles, angles)
        x, y, _ = hold_of(scene, GOAL)["pose"]["position_m"]
        place = {"position_m": [x, y + 0.038, 0.085]}
        scene["obstacles"] = [{"name": "eave", "pose": place, "shape": {"box_m": [0.06, 0.06, 0.03]}}]
        return scene

    with pytest.raises(
        InfeasibleError, match="left-front-high cannot be gripped by faces x: its neighbours leave 0 mm"
    ):
        crux_planner.plan(under_an_eave([0.0]), ROBOT)
    found = crux_planner.plan(under_an_eave([0.0, 40.0]), ROBOT)
    assert found.check.violations == []
    assert np.degrees(found.plan.knots[-1].limbs[LF].gripper_tilt_w_rad) == pytest.approx([40.0, 0.0])


def steep(angles: list[float]) -> dict[str, Any]:
    """The goal's hold has its top 60 degrees out of the wall's plane, away from the robot."""
    scene = wall([0.0], angles)
    hold_of(scene, GOAL)["pose"]["rpy_deg"] = [60, 0, 0]
    hold_of(scene, GOAL)["pose"]["position_m"][2] = 0.03
    return scene


def test_a_limb_grips_at_an_angle_what_it_cannot_reach_square(tmp_path: Path) -> None:
    """About 10 s: a move by runtime and physics, and its replay."""
    found = crux_planner.plan(steep([0.0, -20.0, -40.0]), ROBOT)
    last = found.plan.knots[-1].limbs[LF]
    assert found.plan.holds[last.hold].name == GOAL
    assert min(abs(np.degrees(last.gripper_tilt_w_rad[0]) - angle) for angle in (20.0, 40.0)) < 1e-6
    climbs_and_replays(found, ROBOT, tmp_path / "log.mcap")


def test_the_robot_climbs_from_angle_to_angle(tmp_path: Path) -> None:
    """About 10 s: a move by runtime and physics, and its replay."""
    climbs_and_replays(planned(-20.0, 40.0), ROBOT, tmp_path / "log.mcap")


def test_a_plan_from_a_stance_begins_at_the_angle_that_is_held() -> None:
    found = crux_planner.plan(wall([0.0], [-20.0, 0.0, 20.0]), ROBOT)
    last = found.plan.knots[-1].limbs[LF]
    angle = float(np.degrees(last.gripper_tilt_w_rad[0]))
    there = crux_planner.scenario_at(parse_scenario(found.plan.scenario_yaml), found.plan, len(found.plan.knots) - 1)
    assert there.start.grasps["LF"].grip == [-20.0, 0.0, 20.0].index(round(angle, 6))


@pytest.mark.parametrize("angle_deg", [44.0, -44.0])
def test_a_palm_that_would_be_in_the_hold_is_refused(angle_deg: float) -> None:
    """A hold 200 mm wide and 80 mm high, its pads 45 mm off the foot: by hand, the lower edge of a palm of 24 mm 50 mm
    above them ends at 45 + 50 cos 44 - 12 sin 44 = 72.6 mm, 7.4 mm under the top.
    """
    scene = wall([0.0], [angle_deg])
    goal = hold_of(scene, GOAL)
    goal["shape"]["box_m"] = [0.06, 0.2, 0.08]
    goal["grips"][0]["height_m"] = 0.045
    why = r"grips\[0\].*: at -?44 degrees the palm is 7.4 mm in the hold, it needs 10 mm"
    with pytest.raises(ScenarioError, match=why):
        crux_planner.plan(scene, ROBOT)


def test_angles_that_make_no_sense_are_refused() -> None:
    with pytest.raises(ScenarioError, match=r"grips\[0\].tilt_deg: 46.0: expected a number in -45..45"):
        parse_scenario(wall([0.0], [46.0]))
    scene = wall([0.0], [10.0])
    hold_of(scene, GOAL)["shape"] = {"box_m": [0.09, 0.06, 0.06], "lean_deg": {"+x": 30}}
    with pytest.raises(ScenarioError, match="left-front-high has a tilt_deg on faces x, which lean"):
        parse_scenario(scene)
    hold_of(scene, GOAL)["shape"]["lean_deg"] = {"+y": 30}
    parse_scenario(scene)
    for unsure in ({"hold_position_m": 0.002}, {"hold_yaw_deg": 2.0}):
        with pytest.raises(ScenarioError, match=r"uncertainty: .*left-front-high has a grip at an angle"):
            crux_planner.plan(wall([0.0], [10.0]) | {"uncertainty": unsure}, ROBOT)


def test_plans_at_an_angle_hold_for_uncertain_friction_and_mass() -> None:
    unsure = {"friction": 0.1, "mass_kg": 0.3, "centre_of_mass_m": 0.01}
    found = crux_planner.plan(wall([-20.0], [30.0]) | {"uncertainty": unsure}, ROBOT)
    assert found.check.violations == []
    assert found.plan.knots[-1].limbs[LF].friction == pytest.approx(0.9 * 2.2)
    assert "limit_surface_uncertain" in changed_violations(
        found.plan, ROBOT, lambda _plan: None, "friction: 0.1", "friction: 0.4"
    )


def test_no_proof_is_about_a_wall_with_grips_at_an_angle() -> None:
    """Proofs, and bounds of the cost, know grippers along their hold's z alone."""
    square, at_angle = (wall([0.0], [angle]) | {"obstacles": []} for angle in (0.0, 10.0))
    assert build_problem(parse_scenario(square), ROBOT).upright
    assert not build_problem(parse_scenario(at_angle), ROBOT).upright
    assert crux_planner.plan(at_angle, ROBOT).gap is None


def test_the_checker_has_no_word_for_uncertain_grips_at_an_angle() -> None:
    plan, more = planned(0.0, 15.0).plan, "version: 2\nuncertainty: {hold_position_m: 0.0001}"
    assert "limit_surface_uncertain" in changed_violations(plan, ROBOT, lambda _plan: None, "version: 2", more)


@pytest.mark.parametrize("finger1", [0.0, 180.0])
@pytest.mark.parametrize("faces", ["x", "y"])
def test_the_sketch_shows_the_hand_at_its_angle(faces: str, finger1: float) -> None:
    """The editor's robot, its body turned or not, so that either finger is on either face."""
    scene, heading = wall([0.0], [20.0], 0.0, faces), np.radians(finger1)
    scenario, hold = parse_scenario(scene), hold_of(scene, GOAL)
    x, y, _ = hold["pose"]["position_m"]
    body = {"name": GOAL, "obstacle": False, "position_m": [x, y], "size_m": [0.06] * 3, "yaw_deg": 0.0, "lean_deg": {}}
    c, s = np.cos(heading), np.sin(heading)
    place = [x - 0.14 * c + 0.36 * s, y - 0.14 * s - 0.36 * c, 0.185]
    standing = {"position_m": place, "rpy_deg": [0.0, 0.0, finger1]}
    found = Ghost(ROBOT, scenario).stand(
        [body | {"grips": hold["grips"]}], standing, {"LF": {"hold": GOAL, "faces": faces}}
    )
    model = build_model(ROBOT, planned(0.0, 15.0).plan).model
    number = np.flatnonzero(model.body_weldid != 0).tolist().index(model.body("LF_gripper").id)
    at, quaternion = found[7 * number : 7 * number + 3], found[7 * number + 3 : 7 * number + 7]
    assert at == pytest.approx([x, y, 0.035], abs=1e-4)
    about = Rotation.from_euler(faces, 20.0, degrees=True)
    up = Rotation.from_quat(quaternion, scalar_first=True).apply([0.0, 0.0, 1.0])
    assert up == pytest.approx(about.apply([0.0, 0.0, 1.0]), abs=1e-3)


@settings(max_examples=150, deadline=None)
@given(
    st.sampled_from("xy"), st.floats(-45.0, 45.0), st.floats(0.0, 30.0), st.floats(0.0, 30.0), st.floats(-0.05, 0.05)
)
def test_a_palm_is_in_the_hold_where_both_share_a_point(
    faces: str, angle: float, plus_deg: float, minus_deg: float, aside_m: float
) -> None:
    """Against linear programming over points along the hold's axes, in the palm and within the hold's sides and top."""
    other = "y" if faces == "x" else "x"
    lean_deg = tuple(
        {f"+{other}": plus_deg, f"-{other}": minus_deg}.get(face, 0.0) for face in ("+x", "-x", "+y", "-y")
    )
    size_m = (0.06, 0.12, 0.085) if faces == "x" else (0.12, 0.06, 0.085)
    grip = Grip(faces, aside_m, 0.045, tilt_deg=angle or 1.0)
    hold = Hold("hold", (0.0, 0.0), size_m, lean_deg=lean_deg, grips=(grip,))
    pair = "xy".index(faces)
    at = Faces.of(hold, pair, ROBOT, 0.02, grip)
    assert at is not None
    gap_m = at.palm_gap_m(hold, pair, grip, ROBOT)
    about, middle = np.eye(3)[pair], aside_m * np.eye(3)[1 - pair] + [0.0, 0.0, 0.045]
    turn = Rotation.from_rotvec(grip.tilt_rad * about)
    up, across = turn.apply([0.0, 0.0, 1.0]), turn.apply(np.cross([0.0, 0.0, 1.0], about))
    rows, most = [np.array([0.0, 0.0, 1.0]), np.array([0.0, 0.0, -1.0])], [0.085, 0.0]
    for sign, lean in ((1.0, plus_deg), (-1.0, minus_deg)):
        rows.append(np.cos(np.radians(lean)) * sign * np.eye(3)[1 - pair] + [0.0, 0.0, np.sin(np.radians(lean))])
        most.append(np.cos(np.radians(lean)) * 0.06)
    for way, off_m in ((-up, -ROBOT.gripper.finger_height_m), (across, ROBOT.gripper.pad_radius_m)):
        rows.append(way)
        most.append(off_m + way @ middle)
    rows.append(-across)
    most.append(ROBOT.gripper.pad_radius_m - across @ middle)
    shared = linprog(np.zeros(3), np.array(rows), np.array(most), bounds=(None, None)).status == 0
    assert shared == (gap_m < 0.0) or abs(gap_m) < 1e-6
