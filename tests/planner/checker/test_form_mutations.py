"""Start, goal, form and identity: each constraint, broken by a known amount in the plan made by hand, is reported with
its name, limb, time and amount.
"""

import numpy as np
import pytest
from crux_contracts.robot import load_robot
from crux_msgs import plan_t
from crux_planner.checker import check_plan

from . import synthetic
from .broken import DT, LR, RF, add, broken, only, the

ROBOT = load_robot("scaler")
LAST = synthetic.N_KNOTS - 1


# ---- start and goal


def test_start_elsewhere() -> None:
    def change(plan: plan_t) -> None:
        plan.scenario_yaml = plan.scenario_yaml.replace(
            "position_m: [0.0, 0.0, 0.185]", "position_m: [0.0, 0.003, 0.185]"
        )

    assert the(broken(change), "start_position", None, None, 0).amount == pytest.approx(0.003)


def test_start_turned() -> None:
    def change(plan: plan_t) -> None:
        plan.scenario_yaml = plan.scenario_yaml.replace(
            "0.185], rpy_deg: [0, 0, 0]}\n  grasps: {LF", "0.185], rpy_deg: [0, 0, 2]}\n  grasps: {LF"
        )

    assert the(broken(change), "start_orientation", None, None, 0).amount == pytest.approx(np.deg2rad(2.0))


def test_start_in_motion() -> None:
    found = the(broken(lambda p: add(p.knots[0], "body_velocity_w_m_s", 0, 0.01)), "start_at_rest", None, None, 0)
    assert found.amount == pytest.approx(0.01)


def test_start_grasp_by_other_faces() -> None:
    def change(plan: plan_t) -> None:
        plan.scenario_yaml = plan.scenario_yaml.replace("LR: {hold: c, faces: x}", "LR: {hold: c, faces: y}")

    assert "'c' by faces y" in the(broken(change), "start_grasp", LR, None, 0).detail


def test_goal_missed() -> None:
    def change(plan: plan_t) -> None:
        plan.scenario_yaml = plan.scenario_yaml.replace("position_m: [0.02, 0.0", "position_m: [0.02, 0.012")

    assert the(broken(change), "goal_position", None, None, LAST).amount == pytest.approx(0.012 - 0.005)


def test_goal_orientation_missed() -> None:
    def change(plan: plan_t) -> None:
        plan.scenario_yaml = plan.scenario_yaml.replace("rpy_deg: [0, 0, 0], tol", "rpy_deg: [0, 0, 5], tol")

    assert the(broken(change), "goal_orientation", None, None, LAST).amount == pytest.approx(np.deg2rad(2.0))


def test_goal_grasp_missed() -> None:
    def change(plan: plan_t) -> None:
        plan.scenario_yaml = plan.scenario_yaml.replace("grasps: {RF: {hold: e", "grasps: {RF: {hold: b")

    assert "'b'" in the(broken(change), "goal_grasp", RF, None, LAST).detail


# ---- form and identity


@pytest.mark.parametrize("value", [float("nan"), float("inf")])
def test_numbers_that_are_not_finite(value: float) -> None:
    def change(plan: plan_t) -> None:
        values = list(plan.knots[6].limbs[LR].finger_force_w_n)
        values[4] = value
        plan.knots[6].limbs[LR].finger_force_w_n = values

    report = broken(change)
    found = the(report, "finite_numbers", LR, None, 6)
    assert "finger_force" in found.detail
    assert len(report.violations) == 1


def test_clock_that_is_not_even() -> None:
    def change(plan: plan_t) -> None:
        plan.knots[4].time_s += 0.3

    found = only(broken(change), "time_stamps")
    assert len(found) == 1
    assert found[0].time_s == pytest.approx(4 * DT + 0.3)
    assert found[0].amount == pytest.approx(0.3)


@pytest.mark.parametrize(
    "change",
    [
        lambda p: setattr(p, "gravity_w_m_s2", [0.0, 0.0, -9.81]),
        lambda p: setattr(p, "patch_k_m", 0.02),
        lambda p: setattr(p, "spine_shear_n", 50.0),
        lambda p: setattr(p, "goal_tolerance_m", 1.0),
        lambda p: setattr(p.holds[3], "size_m", [0.06, 0.06, 0.05]),
        lambda p: setattr(p.holds[3], "position_w_m", [-0.15, -0.36, 0.0]),
        lambda p: setattr(p.holds[3], "friction", [3.0] * 5),
        lambda p: setattr(p.holds[3], "name", "z"),
        lambda p: setattr(p, "scenario_name", "another"),
    ],
)
def test_copies_that_differ_from_the_scenario(change: object) -> None:
    assert callable(change)
    assert only(broken(change), "scenario_match")


def test_scenario_that_cannot_be_read() -> None:
    def change(plan: plan_t) -> None:
        plan.scenario_yaml = "version: 1\n"

    assert the(broken(change), "scenario", None, None, None).detail


def test_hashes() -> None:
    plan = synthetic.make_plan()
    plan.cost = 1.0
    assert [v.constraint for v in check_plan(plan, ROBOT).violations] == ["plan_id"]
    plan = synthetic.sign(plan)
    plan.robot_sha256, plan.scenario_sha256, plan.plan_id = "0" * 64, "1" * 64, ""
    assert [v.constraint for v in check_plan(plan, ROBOT).violations] == ["robot_hash", "scenario_hash"]


def test_wrong_format_and_sizes() -> None:
    plan = synthetic.make_plan()
    plan.format = 5
    assert "plan_format" in [v.constraint for v in check_plan(plan, ROBOT).violations]
    plan = synthetic.make_plan()
    plan.n_knots += 1
    assert "plan_format" in [v.constraint for v in check_plan(plan, ROBOT).violations]
    plan = synthetic.make_plan()
    plan.knots[3].limbs[0].finger_force_w_n = [0.0] * 5
    assert {v.constraint for v in check_plan(plan, ROBOT).violations} == {"plan_format"}
    plan = synthetic.make_plan()
    plan.knots[3].limbs[0].phase = 7
    assert "phase 7" in only(check_plan(synthetic.sign(plan), ROBOT), "plan_format")[0].detail
