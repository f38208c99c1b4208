"""A climb in the least time, planned and planned again; the fingers' and body's bounds are in checker/test_pace.py."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from crux_contracts.plan_file import read_plan
from crux_contracts.robot import Robot
from crux_contracts.scenario import load_scenario, parse_scenario
from crux_msgs import plan_t
from crux_planner.checker import CheckReport, check_plan
from crux_planner.checker.report import Violation
from crux_planner.pipeline.pace import _lengthen, _squeeze
from crux_planner.pipeline.replan import Planner
from crux_tools.cli import main

ONE_STEP = Path(__file__).parents[3] / "msgs" / "scenarios" / "climb-one-step.yaml"


def test_a_climb_is_planned_and_planned_again_in_the_least_time(
    robot: Robot, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    output = tmp_path / "plan.mcap"
    assert main(["plan", str(ONE_STEP), "--objective", "time", "-o", str(output), "--json"]) == 0
    result, timed = json.loads(capsys.readouterr().out), read_plan(output)
    asked, scenario = load_scenario(ONE_STEP), parse_scenario(timed.scenario_yaml)
    assert replace(scenario.planner, objective="paper") == asked.planner
    assert timed.format == plan_t.FORMAT_MOVING_FINGERS
    assert timed.knots[-1].time_s < 0.4 * asked.horizon.dt_s * result["steps"]
    assert result["gap"] is None
    again = Planner(scenario, robot).replan(timed, 0.01)
    assert again.plan.format == plan_t.FORMAT_MOVING_FINGERS
    assert check_plan(again.plan, robot).ok
    assert again.plan.knots[-1].time_s < timed.knots[-1].time_s + 1.0


def test_what_no_time_changes_is_answered_by_even_intervals_and_the_rest_by_longer_ones() -> None:
    def lengthened(constraint: str) -> list[float]:
        step_s = np.array([0.2, 0.4, 1.0, 0.3, 0.2])
        found = Violation(constraint, "LF", None, 0.5, 0.01, "rad")  # in the second interval
        assert _lengthen(step_s, CheckReport(violations=[found]), [[0, 1, 2]])
        return [float(v) for v in step_s]

    assert lengthened("joint_position") == [1.0, 1.0, 1.0, 0.3, 0.2]
    assert lengthened("joint_speed") == pytest.approx([0.24, 0.48, 1.2, 0.3, 0.2])


def test_fingers_beyond_their_limit_surface_squeeze_by_what_lacks() -> None:
    lacks = Violation("limit_surface_uncertain", "RF", 2, 0.5, 0.3, "N")
    squeeze_N, friction = np.zeros((5, 4)), np.full((6, 4), 1.5)
    assert _squeeze(squeeze_N, CheckReport(violations=[lacks]), [[0, 1, 2]], friction)
    assert squeeze_N[:, 1] == pytest.approx([0.2, 0.2, 0.2, 0.0, 0.0])
    assert np.abs(squeeze_N[:, [0, 2, 3]]).max() == 0.0
    other = Violation("joint_speed", "RF", None, 0.5, 0.3, "rad/s")
    assert not _squeeze(squeeze_N, CheckReport(violations=[other]), [[0, 1, 2]], friction)


def test_the_objective_of_a_walk_is_left_out_aloud(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    walk = ONE_STEP.with_name("walk-flat.yaml")
    words = ["plan", str(walk), "--objective", "balanced", "--time-limit", "0.01", "-o", str(tmp_path / "plan.mcap")]
    assert main(words) == 1  # out of time at once
    assert "--objective is left out" in capsys.readouterr().err
