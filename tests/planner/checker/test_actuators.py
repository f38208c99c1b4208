"""Limits of actuators: broken by a known amount in the plan made by hand, whatever the joints' own limits are."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from crux_contracts.robot import Robot, load_robot
from crux_msgs.robot_keys import Transmissions
from crux_planner.checker import check_plan
from crux_planner.checker.report import CheckReport, Violation

from .broken import VALID

RATIO, BELT, OFFSET_RAD, NONE = -2.0, 0.5, 0.25, 1e9
JOINT, OTHER = 2, 1  # the elbow's actuator, which turns with the joint before, too


def with_limit(**limits: float) -> Robot:
    """The shipped robot with a gear and a belt at its elbows, whose actuators have these limits."""
    each = {"ratio": 1.0, "offset_rad": 0.0, "coupled_to": 0.0, "coupling": 0.0}
    of_elbow = {"ratio": RATIO, "offset_rad": OFFSET_RAD, "coupled_to": OTHER + 1.0, "coupling": BELT} | limits
    each |= dict.fromkeys(limits, NONE) | {"low_rad": -12.0, "high_rad": 12.0}
    keys = {
        key: tuple(of_elbow.get(key, value) if j == JOINT else value for j in range(7)) for key, value in each.items()
    }
    return replace(load_robot("scaler"), transmissions=Transmissions(**keys))


def of_actuators(report: CheckReport) -> list[Violation]:
    return [each for each in report.worst if each.constraint.startswith("actuator_")]


PLAIN, WIDE = check_plan(VALID, load_robot("scaler")), check_plan(VALID, with_limit())


def test_without_limits_of_their_own_actuators_break_none() -> None:
    assert not PLAIN.actuators
    assert {each.constraint for each in of_actuators(WIDE)} == {
        "actuator_position", "actuator_speed", "actuator_torque", "actuator_torque_shared"
    }  # fmt: skip
    assert max(each.amount for each in of_actuators(WIDE)) < 0.0


def test_torques_are_those_that_make_the_joints() -> None:
    """The elbow's actuator bears its joint's torque over the ratio, and the joint before less by the belt's pull."""
    joints = {load.joint: load for load in WIDE.joints}
    for load in WIDE.actuators:
        joint = joints[load.joint.removesuffix(" (actuator)")]
        if joint.joint.endswith("joint3"):
            assert load.peak_torque_Nm == pytest.approx(joint.peak_torque_Nm / abs(RATIO))
        elif not joint.joint.endswith("joint2"):
            assert load.peak_torque_Nm == pytest.approx(joint.peak_torque_Nm)
            assert load.peak_speed_rad_s == pytest.approx(joint.peak_speed_rad_s)


@pytest.mark.parametrize(("key", "constraint"), [
    ("torque_Nm", "actuator_torque"), ("speed_rad_s", "actuator_speed"),
])  # fmt: skip
def test_a_peak_beyond_an_actuators_limit_is_told(key: str, constraint: str) -> None:
    field = {"torque_Nm": "peak_torque_Nm", "speed_rad_s": "peak_speed_rad_s"}[key]
    elbows = [load for load in WIDE.actuators if "joint3" in load.joint]
    peak = max(getattr(load, field) for load in elbows)
    report = check_plan(VALID, with_limit(**{key: 0.6 * peak}))
    found = [each for each in report.violations if each.constraint == constraint]
    assert all(each.detail.endswith("joint3 (actuator)") for each in found)
    assert max(each.amount for each in found) == pytest.approx(0.4 * peak, rel=1e-6)


def test_an_angle_beyond_an_actuators_limit_is_told() -> None:
    """That the joints keep their own limits does not help."""
    least = -next(each for each in of_actuators(WIDE) if each.constraint == "actuator_position").amount
    assert least > 0.5
    report = check_plan(VALID, with_limit(low_rad=-1.0))
    found = next(each for each in report.violations if each.constraint == "actuator_position")
    assert found.detail.endswith("joint3 (actuator)")
    assert not [each for each in report.violations if each.constraint == "joint_position"]
    assert 0.0 < found.amount < 2 * 2.75 + 0.5 * 2.0
    assert np.isfinite(found.amount)
