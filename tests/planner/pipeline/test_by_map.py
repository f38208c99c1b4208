"""Plans with all of what the limbs reach, on walls that no convex piece of it climbs."""

from __future__ import annotations

import numpy as np
import pytest
from crux_contracts.robot import Robot
from crux_contracts.scenario import parse_scenario
from crux_planner.model.build import build_problem
from crux_planner.model.kinematics import rotation_from_rpy
from crux_simulation.benchmarks.random_fields import random_field
from shared_plans import unproven


@pytest.mark.parametrize("seed", [407, *(pytest.param(seed, marks=pytest.mark.sweep) for seed in (403, 411))])
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
