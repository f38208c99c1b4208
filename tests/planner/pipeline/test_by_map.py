"""Plans with all of what the limbs reach, on walls that no convex piece of it climbs."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from crux_contracts.robot import Robot
from crux_contracts.scenario import parse_scenario
from crux_planner.checker import CheckReport, Violation
from crux_planner.model.build import build_problem
from crux_planner.model.kinematics import rotation_from_rpy
from crux_planner.model.problem import BODY_STATES
from crux_planner.pipeline.by_map import _answered
from crux_planner.trajectory.joint_rows import JointLimits
from crux_simulation.benchmarks.random_fields import random_field
from shared_plans import unproven


def test_what_the_check_finds_is_answered_at_its_knots_and_joint() -> None:
    limits = JointLimits.about(np.zeros((8, BODY_STATES)), 0.02)
    said = [
        Violation("joint_position", "RF", None, 3.0, 0.1, "rad", "any name", joint=4),
        Violation("inverse_kinematics", "LR", None, 9.0, 0.001, "m"),
        Violation("clearance_limbs", "LF", None, 5.0, 0.002, "m"),
        Violation("joint_torque_shared", "LF", None, 5.0, 0.4, "N m", joint=1),
    ]
    answer, others = _answered(limits, CheckReport(violations=said), dt_s=2.0)
    assert others == said[3:]
    more = np.argwhere(answer.margin_rad > limits.margin_rad).tolist()
    assert more == [[1, 1, 4], [2, 1, 4], [4, 2, 2], [5, 2, 2]]
    assert (answer.margin_rad[1:3, 1, 4] > 0.12).all()
    assert np.flatnonzero(answer.apart_m > limits.apart_m + 0.002).tolist() == [2, 3]
    assert np.isinf(answer.near_m).all()
    again, _ = _answered(replace(answer, apart_m=answer.apart_m + 0.01), CheckReport(violations=said), dt_s=2.0)
    assert np.isfinite(again.near_m).any()


@pytest.mark.parametrize("seed", [407, *(pytest.param(seed, marks=pytest.mark.sweep) for seed in (403, 411, 418))])
def test_a_field_is_climbed_with_grips_beyond_the_convex_reach(robot: Robot, seed: int) -> None:
    field = parse_scenario(random_field(seed))
    result = unproven(field, robot, time_limit_s=60.0)
    assert result.check.ok
    inner, beyond = build_problem(field, robot).limb_reach.inner, []
    for knot in result.plan.knots:
        turn = rotation_from_rpy(np.array(knot.body_rpy_rad))
        for limb, each in enumerate(knot.limbs):
            place = turn.T @ (np.array(each.gripper_position_w_m) - knot.body_position_w_m)
            beyond.append(float(inner.beyond(limb, place).max()))
    assert max(beyond) > 0.01
