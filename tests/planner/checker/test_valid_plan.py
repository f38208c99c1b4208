"""The plan made by hand passes, on every slope, and quickly."""

import time

import numpy as np
import pytest
from crux_contracts.robot import load_robot
from crux_planner.checker import check_plan

from . import synthetic

ROBOT = load_robot("scaler")


@pytest.mark.parametrize("slope_deg", [0.0, 30.0, 45.0, 70.0, 90.0])
def test_a_balanced_plan_passes(slope_deg: float) -> None:
    report = check_plan(synthetic.make_plan(slope_deg), ROBOT)
    assert report.violations == []
    assert report.ok


def test_every_constraint_was_looked_at() -> None:
    report = check_plan(synthetic.make_plan(), ROBOT)
    names = {entry.constraint for entry in report.worst}
    assert names >= {
        *("limit_surface", "normal_force_min", "normal_force_max", "contact_moment", "equal_shear", "equal_twist"),
        *("force_balance", "moment_balance", "position_step", "orientation_step"),
        *("equilibrium_between_knots", "limit_surface_between_knots", "air_force_between_knots"),
        *("inverse_kinematics", "inverse_kinematics_orientation", "joint_position", "joint_speed", "joint_torque"),
        *("contact_face", "contact_patch", "pad_height", "finger_axis", "contact_motion", "air_force", "air_moment"),
        *("clearance_finger", "clearance_palm", "clearance_link", "clearance_body", "clearance_wall"),
        *("body_height", "body_tilt", "body_speed", "body_rate", "finger_opening", "gripper_yaw"),
        *("swing_height", "swing_speed", "swing_yaw_rate", "start_position", "goal_position", "goal_grasp"),
        *("plan_id", "robot_hash", "scenario_hash", "scenario_match", "time_stamps", "clearance_limbs"),
    }


def test_the_report_lists_every_joint_with_its_limits() -> None:
    report = check_plan(synthetic.make_plan(), ROBOT)
    assert [joint.joint for joint in report.joints] == [
        f"{limb}_joint{j}" for limb in ("LF", "RF", "LR", "RR") for j in range(1, 7)
    ]
    for joint in report.joints:
        assert 0.0 <= joint.rms_torque_Nm <= joint.peak_torque_Nm < joint.effort_limit_Nm


@pytest.mark.alone
def test_the_cold_budget_of_planning_is_spared() -> None:
    """Processor time, so that a busy machine does not matter."""
    plan, spent = synthetic.make_plan(), []
    for _ in range(3):
        began = time.process_time()
        check_plan(plan, ROBOT)
        spent.append(time.process_time() - began)
    assert min(spent) < 0.5


@pytest.mark.parametrize(("quarter_turns", "face"), [(0, 0), (2, 1), (-1, 2), (1, 3)])
def test_a_grasp_by_any_face_of_a_turned_hold(quarter_turns: int, face: int) -> None:
    """The same grasps with the holds turned by quarters: finger 1 is on +x, -x, +y or -y."""
    plan = synthetic.make_plan()
    yaw = synthetic.YAW_RAD + quarter_turns * np.pi / 2
    plan.scenario_yaml = synthetic.scenario_yaml(45.0, yaw, "x" if face < 2 else "y")
    for hold in plan.holds:
        hold.yaw_rad = yaw
    for knot in plan.knots:
        for limb in knot.limbs:
            limb.finger1_face = face if limb.hold >= 0 else -1
    assert check_plan(synthetic.sign(plan), ROBOT).violations == []
