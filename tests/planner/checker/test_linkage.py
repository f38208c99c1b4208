"""The checker's five-bar: against the contracts' code, against work, and broken by a known amount in the plan made by
hand.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from crux_contracts.five_bar import FiveBar
from crux_contracts.robot import Robot, load_robot
from crux_contracts.transmissions import Transmission
from crux_msgs.robot_keys import FiveBar as Keys
from crux_msgs.robot_keys import Transmissions
from crux_planner.checker import check_plan
from crux_planner.checker.linkage import Linkage
from crux_planner.checker.report import CheckReport, Violation

from .broken import VALID

KEYS = Keys(
    first_joint=2.0, crank_y_m=0.038, crank_m=0.15, rod_m=0.188, pin_x_m=0.177, pin_y_m=-0.046, bends=-1.0,
    least_sine=0.1,
)  # fmt: skip
MIDDLE_RAD = np.array([0.4, 1.5])  # of the shipped robot's ranges
ROBOT = load_robot("scaler")
LINKAGE = Linkage(KEYS, 1, 0.15, -1.0, MIDDLE_RAD)
BAR = FiveBar(KEYS, 0.15, -1.0, MIDDLE_RAD)
NONE = 1e9


def drawn_rad() -> np.ndarray:
    return np.random.default_rng(5).uniform([-0.6, 0.7], [1.9, 2.6], (200, 2))


def with_bar(least_sine: float = 0.1, **of_crank: float) -> Robot:
    """The shipped robot with a five-bar, whose crank's actuator has these limits."""
    each = {"speed_rad_s": 1e6, "torque_Nm": 1e6, "low_rad": -12.0, "high_rad": 12.0}
    keys = {key: tuple(of_crank.get(key, value) if j == 2 else value for j in range(7)) for key, value in each.items()}
    return replace(ROBOT, transmissions=Transmissions(**keys), five_bar=replace(KEYS, least_sine=least_sine))


def violation(report: CheckReport, constraint: str) -> Violation:
    return next(each for each in report.worst if each.constraint == constraint)


def test_cranks_sines_and_torques_are_the_contracts() -> None:
    q, by = drawn_rad(), Transmission(np.eye(4), np.zeros(4), BAR)
    np.testing.assert_allclose(LINKAGE.crank_rad(q), BAR.crank_rad(q), atol=1e-12)
    np.testing.assert_allclose(LINKAGE.sine(q), BAR.sine(q), atol=1e-12)
    joints_Nm = np.random.default_rng(6).uniform(-5, 5, (len(q), 2))
    padded = [np.pad(values, ((0, 0), (1, 1))) for values in (q, joints_Nm)]
    np.testing.assert_allclose(LINKAGE.torques_Nm(q, joints_Nm), by.actuator_torque_Nm(*padded)[:, 1:3], atol=1e-10)


def test_torques_do_the_joints_work() -> None:
    q, step = drawn_rad(), 1e-6
    joints_Nm, ways = np.random.default_rng(7).uniform(-5, 5, (2, len(q), 2))
    moved = np.stack(
        [ways[:, 0], (LINKAGE.crank_rad(q + step * ways) - LINKAGE.crank_rad(q - step * ways)) / (2 * step)]
    )
    worked = (LINKAGE.torques_Nm(q, joints_Nm) * moved.T).sum(axis=1)
    np.testing.assert_allclose(worked, (joints_Nm * ways).sum(axis=1), atol=1e-6)


def test_a_rod_that_does_not_reach_is_told() -> None:
    short = replace(LINKAGE, bar=replace(KEYS, rod_m=0.02))
    assert np.isnan(short.crank_rad(drawn_rad())).any()
    robot = with_bar()
    report = check_plan(VALID, replace(robot, five_bar=replace(robot.five_bar, rod_m=0.02)))
    assert violation(report, "linkage_singular").amount >= NONE
    assert not report.ok


def test_what_is_nearer_to_singular_than_it_may_be_is_told() -> None:
    wide = violation(check_plan(VALID, with_bar()), "linkage_singular")
    least = 0.1 - wide.amount
    assert 0.3 < least < 1.0
    tight = violation(check_plan(VALID, with_bar(least_sine=least + 0.01)), "linkage_singular")
    assert tight.amount == pytest.approx(0.01)
    assert tight in check_plan(VALID, with_bar(least_sine=least + 0.01)).violations


@pytest.mark.parametrize(("key", "constraint", "field"), [
    ("torque_Nm", "actuator_torque", "peak_torque_Nm"), ("speed_rad_s", "actuator_speed", "peak_speed_rad_s"),
])  # fmt: skip
def test_a_peak_beyond_the_cranks_limit_is_told(key: str, constraint: str, field: str) -> None:
    wide = check_plan(VALID, with_bar())
    peak = max(getattr(load, field) for load in wide.actuators if "joint3" in load.joint)
    other = max(getattr(load, field) for load in wide.joints if "joint3" in load.joint)
    assert abs(peak - other) > 0.05 * other  # the linkage is no gear of 1
    found = violation(check_plan(VALID, with_bar(**{key: 0.6 * peak})), constraint)
    assert found.detail.endswith("joint3 (actuator)")
    assert found.amount == pytest.approx(0.4 * peak, rel=1e-6)


def test_an_angle_beyond_the_cranks_limit_is_told() -> None:
    slack = -violation(check_plan(VALID, with_bar(low_rad=-4.0)), "actuator_position").amount
    found = violation(check_plan(VALID, with_bar(low_rad=-4.0 + slack + 0.05)), "actuator_position")
    assert found.amount == pytest.approx(0.05)
    assert found.detail.endswith("joint3 (actuator)")
