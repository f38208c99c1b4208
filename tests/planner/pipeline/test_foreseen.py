"""Joints beyond their limits between knots, against the check."""

from __future__ import annotations

import copy

import numpy as np
import pytest
from crux_contracts.interpolation import PlanReference
from crux_contracts.robot import Robot
from crux_contracts.scenario import load_scenario
from crux_planner import plan
from crux_planner.checker import check_plan
from crux_planner.pipeline.foreseen import beyond_limits
from crux_planner.reach.arm import reaches_of
from crux_tools.paths import SCENARIOS


def test_the_check_finds_the_same_joints_as_far_beyond(robot: Robot) -> None:
    """Of a plan whose body is turned at one knot."""
    right = plan(load_scenario(SCENARIOS / "climb-one-step.yaml"), robot).plan
    reaches, random, compared = reaches_of(robot), np.random.default_rng(3), 0
    assert not beyond_limits(PlanReference(right), reaches)
    for _ in range(6):
        bent = copy.deepcopy(right)
        bent.knots[3].body_rpy_rad = (np.array(right.knots[3].body_rpy_rad) + random.normal(size=3) * 0.3).tolist()
        found = {(each.limb, each.joint): each.amount for each in beyond_limits(PlanReference(bent), reaches)}
        wanted = [each for each in check_plan(bent, robot).violations if each.constraint == "joint_position"]
        assert {(each.limb, each.joint) for each in wanted} == set(found)
        for each in wanted:
            assert found[each.limb, each.joint] == pytest.approx(each.amount, rel=0.1)
            compared += 1
    assert compared > 2
