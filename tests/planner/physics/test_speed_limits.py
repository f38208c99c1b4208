"""Bodies slow enough that what they do between the knots stays within the limit surface."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from crux_contracts.robot import Robot
from crux_planner.checker import CheckReport, Violation
from crux_planner.model.build import build_problem
from crux_planner.physics.speed_limits import speeds, steady_speed
from crux_planner.pipeline.refusals import BETWEEN_KNOTS, slowed
from shared_plans import unproven
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


def test_how_slow_is_foreseen_from_the_least_forces_that_make_up_for_the_way(robot: Robot) -> None:
    problem = build_problem(scenario(slippery_wall()), robot)
    contacts, start = problem.contacts, problem.start_contacts
    held = (None, *start[1:])
    speed = steady_speed(contacts, problem.weight_N, problem.dt_s, held)
    way = speed * problem.dt_s
    grips = [contacts[c] for c in start[1:]]
    places = np.stack([g.centre_h_m for g in grips])
    axis, most = grips[1].axis, 0.0  # of LR
    for turn in np.linspace(0.0, np.pi, 181):
        for lift in np.linspace(-np.pi / 2, np.pi / 2, 91):
            ahead = way * np.array([np.cos(turn) * np.cos(lift), np.sin(turn) * np.cos(lift), np.sin(lift)])
            grasp = np.vstack(
                [np.hstack([np.eye(3)] * 3), np.hstack([np.cross(np.eye(3), -p).T for p in places])]
            )  # forces of the three grips -> their sum and moment
            lacking = np.concatenate([np.zeros(3), np.cross(problem.weight_N, ahead)])
            forces, *_ = np.linalg.lstsq(grasp, lacking, rcond=None)
            force = forces.reshape(3, 3)[1]
            most = max(most, float(np.linalg.norm(force - axis * (axis @ force))) / 2)
    assert most == pytest.approx(0.3, rel=2e-3)
    assert steady_speed(contacts, problem.weight_N, problem.dt_s, (*start[:2], None, start[3])) == np.inf


def test_a_body_on_a_gripper_that_carries_no_shear_moves_slowly(robot: Robot) -> None:
    result = unproven(scenario(slippery_wall()), robot)
    assert result.check.ok
    positions = np.array([knot.body_position_w_m for knot in result.plan.knots])
    assert np.abs(np.diff(positions, axis=0)).max() < 0.01
