"""Bodies slow enough for the limit surface between the knots, and grasps that bear nothing."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from crux_contracts.robot import Robot
from crux_contracts.scenario import ScenarioError
from crux_planner.checker import CheckReport, Violation
from crux_planner.model.build import build_problem
from crux_planner.physics.speed_limits import speeds
from crux_planner.pipeline.refusals import BETWEEN_KNOTS, slowed
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


def test_every_cut_counts_however_little_is_missing() -> None:
    contacts: list[list[int | None]] = [[0, 1, 2, 3]] * 5
    cut = slowed({}, report(4.0, amount=0.01), contacts, np.full(5, 0.02), 2.0)
    assert cut is not None
    assert cut[0, 1, 2, 3] <= 0.8 * 0.02 + 1e-12


def test_other_violations_and_bodies_at_rest_are_not_mended_by_slowness() -> None:
    contacts: list[list[int | None]] = [[0, 1, 2, 3]] * 5
    assert slowed({}, report(4.0, constraint="clearance"), contacts, np.full(5, 0.02), 2.0) is None
    assert slowed({}, report(4.0), contacts, np.zeros(5), 2.0) is None


def slippery_wall() -> dict[str, Any]:
    """LR starts on faces that carry nothing but what presses on them."""
    wall = two_rows(slope_deg=60.0, all_limbs=False)
    slippery = wall["holds"][2]
    slippery["friction"] = dict.fromkeys(("+x", "-x"), 0.0) | {"+y": 1.8, "-y": 1.8, "top": 1.8}
    slippery["spines"] = {"+x": False, "-x": False}
    wall["goal"] = {"body": {"position_m": [0.07, 0.0, 0.185]}}
    return wall


@pytest.mark.parametrize("spines", [False, True])
@pytest.mark.parametrize("face", ["+x", "-x"])
def test_a_start_that_no_robot_can_hold_is_refused(robot: Robot, face: str, spines: bool) -> None:
    """The runtime takes no grasp without friction (plan_validation.cpp), whatever the spines bear."""
    wall = slippery_wall()
    wall["holds"][2]["spines"] = {face: spines}
    wall["holds"][2]["friction"] = dict.fromkeys(("+x", "-x", "+y", "-y", "top"), 1.8) | {face: 0.0}
    refusal = rf"start\.grasps\.LR: \S+, faces x: face \{face[0]}x has friction 0, both faces of a grasp need more"
    with pytest.raises(ScenarioError, match=refusal):
        build_problem(scenario(wall), robot)


def test_nobody_goes_to_faces_that_carry_nothing(robot: Robot) -> None:
    wall = slippery_wall()
    wall["start"]["grasps"]["LR"]["faces"] = "y"
    problem = build_problem(scenario(wall), robot)
    assert {c.pair for c in problem.contacts if c.hold == 2} == {1}
