"""Bodies slow enough that what they do between the knots stays within the limit surface."""

from __future__ import annotations

import crux_planner
import numpy as np
import pytest
from crux_contracts.robot import Robot
from crux_planner.checker import CheckReport, Violation
from crux_planner.search.calm import BETWEEN_KNOTS, slowed, speeds
from walls import scenario, two_rows


def report(*times_s: float, constraint: str = BETWEEN_KNOTS, amount: float = 1.5) -> CheckReport:
    return CheckReport(violations=[Violation(constraint, "LR", None, t, amount, "N") for t in times_s])


def test_the_interval_before_is_slowed_at_a_knot_and_its_own_in_the_middle() -> None:
    contacts: list[list[int | None]] = [[0, 1, 2, k] for k in range(5)]
    speed = np.full(5, 0.02)
    before = slowed({}, report(4.0), contacts, speed, 2.0)
    assert before is not None
    assert list(before) == [(0, 1, 2, 1)]
    assert before[0, 1, 2, 1] == pytest.approx(0.004)
    both = slowed({}, report(4.5), contacts, speed, 2.0)
    assert both is not None
    assert set(both) == {(0, 1, 2, 1), (0, 1, 2, 2)}
    assert speeds(both, contacts, 0.02) == pytest.approx([0.02, 0.004, 0.004, 0.02, 0.02])


def test_other_violations_and_bodies_at_rest_are_not_mended_by_slowness() -> None:
    contacts: list[list[int | None]] = [[0, 1, 2, 3]] * 5
    assert slowed({}, report(4.0, constraint="clearance"), contacts, np.full(5, 0.02), 2.0) is None
    assert slowed({}, report(4.0), contacts, np.zeros(5), 2.0) is None


def test_a_body_on_a_gripper_that_carries_no_shear_moves_slowly(robot: Robot) -> None:
    wall = two_rows(slope_deg=60.0, all_limbs=False)
    slippery = wall["holds"][2]
    slippery["friction"] = dict.fromkeys(("+x", "-x"), 0.0) | {"+y": 1.8, "-y": 1.8, "top": 1.8}
    slippery["spines"] = {"+x": False, "-x": False}
    wall["goal"] = {"body": {"position_m": [0.07, 0.0, 0.185]}}
    result = crux_planner.plan(scenario(wall), robot)
    assert result.check.ok
    positions = np.array([knot.body_position_w_m for knot in result.plan.knots])
    assert np.abs(np.diff(positions, axis=0)).max() < 0.01
